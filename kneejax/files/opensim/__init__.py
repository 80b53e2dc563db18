"""OpenSim models: read in stages, written back as changed numbers."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module, imported when one of its names is first asked for.
_MODULES = {
    "read_activity": "kneejax.files.opensim._activity",
    "CoupledMotion": "kneejax.files.opensim._coupled_motion",
    "coupled_motion": "kneejax.files.opensim._coupled_motion",
    "Registration": "kneejax.files.opensim._registration",
    "registered": "kneejax.files.opensim._registration",
    "couple_model": "kneejax.files.opensim._coupled_joint",
    "WholeBody": "kneejax.files.opensim._whole_body",
    "WholeBodyForces": "kneejax.files.opensim._whole_body",
    "whole_body": "kneejax.files.opensim._whole_body",
    "ask_opensim": "kneejax.files.opensim._whole_body",
    "FRAMES": "kneejax.files.opensim._registration",
    "SMALLEST_MODEL": "kneejax.files.opensim._example",
    "OsimExport": "kneejax.files.opensim._export",
    "export_osim": "kneejax.files.opensim._export",
    "simm_splines": "kneejax.files.opensim._functions",
    "transform_axes": "kneejax.files.opensim._spatial_transform",
    "OsimGeometry": "kneejax.files.opensim._geometry",
    "add_osim_contacts": "kneejax.files.opensim._geometry",
    "OsimImport": "kneejax.files.opensim._import",
    "import_osim": "kneejax.files.opensim._import",
    "format_import_report": "kneejax.files.opensim._report",
    "import_sections": "kneejax.files.opensim._report",
}

if TYPE_CHECKING:
    from kneejax.files.opensim._activity import read_activity as read_activity
    from kneejax.files.opensim._coupled_joint import couple_model as couple_model
    from kneejax.files.opensim._coupled_motion import CoupledMotion as CoupledMotion
    from kneejax.files.opensim._coupled_motion import coupled_motion as coupled_motion
    from kneejax.files.opensim._example import SMALLEST_MODEL as SMALLEST_MODEL
    from kneejax.files.opensim._export import OsimExport as OsimExport
    from kneejax.files.opensim._export import export_osim as export_osim
    from kneejax.files.opensim._functions import simm_splines as simm_splines
    from kneejax.files.opensim._geometry import OsimGeometry as OsimGeometry
    from kneejax.files.opensim._geometry import add_osim_contacts as add_osim_contacts
    from kneejax.files.opensim._import import OsimImport as OsimImport
    from kneejax.files.opensim._import import import_osim as import_osim
    from kneejax.files.opensim._registration import FRAMES as FRAMES
    from kneejax.files.opensim._registration import Registration as Registration
    from kneejax.files.opensim._registration import registered as registered
    from kneejax.files.opensim._report import format_import_report as format_import_report
    from kneejax.files.opensim._report import import_sections as import_sections
    from kneejax.files.opensim._spatial_transform import transform_axes as transform_axes
    from kneejax.files.opensim._whole_body import WholeBody as WholeBody
    from kneejax.files.opensim._whole_body import WholeBodyForces as WholeBodyForces
    from kneejax.files.opensim._whole_body import ask_opensim as ask_opensim
    from kneejax.files.opensim._whole_body import whole_body as whole_body
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
