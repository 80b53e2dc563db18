"""What all reports share: style, numbers, tables, pages, saving."""

from kneejax.report.look.colours import BLACK as BLACK
from kneejax.report.look.colours import BLUE as BLUE
from kneejax.report.look.colours import GREEN as GREEN
from kneejax.report.look.colours import GREY as GREY
from kneejax.report.look.colours import LIGHT as LIGHT
from kneejax.report.look.colours import ORANGE as ORANGE
from kneejax.report.look.colours import PURPLE as PURPLE
from kneejax.report.look.colours import VERMILLION as VERMILLION
from kneejax.report.look.page import Answer as Answer
from kneejax.report.look.page import as_setting as as_setting
from kneejax.report.look.page import write_page as write_page
from kneejax.report.look.style import SHOWN as SHOWN
from kneejax.report.look.style import WIDTH as WIDTH
from kneejax.report.look.style import picture_png as picture_png
from kneejax.report.look.style import picture_svg as picture_svg
from kneejax.report.look.style import styled as styled
from kneejax.report.look.style import verbatim as verbatim
from kneejax.report.look.style import without_frame as without_frame
from kneejax.report.look.style import write_whole as write_whole
from kneejax.report.look.tables import Table as Table
from kneejax.report.look.tables import aligned as aligned
from kneejax.report.look.tables import json_safe as json_safe
from kneejax.report.look.tables import wrapped as wrapped
