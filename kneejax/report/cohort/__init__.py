"""A cohort in text, figures and a page."""

from kneejax.report.cohort._figures import forest_figure as forest_figure
from kneejax.report.cohort._html import cohort_page as cohort_page
from kneejax.report.cohort._html import write_cohort_report as write_cohort_report
from kneejax.report.cohort._rows import COHORT_COLUMNS as COHORT_COLUMNS
from kneejax.report.cohort._rows import cohort_rows as cohort_rows
from kneejax.report.cohort._text import cohort_exit_status as cohort_exit_status
from kneejax.report.cohort._text import cohort_text as cohort_text
