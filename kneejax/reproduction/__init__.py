"""Published claims, computed; a folder a paper."""

from kneejax.reproduction._claims import CANNOT_BE_JUDGED as CANNOT_BE_JUDGED
from kneejax.reproduction._claims import NOT_REPRODUCED as NOT_REPRODUCED
from kneejax.reproduction._claims import REPRODUCED as REPRODUCED
from kneejax.reproduction._claims import VERDICTS as VERDICTS
from kneejax.reproduction._claims import Claim as Claim
from kneejax.reproduction._claims import judged as judged
from kneejax.reproduction.paper1 import Paper1Study as Paper1Study
from kneejax.reproduction.paper1 import paper1_claims as paper1_claims
from kneejax.reproduction.paper4 import LIMITS as LIMITS
from kneejax.reproduction.paper4 import Change as Change
from kneejax.reproduction.paper4 import Influence as Influence
from kneejax.reproduction.paper4 import KneeComparison as KneeComparison
from kneejax.reproduction.paper4 import KneeStudy as KneeStudy
from kneejax.reproduction.paper4 import OneAtATime as OneAtATime
from kneejax.reproduction.paper4 import Outcome as Outcome
from kneejax.reproduction.paper4 import changes_of as changes_of
from kneejax.reproduction.paper4 import compare_knees as compare_knees
from kneejax.reproduction.paper4 import made_up_knee as made_up_knee
from kneejax.reproduction.paper4 import paper4_claims as paper4_claims
from kneejax.reproduction.paper4 import score as score
from kneejax.reproduction.paper4 import with_fibres as with_fibres
from kneejax.reproduction.paper5 import Paper5Study as Paper5Study
from kneejax.reproduction.paper5 import paper5_claims as paper5_claims
from kneejax.reproduction.paper5 import paper5_study as paper5_study
