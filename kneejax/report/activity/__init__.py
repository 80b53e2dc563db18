"""What a recorded movement does to a knee."""

from kneejax.report.activity._answer import activity_answer as activity_answer
from kneejax.report.activity._answer import place_table as place_table
from kneejax.report.activity._answer import round_table as round_table
from kneejax.report.activity._figures import activity_figure as activity_figure
from kneejax.report.activity._figures import places_figure as places_figure
