"""What a recorded movement does to a knee."""

from kneejax.report.activity._figures import activity_figure as activity_figure
from kneejax.report.activity._places import PLACE_COLUMNS as PLACE_COLUMNS
from kneejax.report.activity._places import place_lines as place_lines
from kneejax.report.activity._places import place_rows as place_rows
from kneejax.report.activity._places import places_figure as places_figure
from kneejax.report.activity._rounds import ROUND_COLUMNS as ROUND_COLUMNS
from kneejax.report.activity._rounds import round_lines as round_lines
from kneejax.report.activity._rounds import round_rows as round_rows
from kneejax.report.activity._text import activity_lines as activity_lines
from kneejax.report.activity._text import second_lines as second_lines
from kneejax.report.activity._text import second_words as second_words
