"""Poses against a measurement: residuals, bounded searches, the one fit in lanes."""

from kneejax.inference.fit._bounded import PATIENT as PATIENT
from kneejax.inference.fit._bounded import BoundedLevenbergMarquardt as BoundedLevenbergMarquardt
from kneejax.inference.fit._bounded import ManyFits as ManyFits
from kneejax.inference.fit._bounded import fit_lanes as fit_lanes
from kneejax.inference.fit._cut import balances_of as balances_of
from kneejax.inference.fit._cut import distinct as distinct
from kneejax.inference.fit._cut import passed as passed
from kneejax.inference.fit._cut import slack_at as slack_at
from kneejax.inference.fit._cut import without as without
from kneejax.inference.fit._observations import check_readable as check_readable
from kneejax.inference.fit._observations import observations as observations
from kneejax.inference.fit._observations import rows_of_tests as rows_of_tests
from kneejax.inference.fit._observations import synthetic_motion as synthetic_motion
from kneejax.inference.fit._observed import DEFAULT_WEIGHTS as DEFAULT_WEIGHTS
from kneejax.inference.fit._observed import TABLE_UNITS as TABLE_UNITS
from kneejax.inference.fit._observed import Balance as Balance
from kneejax.inference.fit._observed import Noise as Noise
from kneejax.inference.fit._observed import Observations as Observations
from kneejax.inference.fit._observed import on_bounds as on_bounds
from kneejax.inference.fit._observed import table_of as table_of
from kneejax.inference.fit._problem import Problem as Problem
from kneejax.inference.fit._problem import Progress as Progress
from kneejax.inference.fit._problem import best_offsets as best_offsets
from kneejax.inference.fit._problem import form_of as form_of
from kneejax.inference.fit._problem import named as named
from kneejax.inference.fit._problem import without_offsets as without_offsets
