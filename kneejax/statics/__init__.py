"""Balance of a knee, its stability and its exact derivatives: the one solve of the package."""

from kneejax.statics._balance import *
from kneejax.statics._equilibria import *
from kneejax.statics._equilibrium import *
from kneejax.statics._flexion_paths import *
from kneejax.statics._load_cases import *
from kneejax.statics._many import *
from kneejax.statics._newton import *
from kneejax.statics._slopes import *
from kneejax.statics._status import *
