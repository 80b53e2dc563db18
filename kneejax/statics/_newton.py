"""A globalised Newton search for balance, one decision per lane, as an optimistix root finder.

Plain Newton on the forces finds wrong branches (a knee turned by 166 degrees has been seen). Here
every step must not raise the energy, the loads held during the step, so the search runs downhill
to a stable balance. Where the tangent is not positive definite, or a step was refused, a multiple
of the identity is added to it. Lanes decide alone: one bad lane slows the others but never
changes them.

The meeting points of the contacts are searched alongside: with each step they take one of their
own. Energies are compared only where they nearly are such points; a search that did not look twice
there took a lax knee (MCL strain 0.015) for lost at 13 of 25 angles below 12 degrees.

Where contacts have patches, a tangent is kept while steps still shrink by `_GOOD`, and computed
anew when a quarter of the lanes that come further ask for that: a look takes a fourth to a sixth of
its time. Over points a tangent costs two forces (0.29 and 0.14 ms a lane, 2 x 432 points): every
look takes one along, and 4 looks do where there were 9.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from functools import partial
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array, lax

from kneejax.geometry import Prescribed, free_of, scales
from kneejax.mechanics import Knee
from kneejax.numerics import identity, solve, symmetric
from kneejax.statics._balance import Forces, linearised, rows_of_force

_LONGEST_STEP = 3.0
# Relative rounding that an energy difference may show near the solution.
_ROUNDING = 1e-11
# Step, mm, below which falling forces are enough to accept it.
_CLOSE = 1e-3
# Steps with a kept tangent shall shrink by this factor, or it is computed anew.
_GOOD = 0.2
# How far meeting points may be off, mm, for a pose to be judged, and to be the answer. Where
# surfaces are nearly flat against each other energies change much along them: of 574 knees with a
# lax MCL, in extension, 67, 9, 3 and none were lost with 0.1, 0.01, 0.001 and 0.0003 mm, at the
# same number of looks. A miss of 3e-5 mm moved poses by as much; the last step, from better points,
# takes that out.
_JUDGED, _MET = 3e-4, 3e-5
# N/mm added to the tangent in vain: who is here will not find anything any more.
_HOPELESS = 1e8
# Relative change of the tangent per mm, at worst: surfaces touch within an onset width of 0.02 mm.
_BEND = 50.0


class Guess(eqx.Module):
    """Where a search begins.

    Attributes:
        q: free coordinates `(free, lanes)`, rad and mm.
        meeting: parameters of the meeting points, `(n, 2, lanes)`; NaN where they are not known.
        tangent: stiffness near there, `(free, free, lanes)`; zero in lanes where it is not known.
    """

    q: Array
    meeting: Array
    tangent: Array

    def __init__(self, q: Array, meeting: Array, tangent: Array | None = None):
        self.q = q
        self.meeting = meeting
        self.tangent = jnp.zeros((len(q), *q.shape)) if tangent is None else tangent


@partial(jax.jit, inline=True)
def look(guess: Guess, args: tuple[Knee, Prescribed]):
    """The function whose root is sought: the unbalanced force at a guess, with what it is made of.

    Jitted so that Python runs through the mechanics once however often the search is traced.

    Returns:
        Residual in rows; forces.
    """
    knee, prescribed = args
    return rows_of_force(knee, prescribed, guess.q, (guess.meeting[:, 0], guess.meeting[:, 1]))


def _tangents_are_dear(knee: Knee) -> bool:
    return knee.patch_count > 0


class SearchState(eqx.Module):
    """Of a search; `guess` is the best point so far, `lift` what makes its tangent positive
    definite, `kept` marks lanes whose tangent belongs to an earlier one, `asks` those that want it
    computed anew, `still` those that look once more at the best point, `miss` says how far off
    meeting points were at the look before, where there is another at the same pose; `count` counts
    the looks of each lane. A lane that is `done` waits for the tangent at its solution and is
    `ended` with it; so is one that is given up. `scales`: rad and mm of each free coordinate that
    count as 1 mm."""

    guess: Guess
    residual: tuple[Array, ...]
    forces: Forces
    lift: Array
    kept: Array
    asks: Array
    still: Array
    miss: Array
    shift: Array
    step: tuple[Array, ...]
    done: Array
    count: Array
    ended: Array
    scales: tuple[float, ...] = eqx.field(static=True)

    def anew(self, lanes: Array, guess: Guess) -> SearchState:
        """With a search that begins at a guess in some lanes."""
        first = begun(guess, self.forces, self.scales)
        return jax.tree.map(lambda new, old: jnp.where(lanes, new, old), first, self)


class EnergyNewton(optx.AbstractRootFinder):
    """Newton's method on the forces that never climbs in energy.

    Attributes:
        rtol: unused; the search ends by what is left of the error.
        atol: mm (rotations count at 30 mm). A lane is at rest when its next step, which is still
            taken, is expected to leave less than this.
        most_steps: looks before a lane that still searches is given up.
        waiting: part of the lanes that have not ended which must wait for the tangent at their
            solution before it is computed for them. Less than all where others can begin.
    """

    rtol: float = 0.0
    atol: float = 1e-9
    most_steps: int | Array = 80
    waiting: float = 1.0
    norm: ClassVar[Callable[..., Any]] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> SearchState:
        if options:
            raise ValueError(f"EnergyNewton: unknown options {sorted(options)}; it takes none")
        forces = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), aux_struct)
        return begun(y, forces, scales(free_of(args[1])))

    def step(self, fn, y, args, options, state, tags):
        dear = _tangents_are_dear(args[0])
        residual, forces, tangent_there = linearised(
            lambda q, meeting: fn(Guess(q, meeting, y.tangent), args),
            y.q,
            y.meeting,
            at_once=dear,
        )
        met, miss = jnp.stack(forces.meeting, axis=1), _miss(forces)
        searches, waits = ~(state.done | state.ended), state.done & ~state.ended
        accept, again = self._judged(residual, forces, y.q, state, searches)
        refused = searches & ~(accept | again)
        anew = self._wanted(state, accept, waits) if dear else jnp.asarray(True)
        # With the tangent at the solution comes one step more for nothing.
        ends = waits & anew
        accept = accept | ends

        def choose(new, old):
            return jnp.where(accept, new, old)

        q, meeting = choose(y.q, state.guess.q), choose(y.meeting, state.guess.meeting)
        residual, forces = jax.tree.map(
            choose, (residual, forces), (state.residual, state.forces)
        )

        def renewed() -> tuple[Array, Array]:
            tangent = choose(tangent_there(), state.guess.tangent)
            return tangent, _lift(tangent, state.scales)

        tangent, lift = lax.cond(anew, renewed, lambda: (state.guess.tangent, state.lift))
        kept = jnp.where(accept, ~anew, state.kept & dear)
        # A step by a kept tangent was refused: look once more at the best point, for a new one. Who
        # asks in vain goes on with what there is, in shorter steps.
        in_vain = accept & state.still & ~anew
        still = (refused & kept & ~state.still) | (state.still & again)
        still = still | ((state.count == 0) & (miss > _JUDGED))
        shift = jnp.where(still | state.still | again, state.shift, 0.1 * state.shift)
        longer = in_vain | (refused & ~kept)
        shift = jnp.where(longer, jnp.maximum(8.0 * state.shift, 1.0), shift)
        shift = jnp.where(shift < 1e-3, 0.0, shift)
        step = _newton_step(tangent, residual, jnp.maximum(shift, lift), state.scales)
        size, before = _size(step), _size(state.step)
        shrinks = jnp.where(before > 0, size / jnp.where(before > 0, before, 1.0), 1.0)
        short = jnp.minimum(1.0, _LONGEST_STEP / jnp.where(size > 0, size, 1.0))
        short = jnp.where(still, 0.0, short)
        moves = ends | (searches & ~again)
        step = tuple(
            jnp.where(moves, short * new, old) for new, old in zip(step, state.step, strict=True)
        )
        left = jnp.where(kept, shrinks, _BEND * size) * size
        # A shift that is small against the stiffness does not hide how far the solution is.
        at_rest = accept & (lift == 0.0) & (left < self.atol) & (size < _CLOSE) & (shift < 1.0)
        done = state.done | (searches & at_rest & (_miss(forces) < _MET))
        count = state.count + searches
        lost = searches & ~done & ((shift > _HOPELESS) | (count >= self.most_steps))
        state = SearchState(
            guess=Guess(q, meeting, tangent),
            residual=residual,
            forces=forces,
            lift=lift,
            kept=kept,
            asks=kept & ~in_vain & (state.asks | still | ((before > 0) & (shrinks > _GOOD))),
            still=still,
            miss=jnp.where(again, miss, jnp.inf),
            shift=shift,
            step=step,
            done=done,
            count=count,
            ended=state.ended | ends | lost,
            scales=state.scales,
        )
        return self._next(state, again, Guess(y.q, met)), state, forces

    def _judged(self, residual, here: Forces, q: Array, state: SearchState, searches: Array):
        """Whether each lane takes the pose it looked at, and whether it looks there again."""
        first, miss = state.count == 0, _miss(here)
        lower = state.still | self._is_lower(residual, here, q, state)
        # Off its meeting points a pose's energy says little: look again, as long as they come near.
        # Better ones only raise it: what is too high already needs no other look.
        again = lower & (miss > _JUDGED) & (miss < 0.5 * state.miss)
        astray = miss > jnp.maximum(_JUDGED, _miss(state.forces))
        accept = searches & (first | (lower & (state.still | ~astray) & ~again))
        again = searches & again
        return accept, again & ~accept

    def _wanted(self, state: SearchState, accept: Array, waits: Array) -> Array:
        """Whether enough lanes need a tangent. Those that were refused have no use for it and do
        not count: a lane that is stuck once starved the others."""
        asks = jnp.sum(state.asks & accept)
        many = (asks > 0) & (4 * asks >= jnp.sum(accept))
        waiting = jnp.sum(waits)
        return many | ((waiting > 0) & (waiting >= self.waiting * jnp.sum(~state.ended)))

    def _next(self, state: SearchState, again: Array, there: Guess) -> Guess:
        """Where to look next: a step ahead, or at the same pose from better meeting points."""
        guess, shift = state.guess, _scaled(state.step, state.scales)
        a, b = (
            sum(rate * by for rate, by in zip(rates, shift, strict=True))
            for rates in zip(*state.forces.drift, strict=True)
        )
        (met_a, met_b), tangent = state.forces.meeting, guess.tangent
        moved = (
            jnp.where(again, there.q, guess.q + jnp.stack(shift)),
            jnp.where(again, there.meeting, jnp.stack([met_a + a, met_b + b], axis=1)),
            tangent,
        )
        # A lane whose numbers are not finite stands still: the solver would end the search of all.
        finite = [jnp.all(jnp.isfinite(x), axis=tuple(range(x.ndim - 1))) for x in moved]
        astray = ~functools.reduce(jnp.logical_and, finite)
        still = guess.q, guess.meeting, jnp.zeros_like(guess.tangent)
        q, meeting, tangent = (
            jnp.where(astray, old, new) for old, new in zip(still, moved, strict=True)
        )
        return Guess(q, meeting, tangent)

    def _is_lower(self, residual, here: Forces, q: Array, state: SearchState) -> Array:
        before = state.forces
        work = jnp.sum(before.load * (q - state.guess.q), axis=0)
        climb = here.energy - before.energy - work
        scale = jnp.abs(before.energy) + jnp.abs(here.energy) + 1.0
        force, old_force = (_size(_scaled(x, state.scales)) for x in (residual, state.residual))
        finite = jnp.isfinite(here.energy) & jnp.isfinite(force)
        # Close to the solution energy differences drown in rounding; the forces do not.
        calmer = force < 0.5 * old_force
        close = _size(state.step) < _CLOSE
        return finite & ((climb <= _ROUNDING * scale) | (close & calmer))

    def terminate(self, fn, y, args, options, state, tags):
        return jnp.all(state.ended), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        nowhere = jnp.zeros_like(state.done)
        return self._next(state, nowhere, state.guess), state, {}


def begun(guess: Guess, forces: Forces, scales: tuple[float, ...]) -> SearchState:
    """A search before its first look; the forces give shapes."""
    lanes = guess.q.shape[1:]
    no, nothing = jnp.zeros(lanes, bool), (jnp.zeros(lanes),) * len(scales)
    return SearchState(
        guess=guess,
        residual=nothing,
        forces=forces,
        lift=_lift(guess.tangent, scales),
        kept=jnp.ones(lanes, bool),
        asks=jnp.all(guess.tangent == 0.0, axis=(0, 1)),
        still=no,
        miss=jnp.full(lanes, jnp.inf),
        shift=jnp.zeros(lanes),
        step=nothing,
        done=no,
        count=jnp.zeros(lanes, int),
        ended=no,
        scales=scales,
    )


def _miss(forces: Forces) -> Array:
    """How far off the meeting points of a lane are at most, mm, where contact is near."""
    return jnp.max(jnp.where(forces.depth < -1.0, 0.0, forces.miss), axis=0, initial=0.0)


def _size(rows: tuple[Array, ...]) -> Array:
    """Largest entry of each lane."""
    return functools.reduce(jnp.maximum, map(jnp.abs, rows))


def _scaled(rows: tuple[Array, ...], scales: tuple[float, ...]) -> tuple[Array, ...]:
    return tuple(scale * row for scale, row in zip(scales, rows, strict=True))


def _lift(tangent: Array, scales: tuple[float, ...]) -> Array:
    """N/mm that make a scaled tangent positive definite in any case; 0 where it is."""
    scaled, size = scaled_tangent(tangent, scales), len(scales)
    _, pivots = solve(symmetric(scaled), (jnp.zeros(tangent.shape[2:]),) * size)
    definite = functools.reduce(jnp.logical_and, [pivot > 0 for pivot in pivots])
    # Gershgorin's discs.
    spread = jnp.sum(jnp.abs(scaled), axis=1)
    diagonal = [scaled[i, i] for i in range(size)]
    needed = functools.reduce(
        jnp.maximum, [s - jnp.abs(d) - d for s, d in zip(spread, diagonal, strict=True)]
    )
    return jnp.where(definite, 0.0, jnp.clip(needed + 1.0, 1.0))


def _newton_step(
    tangent: Array, residual: tuple[Array, ...], extra: Array, scales: tuple[float, ...]
) -> tuple[Array, ...]:
    """Newton step in scaled coordinates, in rows, with a multiple of the identity added."""
    right = tuple(-row for row in _scaled(residual, scales))
    lifted = scaled_tangent(tangent, scales) + extra * identity(len(scales), extra.ndim)
    return solve(lifted, right)[0]


def scaled_tangent(tangent: Array, scales: tuple[float, ...]) -> Array:
    """A stiffness in N/mm: per mm of every coordinate, rotations at 30 mm."""
    units = jnp.asarray(scales).reshape(len(scales), *(1,) * (tangent.ndim - 2))
    return tangent * units[:, None] * units[None]
