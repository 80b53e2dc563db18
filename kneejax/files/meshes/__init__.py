"""From triangles to contact: health, anatomy, region, fit, layer."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.meshes._bands import MeshBand as MeshBand
    from kneejax.files.meshes._bands import band_of_meshes as band_of_meshes
    from kneejax.files.meshes._import import MeshImport as MeshImport
    from kneejax.files.meshes._import import MeshOptions as MeshOptions
    from kneejax.files.meshes._import import import_meshes as import_meshes
    from kneejax.files.meshes._points import MESH_ENDINGS as MESH_ENDINGS
    from kneejax.files.meshes._points import MeshPoints as MeshPoints
    from kneejax.files.meshes._points import bone_surface as bone_surface
    from kneejax.files.meshes._points import read_mesh_points as read_mesh_points
    from kneejax.files.meshes._surfaces import SheetFit as SheetFit
else:
    lazy_imports(globals())
