"""Claims of paper 1."""

from kneejax.reproduction.paper1._claims import paper1_claims as paper1_claims
from kneejax.reproduction.paper1._study import CONVENTION as CONVENTION
from kneejax.reproduction.paper1._study import LIGAMENTS as LIGAMENTS
from kneejax.reproduction.paper1._study import Paper1Study as Paper1Study
from kneejax.reproduction.paper1._study import as_paper1_sees as as_paper1_sees
