"""A knee in text, and how it was made from a model or from meshes."""

from kneejax.report.knee._import import mesh_import_answer as mesh_import_answer
from kneejax.report.knee._import import osim_import_answer as osim_import_answer
from kneejax.report.knee._surface_figure import surface_fit_figure as surface_fit_figure
from kneejax.report.knee._text import knee_text as knee_text
