"""Experiments on a knee: each is a few lines over statics."""

from kneejax.experiments._evaluate import Mechanics as Mechanics
from kneejax.experiments._evaluate import evaluate as evaluate
from kneejax.experiments._evaluate import status_of as status_of
from kneejax.experiments._passive import PassiveFlexion as PassiveFlexion
from kneejax.experiments._passive import passive_flexion as passive_flexion
from kneejax.experiments._ways import Way as Way
from kneejax.experiments._ways import ways_of as ways_of
