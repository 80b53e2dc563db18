"""Poses against a measurement: residuals, bounded searches, the one fit in lanes."""

from kneejax.inference.fit._bounded import *
from kneejax.inference.fit._cut import *
from kneejax.inference.fit._observations import *
from kneejax.inference.fit._observed import *
from kneejax.inference.fit._problem import *
