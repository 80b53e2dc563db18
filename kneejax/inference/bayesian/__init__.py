"""What is left after the data, with what was known before: the posterior."""

from kneejax.inference.bayesian._posterior import Posterior as Posterior
from kneejax.inference.bayesian._posterior import check_counts as check_counts
from kneejax.inference.bayesian._posterior import posterior as posterior
from kneejax.inference.bayesian._priors import Prior as Prior
from kneejax.inference.bayesian._priors import normal_priors as normal_priors
from kneejax.inference.bayesian._priors import parameter_priors as parameter_priors
