"""Cartilage: its law, and a contact over a patch or over points."""

from kneejax.mechanics.contact import _cartilage_law as cartilage_law
from kneejax.mechanics.contact._border import OFF_SURFACE_MM as OFF_SURFACE_MM
from kneejax.mechanics.contact._border import Border as Border
from kneejax.mechanics.contact._cartilage_law import ContactDamper as ContactDamper
from kneejax.mechanics.contact._cartilage_law import contact_damping_force as contact_damping_force
from kneejax.mechanics.contact._contact import ELLIPTICAL_PATCH as ELLIPTICAL_PATCH
from kneejax.mechanics.contact._contact import FORMS as FORMS
from kneejax.mechanics.contact._contact import QUADRATURE as QUADRATURE
from kneejax.mechanics.contact._contact import Contact as Contact
from kneejax.mechanics.contact._foundation import Foundation as Foundation
from kneejax.mechanics.contact._foundation import foundations_of as foundations_of
from kneejax.mechanics.contact._patch import Gap as Gap
from kneejax.mechanics.contact._patch_force import Pressed as Pressed
from kneejax.mechanics.contact._points import Sampled as Sampled
from kneejax.mechanics.contact._points_force import PointFaults as PointFaults
from kneejax.mechanics.contact._ring import Ring as Ring

__all__ = ["cartilage_law"]
