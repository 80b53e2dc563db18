"""From triangles to contact: health, anatomy, region, fit, layer."""
