"""Fibres: their law, their courses, their failure."""

from kneejax.mechanics.ligaments import _law as ligament_law
from kneejax.mechanics.ligaments import _neo_hookean as neo_hookean_law
from kneejax.mechanics.ligaments._courses import *
from kneejax.mechanics.ligaments._fibre_field import *
from kneejax.mechanics.ligaments._law import *
from kneejax.mechanics.ligaments._ligaments import *
