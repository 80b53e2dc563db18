"""Scalar laws, the parts made of them, and the knee made of the parts. Knows no solver."""

from kneejax.mechanics._dislocation import *
from kneejax.mechanics._knee import *
from kneejax.mechanics._leg_record import *
from kneejax.mechanics._loads import *
from kneejax.mechanics._mass import *
from kneejax.mechanics._muscles import *
from kneejax.mechanics._named_loads import *
from kneejax.mechanics._plausible import *
from kneejax.mechanics.contact import ELLIPTICAL_PATCH as ELLIPTICAL_PATCH
from kneejax.mechanics.contact import FORMS as FORMS
from kneejax.mechanics.contact import OFF_SURFACE_MM as OFF_SURFACE_MM
from kneejax.mechanics.contact import QUADRATURE as QUADRATURE
from kneejax.mechanics.contact import Border as Border
from kneejax.mechanics.contact import Contact as Contact
from kneejax.mechanics.contact import ContactDamper as ContactDamper
from kneejax.mechanics.contact import Foundation as Foundation
from kneejax.mechanics.contact import Gap as Gap
from kneejax.mechanics.contact import PointFaults as PointFaults
from kneejax.mechanics.contact import Pressed as Pressed
from kneejax.mechanics.contact import Ring as Ring
from kneejax.mechanics.contact import Sampled as Sampled
from kneejax.mechanics.contact import cartilage_law as cartilage_law
from kneejax.mechanics.contact import contact_damping_force as contact_damping_force
from kneejax.mechanics.contact import foundations_of as foundations_of
from kneejax.mechanics.ligaments import BLANKEVOORT as BLANKEVOORT
from kneejax.mechanics.ligaments import FAILURE_SOURCE as FAILURE_SOURCE
from kneejax.mechanics.ligaments import LIGAMENT_LAWS as LIGAMENT_LAWS
from kneejax.mechanics.ligaments import NEO_HOOKEAN as NEO_HOOKEAN
from kneejax.mechanics.ligaments import AttachmentArea as AttachmentArea
from kneejax.mechanics.ligaments import Course as Course
from kneejax.mechanics.ligaments import Dampers as Dampers
from kneejax.mechanics.ligaments import FibreFaults as FibreFaults
from kneejax.mechanics.ligaments import FibreField as FibreField
from kneejax.mechanics.ligaments import Fibres as Fibres
from kneejax.mechanics.ligaments import Ligaments as Ligaments
from kneejax.mechanics.ligaments import WrapState as WrapState
from kneejax.mechanics.ligaments import critical_damping as critical_damping
from kneejax.mechanics.ligaments import damping_force as damping_force
from kneejax.mechanics.ligaments import disc_quadrature as disc_quadrature
from kneejax.mechanics.ligaments import fibre_field as fibre_field
from kneejax.mechanics.ligaments import ligament_law as ligament_law
from kneejax.mechanics.ligaments import neo_hookean_law as neo_hookean_law
from kneejax.mechanics.ligaments import tautness as tautness
from kneejax.mechanics.ligaments import untwisted as untwisted
from kneejax.mechanics.ligaments import usual_failure_strain as usual_failure_strain
