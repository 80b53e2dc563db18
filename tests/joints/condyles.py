"""A made-up femur: two condyles of two arcs each, of radii that adults have."""

from __future__ import annotations

import numpy as np

#: Extension and flexion centres, medial and lateral, and their radii, mm.
CENTERS = np.array([[[5.0, 8.0, -21.0], [3.0, 8.5, 22.0]], [[0.0, 0.0, -21.0], [-1.0, 0.5, 23.0]]])
RADII = np.array([[30.0, 29.0], [22.0, 21.0]])
#: How much lower the condyle is away from its crest: across, it is round too.
ACROSS_MM = 60.0
#: From anterior through distal, degrees.
PARTS = ((60.0, 108.0), (112.0, 195.0))


def condyles(step_deg=1.0, step_mm=1.0, noise_mm=0.0, seed=0):
    """Points and outward normals of both condyles, `(n, 3)` each, mm."""
    rng = np.random.default_rng(seed)
    points, normals = [], []
    for i, (low, high) in enumerate(PARTS):
        for j in range(2):
            angle, along = np.meshgrid(
                np.deg2rad(np.arange(low, high, step_deg)), np.arange(-10.0, 10.0 + 1e-9, step_mm)
            )
            # From anterior through distal: forwards at 0, down at 90, backwards at 180.
            out = np.stack([np.cos(angle), -np.sin(angle), np.zeros_like(angle)], axis=-1)
            radius = RADII[i, j] - along**2 / ACROSS_MM + rng.normal(0, noise_mm, angle.shape)
            place = CENTERS[i, j] + radius[..., None] * out
            place[..., 2] += along
            tilted = out.copy()
            tilted[..., 2] = 2.0 * along / ACROSS_MM
            points.append(place.reshape(-1, 3))
            normals.append((tilted / np.linalg.norm(tilted, axis=-1, keepdims=True)).reshape(-1, 3))
    return np.concatenate(points), np.concatenate(normals)
