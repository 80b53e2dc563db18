"""OpenSim models: read in stages, written back as changed numbers."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.opensim._contact import OsimGeometry as OsimGeometry
    from kneejax.files.opensim._contact import add_osim_contacts as add_osim_contacts
    from kneejax.files.opensim._coupled import CoupledMotion as CoupledMotion
    from kneejax.files.opensim._coupled import couple_model as couple_model
    from kneejax.files.opensim._coupled import coupled_motion as coupled_motion
    from kneejax.files.opensim._coupled import transform_axes as transform_axes
    from kneejax.files.opensim._export import OsimExport as OsimExport
    from kneejax.files.opensim._export import export_osim as export_osim
    from kneejax.files.opensim._frames import Registration as Registration
    from kneejax.files.opensim._frames import registered as registered
    from kneejax.files.opensim._import import OsimImport as OsimImport
    from kneejax.files.opensim._import import import_osim as import_osim
    from kneejax.files.opensim._model import SMALLEST_MODEL as SMALLEST_MODEL
    from kneejax.files.opensim._model import simm_splines as simm_splines
    from kneejax.files.opensim._record import read_activity as read_activity
    from kneejax.files.opensim._report import format_import_report as format_import_report
    from kneejax.files.opensim._report import import_sections as import_sections
    from kneejax.files.opensim._whole_body import WholeBody as WholeBody
    from kneejax.files.opensim._whole_body import WholeBodyForces as WholeBodyForces
    from kneejax.files.opensim._whole_body import ask_opensim as ask_opensim
    from kneejax.files.opensim._whole_body import whole_body as whole_body
else:
    lazy_imports(globals())
