"""A planned reconstruction for people: text, tables, figures, and a page for a surgeon."""

from kneejax.report.planning._figures import strain_figure as strain_figure
from kneejax.report.planning._figures import tension_figure as tension_figure
from kneejax.report.planning._front import front_figure as front_figure
from kneejax.report.planning._html import write_plan_report as write_plan_report
from kneejax.report.planning._maps import tunnel_map_figure as tunnel_map_figure
from kneejax.report.planning._tables import NOT_FOR_PATIENTS as NOT_FOR_PATIENTS
from kneejax.report.planning._tables import curve_rows as curve_rows
from kneejax.report.planning._tables import front_columns as front_columns
from kneejax.report.planning._tables import front_rows as front_rows
from kneejax.report.planning._tables import octagon_rows as octagon_rows
from kneejax.report.planning._tables import plan_columns as plan_columns
from kneejax.report.planning._tables import plan_document as plan_document
from kneejax.report.planning._tables import plan_doubts as plan_doubts
from kneejax.report.planning._tables import plan_failed as plan_failed
from kneejax.report.planning._tables import plan_rows as plan_rows
from kneejax.report.planning._text import plan_text as plan_text
