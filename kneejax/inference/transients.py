"""Damping from a recorded transient: least squares over a motion, with its exact derivative.

The start does not depend on dampers and what is at rest tells nothing of them, so the balance at
which a motion begins is computed once. Frames of a record are seldom those of the knee: changes
from the start are compared.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.dynamics import Given, MovingKnee, Trajectory, given_of, move_within, searched
from kneejax.geometry import FREE_COORDINATES, coordinate, coordinates_of
from kneejax.inference.fit import Noise, Observations, fit_lanes, on_bounds, passed
from kneejax.inference.intervals import Uncertainty, maximum_likelihood, uncertainty
from kneejax.mechanics import RANGES, add_lane_axis
from kneejax.numerics import WrongValue
from kneejax.statics import LoadCases, Slopes, converged

#: Evaluations of a motion and its derivative before a fit is given up.
_MOST = 40
#: A grid of steps is made for the dampers of a start; as often it is made anew for those found.
_GRIDS = 3
#: Standard errors to either side of an interval of 95 %.
_SIDES = 1.96


#: What can be found within `RANGES`, by the names of the options of `kneejax simulate`, and what
#: gives a knee that damping.
DAMPING: Mapping[str, Callable[[MovingKnee, Array], MovingKnee]] = {
    "critical": MovingKnee.critically_damped,
    "damping_N_s_per_mm": MovingKnee.damped_everywhere,
    "dissipation_s_per_mm": lambda moving, size: dataclasses.replace(
        moving, contact_dissipation=dict.fromkeys(moving.knee.contact_names, size)
    ),
}


@dataclasses.dataclass(frozen=True)
class Recorded:
    """A recorded motion; refuses (`ValueError`) coordinates that are none of `FREE_COORDINATES`, or
    none at all."""

    time_s: np.ndarray  # rising, the start of the motion first, `(times,)`
    # Coordinate -> its change from the start, degrees or mm, `(times,)`; NaN where it was not seen.
    changes: Mapping[str, np.ndarray]

    def __post_init__(self):
        for name in self.changes:
            if name not in FREE_COORDINATES:
                known = ", ".join(FREE_COORDINATES)
                raise WrongValue("changes", repr(name), f"some of {known}")
        if not self.changes:
            raise WrongValue("changes", "nothing", "a coordinate at least")

    @classmethod
    def of_table(cls, time_s: ArrayLike, columns: Mapping[str, ArrayLike]) -> "Recorded":
        """From columns like `anterior_mm`, of which the changes from their first row count."""
        names = {coordinate(name).column: name for name in FREE_COORDINATES}
        rows = {names.get(k, k): np.asarray(x, float) for k, x in columns.items()}
        return cls(np.asarray(time_s, float), {name: x - x[0] for name, x in rows.items()})

    def table(self) -> np.ndarray:
        """All coordinates of `FREE_COORDINATES`, `(times, 5)`; NaN where not seen."""
        nothing = np.full(len(self.time_s), np.nan)
        return np.stack([self.changes.get(name, nothing) for name in FREE_COORDINATES], axis=1)


@dataclasses.dataclass(frozen=True)
class FittedTransient:
    """Dampers that were found."""

    names: tuple[str, ...]  # of `DAMPING`
    values: np.ndarray  # of these, `(p,)`
    lower: np.ndarray  # of an interval of 95 %, by linear propagation; NaN at a bound
    upper: np.ndarray  # likewise
    moving: MovingKnee  # with these dampers
    trajectory: Trajectory  # its motion
    uncertainty: Uncertainty
    # As the fit leaves it, `(5,)`, degrees and mm; infinite for a coordinate that was not seen.
    noise: np.ndarray
    rms: Mapping[str, float]  # coordinate -> of what is left, degrees or mm
    converged: bool  # whether the search ended by itself
    evaluations: int  # of a motion with its derivative


def fit_transient(
    moving: MovingKnee,
    start: ArrayLike,
    recorded: Recorded,
    free: Mapping[str, float],
    *,
    most_mm: float = 0.01,
    progress: Callable[[int], None] | None = None,
    **options,
) -> FittedTransient:
    """Find the dampers, `free` names of `DAMPING` with the values where the search begins, with
    which a knee moves as `recorded` from a balance `start`, rad and mm, `(6 bodies,)`. Degrees and
    mm count each by their own scatter, as the fit leaves it; `most_mm` is left of the error of the
    steps, and `options` are those of `kneejax.dynamics.move`. Raises `ValueError` for names that
    are not in `DAMPING`, none, or no motion to begin with."""
    names = tuple(free)
    if not names or not set(names) <= set(DAMPING):
        raise WrongValue("free", str(list(names)), f"some of {', '.join(DAMPING)}")
    ranges = [RANGES[name] for name in names]
    lower, upper = np.array([(one.lower, one.upper) for one in ranges], float).T
    target = recorded.table()[1:]
    data = Observations(LoadCases.at(np.zeros(len(target))), target, np.ones(target.shape[1]))
    x, evaluations = np.array([[free[name] for name in names]], float), 0
    found, fit, motion, grid = None, None, None, None

    def reported(*_) -> np.ndarray:
        nonlocal evaluations
        evaluations += 1
        if progress is not None:
            progress(evaluations)
        return np.zeros(1, bool)

    for _ in range(_GRIDS):
        with_these = _damped(moving, names, x[0])
        found = move_within(most_mm, with_these, start, recorded.time_s, **options)
        if not converged(np.asarray(found.status)).all():
            sizes = zip(names, x[0].tolist(), strict=True)
            words = ", ".join(f"{name} {size:.4g}" for name, size in sizes)
            raise WrongValue("free", words, "sizes with which the motion lasts")
        if grid is not None and len(found.grid.time_s) <= len(grid.time_s):
            break
        grid = found.grid
        motion = _Motions(moving, names, given_of(moving, start, grid, **options), grid.asked)
        fit = fit_lanes(motion, data, motion(x), x, lower, upper, most=_MOST, far=True,
                       watch=reported)  # fmt: skip
        x = fit.values
    assert found is not None and fit is not None and motion is not None
    seen = data.seen.any(axis=0)
    noise = Noise.of(weights=np.where(seen, np.nan, 0.0))
    best, weighed = maximum_likelihood(motion, data, fit.slopes, noise, lower, upper)
    (error,), _ = weighed.error(best.slopes)
    (x,), (slope,) = best.values, weighed.residual(best.slopes)[1]
    spread = uncertainty(slope, on_bounds(x, lower, upper))
    side = _SIDES * spread.standard_error
    rms = {
        name: float(np.sqrt(np.mean(error[weighed.seen[:, k], k] ** 2)))
        for k, name in enumerate(FREE_COORDINATES)
        if weighed.seen[:, k].any()
    }
    return FittedTransient(
        names, x, x - side, x + side, _damped(moving, names, x), found, spread, weighed.noise[0],
        rms, bool(best.converged[0]), evaluations + best.evaluations,
    )  # fmt: skip


def _damped(moving: MovingKnee, names: Sequence[str], x: Array) -> MovingKnee:
    for k, name in enumerate(names):
        moving = DAMPING[name](moving, x[k])
    return moving


@dataclasses.dataclass(frozen=True)
class _Damped:
    """Damps a moving knee; leaves end in lanes."""

    names: tuple[str, ...]

    def __call__(self, moving: MovingKnee, _, values: Array) -> MovingKnee:
        return add_lane_axis(_damped(moving, self.names, values[0]))


@dataclasses.dataclass(frozen=True, eq=False)
class _Motions:
    """Changes from the start, rad and mm; one program serves all records on as many steps."""

    moving: MovingKnee
    names: tuple[str, ...]
    given: Given
    asked: np.ndarray

    def __call__(self, values: np.ndarray, _: Slopes | None = None) -> Slopes:
        every, damped = coordinates_of(self.moving.knee.bodies), _Damped(self.names)
        known = searched(damped(self.moving, None, jnp.asarray(values)), self.given)
        still, asked = np.zeros((1, len(every), len(self.names))), jnp.asarray(self.asked)
        rows = [every.index(name) for name in FREE_COORDINATES]
        found = passed(damped, self.moving, None, self.given, known, asked, values, still, rows)
        change = found.q - np.asarray(self.given.q)[rows, 0]
        change = np.where(converged(found.status)[..., None], change, np.nan)
        return dataclasses.replace(found, q=change)
