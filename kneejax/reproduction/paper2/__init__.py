"""Claims of paper 2 on the Lachman test and on where a graft begins."""

from kneejax.reproduction.paper2._claims import paper2_claims as paper2_claims
from kneejax.reproduction.paper2._octagon import Octagon as Octagon
from kneejax.reproduction.paper2._octagon import octagon_study as octagon_study
from kneejax.reproduction.paper2._study import LENGTH_CHANGES as LENGTH_CHANGES
from kneejax.reproduction.paper2._study import PRESTRAINS as PRESTRAINS
from kneejax.reproduction.paper2._study import Lachman as Lachman
from kneejax.reproduction.paper2._study import Paper2Study as Paper2Study
from kneejax.reproduction.paper2._study import paper2_study as paper2_study
