"""What a knee does through time."""

from kneejax.report.in_time._figures import bundles as bundles
from kneejax.report.in_time._figures import transient_figure as transient_figure
from kneejax.report.in_time._fitted import fitted_lines as fitted_lines
from kneejax.report.in_time._raised_leg import motor_raise_figure as motor_raise_figure
from kneejax.report.in_time._raised_leg import motor_raise_lines as motor_raise_lines
from kneejax.report.in_time._text import transient_lines as transient_lines
