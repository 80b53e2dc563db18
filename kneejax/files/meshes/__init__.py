"""From triangles to contact: health, anatomy, region, fit, layer."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module, imported when one of its names is first asked for.
_MODULES = {
    "bone_surface": "kneejax.files.meshes._bone",
    "THICKNESSES": "kneejax.files.meshes._choices",
    "MeshImport": "kneejax.files.meshes._import",
    "import_meshes": "kneejax.files.meshes._import",
    "MESH_ENDINGS": "kneejax.files.meshes._points",
    "MESH_UNITS": "kneejax.files.meshes._points",
    "MeshPoints": "kneejax.files.meshes._points",
    "read_mesh_points": "kneejax.files.meshes._points",
    "SheetFit": "kneejax.files.meshes._region",
}

if TYPE_CHECKING:
    from kneejax.files.meshes._bone import bone_surface as bone_surface
    from kneejax.files.meshes._choices import THICKNESSES as THICKNESSES
    from kneejax.files.meshes._import import MeshImport as MeshImport
    from kneejax.files.meshes._import import import_meshes as import_meshes
    from kneejax.files.meshes._points import MESH_ENDINGS as MESH_ENDINGS
    from kneejax.files.meshes._points import MESH_UNITS as MESH_UNITS
    from kneejax.files.meshes._points import MeshPoints as MeshPoints
    from kneejax.files.meshes._points import read_mesh_points as read_mesh_points
    from kneejax.files.meshes._region import SheetFit as SheetFit
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
