"""What knees of a cohort have in common: means and spreads of parameters, and shrinkage."""

from kneejax.inference.population._population import Population as Population
from kneejax.inference.population._population import in_log as in_log
from kneejax.inference.population._population import population as population
