"""Fibres: their law, their courses, their failure."""

from kneejax.mechanics.ligaments import _law as ligament_law
from kneejax.mechanics.ligaments import _neo_hookean as neo_hookean_law
from kneejax.mechanics.ligaments._courses import Course as Course
from kneejax.mechanics.ligaments._fibre_field import AttachmentArea as AttachmentArea
from kneejax.mechanics.ligaments._fibre_field import FibreField as FibreField
from kneejax.mechanics.ligaments._fibre_field import disc_quadrature as disc_quadrature
from kneejax.mechanics.ligaments._fibre_field import fibre_field as fibre_field
from kneejax.mechanics.ligaments._fibre_field import untwisted as untwisted
from kneejax.mechanics.ligaments._law import FAILURE_SOURCE as FAILURE_SOURCE
from kneejax.mechanics.ligaments._law import Dampers as Dampers
from kneejax.mechanics.ligaments._law import FibreFaults as FibreFaults
from kneejax.mechanics.ligaments._law import critical_damping as critical_damping
from kneejax.mechanics.ligaments._law import damping_force as damping_force
from kneejax.mechanics.ligaments._law import tautness as tautness
from kneejax.mechanics.ligaments._law import usual_failure_strain as usual_failure_strain
from kneejax.mechanics.ligaments._ligaments import BLANKEVOORT as BLANKEVOORT
from kneejax.mechanics.ligaments._ligaments import LIGAMENT_LAWS as LIGAMENT_LAWS
from kneejax.mechanics.ligaments._ligaments import NEO_HOOKEAN as NEO_HOOKEAN
from kneejax.mechanics.ligaments._ligaments import Fibres as Fibres
from kneejax.mechanics.ligaments._ligaments import Ligaments as Ligaments
from kneejax.mechanics.ligaments._ligaments import WrapState as WrapState

__all__ = ["ligament_law", "neo_hookean_law"]
