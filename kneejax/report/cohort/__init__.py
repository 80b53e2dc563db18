"""A cohort as an answer, with its figure."""

from kneejax.report.cohort._answer import COHORT_COLUMNS as COHORT_COLUMNS
from kneejax.report.cohort._answer import cohort_answer as cohort_answer
from kneejax.report.cohort._figures import forest_figure as forest_figure
