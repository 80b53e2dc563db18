"""Compiling, lanes, all cores, elimination, safe primitives. Knows no knee."""

from kneejax.numerics._configure import *
from kneejax.numerics._datasets import *
from kneejax.numerics._elimination import *
from kneejax.numerics._errors import *
from kneejax.numerics._kept_programs import *
from kneejax.numerics._lanes import *
from kneejax.numerics._safe import *
from kneejax.numerics._seconds import *
from kneejax.numerics._tangents import *
