"""Experiments on a knee: each is a few lines over statics."""

from kneejax.experiments._activity import *
from kneejax.experiments._branches import *
from kneejax.experiments._curves import *
from kneejax.experiments._evaluate import *
from kneejax.experiments._extensor import *
from kneejax.experiments._extensor_by_length import *
from kneejax.experiments._extensor_mechanism import *
from kneejax.experiments._frames import *
from kneejax.experiments._lab_tests import *
from kneejax.experiments._measured_test import *
from kneejax.experiments._motion import *
from kneejax.experiments._recorded import *
from kneejax.experiments._transient import *
