"""Sweeps, slopes, indices and maps in text and figures."""

from kneejax.report.sensitivity._figures import local_curves_figure as local_curves_figure
from kneejax.report.sensitivity._figures import local_heatmap_figure as local_heatmap_figure
from kneejax.report.sensitivity._indices_figures import fit_indices_figure as fit_indices_figure
from kneejax.report.sensitivity._indices_figures import pose_indices_figure as pose_indices_figure
from kneejax.report.sensitivity._map_figures import map_figure as map_figure
from kneejax.report.sensitivity._map_figures import map_matrix_figure as map_matrix_figure
from kneejax.report.sensitivity._sweep_figure import sweep_figure as sweep_figure
from kneejax.report.sensitivity._sweep_figure import uniform_colours as uniform_colours
from kneejax.report.sensitivity._text import sensitivity_doubts as sensitivity_doubts
from kneejax.report.sensitivity._text import sensitivity_summary as sensitivity_summary
