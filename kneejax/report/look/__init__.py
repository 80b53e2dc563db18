"""What all reports share: style, numbers, tables, pages, saving."""

from kneejax.report.look.colours import *
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
from kneejax.report.look.tables import *
