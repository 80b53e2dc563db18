"""Fibres: their law, their courses, their failure."""

from kneejax.mechanics.ligaments import _law as ligament_law
from kneejax.mechanics.ligaments._courses import Course as Course
from kneejax.mechanics.ligaments._law import FAILURE_SOURCE as FAILURE_SOURCE
from kneejax.mechanics.ligaments._law import Dampers as Dampers
from kneejax.mechanics.ligaments._law import FibreFaults as FibreFaults
from kneejax.mechanics.ligaments._law import critical_damping as critical_damping
from kneejax.mechanics.ligaments._law import damping_force as damping_force
from kneejax.mechanics.ligaments._law import tautness as tautness
from kneejax.mechanics.ligaments._law import usual_failure_strain as usual_failure_strain
from kneejax.mechanics.ligaments._ligaments import Fibres as Fibres
from kneejax.mechanics.ligaments._ligaments import Ligaments as Ligaments
from kneejax.mechanics.ligaments._ligaments import WrapState as WrapState

__all__ = ["ligament_law"]
