"""The one estimator: the best values, and error bars that hold.

Squared errors weigh by the noise that is stated or that the best fit leaves, priors are
further residuals, and limits are those of the profile of the same sum. They follow the bend of the
valley and know of bounds, which a standard error does not: it is told where it leads to the same.
"""

__all__ = [
    "Interval", "IntervalKind", "MaximumLikelihood", "estimate", "maximum_likelihood", "same_ends",
]

import dataclasses
import enum
from collections.abc import Sequence

import numpy as np

from kneejax.inference.fit import (
    PATIENT,
    Balance,
    ManyFits,
    Noise,
    Observations,
    fit_lanes,
    on_bounds,
)
from kneejax.inference.intervals._profile_arms import BOUND, Pace
from kneejax.inference.intervals._profiles import Profile, follow_to_the_lowest, uncertainty
from kneejax.statics import Slopes

#: Confidence that is asked for.
CONFIDENCE = 0.95
#: Noise and fit depend on each other: so often each is found anew.
_ROUNDS = 3
#: Ends that differ by less than this part of the interval tell the same.
SAME = 0.3
#: Limits that exclude less than this part of what bounds allow tell nothing.
_TELLING = 0.1
#: Part of a prior's standard deviation above which that of the posterior is the prior's own.
_PRIOR_ALONE = 0.9


#: Why limits could not be computed.
NO_NOISE = "no noise is stated, and no reading is left from which to estimate it"
LOWER_MINIMA = "the search for them kept finding better fits"


class IntervalKind(enum.Enum):
    """What is known of a parameter, in the word that tables print.

    Example:
        >>> IntervalKind("one-sided").name
        'ONE_SIDED'
    """

    STANDARD_ERROR = "standard error"
    PROFILE = "profile"
    ONE_SIDED = "one-sided"
    PRIOR = "prior"
    NOT_DETERMINED = "not determined"
    NOT_COMPUTED = "not computed"

    @property
    def from_data(self) -> bool:
        """Whether the data limit the parameter, on one side at least."""
        return self in (IntervalKind.STANDARD_ERROR, IntervalKind.PROFILE, IntervalKind.ONE_SIDED)

    @property
    def has_limits(self) -> bool:
        """Whether there is a limit, of the data or of the prior."""
        return self.from_data or self is IntervalKind.PRIOR


@dataclasses.dataclass(frozen=True)
class Interval:
    """What data say about one parameter, with 95 % confidence.

    Attributes:
        kind: which of the numbers mean something; `PRIOR` where the limits are those that the
            prior sets without the data.
        low: lower limit; NaN if there is none.
        high: upper limit; NaN if there is none.
        standard_error: NaN unless it tells the limits as well.
        reason: why a limit could not be computed; empty otherwise.

    Example:
        >>> one = Interval(IntervalKind("profile"), 4127.0, 6081.0)
        >>> one.low, one.high
        (4127.0, 6081.0)
    """

    kind: IntervalKind
    low: float
    high: float
    standard_error: float = np.nan
    reason: str = ""

    @classmethod
    def of(
        cls, profile: Profile, value: float, error: float, lower: float, upper: float,
        prior: float = np.inf,
    ) -> "Interval":  # fmt: skip
        """What is known of a parameter.

        A standard error means something where it leads from the estimate to the same limits as the
        profile: the valley is straight, no bound cuts it, and the estimate lies in its middle.
        `prior` is the standard deviation of the prior that the profile contains.
        """
        failed = [why for why in (profile.low_open, profile.high_open) if why not in ("", BOUND)]
        reason = failed[0] if failed else ""
        low = np.nan if profile.low_open else profile.low
        high = np.nan if profile.high_open else profile.high
        excluded = upper - lower - (profile.high - profile.low)
        both_open = profile.low_open and profile.high_open
        if both_open or not excluded > _TELLING * (upper - lower):
            kind = IntervalKind.NOT_COMPUTED if failed else IntervalKind.NOT_DETERMINED
            return cls(kind, np.nan, np.nan, reason=reason)
        root, best = np.sqrt(profile.threshold), profile.estimate
        # Limits are no farther apart than those of the prior. One beyond a bound is missing: the
        # other side tells how wide the posterior is.
        wide = float(np.nanmean([best - low, high - best]))
        share, alone = min(1.0, root * prior / wide), wide > _PRIOR_ALONE * root * prior
        low, high = float(best - share * (best - low)), float(best + share * (high - best))
        half = root * error
        straight = same_ends((low, high), (value - half, value + half))
        error = float(error) if straight else np.nan
        if alone:
            return cls(IntervalKind.PRIOR, low, high, error, reason)
        if not profile.closed:
            return cls(IntervalKind.ONE_SIDED, low, high, reason=reason)
        return cls(
            IntervalKind.STANDARD_ERROR if straight else IntervalKind.PROFILE, low, high, error
        )

    def beside(self, value: float, best: float) -> "Interval":
        """The same of an answer that a search in stages gives, which need not be the best fit."""
        if value < self.low or value > self.high:
            reason = f"this search ends beside the best fit, which has {best:.4g}"
            return Interval(IntervalKind.NOT_COMPUTED, np.nan, np.nan, reason=reason)
        if abs(value - best) > SAME * (self.high - self.low):
            if self.kind is IntervalKind.STANDARD_ERROR:
                return Interval(IntervalKind.PROFILE, self.low, self.high)
            return dataclasses.replace(self, standard_error=np.nan)
        return self


