"""What a knee does while its quadriceps pulls."""

from kneejax.report.extensor._figures import extensor_figure as extensor_figure
from kneejax.report.extensor._figures import shear_figure as shear_figure
from kneejax.report.extensor._tables import EXTENSOR_COLUMNS as EXTENSOR_COLUMNS
from kneejax.report.extensor._tables import extensor_lines as extensor_lines
from kneejax.report.extensor._tables import extensor_rows as extensor_rows
