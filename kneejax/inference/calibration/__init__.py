"""The procedures of a calibration, its search and its answers."""

from kneejax.inference.calibration._answer import *
from kneejax.inference.calibration._question import *
from kneejax.inference.calibration._result import *
from kneejax.inference.calibration._search import *
from kneejax.inference.calibration._side_by_side import *
