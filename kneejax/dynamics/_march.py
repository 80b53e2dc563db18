"""Steps through time on a grid.

A motion is found first (`found`: a search in every step) and then followed (`follow`: the same
steps as functions of every number, by the implicit rule of statics, without a search). So one
compiled search serves every choice of what is differentiated. Going backwards, each step is
computed anew from the moments before it: memory grows with the moments, not with the mechanics.
"""

__all__ = ["Given", "Grid", "followed", "march", "rising", "searched", "with_idle_steps"]

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from numpy.typing import ArrayLike, NDArray

from kneejax.dynamics._moving import History, Moment, MovingKnee, Step
from kneejax.geometry import coordinates_of, free_of, scales
from kneejax.numerics import WrongValue, compiled, on_all_cores, traced
from kneejax.statics import (
    EnergyNewton,
    Equilibrium,
    Guess,
    converged,
    differentiable,
    solve_equilibrium,
    with_tangent,
)

#: Parts of the first step: it begins with order one, and the errors of that shrink with its square.
_FIRST = (1, 1, 2, 4, 8)
#: Growth of a step against the one before; the formula is stable up to 2.4.
_LONGER = 2.0


def rising(time_s: ArrayLike) -> np.ndarray:
    """Times in s as numbers; raises `WrongValue` where one is not later than that before it.

    Example:
        >>> rising([0.0, 0.1, 0.3]).tolist()
        [0.0, 0.1, 0.3]
    """
    times = np.asarray(time_s, float)
    back = np.flatnonzero(~(np.diff(times) > 0.0))
    if len(back):
        at = back[0]
        raise WrongValue("time_s", f"{times[at + 1]:g} s after {times[at]:g} s", "times that rise")
    return times


@dataclasses.dataclass(frozen=True)
class Grid:
    """Steps through time.

    Attributes:
        time_s: at the end of each step, `(steps,)`, since the start.
        asked: rows of the steps that end at times that were asked for; the start is none of them.
        start_s: when the motion begins: what acts and is led is known over time.
    """

    time_s: NDArray[np.float64]
    asked: NDArray[np.int64]
    start_s: float = 0.0

    @classmethod
    def of(cls, time_s: ArrayLike, within: ArrayLike = 1) -> "Grid":
        """Equal steps between two of the times asked for.

        Args:
            time_s: rising, from the start on, `(times,)`; two at least.
            within: steps between two of them, one number or one for each pair. No step is made
                more than about twice as long as the one before it.

        Raises:
            ValueError: times that do not rise, or fewer than one step.

        Example:
            >>> Grid.of([0.0, 0.1, 0.2]).time_s[[0, 4, 5]].tolist()
            [0.00625, 0.1, 0.2]
        """
        times = np.asarray(time_s, float)
        if times.ndim != 1 or len(times) < 2 or not np.isfinite(times).all():
            raise WrongValue("time_s", str(times), "two finite times at least")
        rising(times)
        count = len(times) - 1
        parts = np.broadcast_to(np.asarray(within, int), (count,)).copy()
        if parts.min() < 1:
            raise WrongValue("within", str(parts.min()), "one step at least between two times")
        span = np.diff(times)
        for k in range(1, count):
            longest = _LONGER * span[k - 1] / parts[k - 1]
            parts[k] = max(parts[k], int(np.ceil(span[k] / longest - 1e-9)))
        first = np.cumsum(_FIRST[:-1]) / sum(_FIRST) * span[0] / parts[0]
        ends = [
            t + length * np.arange(1, n + 1) / n
            for t, length, n in zip(times[:-1], span, parts, strict=True)
        ]
        every = np.concatenate([times[0] + first, *ends])
        return cls(every - times[0], len(first) + np.cumsum(parts) - 1, float(times[0]))

    @property
    def moments_s(self) -> NDArray[np.float64]:
        """The start and the end of each step, `(1 + steps,)`."""
        return self.start_s + np.concatenate([[0.0], self.time_s])

    def within(self) -> NDArray[np.int64]:
        """Steps between two of the times asked for."""
        found = np.diff(self.asked, prepend=-1)
        found[0] -= len(_FIRST) - 1
        return found

    @property
    def length_s(self) -> NDArray[np.float64]:
        """Of each step."""
        return np.diff(self.time_s, prepend=0.0)

    @property
    def ratio(self) -> NDArray[np.float64]:
        """Of each step to the one before; 0 of the first."""
        length = self.length_s
        return np.concatenate([[0.0], length[1:] / length[:-1]])


