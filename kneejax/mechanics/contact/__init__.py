"""Cartilage: its law, and a contact over a patch or over points."""

from kneejax.mechanics.contact import _cartilage_law as cartilage_law
from kneejax.mechanics.contact._border import *
from kneejax.mechanics.contact._cartilage_law import *
from kneejax.mechanics.contact._contact import *
from kneejax.mechanics.contact._foundation import *
from kneejax.mechanics.contact._patch import *
from kneejax.mechanics.contact._patch_force import *
from kneejax.mechanics.contact._points import *
from kneejax.mechanics.contact._points_force import *
from kneejax.mechanics.contact._ring import *
