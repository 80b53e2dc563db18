"""What earlier work left: a calibration, finished parts of a map, netCDF."""

from kneejax.files.results._calibrated import Calibrated as Calibrated
from kneejax.files.results._calibrated import read_calibrated as read_calibrated
from kneejax.files.results._checkpoints import Checkpoints as Checkpoints
from kneejax.files.results._netcdf import write_netcdf as write_netcdf
