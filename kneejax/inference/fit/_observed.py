"""What was observed, where, and how well: as stated, or as a fit leaves it."""

__all__ = [
    "DEFAULT_WEIGHTS", "TABLE_UNITS", "Balance", "Noise", "Observations", "on_bounds", "table_of",
]

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from numpy.typing import ArrayLike

from kneejax.geometry import CLINICAL, FEMORAL, FREE_COORDINATES, convert, table_units
from kneejax.numerics import lanes_for
from kneejax.parameters import UnsuitableData
from kneejax.statics import LoadCases, Slopes

if TYPE_CHECKING:
    from kneejax.inference.fit._cut import Passage
    from kneejax.inference.fit._observations import Readings

#: Degrees and mm per internal unit of a free coordinate.
TABLE_UNITS = table_units(FREE_COORDINATES)
#: Balances at values `(fits, p)`, reached from near ones, with their derivatives by the values.
Balance = Callable[..., Slopes]


def table_of(found: Slopes) -> tuple[np.ndarray, np.ndarray]:
    """Where the tibia, whose coordinates stand first, is in balances under a prescribed flexion,
    degrees and mm, `(fits, load_cases, 5)`, and by the values, `(fits, load_cases, 5, p)`."""
    q, slope = _of_tibia(found)
    return q * TABLE_UNITS, slope * TABLE_UNITS[:, None]


def _of_tibia(found: Slopes) -> tuple[np.ndarray, np.ndarray]:
    own = slice(len(TABLE_UNITS))
    return found.q[..., own], found.jacobian[..., own, :]


def _in_all(number: float) -> Any:
    """A field that has one number at every load case where nobody says more."""
    return dataclasses.field(default_factory=lambda: np.array(number))


