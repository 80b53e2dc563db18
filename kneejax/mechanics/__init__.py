"""Scalar laws, the parts made of them, and the knee made of the parts. Knows no solver."""

from kneejax.mechanics import _cartilage_law as cartilage_law
from kneejax.mechanics import _ligament_law as ligament_law
from kneejax.mechanics._border import Border as Border
from kneejax.mechanics._condyle_points import condyle_points as condyle_points
from kneejax.mechanics._contact import ELLIPTICAL_PATCH as ELLIPTICAL_PATCH
from kneejax.mechanics._contact import FORMS as FORMS
from kneejax.mechanics._contact import QUADRATURE as QUADRATURE
from kneejax.mechanics._contact import Contact as Contact
from kneejax.mechanics._courses import Course as Course
from kneejax.mechanics._dislocation import LIMITS as LIMITS
from kneejax.mechanics._dislocation import WIDEST_GAP_MM as WIDEST_GAP_MM
from kneejax.mechanics._dislocation import dislocated as dislocated
from kneejax.mechanics._dislocation import displacement as displacement
from kneejax.mechanics._failure_strain import FAILURE_SOURCE as FAILURE_SOURCE
from kneejax.mechanics._failure_strain import FibreFaults as FibreFaults
from kneejax.mechanics._failure_strain import usual_failure_strain as usual_failure_strain
from kneejax.mechanics._knee import Knee as Knee
from kneejax.mechanics._knee import add_lane_axis as add_lane_axis
from kneejax.mechanics._ligaments import Ligaments as Ligaments
from kneejax.mechanics._ligaments import WrapState as WrapState
from kneejax.mechanics._loads import AXES as AXES
from kneejax.mechanics._loads import BONES as BONES
from kneejax.mechanics._loads import GROOD_SUNTAY as GROOD_SUNTAY
from kneejax.mechanics._loads import ConstantTensionLine as ConstantTensionLine
from kneejax.mechanics._loads import Load as Load
from kneejax.mechanics._named_loads import NAMED_LOADS as NAMED_LOADS
from kneejax.mechanics._named_loads import NamedLoad as NamedLoad
from kneejax.mechanics._named_loads import load_called as load_called
from kneejax.mechanics._named_loads import load_of as load_of
from kneejax.mechanics._named_loads import load_words as load_words
from kneejax.mechanics._patch import Gap as Gap
from kneejax.mechanics._patch_force import Pressed as Pressed
from kneejax.mechanics._plausible import RANGES as RANGES
from kneejax.mechanics._plausible import Implausible as Implausible
from kneejax.mechanics._plausible import Range as Range
from kneejax.mechanics._plausible import at_reference as at_reference
from kneejax.mechanics._plausible import check_fibres as check_fibres
from kneejax.mechanics._plausible import range_of_parameter as range_of_parameter
from kneejax.mechanics._quadrature import Sampled as Sampled
from kneejax.mechanics._wrench import Wrench as Wrench
from kneejax.mechanics._wrench import generalised_force as generalised_force

__all__ = ["cartilage_law", "ligament_law"]
