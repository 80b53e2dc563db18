"""A globalised Newton search for balance, one decision per lane, as an optimistix root finder.

Plain Newton on the forces finds wrong branches (a knee turned by 166 degrees has been seen). Here
every step must not raise the energy, the loads held during the step, so the search runs downhill
to a stable balance. Where the tangent is not positive definite, or a step was refused, a multiple
of the identity is added to it. Lanes decide alone: one bad lane slows the others but never
changes them.

The points where contacts meet are searched alongside: with each step they take one of their own.
Energies are compared only where they nearly are such points; a search that did not look twice
there took a lax knee (MCL strain 0.015) for lost at 13 of 25 angles below 12 degrees.

Every look computes the tangent: docs/performance.md says what leaving it out has cost.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array

from kneejax.geometry import Prescribed, free_of, scales
from kneejax.mechanics import Knee
from kneejax.statics._balance import Forces, linearised, rows_of_force
from kneejax.statics._stiffness import damped_step, scaled, size_of

_LONGEST_STEP = 3.0
# Relative rounding that an energy difference may show near the solution.
_ROUNDING = 1e-11
# Step, mm, below which falling forces are enough to accept it.
_CLOSE = 1e-3
# A step below the first, mm, that is not shorter than this part of the one before it is rounding:
# that of a force, in a direction in which next to nothing holds.
_ROUNDED, _SHRINKS = 1e-6, 0.1
# How far meeting points may be off, mm, for a pose to be judged; for a first pose, which nothing is
# compared with, to be gone on from; and to be the answer. Where surfaces are nearly flat against
# each other energies change much along them: of 574 knees with a lax MCL, in extension, 67, 9, 3
# and none were lost with 0.1, 0.01, 0.001 and 0.0003 mm, at the same number of looks.
_JUDGED, _GONE_ON, _MET = 3e-4, 1e-2, 1e-9
# N/mm added to the tangent in vain: who is here will not find anything any more.
_HOPELESS = 1e8


class Guess(eqx.Module):
    """Where a search begins.

    Attributes:
        q: free coordinates `(free, lanes)`, rad and mm.
        meeting: parameters of the meeting points, `(n, 2, lanes)`; NaN where they are not known.
    """

    q: Array
    meeting: Array


class Phase(enum.IntEnum):
    """Where a lane's search stands."""

    SEARCHING = 0
    FOUND = 1
    LOST = 2


class SearchState(eqx.Module):
    """Of a search; arrays end in lanes.

    Attributes:
        guess: the best point so far.
        residual: unbalanced force there, in rows.
        tangent: stiffness there, `(free, free, lanes)`.
        reaction: what holds the prescribed coordinates, in rows, in the order of their names.
        coupling: its derivative by the free ones, `(prescribed, free, lanes)`.
        forces: what holds it.
        miss: how far off meeting points were at the look before, mm, where there is another at the
            same pose; infinite elsewhere.
        damping: N/mm added to the tangent.
        step: the last one, `(free, lanes)`, mm (rotations at 30 mm).
        phase: `Phase` values.
        count: looks so far.
        scales: rad and mm of each free coordinate that count as 1 mm.
    """

    guess: Guess
    residual: tuple[Array, ...]
    tangent: Array
    reaction: tuple[Array, ...]
    coupling: Array
    forces: Forces
    miss: Array
    damping: Array
    step: Array
    phase: Array
    count: Array
    scales: tuple[float, ...] = eqx.field(static=True)

    @classmethod
    def begun(
        cls, guess: Guess, forces: Forces, scales: tuple[float, ...], held: int
    ) -> SearchState:
        """Before the first look, so many coordinates prescribed; the forces give shapes."""
        lanes, nothing = guess.q.shape[1:], jnp.zeros_like(guess.q)
        reaction = jnp.zeros((held, *lanes))
        forces = dataclasses.replace(forces, energy=jnp.full(lanes, jnp.inf))
        return cls(
            guess=guess,
            residual=tuple(nothing),
            tangent=jnp.zeros((len(scales), *guess.q.shape)),
            reaction=tuple(reaction),
            coupling=jnp.zeros((held, *guess.q.shape)),
            forces=forces,
            miss=jnp.full(lanes, jnp.inf),
            damping=jnp.zeros(lanes),
            step=nothing,
            phase=jnp.full(lanes, int(Phase.SEARCHING)),
            count=jnp.zeros(lanes, int),
            scales=scales,
        )

    @property
    def searches(self) -> Array:
        """Lanes that look for a balance."""
        return self.phase == Phase.SEARCHING

    @property
    def compares(self) -> Array:
        """Lanes whose best point is one that energies can be compared with."""
        return jnp.isfinite(self.forces.energy)

    @property
    def done(self) -> Array:
        """Lanes that have found one."""
        return self.phase == Phase.FOUND

    def anew(self, lanes: Array, guess: Guess) -> SearchState:
        """With a search that begins at a guess in some lanes."""
        first = SearchState.begun(guess, self.forces, self.scales, len(self.reaction))
        return jax.tree.map(lambda new, old: jnp.where(lanes, new, old), first, self)


