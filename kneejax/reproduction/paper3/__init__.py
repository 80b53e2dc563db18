"""Claims of paper 3 on the laxity of its knee."""

from kneejax.reproduction.paper3._claims import paper3_claims as paper3_claims
from kneejax.reproduction.paper3._study import TORSION_DEG as TORSION_DEG
from kneejax.reproduction.paper3._study import Paper3Study as Paper3Study
from kneejax.reproduction.paper3._study import paper3_study as paper3_study
