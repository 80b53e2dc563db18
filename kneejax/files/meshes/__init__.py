"""From triangles to contact: health, anatomy, region, fit, layer."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.meshes.points import MESH_ENDINGS as MESH_ENDINGS
else:
    lazy_imports(globals())
