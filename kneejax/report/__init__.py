"""Results for people: text, JSON, figures and the HTML report."""

from kneejax.report._figures import convergence_figure as convergence_figure
from kneejax.report._figures import correlation_figure as correlation_figure
from kneejax.report._figures import parameters_figure as parameters_figure
from kneejax.report._figures import partial_objectives_figure as partial_objectives_figure
from kneejax.report._html import report_page as report_page
from kneejax.report._html import write_report as write_report
from kneejax.report._motion_figures import ligament_forces_figure as ligament_forces_figure
from kneejax.report._motion_figures import motion_figure as motion_figure
from kneejax.report._motion_figures import simulation_figure as simulation_figure
from kneejax.report._results import PARAMETER_COLUMNS as PARAMETER_COLUMNS
from kneejax.report._results import json_safe as json_safe
from kneejax.report._results import parameters_rows as parameters_rows
from kneejax.report._results import result_document as result_document
from kneejax.report._saving import save_figure as save_figure
from kneejax.report._style import COORDINATES as COORDINATES
from kneejax.report._style import Coordinate as Coordinate
from kneejax.report._surface_figure import surface_fit_figure as surface_fit_figure
from kneejax.report._text import calibration_summary as calibration_summary
from kneejax.report._verdict import verdict as verdict
from kneejax.report._verdict import warnings as warnings
