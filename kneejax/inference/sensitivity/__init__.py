"""What a parameter moves: sweeps, slopes, indices, maps."""

from kneejax.inference.sensitivity._global_indices import *
from kneejax.inference.sensitivity._map import *
from kneejax.inference.sensitivity._parameter_map import *
from kneejax.inference.sensitivity._sweeps import *
