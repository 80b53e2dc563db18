"""Figures of tests under load."""

from kneejax.report.laboratory._figures import laxity_figure as laxity_figure
from kneejax.report.laboratory._figures import load_figure as load_figure
