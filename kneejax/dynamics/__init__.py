"""A knee through time: mass, damping, and the same balance at the end of every step."""

from kneejax.dynamics._account import *
from kneejax.dynamics._accuracy import *
from kneejax.dynamics._march import *
from kneejax.dynamics._moving import *
from kneejax.dynamics._trajectory import *
