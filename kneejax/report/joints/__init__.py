"""Simple joints: axes, fits and comparisons."""

from kneejax.report.joints import _comparison_text as joint_comparison_text
from kneejax.report.joints._axes_figure import joint_axes_figure as joint_axes_figure
from kneejax.report.joints._axes_figure import joint_motion_figure as joint_motion_figure
from kneejax.report.joints._comparison_figures import (
    joint_comparison_figure as joint_comparison_figure,
)
from kneejax.report.joints._comparison_notes import comparison_doubts as comparison_doubts
from kneejax.report.joints._comparison_notes import comparison_notes as comparison_notes
from kneejax.report.joints._comparison_text import (
    joint_comparison_document as joint_comparison_document,
)
from kneejax.report.joints._comparison_text import (
    joint_comparison_summary as joint_comparison_summary,
)
from kneejax.report.joints._fit_text import FACET_COLUMNS as FACET_COLUMNS
from kneejax.report.joints._fit_text import facet_rows as facet_rows
from kneejax.report.joints._fit_text import joint_fit_summary as joint_fit_summary
from kneejax.report.joints._fit_text import joint_kind as joint_kind

__all__ = ["joint_comparison_text"]
