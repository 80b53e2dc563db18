"""Scalar laws, the parts made of them, and the knee made of the parts. Knows no solver."""

from kneejax.mechanics._dislocation import *
from kneejax.mechanics._knee import *
from kneejax.mechanics._leg_record import *
from kneejax.mechanics._loads import *
from kneejax.mechanics._mass import *
from kneejax.mechanics._muscles import *
from kneejax.mechanics._named_loads import *
from kneejax.mechanics._plausible import *
from kneejax.mechanics.contact import *
from kneejax.mechanics.contact import cartilage_law as cartilage_law
from kneejax.mechanics.ligaments import *
from kneejax.mechanics.ligaments import ligament_law as ligament_law
from kneejax.mechanics.ligaments import neo_hookean_law as neo_hookean_law
