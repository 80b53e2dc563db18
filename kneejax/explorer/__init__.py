"""A knee to move by hand: settings, answers within a tenth of a second, a page, a notebook."""

from kneejax.explorer.by_hand import *
from kneejax.explorer.notebook import *
from kneejax.explorer.page import *
from kneejax.explorer.server import *
from kneejax.explorer.setting import *
from kneejax.explorer.solving import *
