"""Results for people: text, JSON, figures and the HTML report."""

from kneejax.report._design_figures import candidates_figure as candidates_figure
from kneejax.report._design_figures import standard_errors_figure as standard_errors_figure
from kneejax.report._design_text import CANDIDATE_COLUMNS as CANDIDATE_COLUMNS
from kneejax.report._design_text import candidates_rows as candidates_rows
from kneejax.report._design_text import design_text as design_text
from kneejax.report._figures import convergence_figure as convergence_figure
from kneejax.report._figures import correlation_figure as correlation_figure
from kneejax.report._figures import correlation_matrix_figure as correlation_matrix_figure
from kneejax.report._figures import parameters_figure as parameters_figure
from kneejax.report._figures import partial_objectives_figure as partial_objectives_figure
from kneejax.report._html import report_page as report_page
from kneejax.report._html import write_report as write_report
from kneejax.report._identify_text import ESTIMATE_COLUMNS as ESTIMATE_COLUMNS
from kneejax.report._identify_text import estimate_rows as estimate_rows
from kneejax.report._identify_text import estimates_text as estimates_text
from kneejax.report._identify_text import undetermined_words as undetermined_words
from kneejax.report._indices_figures import fit_indices_figure as fit_indices_figure
from kneejax.report._indices_figures import pose_indices_figure as pose_indices_figure
from kneejax.report._information_figures import (
    information_correlation_figure as information_correlation_figure,
)
from kneejax.report._information_figures import spectrum_figure as spectrum_figure
from kneejax.report._information_text import INFORMATION_COLUMNS as INFORMATION_COLUMNS
from kneejax.report._information_text import information_rows as information_rows
from kneejax.report._information_text import information_text as information_text
from kneejax.report._joint_axes_figure import joint_axes_figure as joint_axes_figure
from kneejax.report._joint_axes_figure import joint_motion_figure as joint_motion_figure
from kneejax.report._joint_comparison_figures import (
    joint_comparison_figure as joint_comparison_figure,
)
from kneejax.report._joint_comparison_text import (
    joint_comparison_document as joint_comparison_document,
)
from kneejax.report._joint_comparison_text import (
    joint_comparison_summary as joint_comparison_summary,
)
from kneejax.report._knee_comparison_figures import ramp_figure as ramp_figure
from kneejax.report._knee_comparison_figures import score_figure as score_figure
from kneejax.report._knee_comparison_text import CLAIM_COLUMNS as CLAIM_COLUMNS
from kneejax.report._knee_comparison_text import claims_summary as claims_summary
from kneejax.report._knee_comparison_text import comparison_document as comparison_document
from kneejax.report._knee_comparison_text import comparison_summary as comparison_summary
from kneejax.report._knee_text import knee_text as knee_text
from kneejax.report._map_figures import map_figure as map_figure
from kneejax.report._map_figures import map_matrix_figure as map_matrix_figure
from kneejax.report._motion_figures import ligament_forces_figure as ligament_forces_figure
from kneejax.report._motion_figures import motion_figure as motion_figure
from kneejax.report._motion_figures import simulation_figure as simulation_figure
from kneejax.report._paper5_figure import paper5_figure as paper5_figure
from kneejax.report._pose_doubts import accepted_statuses as accepted_statuses
from kneejax.report._pose_doubts import pose_doubts as pose_doubts
from kneejax.report._posterior_figures import marginals_figure as marginals_figure
from kneejax.report._posterior_figures import pairs_figure as pairs_figure
from kneejax.report._posterior_figures import posterior_figures as posterior_figures
from kneejax.report._posterior_figures import predictive_figure as predictive_figure
from kneejax.report._posterior_text import POSTERIOR_COLUMNS as POSTERIOR_COLUMNS
from kneejax.report._posterior_text import posterior_rows as posterior_rows
from kneejax.report._posterior_text import posterior_summary as posterior_summary
from kneejax.report._pressure_map import PlateauPressure as PlateauPressure
from kneejax.report._pressure_map import plateau_pressures as plateau_pressures
from kneejax.report._pressure_map import pressure_figure as pressure_figure
from kneejax.report._profile_figures import profiles_figure as profiles_figure
from kneejax.report._reproduction_html import write_reproduction as write_reproduction
from kneejax.report._results import PARAMETER_COLUMNS as PARAMETER_COLUMNS
from kneejax.report._results import json_safe as json_safe
from kneejax.report._results import parameters_rows as parameters_rows
from kneejax.report._results import result_document as result_document
from kneejax.report._saving import picture_png as picture_png
from kneejax.report._saving import save_figure as save_figure
from kneejax.report._saving import write_whole as write_whole
from kneejax.report._scene import BoneMesh as BoneMesh
from kneejax.report._scene import Scene as Scene
from kneejax.report._scene import scenes as scenes
from kneejax.report._scene_figure import film as film
from kneejax.report._scene_figure import scene_figure as scene_figure
from kneejax.report._scene_figure import scenes_figure as scenes_figure
from kneejax.report._scene_html import scene_page as scene_page
from kneejax.report._scene_render import VIEWS as VIEWS
from kneejax.report._scene_render import CannotRender as CannotRender
from kneejax.report._scene_render import MissingPackage as MissingPackage
from kneejax.report._scene_render import need_view_packages as need_view_packages
from kneejax.report._scene_render import simplified as simplified
from kneejax.report._sensitivity_figures import local_curves_figure as local_curves_figure
from kneejax.report._sensitivity_figures import local_heatmap_figure as local_heatmap_figure
from kneejax.report._sensitivity_text import sensitivity_doubts as sensitivity_doubts
from kneejax.report._sensitivity_text import sensitivity_summary as sensitivity_summary
from kneejax.report._style import COORDINATES as COORDINATES
from kneejax.report._style import Coordinate as Coordinate
from kneejax.report._surface_figure import surface_fit_figure as surface_fit_figure
from kneejax.report._sweep_figure import sweep_figure as sweep_figure
from kneejax.report._text import calibration_summary as calibration_summary
from kneejax.report._verdict import Outcome as Outcome
from kneejax.report._verdict import outcome as outcome
from kneejax.report._verdict import verdict as verdict
from kneejax.report._verdict import warnings as warnings
