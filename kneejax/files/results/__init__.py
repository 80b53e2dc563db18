"""What earlier work left: a calibration, finished parts of a map, netCDF."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.files.results._calibrated import Calibrated as Calibrated
    from kneejax.files.results._calibrated import read_calibrated as read_calibrated
    from kneejax.files.results._checkpoints import CLAIM as CLAIM
    from kneejax.files.results._checkpoints import PARTS as PARTS
    from kneejax.files.results._checkpoints import Checkpoints as Checkpoints
    from kneejax.files.results._checkpoints import parts_of as parts_of
    from kneejax.files.results._checkpoints import write_netcdf as write_netcdf
else:
    lazy_imports(globals())
