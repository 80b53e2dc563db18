"""Fibres: their law, their courses, their failure."""

from kneejax.mechanics.ligaments import _law as ligament_law
from kneejax.mechanics.ligaments._courses import Course as Course
from kneejax.mechanics.ligaments._dampers import Dampers as Dampers
from kneejax.mechanics.ligaments._dampers import critical_damping as critical_damping
from kneejax.mechanics.ligaments._dampers import damping_force as damping_force
from kneejax.mechanics.ligaments._dampers import tautness as tautness
from kneejax.mechanics.ligaments._failure_strain import FAILURE_SOURCE as FAILURE_SOURCE
from kneejax.mechanics.ligaments._failure_strain import FibreFaults as FibreFaults
from kneejax.mechanics.ligaments._failure_strain import usual_failure_strain as usual_failure_strain
from kneejax.mechanics.ligaments._fibres import Fibres as Fibres
from kneejax.mechanics.ligaments._fibres import WrapState as WrapState
from kneejax.mechanics.ligaments._ligaments import Ligaments as Ligaments

__all__ = ["ligament_law"]
