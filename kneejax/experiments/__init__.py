"""Experiments on a knee: each is a few lines over statics."""

from kneejax.experiments._branches import Branch as Branch
from kneejax.experiments._branches import branches as branches
from kneejax.experiments._doubts import doubts as doubts
from kneejax.experiments._doubts import of_search as of_search
from kneejax.experiments._doubts import with_flips as with_flips
from kneejax.experiments._evaluate import Mechanics as Mechanics
from kneejax.experiments._evaluate import evaluate as evaluate
from kneejax.experiments._evaluate import status_of as status_of
from kneejax.experiments._motion import Motion as Motion
from kneejax.experiments._motion import passive_flexion as passive_flexion
from kneejax.experiments._peak_pressure import PeakPressure as PeakPressure
from kneejax.experiments._peak_pressure import peak_pressure as peak_pressure
from kneejax.experiments._slack import slack_poses as slack_poses
from kneejax.experiments._varus_valgus import BODY_WEIGHT_N as BODY_WEIGHT_N
from kneejax.experiments._varus_valgus import DIRECTIONS as DIRECTIONS
from kneejax.experiments._varus_valgus import VALGUS as VALGUS
from kneejax.experiments._varus_valgus import VARUS as VARUS
from kneejax.experiments._varus_valgus import VarusValgus as VarusValgus
from kneejax.experiments._varus_valgus import VarusValgusRamp as VarusValgusRamp
from kneejax.experiments._varus_valgus import varus_valgus as varus_valgus
from kneejax.experiments._ways import Way as Way
from kneejax.experiments._ways import ways_of as ways_of
