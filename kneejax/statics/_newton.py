"""A globalised Newton search for balance, one decision per lane, as an optimistix root finder.

Plain Newton on the forces finds wrong branches (a knee turned by 166 degrees has been seen). Here
every step must not raise the energy at constant loads, so the search runs downhill to a stable
balance. Where the tangent is not positive definite, or a step was refused, a multiple of the
identity is added to it. Lanes decide alone: one bad lane slows the others but never changes them.

A look begins its search for the points where surfaces meet at those of the best pose so far; where
one is not found the energy is infinite, and the step is refused. Every look computes the tangent:
docs/performance.md says what leaving it out has cost.

Lengths are in mm: rotations count at 30 mm. A scale is what counts as 1 mm of a free coordinate,
rad or mm.
"""

__all__ = ["EnergyNewton", "Guess"]

import dataclasses
import enum
import functools
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array, lax

from kneejax.geometry import Prescribed, free_of, scales
from kneejax.mechanics import Knee
from kneejax.numerics import identity, solve, symmetric
from kneejax.statics._balance import Balance, linearised, rows_of_force

_LONGEST_STEP = 3.0
# Relative rounding that an energy difference may show near the solution.
_ROUNDING = 1e-11
# Step, mm, below which falling forces are enough to accept it.
_CLOSE = 1e-3
# A step below the first, mm, that is not shorter than this part of the one before it is rounding:
# that of a force, in a direction in which next to nothing holds.
_ROUNDED, _SHRINKS = 1e-6, 0.1
# N/mm added to the tangent in vain: who is here will not find anything any more.
_HOPELESS = 1e8
# N/mm that are tried first where a stiffness is not positive definite, and how much more then.
_LEAST, _MORE, _MOST = 0.5, 4.0, 1e12
#: Squares of a load that is unlike in every coordinate, of up to three bodies.
_PRIMES = (2.0, 3.0, 5.0, 7.0, 11.0, 13.0, 17.0, 19.0, 23.0, 29.0, 31.0, 37.0,
           41.0, 43.0, 47.0, 53.0, 59.0, 61.0)  # fmt: skip


def size_of(rows: Sequence[Array] | Array) -> Array:
    """Largest entry of each lane."""
    return functools.reduce(jnp.maximum, map(jnp.abs, rows))


def _scaled(rows: Sequence[Array] | Array, scales: Sequence[float]) -> tuple[Array, ...]:
    return tuple(scale * row for scale, row in zip(scales, rows, strict=True))


def _scaled_tangent(tangent: Array, scales: Sequence[float]) -> Array:
    """A stiffness per mm of every coordinate, N/mm."""
    units = jnp.asarray(scales).reshape(len(scales), *(1,) * (tangent.ndim - 2))
    return tangent * units[:, None] * units[None]


