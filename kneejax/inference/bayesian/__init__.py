"""What is left after the data, with what was known before: the posterior."""

from kneejax.inference.bayesian._posterior import *
from kneejax.inference.bayesian._priors import *
