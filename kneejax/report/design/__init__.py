"""Tests to make next, in sentences, tables and figures."""

from kneejax.report.design._figures import candidates_figure as candidates_figure
from kneejax.report.design._figures import standard_errors_figure as standard_errors_figure
from kneejax.report.design._text import CANDIDATE_COLUMNS as CANDIDATE_COLUMNS
from kneejax.report.design._text import candidates_table as candidates_table
from kneejax.report.design._text import design_notes as design_notes
from kneejax.report.design._text import design_tables as design_tables
from kneejax.report.design._text import design_text as design_text
from kneejax.report.design._text import design_words as design_words
from kneejax.report.design._text import goal_words as goal_words
from kneejax.report.design._text import next_tests_table as next_tests_table
