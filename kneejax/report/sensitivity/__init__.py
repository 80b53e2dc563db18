"""Sweeps, derivatives, indices and maps as answers and figures."""

from kneejax.report.sensitivity._answer import sensitivity_answer as sensitivity_answer
from kneejax.report.sensitivity._answer import sensitivity_doubts as sensitivity_doubts
from kneejax.report.sensitivity._answer import swept_table as swept_table
from kneejax.report.sensitivity._indices_figures import fit_indices_figure as fit_indices_figure
from kneejax.report.sensitivity._indices_figures import pose_indices_figure as pose_indices_figure
from kneejax.report.sensitivity._map_answer import map_answer as map_answer
from kneejax.report.sensitivity._maps import map_figure as map_figure
from kneejax.report.sensitivity._maps import map_matrix_figure as map_matrix_figure
from kneejax.report.sensitivity._motion_figures import local_curves_figure as local_curves_figure
from kneejax.report.sensitivity._motion_figures import local_heatmap_figure as local_heatmap_figure
from kneejax.report.sensitivity._motion_figures import sweep_figure as sweep_figure
from kneejax.report.sensitivity._motion_figures import uniform_colours as uniform_colours
