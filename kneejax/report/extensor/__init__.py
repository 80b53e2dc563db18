"""What a knee does while its quadriceps pulls."""

from kneejax.report.extensor._answer import extensor_answer as extensor_answer
from kneejax.report.extensor._answer import extensor_table as extensor_table
from kneejax.report.extensor._figures import extensor_figure as extensor_figure
from kneejax.report.extensor._figures import shear_figure as shear_figure
