"""Simple joints: fits and comparisons as answers, and their figures."""

from kneejax.report.joints._axes_figure import joint_axes_figure as joint_axes_figure
from kneejax.report.joints._axes_figure import joint_motion_figure as joint_motion_figure
from kneejax.report.joints._comparison import comparison_answer as comparison_answer
from kneejax.report.joints._comparison import comparison_doubts as comparison_doubts
from kneejax.report.joints._comparison import comparison_notes as comparison_notes
from kneejax.report.joints._comparison import comparison_tables as comparison_tables
from kneejax.report.joints._comparison_figures import (
    joint_comparison_figure as joint_comparison_figure,
)
from kneejax.report.joints._fit import joint_fit_answer as joint_fit_answer
