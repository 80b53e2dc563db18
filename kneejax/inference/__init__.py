"""Parameters from measurements, with what the measurements can and cannot tell."""

from kneejax.inference._bounded import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
from kneejax.inference._bounded import compile_step as compile_step
from kneejax.inference._calibrate import calibrate as calibrate
from kneejax.inference._calibrate import versions as versions
from kneejax.inference._parameters import QUANTITIES as QUANTITIES
from kneejax.inference._parameters import Selection as Selection
from kneejax.inference._parameters import UnknownParameter as UnknownParameter
from kneejax.inference._parameters import UnsuitableData as UnsuitableData
from kneejax.inference._parameters import select as select
from kneejax.inference._parameters import with_values as with_values
from kneejax.inference._physiological import PHYSIOLOGICAL_LIMITS as PHYSIOLOGICAL_LIMITS
from kneejax.inference._physiological import unphysiological as unphysiological
from kneejax.inference._problem import Problem as Problem
from kneejax.inference._problem import evaluate_poses as evaluate_poses
from kneejax.inference._result import Calibration as Calibration
from kneejax.inference._result import Estimate as Estimate
from kneejax.inference._result import Fit as Fit
from kneejax.inference._result import Iteration as Iteration
from kneejax.inference._result import Motion as Motion
from kneejax.inference._scales import percent_scales as percent_scales
from kneejax.inference._scales import prior_scales as prior_scales
from kneejax.inference._search import PROCEDURES as PROCEDURES
from kneejax.inference._search import run_procedure as run_procedure
from kneejax.inference._synthetic import synthetic_motion as synthetic_motion
from kneejax.inference._uncertainty import uncertainty as uncertainty
