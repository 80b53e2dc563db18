"""What was observed, where, and how well; and constants between model and laboratory frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import FREE_COORDINATES, convert, table_units
from kneejax.statics import Slopes, Stations

#: The package's own convention of poses.
FEMORAL = "femoral"
#: Degrees and mm per internal unit of a free coordinate.
TABLE_UNITS = table_units(FREE_COORDINATES)
#: Weights of paper 1, section 3.4: 8 per degree^2, 1 per mm^2, in the order of the coordinates.
DEFAULT_WEIGHTS = np.array([8.0, 8.0, 1.0, 1.0, 1.0])
#: Balances at values `(fits, p)`, reached from near ones, with their derivatives by the values.
Balance = Callable[[np.ndarray, Slopes], Slopes]


@dataclasses.dataclass(frozen=True)
class LoadCases:
    """What was observed of a knee, and how well it is known.

    Attributes:
        stations: where: flexion, loads, and what was held.
        target: free coordinates, degrees and mm, `(stations, 5)`, or one set per fit
            `(fits, stations, 5)`; NaN where a coordinate was not observed.
        noise: standard deviation of each coordinate, degrees and mm, `(5,)`, or one set per fit
            `(fits, 5)`; infinite for a coordinate that does not count.
        offsets: free coordinates whose constant difference to the measurement is free.
        used: load cases that count, `(stations,)`.
        prior: means and standard deviations of the values, `(p,)` each, that count as observed too;
            None where nothing is known of them beforehand.
        read_as: convention of the target, one of `kneejax.geometry.CONVENTIONS`; any but the
            package's own needs flexion, and nothing else, prescribed.
        neutral: load case from which each one is counted, `(stations,)`, -1 where the pose counts
            as it is; None where all do.
    """

    stations: Stations
    target: np.ndarray
    noise: np.ndarray
    offsets: tuple[str, ...] = ()
    used: np.ndarray | None = None
    prior: tuple[np.ndarray, np.ndarray] | None = None
    read_as: str = FEMORAL
    neutral: np.ndarray | None = None

    @property
    def counted(self) -> np.ndarray:
        """Load cases that count, `(stations,)`."""
        return np.ones(len(self.stations), bool) if self.used is None else self.used

    @property
    def count(self) -> int:
        """Rows of the residual."""
        believed = 0 if self.prior is None else len(self.prior[0])
        return 5 * int(self.counted.sum()) + believed

    def take(self, rows) -> LoadCases:
        """The data of some of the fits."""
        target = self.target if self.target.ndim == 2 else self.target[rows]
        noise = self.noise if self.noise.ndim == 1 else self.noise[rows]
        return dataclasses.replace(self, target=target, noise=noise)

    def observed(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """What the model gives to compare with the target, and its derivative by the values.

        Args:
            found: balances at the stations.

        Returns:
            Degrees and mm, `(fits, stations, 5)`, and by the values `(fits, stations, 5, p)`.
        """
        q, slope = found.q, found.jacobian
        if self.read_as != FEMORAL:
            flexion = np.broadcast_to(np.asarray(self.stations.flexion), q.shape[:2])
            q, turn = map(np.asarray, _read(flexion, q, self.read_as))
            slope = turn @ slope
        value, slope = q * TABLE_UNITS, slope * TABLE_UNITS[:, None]
        if self.neutral is None:
            return value, slope
        counts = self.neutral >= 0
        zero = np.where(counts, self.neutral, 0)
        away = counts[:, None]
        return (
            value - np.where(away, value[:, zero], 0.0),
            slope - np.where(away[..., None], slope[:, zero], 0.0),
        )

    def residual(self, found: Slopes) -> tuple[np.ndarray, np.ndarray]:
        """Errors over their standard deviations `(fits, r)`, and by the parameters; zero where
        nothing was observed."""
        value, slope = self.observed(found)
        error = value - self.target
        unseen = np.broadcast_to(np.isnan(self.target), error.shape)
        error, slope = np.where(unseen, 0.0, error), np.where(unseen[..., None], 0.0, slope)
        error, slope = error[:, self.counted], slope[:, self.counted]
        seen = ~unseen[:, self.counted]
        for name in self.offsets:
            column = FREE_COORDINATES.index(name)
            share = seen[..., column] / np.maximum(seen[..., column].sum(axis=1, keepdims=True), 1)
            shift = (share * error[..., column]).sum(axis=1, keepdims=True)
            turn = np.einsum("fs,fsp->fp", share, slope[..., column, :])[:, None]
            error[..., column] -= np.where(seen[..., column], shift, 0.0)
            slope[..., column, :] -= np.where(seen[..., column, None], turn, 0.0)
        noise = self.noise[..., None, :]
        error, slope = error / noise, slope / noise[..., None]
        error = error.reshape(len(error), -1)
        slope = slope.reshape(len(slope), -1, slope.shape[-1])
        if self.prior is None:
            return error, slope
        mean, deviation = self.prior
        each = np.broadcast_to(np.diag(1.0 / deviation), (len(error), *(len(mean),) * 2))
        believed = (found.values - mean) / deviation
        return np.hstack([error, believed]), np.concatenate([slope, each], axis=1)


@partial(jax.jit, static_argnums=2)
def _read(flexion: Array, q: Array, convention: str) -> tuple[Array, Array]:
    """Free coordinates `(fits, stations, 5)` in a convention, and by those of the package."""

    def one(flexion: Array, q: Array) -> Array:
        return convert(jnp.concatenate([flexion[None], q]), FEMORAL, convention)[1:]

    over_all = jax.vmap(jax.vmap(lambda f, x: (one(f, x), jax.jacfwd(one, 1)(f, x))))
    return over_all(flexion, q)


def with_offsets(balance: Balance, offsets: Sequence[str]) -> Balance:
    """A balance whose last values are constants added to some coordinates.

    `LoadCases.offsets` takes the best constants out of every residual; this makes them values
    like any other, which have bounds and can be held.

    Args:
        balance: of the other values.
        offsets: free coordinates; their constants are in degrees and mm.

    Returns:
        The balance.
    """

    def shifted(values: np.ndarray, near: Slopes) -> Slopes:
        size = values.shape[1] - len(offsets)
        found = balance(values[:, :size], without_offsets(near, offsets))
        return add_offsets(found, values[:, size:], offsets)

    return shifted if offsets else balance


def add_offsets(found: Slopes, shifts: np.ndarray, offsets: Sequence[str]) -> Slopes:
    """Balances with constants `(fits, offsets)` added, degrees and mm, as their last values."""
    q, more = np.array(found.q), np.zeros((*found.q.shape, len(offsets)))
    for k, name in enumerate(offsets):
        row = FREE_COORDINATES.index(name)
        q[..., row] += shifts[:, [k]] / TABLE_UNITS[row]
        more[..., row, k] = 1.0 / TABLE_UNITS[row]
    still = np.zeros((*found.meeting.shape, len(offsets)))
    return dataclasses.replace(
        found,
        values=np.hstack([found.values, shifts]),
        q=q,
        jacobian=np.concatenate([found.jacobian, more], axis=-1),
        meeting_jacobian=np.concatenate([found.meeting_jacobian, still], axis=-1),
    )


def without_offsets(found: Slopes, offsets: Sequence[str]) -> Slopes:
    """The reverse of `add_offsets`."""
    q, size = np.array(found.q), found.values.shape[1] - len(offsets)
    for k, name in enumerate(offsets):
        row = FREE_COORDINATES.index(name)
        q[..., row] -= found.values[:, [size + k]] / TABLE_UNITS[row]
    return dataclasses.replace(
        found,
        values=found.values[:, :size],
        q=q,
        jacobian=found.jacobian[..., :size],
        meeting_jacobian=found.meeting_jacobian[..., :size],
    )


def best_offsets(data: LoadCases, fit: Slopes) -> list[float]:
    """The best constant of each coordinate whose frames may differ, to be added to the model's.

    Args:
        data: measured motion of one fit.
        fit: balances of one variant.

    Returns:
        Degrees or mm, in the order of `data.offsets`.
    """
    target = data.target.reshape(len(data.stations), 5)
    error = (data.observed(fit)[0][0] - target)[data.counted]
    return [-float(error[:, FREE_COORDINATES.index(name)].mean()) for name in data.offsets]
