"""Paper 5: simple joints of a cohort, and its claims."""

from kneejax.reproduction.paper5 import _printed as printed_paper5
from kneejax.reproduction.paper5._axes import DONOR as DONOR
from kneejax.reproduction.paper5._axes import FACETS as FACETS
from kneejax.reproduction.paper5._claims import paper5_claims as paper5_claims
from kneejax.reproduction.paper5._study import CENTRE_SD_MM as CENTRE_SD_MM
from kneejax.reproduction.paper5._study import COHORTS as COHORTS
from kneejax.reproduction.paper5._study import CORRELATIONS as CORRELATIONS
from kneejax.reproduction.paper5._study import DRAWS as DRAWS
from kneejax.reproduction.paper5._study import MIDPOINT_SD_MM as MIDPOINT_SD_MM
from kneejax.reproduction.paper5._study import SIZES as SIZES
from kneejax.reproduction.paper5._study import Paper5Study as Paper5Study
from kneejax.reproduction.paper5._study import paper5_study as paper5_study

__all__ = ["printed_paper5"]
