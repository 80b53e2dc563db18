"""A calibration in text, JSON, figures and HTML, with its verdict."""

from kneejax.report.calibration._estimates import remark as remark
from kneejax.report.calibration._figures import convergence_figure as convergence_figure
from kneejax.report.calibration._figures import correlation_figure as correlation_figure
from kneejax.report.calibration._figures import (
    correlation_matrix_figure as correlation_matrix_figure,
)
from kneejax.report.calibration._figures import parameters_figure as parameters_figure
from kneejax.report.calibration._html import report_page as report_page
from kneejax.report.calibration._html import write_report as write_report
from kneejax.report.calibration._notes import calibration_notes as calibration_notes
from kneejax.report.calibration._results import PARAMETER_COLUMNS as PARAMETER_COLUMNS
from kneejax.report.calibration._results import parameters_rows as parameters_rows
from kneejax.report.calibration._results import result_document as result_document
from kneejax.report.calibration._tests import reading_table as reading_table
from kneejax.report.calibration._tests import tests_figure as tests_figure
from kneejax.report.calibration._text import calibration_summary as calibration_summary
from kneejax.report.calibration._verdict import Outcome as Outcome
from kneejax.report.calibration._verdict import message as message
from kneejax.report.calibration._verdict import outcome as outcome
from kneejax.report.calibration._verdict import verdict as verdict
from kneejax.report.calibration._verdict import warnings as warnings
