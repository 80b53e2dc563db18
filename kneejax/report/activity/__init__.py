"""What a recorded movement does to a knee."""

from kneejax.report.activity._figures import activity_figure as activity_figure
from kneejax.report.activity._text import activity_lines as activity_lines