def same_ends(ends: Sequence[float], others: Sequence[float]) -> bool:
    """Whether two intervals tell the same story.

    Example:
        >>> same_ends((1.0, 2.0), (1.1, 2.1)), same_ends((1.0, 2.0), (1.0, 3.0))
        (True, False)
    """
    both = np.array([ends, others])
    if not np.isfinite(both).all():
        return False
    width = max(both[0, 1] - both[0, 0], 1e-300)
    return bool(np.all(np.abs(both[0] - both[1]) <= SAME * width))


@dataclasses.dataclass(frozen=True, eq=False)
class MaximumLikelihood:
    """The best fit to some data, and how sure it is."""

    best: Slopes  # at the lowest sum of squares that is known, one fit
    intervals: tuple[Interval, ...]  # around its values, one each
    correlation: np.ndarray  # of its values, `(p, p)`; NaN for those on a bound
    noise: np.ndarray  # standard deviation of each coordinate, degrees and mm, `(5,)`
    noise_estimated: bool  # whether any of it was estimated from what this fit leaves
    converged: bool  # whether the fit converged
    profiles: tuple[Profile, ...] = ()  # from which the intervals are read


def maximum_likelihood(
    balance: Balance, data: Observations, near: Slopes, noise: Noise, lower: np.ndarray,
    upper: np.ndarray, *, far: bool = False,
) -> tuple[ManyFits, Observations]:  # fmt: skip
    """Fit by maximum likelihood, many times at once; arguments as in `estimate`.

    Returns:
        The fits, and the data with the noise that is stated or that the fits leave, `(fits, 5)`.
    """
    weighed = np.broadcast_to(data.noise, (len(near.values), 5))
    weighed = np.where(noise.unknown, weighed, noise.stated)
    data = dataclasses.replace(data, noise=weighed)
    for _ in range(_ROUNDS if noise.estimated else 1):
        fits = fit_lanes(balance, data, near, near.values, lower, upper, most=PATIENT, far=far)
        near, far = fits.slopes, False
        data = dataclasses.replace(data, noise=noise.left(data, near, lower, upper))
    return fits, data


def estimate(
    balance: Balance, data: Observations, near: Slopes, noise: Noise, lower: np.ndarray,
    upper: np.ndarray, names: Sequence[tuple[str, str]], pace: Pace = Pace.LIMITS, *,
    far: bool = False,
) -> list[MaximumLikelihood]:  # fmt: skip
    """The best fits to data, one for all or one each, with their limits: those of the profile
    likelihood.

    The noise of the data weighs the first fit where some is to be estimated. Fits begin at balances
    `near`; `far` says whether their answers may be far from there, and `pace` whether the whole
    profiles are wanted or their limits only.
    """
    size = len(names)
    spare = int((data.seen.sum(axis=0) - data.taken)[noise.counted].sum()) - size
    rows, kind = range(len(near.values)), IntervalKind.NOT_COMPUTED
    if noise.estimated and spare <= 0:
        intervals = (Interval(kind, np.nan, np.nan, reason=NO_NOISE),) * size
        nothing = np.full((size, size), np.nan), np.full(5, np.nan), True, True
        return [MaximumLikelihood(near.take([row]), intervals, *nothing) for row in rows]
    if noise.estimated:
        # What earlier fits leave tells more than the first weights.
        data = dataclasses.replace(data, noise=noise.left(data, near, lower, upper))
    fits, weighed = maximum_likelihood(balance, data, near, noise, lower, upper, far=far)
    # `scipy.stats` takes half a second to import.
    from scipy import special

    # The F distribution where the noise is estimated from what the fit leaves, or chi squared.
    known = special.chdtri(1, 1.0 - CONFIDENCE)
    threshold = float(special.fdtri(1, spare, CONFIDENCE) if noise.estimated else known)
    here, found = follow_to_the_lowest(balance, weighed, fits, lower, upper, threshold, names, pace)
    prior = np.full(size, np.inf) if data.prior is None else data.prior[1]
    _, slope = weighed.residual(here)
    judged = []
    for row, profiles in zip(rows, found, strict=True):
        values = here.values[row]
        linear = uncertainty(slope[row], on_bounds(values, lower, upper))
        if any(one.better for one in profiles):
            # Where lower valleys are found over and over, limits are those of none.
            intervals = (Interval(kind, np.nan, np.nan, reason=LOWER_MINIMA),) * size
        else:
            every = profiles, values, linear.standard_error, lower, upper, prior
            intervals = tuple(map(Interval.of, *every))
        judged.append(
            MaximumLikelihood(
                here.take([row]), intervals, linear.correlation, weighed.noise[row],
                noise.estimated, bool(fits.converged[row]), profiles,
            )
        )  # fmt: skip
    return judged
