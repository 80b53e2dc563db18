"""Recorded movements: what they do to a knee."""

from kneejax.experiments.activity._activity import Activity as Activity
from kneejax.experiments.activity._activity import activity as activity
from kneejax.experiments.activity._cycle import Cycle as Cycle
from kneejax.experiments.activity._cycle import Round as Round
from kneejax.experiments.activity._cycle import cycle_of as cycle_of
from kneejax.experiments.activity._cycle import weights as weights
