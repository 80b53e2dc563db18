"""OpenSim models: read in stages, written back as changed numbers."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.opensim.coupled import transform_axes as transform_axes
    from kneejax.files.opensim.model import simm_spline as simm_spline
    from kneejax.files.opensim.report import import_sections as import_sections
else:
    lazy_imports(globals())
