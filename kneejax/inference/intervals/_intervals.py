"""Error bars that hold: a standard error where it tells the limits, else the limits themselves.

Limits are those of the profile likelihood, with the noise that is stated or that the likeliest fit
leaves. They follow the bend of the valley and know of bounds, which a standard error does not.
"""

from __future__ import annotations

import dataclasses
import enum
from collections.abc import Sequence

import numpy as np

from kneejax.inference.fit import Balance, Observations
from kneejax.inference.intervals._likelihood import (
    errors,
    likeliest,
    noise_left,
    on_bounds,
    rise_at_limits,
)
from kneejax.inference.intervals._profile_arms import BOUND, Pace
from kneejax.inference.intervals._profiles import Profile, follow_to_the_lowest
from kneejax.inference.intervals._uncertainty import uncertainty
from kneejax.statics import Slopes

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
    """What is known of a parameter, in the word that tables print."""

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
    """

    kind: IntervalKind
    low: float
    high: float
    standard_error: float = np.nan
    reason: str = ""

    @classmethod
    def of(
        cls,
        profile: Profile,
        value: float,
        error: float,
        lower: float,
        upper: float,
        prior: float = np.inf,
    ) -> Interval:
        """What is known of a parameter.

        A standard error means something where it leads from the estimate to the same limits as the
        profile: the valley is straight, no bound cuts it, and the estimate lies in its middle.

        Args:
            profile: of it, at the likeliest fit.
            value: the estimate that is printed.
            error: its standard error; NaN if it has none.
            lower: bound.
            upper: bound.
            prior: standard deviation of the prior that the profile contains; infinite without one.
                The limits are never farther apart than those of the prior.
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
        root = np.sqrt(profile.threshold)
        low, high, alone = _within_prior(low, high, profile.estimate, root * prior)
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


def _within_prior(
    low: float, high: float, likeliest: float, prior: float
) -> tuple[float, float, bool]:
    """Limits no farther apart than a prior's, whose half width is given, and whether they are
    nearly its own."""
    sides = np.array([likeliest - low, high - likeliest])
    # A limit beyond a bound is missing: the other side tells how wide the posterior is.
    half = float(np.nanmean(sides))
    sides *= min(1.0, prior / half)
    return float(likeliest - sides[0]), float(likeliest + sides[1]), half > _PRIOR_ALONE * prior


def same_ends(ends: Sequence[float], others: Sequence[float]) -> bool:
    """Whether two intervals tell the same story."""
    both = np.array([ends, others])
    if not np.isfinite(both).all():
        return False
    width = max(both[0, 1] - both[0, 0], 1e-300)
    return bool(np.all(np.abs(both[0] - both[1]) <= SAME * width))


@dataclasses.dataclass(frozen=True)
class Surety:
    """How sure an answer is.

    Attributes:
        intervals: one per value.
        likeliest: values at the maximum of the likelihood, `(p,)`.
        correlation: of the answer's values, `(p, p)`; NaN for those on a bound.
        noise: standard deviation of each coordinate, degrees and mm, `(5,)`.
        noise_estimated: whether any of it was estimated from what the likeliest fit leaves.
        converged: whether that fit converged.
    """

    intervals: tuple[Interval, ...]
    likeliest: np.ndarray
    correlation: np.ndarray
    noise: np.ndarray
    noise_estimated: bool
    converged: bool


def sureties(
    balance: Balance,
    data: Observations,
    answers: Slopes,
    weights: np.ndarray,
    stated: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    names: Sequence[tuple[str, str]],
) -> list[Surety]:
    """Limits of many fits at once that minimised a weighted sum of squares.

    Weights need not be the inverse variances of the measurement (those of paper 1 are not). Limits
    are therefore taken from the likelihood, around its own best fit, and so are the same whatever
    the weights. A standard error is that of the weighted answer.

    Args:
        balance: of the values.
        data: measured motion; of its noise only what is infinite counts.
        answers: balances at the answers, with their derivatives.
        weights: of the sum, `(5,)`.
        stated: standard deviation of each coordinate, NaN where it is to be estimated, `(5,)`.
        lower: bounds, `(p,)`.
        upper: bounds.
        names: of the values, with their units.

    Returns:
        One per answer.
    """
    unknown, size = bool(np.isnan(stated).any()), len(names)
    spare = int((data.seen.sum(axis=0) - data.taken)[weights > 0].sum()) - size
    if unknown and spare <= 0:
        return [_nothing_known(size, NO_NOISE) for _ in answers.values]
    with np.errstate(divide="ignore"):
        data = dataclasses.replace(data, noise=1.0 / np.sqrt(weights))
    noise = noise_left(data, answers, stated, lower, upper)
    first = dataclasses.replace(data, noise=noise)
    fits, weighed = likeliest(balance, first, answers, stated, lower, upper)
    threshold = rise_at_limits(spare if unknown else None)
    here, found = follow_to_the_lowest(
        balance, weighed, fits, lower, upper, threshold, names, Pace.LIMITS
    )
    prior = np.full(size, np.inf) if data.prior is None else data.prior[1]
    judged = []
    for row, profiles in enumerate(found):
        own, at_answer = weighed.noise[row], answers.take([row])
        error, jacobian = errors(data.take([row]), at_answer)
        values = at_answer.values[0]
        held = on_bounds(values, lower, upper)
        linear = uncertainty(
            jacobian, error, weights, held, np.where(np.isinf(own), np.nan, own),
            data.seen[data.counted].T, data.take([row]).beside_poses(at_answer)[1][0],
        )  # fmt: skip
        judged.append(
            Surety(
                _intervals(profiles, values, linear.standard_error, lower, upper, prior),
                here.values[row],
                linear.correlation,
                own,
                unknown,
                bool(fits.converged[row]),
            )
        )
    return judged


def _intervals(profiles, values, error, lower, upper, prior) -> tuple[Interval, ...]:
    if any(profile.better for profile in profiles):
        # Where lower valleys are found over and over, limits are those of none.
        return _nothing_known(len(profiles), LOWER_MINIMA).intervals
    return tuple(map(Interval.of, profiles, values, error, lower, upper, prior))


def _nothing_known(size: int, reason: str) -> Surety:
    nothing = Interval(IntervalKind.NOT_COMPUTED, np.nan, np.nan, reason=reason)
    return Surety(
        (nothing,) * size,
        np.full(size, np.nan),
        np.full((size, size), np.nan),
        np.full(5, np.nan),
        True,
        True,
    )
