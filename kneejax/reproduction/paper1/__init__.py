"""Claims of paper 1."""

from kneejax.reproduction.paper1._claims import CONVENTION as CONVENTION
from kneejax.reproduction.paper1._claims import LIGAMENTS as LIGAMENTS
from kneejax.reproduction.paper1._claims import Paper1Study as Paper1Study
from kneejax.reproduction.paper1._claims import as_paper1_sees as as_paper1_sees
from kneejax.reproduction.paper1._claims import paper1_claims as paper1_claims
