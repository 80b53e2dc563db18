"""What a recorded motion through time tells of dampers."""

from kneejax.inference.transients._fit_transient import DAMPING as DAMPING
from kneejax.inference.transients._fit_transient import Damper as Damper
from kneejax.inference.transients._fit_transient import FittedTransient as FittedTransient
from kneejax.inference.transients._fit_transient import Recorded as Recorded
from kneejax.inference.transients._fit_transient import fit_transient as fit_transient
