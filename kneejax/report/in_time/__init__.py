"""What a knee does through time."""

from kneejax.report.in_time._answer import raised_leg_answer as raised_leg_answer
from kneejax.report.in_time._answer import transient_answer as transient_answer
