"""Poses against a measurement: residuals, bounded searches, the one fit in lanes."""

from kneejax.inference.fit._bounded import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
from kneejax.inference.fit._cut import balances_of as balances_of
from kneejax.inference.fit._cut import slack_at as slack_at
from kneejax.inference.fit._cut import state_of as state_of
from kneejax.inference.fit._cut import without as without
from kneejax.inference.fit._lbfgsb import minimise_bounded as minimise_bounded
from kneejax.inference.fit._load_cases import DEFAULT_WEIGHTS as DEFAULT_WEIGHTS
from kneejax.inference.fit._load_cases import TABLE_UNITS as TABLE_UNITS
from kneejax.inference.fit._load_cases import Balance as Balance
from kneejax.inference.fit._load_cases import LoadCases as LoadCases
from kneejax.inference.fit._load_cases import best_offsets as best_offsets
from kneejax.inference.fit._load_cases import table_of as table_of
from kneejax.inference.fit._load_cases import without_offsets as without_offsets
from kneejax.inference.fit._many_fits import PATIENT as PATIENT
from kneejax.inference.fit._many_fits import ManyFits as ManyFits
from kneejax.inference.fit._many_fits import compile_step as compile_step
from kneejax.inference.fit._many_fits import fit_lanes as fit_lanes
from kneejax.inference.fit._observations import observations as observations
from kneejax.inference.fit._problem import Problem as Problem
from kneejax.inference.fit._problem import Progress as Progress
from kneejax.inference.fit._problem import check_finite as check_finite
from kneejax.inference.fit._problem import offset_units as offset_units
from kneejax.inference.fit._readings import check_readable as check_readable
from kneejax.inference.fit._several_knees import SeveralKnees as SeveralKnees
from kneejax.inference.fit._several_knees import form_of as form_of
from kneejax.inference.fit._synthetic import synthetic_motion as synthetic_motion
