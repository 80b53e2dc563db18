"""Poses against a measurement: residuals, bounded searches, one fit and many."""

from kneejax.inference.fit._bounded import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
from kneejax.inference.fit._bounded import compile_step as compile_step
from kneejax.inference.fit._lbfgsb import minimise_bounded as minimise_bounded
from kneejax.inference.fit._many_fits import PATIENT as PATIENT
from kneejax.inference.fit._many_fits import Balance as Balance
from kneejax.inference.fit._many_fits import ManyFits as ManyFits
from kneejax.inference.fit._many_fits import MotionData as MotionData
from kneejax.inference.fit._many_fits import add_offsets as add_offsets
from kneejax.inference.fit._many_fits import balances_of as balances_of
from kneejax.inference.fit._many_fits import best_offsets as best_offsets
from kneejax.inference.fit._many_fits import fit_lanes as fit_lanes
from kneejax.inference.fit._many_fits import fit_many as fit_many
from kneejax.inference.fit._many_fits import with_offsets as with_offsets
from kneejax.inference.fit._problem import DEFAULT_WEIGHTS as DEFAULT_WEIGHTS
from kneejax.inference.fit._problem import TABLE_UNITS as TABLE_UNITS
from kneejax.inference.fit._problem import Evaluation as Evaluation
from kneejax.inference.fit._problem import Problem as Problem
from kneejax.inference.fit._problem import slopes_of as slopes_of
from kneejax.inference.fit._synthetic import synthetic_motion as synthetic_motion
