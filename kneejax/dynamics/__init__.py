"""A knee through time: mass, damping, and the same balance at the end of every step."""

from kneejax.dynamics._account import Account as Account
from kneejax.dynamics._accuracy import integrated as integrated
from kneejax.dynamics._accuracy import move_within as move_within
from kneejax.dynamics._march import Given as Given
from kneejax.dynamics._march import Grid as Grid
from kneejax.dynamics._march import followed as followed
from kneejax.dynamics._march import march as march
from kneejax.dynamics._march import rising as rising
from kneejax.dynamics._march import searched as searched
from kneejax.dynamics._march import with_idle_steps as with_idle_steps
from kneejax.dynamics._moving import MovingKnee as MovingKnee
from kneejax.dynamics._moving import Step as Step
from kneejax.dynamics._moving import gravity_of as gravity_of
from kneejax.dynamics._trajectory import LoadCurve as LoadCurve
from kneejax.dynamics._trajectory import Trajectory as Trajectory
from kneejax.dynamics._trajectory import given_of as given_of
from kneejax.dynamics._trajectory import move as move
