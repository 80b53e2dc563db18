"""Experiments in which the quadriceps pulls on a patella."""

from kneejax.experiments.extensor._by_length import DrivenExtensor as DrivenExtensor
from kneejax.experiments.extensor._by_length import extension_by_length as extension_by_length
from kneejax.experiments.extensor._by_length import leg_raise_by_length as leg_raise_by_length
from kneejax.experiments.extensor._extensor import Extensor as Extensor
from kneejax.experiments.extensor._extensor import at_rest as at_rest
from kneejax.experiments.extensor._extensor import held_leg as held_leg
from kneejax.experiments.extensor._extensor import isometric_extension as isometric_extension
from kneejax.experiments.extensor._extensor import leg_raise as leg_raise
from kneejax.experiments.extensor._extensor import patellar_tracking as patellar_tracking
from kneejax.experiments.extensor._mechanism import TENDON as TENDON
from kneejax.experiments.extensor._mechanism import Shank as Shank
from kneejax.experiments.extensor._mechanism import tendon_of as tendon_of
from kneejax.experiments.extensor._mechanism import weight_of as weight_of
