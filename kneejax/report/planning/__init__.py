"""A planned reconstruction as an answer, with its tables and figures."""

from kneejax.report.planning._answer import plan_answer as plan_answer
from kneejax.report.planning._answer import plan_document as plan_document
from kneejax.report.planning._answer import plan_failed as plan_failed
from kneejax.report.planning._figures import front_figure as front_figure
from kneejax.report.planning._figures import strain_figure as strain_figure
from kneejax.report.planning._figures import tension_figure as tension_figure
from kneejax.report.planning._maps import tunnel_map_figure as tunnel_map_figure
