"""Tests under load as an answer, their figures, and what is wrong with their poses."""

from kneejax.report.laboratory._answer import curve_words as curve_words
from kneejax.report.laboratory._answer import femoral_poses as femoral_poses
from kneejax.report.laboratory._answer import laboratory_answer as laboratory_answer
from kneejax.report.laboratory._figures import laxity_figure as laxity_figure
from kneejax.report.laboratory._figures import load_figure as load_figure