#: Steps that are computed by one call.
BLOCK = 256
#: Motions that one program computes side by side; more are dealt to all cores.
_MOST_LANES = 32
#: Motions that are followed are filled up to a multiple of so many steps.
_IDLE = 64
#: Derivatives compute the tangents anew: a step need not.
SEARCH = EnergyNewton(atol=1e-9)


class Given(eqx.Module):
    """What is given of a motion.

    Attributes:
        q: of all coordinates at the start, `(6 bodies, lanes)`, rad and mm.
        rate: of them, rad/s and mm/s.
        steps: all of them; the first axis counts.
        pull: of the quadriceps at the start besides its tension at rest, N, `(lanes,)`.
    """

    q: Array
    rate: Array
    steps: Step
    pull: Array | float = 0.0


class Moments(eqx.Module):
    """A motion: what is known at the end of each step, `(steps, ..., lanes)`."""

    known: Moment  # NaN from where a step could not be taken
    contact_points: Array  # where contacts meet
    status: Array  # of the step; that of the one that could not be taken is kept to the end
    looks: Array  # of its search
    # How far the step ended from where it was expected, mm (rotations at 30 mm): its error is a
    # part of that.
    surprise: Array


def march(
    moving: MovingKnee, given: Given, progress: Callable[[int], None] | None = None
) -> Moments:
    """Compute a motion.

    Args:
        moving: leaves end in a lane axis.
        given: what is given.
        progress: is told how many steps are done.

    Returns:
        The motion, differentiable by every number of the knee and of what is given, forward and
        backward; the lengths of steps are fixed.
    """
    if not traced((moving, given)) and given.q.shape[1] > _MOST_LANES:
        return _on_all_cores(moving, given, progress)
    equilibrium = searched(moving, given, progress)
    if traced((moving, given)):
        return followed(moving, given, equilibrium)

    def without_tangents(*block):
        return follow(*block, False)

    rows = given.steps, equilibrium
    moments = _in_blocks(without_tangents, moving, rows, begun(moving, given))
    return jax.tree.map(lambda x: x[: len(given.steps.length_s)], moments)


def _on_all_cores(moving: MovingKnee, given: Given, progress) -> Moments:
    """Many motions, dealt to cores by lanes: one program keeps one core busy."""
    lanes = given.q.shape[1]
    each = -(-lanes // -(-lanes // _MOST_LANES))

    def some(first: int) -> Moments:
        # Filled up with the last: one program serves all parts.
        rows = np.minimum(np.arange(first, first + each), lanes - 1)

        def taken(x):
            return x[..., rows] if jnp.ndim(x) and x.shape[-1] == lanes else x

        own = jax.tree.map(taken, given)
        steps = dataclasses.replace(
            own.steps, length_s=given.steps.length_s, ratio=given.steps.ratio
        )
        own = dataclasses.replace(own, steps=steps)
        return march(jax.tree.map(taken, moving), own, None if first else progress)

    parts = on_all_cores(some, range(0, lanes, each))
    return jax.tree.map(lambda *x: np.concatenate(x, axis=-1)[..., :lanes], *parts)


def searched(
    moving: MovingKnee, given: Given, progress: Callable[[int], None] | None = None
) -> Equilibrium:
    """The balances of all steps of a motion, which depend on nothing.

    Arguments as those of `march`.
    """
    moving, given = lax.stop_gradient((moving, given))
    if traced((moving, given)):
        return found(moving, given.steps, begun(moving, given))[1]
    equilibrium = _in_blocks(found, moving, (given.steps,), begun(moving, given), progress)
    return jax.tree.map(lambda x: x[: len(given.steps.length_s)], equilibrium)


def followed(moving: MovingKnee, given: Given, equilibrium: Equilibrium) -> Moments:
    """The motion whose balances were found (`searched`), as a function of all that it depends on.

    For programs that are differentiated: the search compiles once for all of them.
    """
    return follow(moving, given.steps, equilibrium, begun(moving, given), True)[1]


def with_idle_steps(given: Given, equilibrium: Equilibrium) -> tuple[Given, Equilibrium]:
    """With steps of no length at the end, so that one program follows motions of several lengths.

    Args:
        given: of a motion.
        equilibrium: its balances.

    Returns:
        The same; what is followed of it has moments beyond the last.
    """
    count = -(-len(given.steps.length_s) // _IDLE) * _IDLE
    rows = jax.tree.map(lambda x: _filled_up(x, count), (given.steps, equilibrium))
    return dataclasses.replace(given, steps=rows[0]), rows[1]


def _in_blocks(program, moving: MovingKnee, rows, history: History, progress=None):
    """Steps by the block: one compiled program serves motions of any length."""
    count, blocks = len(jax.tree.leaves(rows)[0]), []
    rows = jax.tree.map(np.asarray, rows)
    for first in range(0, count, BLOCK):
        block = jax.tree.map(lambda x, k=first: _filled_up(x[k : k + BLOCK], BLOCK), rows)
        history, answer = program(moving, *block, history)
        blocks.append(jax.tree.map(np.asarray, answer))
        if progress is not None:
            progress(min(first + BLOCK, count))
    # By NumPy: each length of a motion would compile its own.
    return jax.tree.map(lambda *x: np.concatenate(x), *blocks)


def _filled_up(rows, count: int) -> np.ndarray:
    """Filled up with rows of zeros: steps of no length."""
    rows = np.asarray(rows)
    return np.pad(rows, [(0, count - len(rows))] + [(0, 0)] * (rows.ndim - 1))


@compiled()
def found(moving: MovingKnee, steps: Step, history: History) -> tuple[History, Equilibrium]:
    """The balance of every step; the first axis counts them."""

    names, bodies = coordinates_of(moving.knee.bodies), moving.knee.bodies

    def advance(before: History, step: Step):
        step, idle = _filled(step)

        def taken():
            rows = jnp.array([names.index(name) for name in free_of(step.held, bodies)])
            guess = Guess(before.guess(step)[rows], before.contact_points)
            return solve_equilibrium(before.knee_of(moving, step), step.held, guess, SEARCH)

        def rested():
            return jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), jax.eval_shape(taken))

        equilibrium = lax.cond(jnp.all(before.ended) | idle, rested, taken)
        return _moved_on(moving, before, step, equilibrium, idle), equilibrium

    return lax.scan(advance, history, steps)


