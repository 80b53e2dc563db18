"""A knee to move by hand: settings, answers within a tenth of a second, a page, a notebook."""

from kneejax.explorer.by_hand import ByHand as ByHand
from kneejax.explorer.notebook import explore as explore
from kneejax.explorer.page import Page as Page
from kneejax.explorer.server import serve as serve
from kneejax.explorer.setting import Setting as Setting
from kneejax.explorer.setting import Subject as Subject
from kneejax.explorer.solving import Solver as Solver