def damped_step(
    tangent: Array, residual: Sequence[Array] | Array, damping: Array, scales: Sequence[float]
) -> tuple[Array, Array]:
    """Newton step `(free, lanes)`, mm, with a multiple of the identity added to the stiffness: the
    damping `(lanes,)`, N/mm, or more where the stiffness is not positive definite with it; and
    what was added."""
    right, unit = _scaled(residual, scales), identity(len(scales), damping.ndim)
    right, stiffness = tuple(-row for row in right), _scaled_tangent(tangent, scales)

    def tried(state: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        added, _, _ = state
        step, pivots = solve(stiffness + added * unit, right)
        definite = functools.reduce(jnp.logical_and, [~(pivot <= 0.0) for pivot in pivots])
        more = jnp.where(added > 0.0, _MORE * added, _LEAST)
        return jnp.where(definite | (added > _MOST), added, more), definite, jnp.stack(step)

    nothing = jnp.zeros((len(scales), *damping.shape))
    state = damping, jnp.zeros(damping.shape, bool), nothing
    added, _, step = lax.while_loop(
        lambda state: jnp.any(~state[1] & (state[0] <= _MOST)), tried, state
    )
    return step, added


def newton_step_left(
    tangent: Array, residual: Sequence[Array] | Array, scales: Sequence[float]
) -> tuple[Array, Array]:
    """The largest part of the Newton step that is left to a balance, mm, `(lanes,)`; and the pivots
    of the scaled symmetric tangent, `(free, lanes)`."""
    stiffness = _scaled_tangent(symmetric(tangent), scales)
    step, pivots = map(jnp.stack, solve(stiffness, _scaled(residual, scales)))
    return jnp.max(jnp.abs(step), axis=0), pivots


def softness_of(tangent: Array, scales: Sequence[float]) -> tuple[Array, Array]:
    """How little force moves a knee, N/mm, `(lanes,)`: near zero where the stiffness is singular,
    not positive where it is not positive definite; and the pivots of the scaled symmetric tangent.

    Pivots alone do not tell: the least eigenvalue was a twentieth of the least pivot where a knee
    gave way by turning and sliding at once. A step under some load in every coordinate does.
    """
    # Any load will do that is not square to the direction that gives; these are unlike each other.
    squares = _PRIMES[: len(scales)]
    load = np.sqrt(squares) / np.asarray(scales)
    left, pivots = newton_step_left(tangent, list(load), scales)
    size = float(np.sqrt(sum(squares)))
    return jnp.where(jnp.all(pivots > 0, axis=0), size / left, jnp.min(pivots, axis=0)), pivots


class Guess(eqx.Module):
    """Where a search begins.

    Attributes:
        q: free coordinates `(free, lanes)`, rad and mm.
        contact_points: parameters of points near those where surfaces meet, `(n, 2, lanes)`; None,
            or NaN, where they are not known.

    Example:
        >>> import jax.numpy as jnp
        >>> Guess(jnp.zeros((5, 1))).q.shape
        (5, 1)
    """

    q: Array
    contact_points: Array = eqx.field(default=None)


class Phase(enum.IntEnum):
    """Where a lane's search stands."""

    SEARCHING = 0
    FOUND = 1
    LOST = 2


class SearchState(eqx.Module):
    """Of a search; arrays end in lanes."""

    best: Guess  # the best point so far
    there: Balance  # what was seen there
    damping: Array  # N/mm added to the tangent
    step: Array  # the last one, `(free, lanes)`, mm
    phase: Array  # `Phase` values
    count: Array  # looks so far
    scales: tuple[float, ...] = eqx.field(static=True)

    @classmethod
    def begun(cls, guess: Guess, nothing: Balance, scales: tuple[float, ...]) -> "SearchState":
        """Before the first look; nothing gives shapes."""
        lanes = guess.q.shape[1:]
        forces = dataclasses.replace(nothing.forces, energy=jnp.full(lanes, jnp.inf))
        return cls(
            best=guess,
            there=dataclasses.replace(nothing, forces=forces),
            damping=jnp.zeros(lanes),
            step=jnp.zeros_like(guess.q),
            phase=jnp.full(lanes, int(Phase.SEARCHING)),
            count=jnp.zeros(lanes, int),
            scales=scales,
        )

    @property
    def searches(self) -> Array:
        """Lanes that look for a balance."""
        return self.phase == Phase.SEARCHING

    @property
    def done(self) -> Array:
        """Lanes that have found one."""
        return self.phase == Phase.FOUND

    def restarted(self, lanes: Array, guess: Guess) -> "SearchState":
        """With a search that begins at a guess in some lanes."""
        first = SearchState.begun(guess, self.there, self.scales)
        return jax.tree.map(lambda new, old: jnp.where(lanes, new, old), first, self)


@functools.partial(jax.jit, inline=True)
def look(q: Array, args: tuple[Knee, Prescribed, Array | None]):
    """The function whose root is sought: `rows_of_force`. Jitted so that Python runs through the
    mechanics once however often the search is traced."""
    knee, prescribed, near = args
    return rows_of_force(knee, prescribed, q, near)


class EnergyNewton(optx.AbstractRootFinder):
    """Newton's method on the forces that never climbs in energy.

    Attributes:
        rtol: unused; the search ends by the length of a step.
        atol: mm (rotations count at 30 mm). A step that is shorter, which is still taken, is the
            last: so far the tangent is off its balance.
        most_steps: looks before a lane that still searches is given up.
    """

    rtol: float = 0.0
    atol: float = 1e-11
    most_steps: int | Array = 80
    norm: ClassVar[Callable[..., Any]] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> SearchState:
        if options:
            raise ValueError(f"EnergyNewton: unknown options {sorted(options)}; it takes none")
        (knee, prescribed, near), nothing = args, jnp.zeros_like(y)
        reaction = jnp.zeros((len(prescribed), *y.shape[1:]))
        tangent, coupling = (jnp.zeros((len(x), *y.shape)) for x in (nothing, reaction))
        forces = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), aux_struct)
        there = Balance(tuple(nothing), tuple(reaction), tangent, coupling, forces)
        units = scales(free_of(prescribed, knee.bodies))
        return SearchState.begun(Guess(y, near), there, units)

    def step(self, fn, y, args, options, state, tags):
        (knee, prescribed, _), near = args, state.best.contact_points
        here = linearised(lambda q: fn(q, (knee, prescribed, near)), y)
        # Only where a search has a best point can energies be compared with it.
        first = ~jnp.isfinite(state.there.forces.energy)
        accept = state.searches & (first | self._is_lower(y, here, state))
        seen = Guess(y, here.forces.contact_points), here
        best, there = jax.tree.map(
            lambda new, old: jnp.where(accept, new, old), seen, (state.best, state.there)
        )
        damping = jnp.where(accept, 0.1 * state.damping, jnp.maximum(8.0 * state.damping, 1.0))
        damping = jnp.where(damping < 1e-3, 0.0, damping)
        step, added = damped_step(there.tangent, there.residual, damping, state.scales)
        size, last = size_of(step), size_of(state.step)
        # A damping that is small against the stiffness does not hide how far the solution is.
        plain = accept & (added == damping) & (added < 1.0) & jnp.isfinite(there.forces.energy)
        rounding = (size < _ROUNDED) & (size > _SHRINKS * last) & (last > 0.0)
        found = plain & ((size < self.atol) | rounding)
        step = step * jnp.minimum(1.0, _LONGEST_STEP / jnp.where(size > 0.0, size, 1.0))
        step = jnp.where(state.searches, step, state.step)
        count = state.count + state.searches
        lost = state.searches & ((damping > _HOPELESS) | (count >= self.most_steps))
        phase = jnp.where(lost, int(Phase.LOST), state.phase)
        phase = jnp.where(found, int(Phase.FOUND), phase)
        ahead = SearchState(best, there, damping, step, phase, count, state.scales)
        return self._next(ahead), ahead, there.forces

    def _is_lower(self, q: Array, here: Balance, state: SearchState) -> Array:
        before, energy = state.there.forces, here.forces.energy
        work = jnp.sum(before.load * (q - state.best.q), axis=0)
        climb = energy - before.energy - work
        scale = jnp.abs(before.energy) + jnp.abs(energy) + 1.0
        both = here.residual, state.there.residual
        force, old_force = (size_of(_scaled(x, state.scales)) for x in both)
        finite = jnp.isfinite(energy) & jnp.isfinite(force)
        # Close to the solution energy differences drown in rounding; the forces do not.
        calmer = (size_of(state.step) < _CLOSE) & (force < 0.5 * old_force)
        return finite & ((climb <= _ROUNDING * scale) | calmer)

    def _next(self, state: SearchState) -> Array:
        """Where to look next: a step ahead of the best point."""
        q = state.best.q + jnp.stack(_scaled(state.step, state.scales))
        # A lane whose numbers are not finite stands still: the solver would end the search of all.
        goes = jnp.all(jnp.isfinite(q), axis=0)
        return jnp.where(goes, q, state.best.q)

    def terminate(self, fn, y, args, options, state, tags):
        return ~jnp.any(state.searches), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return self._next(state), state, {}