@dataclasses.dataclass(frozen=True)
class Observations:
    """What was observed of a knee, and how well it is known.

    Attributes:
        load_cases: where: flexion, loads, and what was held.
        target: free coordinates, degrees and mm, `(load_cases, 5)`, or one set per fit
            `(fits, load_cases, 5)`; NaN where a coordinate was not observed.
        noise: standard deviation of each coordinate, degrees and mm, `(5,)`, or one set per fit
            `(fits, 5)`; infinite for a coordinate that does not count.
        offsets: free coordinates whose constant difference to the measurement is free.
        used: load cases that count, `(load_cases,)`; all by default.
        prior: means and standard deviations of the values, `(p,)` each, that count as observed too,
            means perhaps one set per fit `(fits, p)`; None where nothing is known beforehand.
        clinical: whose translations are those of Grood and Suntay, `(load_cases,)`; frame offsets
            are not of these.
        neutral: load case from which each one is counted, `(load_cases,)`; -1, the default, where
            the pose counts as it is.
        group: load cases that share unknown constants, one a coordinate: their number
            `(load_cases,)`; -1, the default, for cases without.
        spread: times its coordinate's noise that an observation has, `(load_cases, 5)`, or one set
            per fit `(fits, load_cases, 5)`, infinite for one that does not count; 1 by default.
        cuts: what was cut, a set of ligaments each; the first is that of a whole knee, none.
        cut: which of these each load case had, `(load_cases,)`; the first by default.
        readings: forces and strains that were read of parts of the knee; None without any.
        passages: load cases that a knee in motion passes; all others are balances.
    """

    load_cases: LoadCases
    target: np.ndarray
    noise: np.ndarray
    offsets: tuple[str, ...] = ()
    used: np.ndarray = _in_all(True)
    prior: tuple[np.ndarray, np.ndarray] | None = None
    clinical: np.ndarray = _in_all(False)
    neutral: np.ndarray = _in_all(-1)
    group: np.ndarray = _in_all(-1)
    spread: np.ndarray = _in_all(1.0)
    cuts: tuple[tuple[str, ...], ...] = ((),)
    cut: np.ndarray = _in_all(0)
    readings: "Readings | None" = None
    passages: "tuple[Passage, ...]" = ()

    def __post_init__(self) -> None:
        count = len(self.load_cases)
        for name in ("used", "clinical", "neutral", "group", "cut", "spread"):
            shape, given = (count, 5) if name == "spread" else (count,), getattr(self, name)
            if given.ndim == 0:
                object.__setattr__(self, name, np.broadcast_to(given, shape))

    @property
    def numbers(self) -> int:
        """How many numbers were observed and count."""
        return int(self.seen.sum()) + (0 if self.readings is None else len(self.readings))

    @property
    def seen(self) -> np.ndarray:
        """Which numbers were observed and count, `(load_cases, 5)`; the same in every fit."""
        one = self.target.reshape(-1, len(self.load_cases), 5)[0]
        return ~np.isnan(one) & self.used[:, None]

    @property
    def posed(self) -> np.ndarray:
        """Load cases in the frame to which offsets lead, `(load_cases,)`."""
        return ~self.clinical

    @property
    def taken(self) -> np.ndarray:
        """Constants that are taken out of each coordinate, `(5,)`."""
        taken, seen = np.zeros(5, int), self.seen
        for rows, column in self._constants():
            taken[column] += seen[rows, column].any()
        return taken

    def _constants(self) -> list[tuple[np.ndarray, int]]:
        """Rows and column of each unknown constant."""
        found = [(self.posed, FREE_COORDINATES.index(name)) for name in self.offsets]
        groups = [self.group == g for g in np.unique(self.group[self.group >= 0])]
        return found + [(rows, column) for rows in groups for column in range(5)]

    def take(self, rows) -> "Observations":
        """The data of some of the fits."""
        axes = {"target": 2, "noise": 1, "spread": 2}  # of one set for all fits
        each: dict[str, Any] = {x: getattr(self, x) for x in axes}
        some = {name: x[rows] for name, x in each.items() if x.ndim > axes[name]}
        if self.prior is not None and self.prior[0].ndim == 2:
            some["prior"] = self.prior[0][rows], self.prior[1]
        return dataclasses.replace(self, **some)

    def observed(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """What balances give to compare with the target, degrees and mm, `(fits, load_cases, 5)`,
        and its derivative by the values, `(fits, load_cases, 5, p)`."""
        q, slope = _of_tibia(found)
        if self.clinical.any():
            read, turn = _read_all(np.asarray(self.load_cases.flexion), q)
            q = np.where(self.clinical[:, None], read, q)
            slope = np.where(self.clinical[:, None, None], turn @ slope, slope)
        value, slope = q * TABLE_UNITS, slope * TABLE_UNITS[:, None]
        away = self.neutral[:, None] >= 0
        if not away.any():
            return value, slope
        return (
            value - np.where(away, value[:, self.neutral], 0.0),
            slope - np.where(away[..., None], slope[:, self.neutral], 0.0),
        )

    def error(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """Model minus observation, the best unknown constants taken out, and by the values; as
        `observed`, zero where nothing was observed or a load case does not count."""
        value, slope = self.observed(found)
        seen = self.seen
        error = np.where(seen, value - self.target, 0.0)
        slope = np.where(seen[..., None], slope, 0.0)
        for rows, column in self._constants():
            known = np.where(rows & seen[:, column], self.spread[..., column] ** -2.0, 0.0)
            without_mean(error[..., column], slope[..., column, :], known)
        return error, slope

    def residual(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """Errors over their standard deviations `(fits, r)`, and by the parameters; zero where
        nothing was observed. Those of poses come first, then what was read of the knee's parts, and
        what was known beforehand."""
        error, slope = (each[:, self.used] for each in self.error(found))
        noise = self.noise[..., None, :] * self.spread[..., self.used, :]
        fits, size = found.values.shape
        rows = [(error / noise).reshape(fits, -1)]
        slopes = [(slope / noise[..., None]).reshape(fits, rows[0].shape[1], size)]
        if self.readings is not None:
            read, slope = self.readings.error(self, found)
            rows.append(read / self.readings.sd)
            slopes.append(slope / self.readings.sd[:, None])
        if self.prior is not None:
            mean, deviation = self.prior
            rows.append((found.values - mean) / deviation)
            slopes.append(np.broadcast_to(np.diag(1.0 / deviation), (fits, size, size)))
        return np.hstack(rows), np.concatenate(slopes, axis=1)


def without_mean(error: np.ndarray, slope: np.ndarray, weight: np.ndarray) -> None:
    """Take the best constant out of errors `(fits, n)`, weight `(n,)` or `(fits, n)`, and of
    slopes, in place."""
    own = np.flatnonzero(weight.reshape(-1, weight.shape[-1]).any(axis=0))
    share = weight[..., own] / np.maximum(weight.sum(axis=-1, keepdims=True), 1e-300)
    error[:, own] -= np.sum(error[:, own] * share, axis=-1, keepdims=True)
    slope[:, own] -= np.sum(slope[:, own] * share[..., None], axis=1, keepdims=True)


def _read_all(flexion: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Free coordinates `(fits, load_cases, 5)` of Grood and Suntay, and by those of the package."""
    shape = q.shape[:2]
    count = shape[0] * shape[1]
    # Arms of profiles end one by one: a program for each number of fits took a second each.
    node = np.minimum(np.arange(lanes_for(count)), count - 1)
    found = _read(np.broadcast_to(flexion, shape).ravel()[node], q.reshape(count, -1)[node])
    read, turn = (np.asarray(x)[:count].reshape(*shape, *x.shape[1:]) for x in found)
    return read, turn


@jax.jit
def _read(flexion: Array, q: Array) -> tuple[Array, Array]:
    """The same of nodes, `(nodes, 5)`."""

    def one(flexion: Array, q: Array) -> Array:
        return convert(jnp.concatenate([flexion[None], q]), FEMORAL, CLINICAL)[1:]

    return jax.vmap(lambda f, x: (one(f, x), jax.jacfwd(one, 1)(f, x)))(flexion, q)


#: Weights of paper 1, section 3.4: 8 per degree^2, 1 per mm^2, in the order of the coordinates.
DEFAULT_WEIGHTS = np.array([8.0, 8.0, 1.0, 1.0, 1.0])
#: No data are better known than this, degrees and mm: what a fit without noise leaves is rounding.
_LEAST = 1e-9


@dataclasses.dataclass(frozen=True, eq=False)
class Noise:
    """Standard deviations of the five free coordinates, degrees and mm.

    What is not stated is estimated from what the best fit leaves, of rotations and of displacements
    apart, and the fit is made again with it, so that estimates and their limits are of one sum of
    squares. Weights that a person gives fix the ratios of the deviations, and one factor of all is
    estimated.

    Attributes:
        stated: standard deviations, NaN where nobody states one, infinite for a coordinate that
            does not count, `(5,)`.
        ratio: of those that are estimated to each other, `(5,)`.
        given: whether weights were given, so that all is estimated, whatever is stated.

    Example:
        >>> Noise.of(noise_mm=0.2).first.round(3).tolist()
        [0.071, 0.071, 0.2, 0.2, 0.2]
    """

    stated: np.ndarray
    ratio: np.ndarray
    given: bool = False

    @classmethod
    def of(
        cls,
        noise_mm: float | None = None,
        noise_deg: float | None = None,
        weights: ArrayLike | None = None,
    ) -> "Noise":
        """From what a person states.

        Args:
            noise_mm: standard deviation of measured displacements; None to be estimated.
            noise_deg: of measured rotations.
            weights: of squared errors, per degree^2 and per mm^2, `(5,)`: 0 for a coordinate that
                does not count, NaN for one whose noise weighs it.

        Raises:
            UnsuitableData: a deviation that is not a positive number.
        """
        for name, value in (("noise_mm", noise_mm), ("noise_deg", noise_deg)):
            if value is not None and not (np.isfinite(value) and value > 0):
                raise UnsuitableData(f"{name}: {value:g}: expected a standard deviation above 0")
        stated = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm], float)
        weights = np.full(5, np.nan) if weights is None else np.asarray(weights, float)
        counts = ~(weights == 0)
        stated = np.where(counts, stated, np.inf)
        given = weights[counts]
        if np.isnan(given).any():
            return cls(stated, DEFAULT_WEIGHTS**-0.5)
        units = given * stated[counts] ** 2
        ratio = np.where(counts, weights, 1.0) ** -0.5
        if np.allclose(units, units[0], rtol=1e-6):
            return cls(stated, ratio)
        return cls(stated, ratio, given=True)

    @property
    def counted(self) -> np.ndarray:
        """Coordinates that count, `(5,)`."""
        return ~np.isinf(self.stated)

    @property
    def unknown(self) -> np.ndarray:
        """Coordinates whose noise is estimated, `(5,)`."""
        return self.counted if self.given else np.isnan(self.stated)

    @property
    def estimated(self) -> bool:
        """Whether any of it is."""
        return bool(self.unknown.any())

    @property
    def weighs(self) -> bool:
        """Whether it decides, as estimated, what a square weighs."""
        return self.estimated and not self.given

    @property
    def unit(self) -> float:
        """What the first sum of squares rises by where chi squared does by one; infinite where the
        noise is not known."""
        return np.inf if self.estimated else 1.0

    @property
    def first(self) -> np.ndarray:
        """Standard deviations with which a search begins, `(5,)`: where some are stated, the others
        in their ratio to these."""
        known = self.counted & ~self.unknown
        scale = (self.stated / self.ratio)[known].mean() if known.any() else 1.0
        return np.where(self.unknown, scale * self.ratio, self.stated)

    def as_stated(self) -> "Noise":
        """The same by what is stated alone: of weights counts only which are zero."""
        return Noise(self.stated, DEFAULT_WEIGHTS**-0.5)

    def left(
        self, data: Observations, fits: Slopes, lower: np.ndarray, upper: np.ndarray
    ) -> np.ndarray:
        """The noise as the best fits within bounds leave it, `(fits, 5)`; what is stated stays. The
        noise of the data weighs what the parameters have absorbed."""
        noise = np.array(np.broadcast_to(data.noise, (len(fits.values), 5)), float)
        noise = np.where(self.unknown, noise, self.stated)
        if not self.estimated:
            return noise
        poses = int(data.used.sum())
        seen = data.seen[data.used].T
        # Each constant that was taken out takes the freedom of one number from its coordinate.
        share = 1.0 - data.taken / np.maximum(seen.sum(axis=1), 1)
        residual, slope = dataclasses.replace(data, noise=noise).residual(fits)
        for row, free in enumerate(~on_bounds(fits.values, lower, upper)):
            columns = slope[row, : 5 * poses, free].T.reshape(poses, 5, -1)
            errors = residual[row, : 5 * poses].reshape(poses, 5)
            # A pose that was lost says nothing.
            known = np.isfinite(columns).all(axis=(1, 2)) & np.isfinite(errors).all(axis=1)
            columns = columns[known].reshape(5 * known.sum(), -1)
            size = np.linalg.norm(columns, axis=0)
            left, *_ = np.linalg.svd(columns / np.where(size > 0, size, 1.0), full_matrices=False)
            absorbed = (left**2).sum(axis=1).reshape(-1, 5).T
            squares = errors[known].T ** 2
            # Coordinates that share an estimated factor.
            for group in ((0, 1, 2, 3, 4),) if self.given else ((0, 1), (2, 3, 4)):
                own = [k for k in group if self.unknown[k]]
                spare = float((seen[own][:, known] - absorbed[own]).sum(axis=1) @ share[own])
                if spare > 1e-9:
                    sums = squares[own].sum(axis=1) * (noise[row, own] / self.ratio[own]) ** 2
                    factor = np.sqrt(sums.sum() / spare)
                    noise[row, own] = np.maximum(factor * self.ratio[own], _LEAST)
        return noise


def on_bounds(values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Which values lie on a bound."""
    width = upper - lower
    return (values - lower < 1e-9 * width) | (upper - values < 1e-9 * width)
