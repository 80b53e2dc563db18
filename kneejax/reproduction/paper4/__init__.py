"""Paper 4: knees side by side with their fibres changed, and its claims."""

from kneejax.reproduction.paper4._claims import paper4_claims as paper4_claims
from kneejax.reproduction.paper4._fibre_changes import ATTACHMENT as ATTACHMENT
from kneejax.reproduction.paper4._fibre_changes import CHANGED as CHANGED
from kneejax.reproduction.paper4._fibre_changes import HALVES as HALVES
from kneejax.reproduction.paper4._fibre_changes import MODULUS as MODULUS
from kneejax.reproduction.paper4._fibre_changes import PRESTRETCH as PRESTRETCH
from kneejax.reproduction.paper4._fibre_changes import Change as Change
from kneejax.reproduction.paper4._fibre_changes import changes_of as changes_of
from kneejax.reproduction.paper4._fibre_changes import with_fibres as with_fibres
from kneejax.reproduction.paper4._knee_comparison import compare_knees as compare_knees
from kneejax.reproduction.paper4._knee_scores import LIMITS as LIMITS
from kneejax.reproduction.paper4._knee_scores import score as score
from kneejax.reproduction.paper4._made_up_knee import made_up_knee as made_up_knee
from kneejax.reproduction.paper4._one_at_a_time import Influence as Influence
from kneejax.reproduction.paper4._one_at_a_time import KneeComparison as KneeComparison
from kneejax.reproduction.paper4._one_at_a_time import KneeStudy as KneeStudy
from kneejax.reproduction.paper4._one_at_a_time import OneAtATime as OneAtATime
from kneejax.reproduction.paper4._one_at_a_time import Outcome as Outcome
