"""Claims, and the figures of the papers."""

from kneejax.report.reproduction import _knee_comparison_text as knee_comparison_text
from kneejax.report.reproduction._html import write_reproduction as write_reproduction
from kneejax.report.reproduction._knee_comparison_figures import ramp_figure as ramp_figure
from kneejax.report.reproduction._knee_comparison_figures import score_figure as score_figure
from kneejax.report.reproduction._knee_comparison_text import CLAIM_COLUMNS as CLAIM_COLUMNS
from kneejax.report.reproduction._knee_comparison_text import claims_summary as claims_summary
from kneejax.report.reproduction._knee_comparison_text import (
    comparison_document as comparison_document,
)
from kneejax.report.reproduction._knee_comparison_text import (
    comparison_summary as comparison_summary,
)
from kneejax.report.reproduction._laxity_figures import drawer_figure as drawer_figure
from kneejax.report.reproduction._laxity_figures import lachman_figure as lachman_figure
from kneejax.report.reproduction._laxity_figures import torsion_figure as torsion_figure
from kneejax.report.reproduction._leg_figure import raised_leg_figure as raised_leg_figure
from kneejax.report.reproduction._paper5_figure import paper5_figure as paper5_figure

__all__ = ["knee_comparison_text"]
