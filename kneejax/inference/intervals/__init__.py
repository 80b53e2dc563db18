"""How sure a fit is: chi squared, profiles, intervals."""

from kneejax.inference.intervals._estimate import *
from kneejax.inference.intervals._profile_arms import *
from kneejax.inference.intervals._profiles import *
