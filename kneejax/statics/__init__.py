"""Balance of a knee, its stability and its exact derivatives: the one solve of the package."""

from kneejax.statics._balance import Balance as Balance
from kneejax.statics._balance import balance as balance
from kneejax.statics._balance import force as force
from kneejax.statics._balance import force_derivative as force_derivative
from kneejax.statics._balances import Balances as Balances
from kneejax.statics._batch import Progress as Progress
from kneejax.statics._batch import balance_lines as balance_lines
from kneejax.statics._batch import balance_many as balance_many
from kneejax.statics._batch import own_motion as own_motion
from kneejax.statics._compiled import compiled as compiled
from kneejax.statics._compiled import compiler_options as compiler_options
from kneejax.statics._compiled import (
    share_memory_between_threads as share_memory_between_threads,
)
from kneejax.statics._compiled import use_shared_fusion as use_shared_fusion
from kneejax.statics._cores import on_all_cores as on_all_cores
from kneejax.statics._faults import ContactFaults as ContactFaults
from kneejax.statics._faults import Faults as Faults
from kneejax.statics._newton import UNITS as UNITS
from kneejax.statics._newton import EnergyNewton as EnergyNewton
from kneejax.statics._newton import Guess as Guess
from kneejax.statics._settle import Settled as Settled
from kneejax.statics._settle import differentiable as differentiable
from kneejax.statics._settle import first_guess as first_guess
from kneejax.statics._settle import poses_on_the_way as poses_on_the_way
from kneejax.statics._settle import settle as settle
from kneejax.statics._settle import with_meeting as with_meeting
from kneejax.statics._slopes import Slopes as Slopes
from kneejax.statics._slopes import balance_with_slopes as balance_with_slopes
from kneejax.statics._softness import newton_step_left as newton_step_left
from kneejax.statics._stations import Stations as Stations
from kneejax.statics._status import FAILURES as FAILURES
from kneejax.statics._status import Status as Status
from kneejax.statics._status import converged as converged
from kneejax.statics._status import fails as fails
from kneejax.statics._status import failures_of as failures_of
from kneejax.statics._status import sound as sound
from kneejax.statics._variants import Vary as Vary
from kneejax.statics._variants import in_lanes as in_lanes
