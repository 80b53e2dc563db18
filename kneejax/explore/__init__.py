"""A knee to move in the browser: settings, answers within a tenth of a second, the page."""

from kneejax.explore.page import Page as Page
from kneejax.explore.server import serve as serve
from kneejax.explore.setting import Setting as Setting
from kneejax.explore.setting import Subject as Subject
from kneejax.explore.solving import Answer as Answer
from kneejax.explore.solving import Curves as Curves
from kneejax.explore.solving import Solver as Solver
