"""The procedures of a calibration, its search and its answers."""

from kneejax.inference.calibration._answer import motion_of as motion_of
from kneejax.inference.calibration._question import METHODS as METHODS
from kneejax.inference.calibration._question import PROCEDURES as PROCEDURES
from kneejax.inference.calibration._question import USUAL_PROCEDURES as USUAL_PROCEDURES
from kneejax.inference.calibration._question import CalibrationProblem as CalibrationProblem
from kneejax.inference.calibration._question import Stage as Stage
from kneejax.inference.calibration._result import Calibration as Calibration
from kneejax.inference.calibration._result import Ending as Ending
from kneejax.inference.calibration._result import Estimate as Estimate
from kneejax.inference.calibration._result import Fault as Fault
from kneejax.inference.calibration._result import Fit as Fit
from kneejax.inference.calibration._result import FittedTest as FittedTest
from kneejax.inference.calibration._result import Iteration as Iteration
from kneejax.inference.calibration._result import Misfit as Misfit
from kneejax.inference.calibration._result import Motion as Motion
from kneejax.inference.calibration._result import versions as versions
from kneejax.inference.calibration._search import run_procedure as run_procedure
from kneejax.inference.calibration._side_by_side import calibrate as calibrate
from kneejax.inference.calibration._side_by_side import (
    calibrate_side_by_side as calibrate_side_by_side,
)
