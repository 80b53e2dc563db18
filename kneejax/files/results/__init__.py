"""What earlier work left: a calibration, finished parts of a map, netCDF."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module, imported when one of its names is first asked for.
_MODULES = {
    "Calibrated": "kneejax.files.results._calibrated",
    "read_calibrated": "kneejax.files.results._calibrated",
    "CLAIM": "kneejax.files.results._checkpoints",
    "Checkpoints": "kneejax.files.results._checkpoints",
    "PARTS": "kneejax.files.results._checkpoints",
    "parts_of": "kneejax.files.results._checkpoints",
    "write_netcdf": "kneejax.files.results._netcdf",
}

if TYPE_CHECKING:
    from kneejax.files.results._calibrated import Calibrated as Calibrated
    from kneejax.files.results._calibrated import read_calibrated as read_calibrated
    from kneejax.files.results._checkpoints import CLAIM as CLAIM
    from kneejax.files.results._checkpoints import PARTS as PARTS
    from kneejax.files.results._checkpoints import Checkpoints as Checkpoints
    from kneejax.files.results._checkpoints import parts_of as parts_of
    from kneejax.files.results._netcdf import write_netcdf as write_netcdf
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