@compiled(static_argnums=(4,))
def follow(
    moving: MovingKnee, steps: Step, equilibrium: Equilibrium, history: History, exactly: bool
) -> tuple[History, Moments]:
    """The motion whose balances were found; for derivatives `exactly`, with tangents at these."""
    scale = jnp.array(scales(coordinates_of(moving.knee.bodies)))[:, None]

    @jax.checkpoint  # pyright: ignore[reportPrivateImportUsage]
    def advance(before: History, each: tuple[Step, Equilibrium]):
        step, idle = _filled(each[0])
        knee, known = before.knee_of(moving, step), each[1]
        known = with_tangent(knee, step.held, known) if exactly else known
        balance = differentiable(knee, step.held, known)
        after = _moved_on(moving, before, step, balance, idle)
        off = (after.last.q - before.guess(step)) / scale
        known = jax.tree.map(lambda x: jnp.where(after.ended, jnp.nan, x), after.last)
        surprise = jnp.max(jnp.abs(off), axis=0)
        return after, Moments(known, after.contact_points, after.status, balance.steps, surprise)

    return lax.scan(advance, history, (steps, equilibrium))


def begun(moving: MovingKnee, given: Given) -> History:
    """What goes into the first step."""
    first, contact_points = first_moment(moving, given.q, given.rate, jnp.asarray(given.pull))
    lanes = given.q.shape[1:]
    return History(first, first, contact_points, jnp.zeros(lanes, bool), jnp.zeros(lanes, int))


#: The start of a motion, and where contacts meet there: `Moment.at_first`.
first_moment = compiled()(Moment.at_first)


def _filled(step: Step) -> tuple[Step, Array]:
    """A step, and whether it only fills up a block: it has no length."""
    idle = step.length_s == 0.0
    return dataclasses.replace(step, length_s=jnp.where(idle, 1.0, step.length_s)), idle


def _moved_on(
    moving: MovingKnee, before: History, step: Step, equilibrium: Equilibrium, idle: Array
) -> History:
    """With a step's end in the past, in lanes where the motion goes on."""
    still = before.ended | idle
    goes_on = ~still & converged(equilibrium.status)
    # Nothing is made of coordinates that are NaN: their derivatives would be so everywhere.
    q = equilibrium.state.at(coordinates_of(moving.knee.bodies))
    there = jnp.where(goes_on, q, before.last.q)
    moment = before.after(moving, step, there, jnp.nan_to_num(equilibrium.contact_points))
    last, older, points = jax.tree.map(
        lambda new, old: jnp.where(goes_on, new, old),
        (moment, before.last, equilibrium.contact_points),
        (before.last, before.older, before.contact_points),
    )
    status = jnp.where(still, before.status, equilibrium.status)
    return History(last, older, points, before.ended | (~goes_on & ~idle), status)
