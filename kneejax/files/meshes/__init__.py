"""From triangles to contact: health, anatomy, region, fit, layer."""

from kneejax.files.meshes._choices import THICKNESSES as THICKNESSES
from kneejax.files.meshes._import import MeshImport as MeshImport
from kneejax.files.meshes._import import import_meshes as import_meshes
from kneejax.files.meshes._points import MESH_ENDINGS as MESH_ENDINGS
from kneejax.files.meshes._points import MESH_UNITS as MESH_UNITS
from kneejax.files.meshes._points import MeshPoints as MeshPoints
from kneejax.files.meshes._points import read_mesh_points as read_mesh_points
from kneejax.files.meshes._region import SheetFit as SheetFit
