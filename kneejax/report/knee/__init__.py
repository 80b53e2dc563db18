"""A knee in text, and the fit of its surfaces."""

from kneejax.report.knee._surface_figure import surface_fit_figure as surface_fit_figure
from kneejax.report.knee._text import knee_text as knee_text
