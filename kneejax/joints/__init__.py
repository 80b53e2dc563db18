"""Simplified joints: a tibia that turns about an axis, fixed or moving with flexion."""

from kneejax.joints._comparison import *
from kneejax.joints._facets import *
from kneejax.joints._fit import *
from kneejax.joints._frames import *
from kneejax.joints._joint import *
from kneejax.joints._repeated_measures import *
