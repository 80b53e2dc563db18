"""A calibration as an answer: its page and files, figures, verdict and what to doubt."""

from kneejax.report.calibration._answer import calibration_answer as calibration_answer
from kneejax.report.calibration._answer import calibration_summary as calibration_summary
from kneejax.report.calibration._answer import result_document as result_document
from kneejax.report.calibration._answer import write_report as write_report
from kneejax.report.calibration._estimates import PARAMETER_COLUMNS as PARAMETER_COLUMNS
from kneejax.report.calibration._estimates import limits as limits
from kneejax.report.calibration._estimates import parameters_table as parameters_table
from kneejax.report.calibration._estimates import remark as remark
from kneejax.report.calibration._figures import convergence_figure as convergence_figure
from kneejax.report.calibration._figures import (
    correlation_matrix_figure as correlation_matrix_figure,
)
from kneejax.report.calibration._figures import parameters_figure as parameters_figure
from kneejax.report.calibration._tests import reading_table as reading_table
from kneejax.report.calibration._tests import tests_figure as tests_figure
from kneejax.report.calibration._verdict import Outcome as Outcome
from kneejax.report.calibration._verdict import calibration_notes as calibration_notes
from kneejax.report.calibration._verdict import message as message
from kneejax.report.calibration._verdict import outcome as outcome
from kneejax.report.calibration._verdict import verdict as verdict
from kneejax.report.calibration._verdict import warnings as warnings
