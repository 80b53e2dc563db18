"""Candidate tests in text and figures."""

from kneejax.report.design._figures import candidates_figure as candidates_figure
from kneejax.report.design._figures import standard_errors_figure as standard_errors_figure
from kneejax.report.design._text import CANDIDATE_COLUMNS as CANDIDATE_COLUMNS
from kneejax.report.design._text import candidates_rows as candidates_rows
from kneejax.report.design._text import design_notes as design_notes
from kneejax.report.design._text import design_text as design_text
from kneejax.report.design._text import design_words as design_words
from kneejax.report.design._text import next_test_table as next_test_table
