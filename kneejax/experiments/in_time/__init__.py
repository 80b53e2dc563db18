"""Experiments through time: knees with mass that are loaded, led or let go."""

from kneejax.experiments.in_time._frames import Frames as Frames
from kneejax.experiments.in_time._raised_leg import RaisedLeg as RaisedLeg
from kneejax.experiments.in_time._raised_leg import leg_of_person as leg_of_person
from kneejax.experiments.in_time._raised_leg import raised_leg as raised_leg
from kneejax.experiments.in_time._transient import MOST_ERROR_MM as MOST_ERROR_MM
from kneejax.experiments.in_time._transient import Transient as Transient
from kneejax.experiments.in_time._transient import beginning as beginning
from kneejax.experiments.in_time._transient import transient as transient
