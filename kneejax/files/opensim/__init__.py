"""OpenSim models: read in stages, written back as changed numbers."""

from kneejax.files.opensim._example import SMALLEST_MODEL as SMALLEST_MODEL
from kneejax.files.opensim._export import OsimExport as OsimExport
from kneejax.files.opensim._export import export_osim as export_osim
from kneejax.files.opensim._functions import simm_splines as simm_splines
from kneejax.files.opensim._geometry import OsimGeometry as OsimGeometry
from kneejax.files.opensim._geometry import add_osim_contacts as add_osim_contacts
from kneejax.files.opensim._import import OsimImport as OsimImport
from kneejax.files.opensim._import import import_osim as import_osim
from kneejax.files.opensim._report import format_import_report as format_import_report
