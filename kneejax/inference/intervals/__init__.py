"""How sure a fit is: chi squared, profiles, intervals."""

from kneejax.inference.intervals._estimate import Interval as Interval
from kneejax.inference.intervals._estimate import IntervalKind as IntervalKind
from kneejax.inference.intervals._estimate import MaximumLikelihood as MaximumLikelihood
from kneejax.inference.intervals._estimate import estimate as estimate
from kneejax.inference.intervals._estimate import maximum_likelihood as maximum_likelihood
from kneejax.inference.intervals._estimate import same_ends as same_ends
from kneejax.inference.intervals._profile_arms import Pace as Pace
from kneejax.inference.intervals._profiles import Profile as Profile
from kneejax.inference.intervals._profiles import Uncertainty as Uncertainty
from kneejax.inference.intervals._profiles import profiles as profiles
from kneejax.inference.intervals._profiles import propagated as propagated
from kneejax.inference.intervals._profiles import uncertainty as uncertainty