@partial(jax.jit, inline=True)
def look(guess: Guess, args: tuple[Knee, Prescribed]):
    """The function whose root is sought: the unbalanced force at a guess, with what it is made of.

    Jitted so that Python runs through the mechanics once however often the search is traced.

    Returns:
        Residual in rows, what holds prescribed coordinates below; forces.
    """
    knee, prescribed = args
    return rows_of_force(knee, prescribed, guess.q, (guess.meeting[:, 0], guess.meeting[:, 1]))


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
        forces = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), aux_struct)
        knee, prescribed = args
        units = scales(free_of(prescribed, knee.bodies))
        return SearchState.begun(y, forces, units, len(prescribed))

    def step(self, fn, y, args, options, state, tags):
        rows, forces, tangent = linearised(
            lambda q, meeting: fn(Guess(q, meeting), args), y.q, y.meeting
        )
        free, stiffness = len(y.q), tangent()
        residual = rows[:free]
        accept, again = self._judged(y, residual, forces, state)
        miss = _miss(forces)
        # With what is seen off the meeting points nothing is compared.
        energy = jnp.where(state.compares | (miss <= _JUDGED), forces.energy, jnp.inf)
        seen = dataclasses.replace(forces, energy=energy)
        here = dataclasses.replace(
            state,
            guess=y,
            residual=residual,
            tangent=stiffness[:free],
            reaction=rows[free:],
            coupling=stiffness[free:],
            forces=seen,
        )
        best = jax.tree.map(lambda new, old: jnp.where(accept, new, old), here, state)
        damping = jnp.where(accept, 0.1 * state.damping, jnp.maximum(8.0 * state.damping, 1.0))
        damping = jnp.where(damping < 1e-3, 0.0, damping)
        damping = jnp.where(again, state.damping, damping)
        best = dataclasses.replace(best, miss=jnp.where(again, miss, jnp.inf), damping=damping)
        ahead = self._ahead(best, state, accept, again)
        return self._next(ahead, again, y.q, forces.meeting), ahead, ahead.forces

    def _judged(self, y: Guess, residual, forces: Forces, state: SearchState):
        """Whether each lane takes the pose it looked at, and whether it looks there again."""
        miss = _miss(forces)
        lower = ~state.compares | self._is_lower(y, residual, forces, state)
        # Off its meeting points a pose's energy says little: look again, as long as they come near.
        # Better ones only raise it: what is too high already needs no other look.
        off = miss > jnp.where(state.compares, _JUDGED, _GONE_ON)
        again = state.searches & lower & off & (miss < 0.5 * state.miss)
        near = miss <= jnp.maximum(_JUDGED, _miss(state.forces))
        return state.searches & lower & ~again & (~state.compares | near), again

    def _is_lower(self, y: Guess, residual, forces: Forces, state: SearchState) -> Array:
        before, energy = state.forces, forces.energy
        work = jnp.sum(before.load * (y.q - state.guess.q), axis=0)
        climb = energy - before.energy - work
        scale = jnp.abs(before.energy) + jnp.abs(energy) + 1.0
        force, old_force = (size_of(scaled(x, state.scales)) for x in (residual, state.residual))
        finite = jnp.isfinite(energy) & jnp.isfinite(force)
        # Close to the solution energy differences drown in rounding; the forces do not.
        calmer = (size_of(state.step) < _CLOSE) & (force < 0.5 * old_force)
        return finite & ((climb <= _ROUNDING * scale) | calmer)

    def _ahead(
        self, best: SearchState, before: SearchState, accept: Array, again: Array
    ) -> SearchState:
        """The next step of each lane, and whether it has found a balance or is lost."""
        step, added = damped_step(best.tangent, best.residual, best.damping, best.scales)
        size, last = size_of(step), size_of(before.step)
        # A damping that is small against the stiffness does not hide how far the solution is.
        plain = accept & (added == best.damping) & (added < 1.0) & (_miss(best.forces) < _MET)
        rounding = (size < _ROUNDED) & (size > _SHRINKS * last) & (last > 0.0)
        found = plain & ((size < self.atol) | rounding)
        step = step * jnp.minimum(1.0, _LONGEST_STEP / jnp.where(size > 0.0, size, 1.0))
        step = jnp.where(before.searches & ~again, step, before.step)
        count = before.count + before.searches
        lost = before.searches & ((best.damping > _HOPELESS) | (count >= self.most_steps))
        phase = jnp.where(lost, int(Phase.LOST), before.phase)
        phase = jnp.where(found, int(Phase.FOUND), phase)
        return dataclasses.replace(best, step=step, phase=phase, count=count)

    def _next(self, state: SearchState, again: Array, q: Array, met) -> Guess:
        """Where to look next: a step ahead, or at the same pose from better meeting points."""
        forces, shift = state.forces, scaled(state.step, state.scales)
        moved = (
            sum(rate * by for rate, by in zip(rates, shift, strict=True))
            for rates in zip(*forces.drift, strict=True)
        )
        meeting = [x + by for x, by in zip(forces.meeting, moved, strict=True)]
        new = (
            jnp.where(again, q, state.guess.q + jnp.stack(shift)),
            jnp.where(again, jnp.stack(met, axis=1), jnp.stack(meeting, axis=1)),
        )
        # A lane whose numbers are not finite stands still: the solver would end the search of all.
        finite = [jnp.all(jnp.isfinite(x), axis=tuple(range(x.ndim - 1))) for x in new]
        goes = functools.reduce(jnp.logical_and, finite)
        old = state.guess.q, state.guess.meeting
        return Guess(*(jnp.where(goes, x, y) for x, y in zip(new, old, strict=True)))

    def terminate(self, fn, y, args, options, state, tags):
        return ~jnp.any(state.searches), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        nowhere, met = jnp.zeros_like(state.done), state.forces.meeting
        return self._next(state, nowhere, y.q, met), state, {}


def _miss(forces: Forces) -> Array:
    """How far off the meeting points of a lane are at most, mm, where contact is near."""
    return jnp.max(jnp.where(forces.depth < -1.0, 0.0, forces.miss), axis=0, initial=0.0)
