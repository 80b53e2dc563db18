"""A differentiable knee: balance, exact derivatives, and ligaments identified from motion.

Everything is computed in float64. The command line switches it on; in Python, call
`kneejax.configure()` first (or `jax.config.update("jax_enable_x64", True)`); every solve says so if
nobody did.
"""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

__version__ = "0.2.0"

if TYPE_CHECKING:
    from kneejax import cohorts as cohorts
    from kneejax import dynamics as dynamics
    from kneejax import experiments as experiments
    from kneejax import explorer as explorer
    from kneejax import files as files
    from kneejax import geometry as geometry
    from kneejax import inference as inference
    from kneejax import joints as joints
    from kneejax import mechanics as mechanics
    from kneejax import numerics as numerics
    from kneejax import papers as papers
    from kneejax import parameters as parameters
    from kneejax import report as report
    from kneejax import statics as statics
    from kneejax import studies as studies
    from kneejax.dynamics import LoadCurve as LoadCurve
    from kneejax.dynamics import MovingKnee as MovingKnee
    from kneejax.dynamics import Trajectory as Trajectory
    from kneejax.dynamics import move as move
    from kneejax.experiments import Curves as Curves
    from kneejax.experiments import LabTest as LabTest
    from kneejax.experiments import Laxity as Laxity
    from kneejax.experiments import MeasuredTest as MeasuredTest
    from kneejax.experiments import Mechanics as Mechanics
    from kneejax.experiments import Motion as Motion
    from kneejax.experiments import Shank as Shank
    from kneejax.experiments import branches as branches
    from kneejax.experiments import evaluate as evaluate
    from kneejax.experiments import isometric_extension as isometric_extension
    from kneejax.experiments import lab_tests as lab_tests
    from kneejax.experiments import laxity as laxity
    from kneejax.experiments import leg_raise as leg_raise
    from kneejax.experiments import load_curves as load_curves
    from kneejax.experiments import load_cycle as load_cycle
    from kneejax.experiments import passive_flexion as passive_flexion
    from kneejax.experiments import patellar_tracking as patellar_tracking
    from kneejax.explorer import explore as explore
    from kneejax.files import InputProblem as InputProblem
    from kneejax.files import load_knee as load_knee
    from kneejax.files import load_knee_file as load_knee_file
    from kneejax.files import read_joint as read_joint
    from kneejax.files import read_poses as read_poses
    from kneejax.geometry import Pose as Pose
    from kneejax.geometry import State as State
    from kneejax.inference import Calibration as Calibration
    from kneejax.inference import Stage as Stage
    from kneejax.inference import design_tests as design_tests
    from kneejax.inference import local_sensitivity as local_sensitivity
    from kneejax.inference import sweep as sweep
    from kneejax.joints import Joint as Joint
    from kneejax.joints import fit_joints as fit_joints
    from kneejax.joints import generalised_axis as generalised_axis
    from kneejax.joints import hinge as hinge
    from kneejax.joints import moving_axis as moving_axis
    from kneejax.mechanics import Knee as Knee
    from kneejax.mechanics import Load as Load
    from kneejax.mechanics import Mass as Mass
    from kneejax.mechanics import load_of as load_of
    from kneejax.numerics import configure as configure
    from kneejax.numerics import use_shared_fusion as use_shared_fusion
    from kneejax.parameters import cut as cut
    from kneejax.parameters import select as select
    from kneejax.report import write_report as write_report
    from kneejax.statics import Status as Status
    from kneejax.studies import Identify as Identify
    from kneejax.studies import Map as Map
    from kneejax.studies import Sensitivity as Sensitivity
    from kneejax.studies import Study as Study
    from kneejax.studies import Synthetic as Synthetic
    from kneejax.studies import calibrate as calibrate
    from kneejax.studies import identify as identify
    from kneejax.studies import read_study as read_study
    from kneejax.studies import sensitivity as sensitivity
    from kneejax.studies import sensitivity_map as sensitivity_map
else:
    lazy_imports(globals())
