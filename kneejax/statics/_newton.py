"""A globalised Newton search for balance, one decision per lane, as an optimistix root finder.

Plain Newton on the forces finds wrong branches (a knee turned by 166 degrees has been seen). Here
every step must not raise the energy, the loads held during the step, so the search runs downhill
to a stable balance. Where the tangent is not positive definite, or a step was refused, a multiple
of the identity is added to it. Lanes decide alone: one bad lane slows the others but never
changes them.

Where contacts have patches, a tangent is kept while steps still shrink by `_GOOD`, and computed
anew when a quarter of the lanes that still search ask for that. With shared fusion it takes 0.10 ms
over 25 lanes and 1.1 ms over 256; a look, which is a force and a step of the meeting points, 0.03
and 0.18 ms: a fourth to a sixth of that. Over points a tangent costs two forces (0.29 and 0.14 ms a
lane, 2 x 432 points): every look takes one along, and 4 looks do where there were 9.
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

from kneejax.geometry import Pose
from kneejax.mechanics import Contact, Knee
from kneejax.statics._balance import Forces, balance, rows_of_force
from kneejax.statics._elimination import solve, symmetric

#: Rad and mm that count as one unit of a free coordinate: 1 mm at 30 mm from the centre.
UNITS = (1.0 / 30.0, 1.0 / 30.0, 1.0, 1.0, 1.0)
_LONGEST_STEP = 3.0
# Relative rounding that an energy difference may show near the solution.
_ROUNDING = 1e-11
# Step, mm, below which falling forces are enough to accept it.
_CLOSE = 1e-3
# Steps with a kept tangent shall shrink by this factor, or it is computed anew.
_GOOD = 0.2
# Relative change of the tangent per mm, at worst: surfaces touch within an onset width of 0.02 mm.
_BEND = 50.0


class Guess(eqx.Module):
    """Where a search begins.

    Attributes:
        q: free coordinates `(5, lanes)`, rad and mm.
        meeting: parameters of the meeting points, `(n, 2, lanes)`; NaN where they are not known.
        tangent: stiffness near there, `(5, 5, lanes)`; zero in lanes where it is not known.
    """

    q: Array
    meeting: Array
    tangent: Array

    def __init__(self, q: Array, meeting: Array, tangent: Array | None = None):
        self.q = q
        self.meeting = meeting
        self.tangent = jnp.zeros((5, *q.shape)) if tangent is None else tangent


@partial(jax.jit, inline=True)
def look(guess: Guess, args: tuple[Knee, Array]):
    """The function whose root is sought: unbalanced force, with what the search needs besides.

    Jitted so that Python runs through the mechanics once however often the search is traced.

    Returns:
        Residual in five rows; forces, meeting points and tangent, which is that of the guess
        where it is dear.
    """
    knee, flexion = args
    meeting = guess.meeting[:, 0], guess.meeting[:, 1]
    if not _tangents_are_dear(knee):
        here = balance(knee, flexion, guess.q, meeting)
        return tuple(here.residual), (here.forces, guess.meeting, here.tangent)
    tibia = Pose.from_state(flexion, guess.q).placement
    meeting = knee.map_patches(Contact.improved, tibia, meeting)
    residual, forces = rows_of_force(knee, flexion, guess.q, meeting)
    return residual, (forces, jnp.stack(meeting, axis=1), guess.tangent)


def _tangents_are_dear(knee: Knee) -> bool:
    return knee.patch_count > 0


class SearchState(eqx.Module):
    """Of a search; `guess` is the best point so far, `kept` marks lanes whose tangent belongs to
    an earlier one, `asks` those that want it computed anew, `rounds` counts all steps and `count`
    those of each lane."""

    guess: Guess
    residual: tuple[Array, ...]
    forces: Forces
    kept: Array
    asks: Array
    shift: Array
    step: tuple[Array, ...]
    done: Array
    count: Array
    rounds: Array
    ended: Array


class EnergyNewton(optx.AbstractRootFinder):
    """Newton's method on the forces that never climbs in energy.

    Attributes:
        rtol: unused; the search ends by what is left of the error.
        atol: mm (rotations count at 30 mm). A lane is at rest when its next step, which is still
            taken, is expected to leave less than this.
        most_steps: steps before the lanes that still search are given up.
        least_share: part of all lanes that must ask before tangents are computed anew; those that
            ask in vain go on with what they have. For batches that search stragglers again.
    """

    rtol: float = 0.0
    atol: float = 1e-9
    most_steps: int = 40
    least_share: float = 0.0
    norm: ClassVar[Callable[..., Any]] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> SearchState:
        if options:
            raise ValueError(f"EnergyNewton: unknown options {sorted(options)}; it takes none")
        lanes, unknown = y.q.shape[1:], jnp.all(y.tangent == 0.0, axis=(0, 1))
        forces, *_ = aux_struct
        return SearchState(
            guess=y,
            residual=(jnp.zeros(lanes),) * 5,
            forces=jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), forces),
            kept=jnp.ones(lanes, bool),
            asks=unknown,
            shift=jnp.zeros(lanes),
            step=(jnp.zeros(lanes),) * 5,
            done=jnp.zeros(lanes, bool),
            count=jnp.zeros(lanes, int),
            rounds=jnp.asarray(0),
            ended=jnp.asarray(False),
        )

    def step(self, fn, y, args, options, state, tags):
        (knee, flexion), (residual, (forces, meeting, here)) = args, fn(y, args)
        first, last = state.rounds == 0, self._over(state)
        lower = first | self._is_lower(residual, forces, y.q, state)
        accept = jnp.where(last, state.done, lower & ~state.done)

        def choose(new, old):
            return jnp.where(accept, new, old)

        q, meeting = choose(y.q, state.guess.q), choose(meeting, state.guess.meeting)
        residual, forces = jax.tree.map(
            choose, (residual, forces), (state.residual, state.forces)
        )
        refused = ~accept & ~first
        asks = ~state.done & (state.asks | (refused & state.kept))
        if _tangents_are_dear(knee):
            many = 4 * jnp.sum(asks) >= jnp.sum(~state.done)
            many = many & (jnp.sum(asks) > self.least_share * asks.size)
            anew = last | (many & jnp.any(asks))
            tangent = lax.cond(
                anew,
                lambda: balance(knee, flexion, q, (meeting[:, 0], meeting[:, 1])).tangent,
                lambda: state.guess.tangent,
            )
            kept = ~anew & (state.kept | accept)
        else:
            anew, kept = jnp.asarray(True), jnp.zeros_like(accept)
            tangent = choose(here, state.guess.tangent)
        shift = jnp.where(refused, jnp.maximum(8.0 * state.shift, 1.0), 0.1 * state.shift)
        shift = jnp.where(refused & state.kept & anew, state.shift, shift)
        shift = jnp.where(shift < 1e-3, 0.0, shift)
        step, definite = _newton_step(tangent, residual, shift)
        size, before = _size(step), _size(state.step)
        shrinks = jnp.where(before > 0, size / jnp.where(before > 0, before, 1.0), 1.0)
        short = jnp.minimum(1.0, _LONGEST_STEP / jnp.where(size > 0, size, 1.0))
        # With the tangent at the solution comes one step more for nothing.
        moves = jnp.where(last, state.done, ~state.done)
        stay = jnp.where(last, 0.0, 1.0)
        step = tuple(
            jnp.where(moves, short * new, stay * old)
            for new, old in zip(step, state.step, strict=True)
        )
        left = jnp.where(kept, shrinks, _BEND * size) * size
        # A shift that is small against the stiffness does not hide how far the solution is.
        at_rest = accept & definite & (left < self.atol) & (size < _CLOSE) & (shift < 1.0)
        # A tilted meeting point tilts the force: with 1e-6 rad poses were 3e-5 mm off.
        met = jnp.all((forces.tilt < 1e-8) | (forces.depth < -1.0), axis=0)
        state = SearchState(
            guess=Guess(q, meeting, tangent),
            residual=residual,
            forces=forces,
            kept=kept,
            asks=kept & (asks | ((before > 0) & (shrinks > _GOOD))),
            shift=shift,
            step=step,
            done=state.done | (at_rest & met & ~last),
            count=state.count + ~state.done,
            rounds=state.rounds + 1,
            ended=last,
        )
        return self._trial(state), state, (forces, meeting, here)

    def _over(self, state: SearchState) -> Array:
        """Whether nothing is left to search for."""
        return jnp.all(state.done) | (state.rounds >= self.most_steps)

    def _trial(self, state: SearchState) -> Guess:
        guess, shift = state.guess, [u * s for u, s in zip(UNITS, state.step, strict=True)]
        a, b = (
            sum(rate * by for rate, by in zip(rates, shift, strict=True))
            for rates in zip(*state.forces.drift, strict=True)
        )
        moved = guess.q + jnp.stack(shift), guess.meeting + jnp.stack([a, b], axis=1), guess.tangent
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
        force, old_force = _size(_scaled(residual)), _size(_scaled(state.residual))
        finite = jnp.isfinite(here.energy) & jnp.isfinite(force)
        # Close to the solution energy differences drown in rounding; the forces do not.
        calmer = force < 0.5 * old_force
        close = _size(state.step) < _CLOSE
        return finite & ((climb <= _ROUNDING * scale) | (close & calmer))

    def terminate(self, fn, y, args, options, state, tags):
        # One round more, at the solution, gives the tangent there.
        return state.ended, optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return self._trial(state), state, {}


def _size(rows: tuple[Array, ...]) -> Array:
    """Largest entry of each lane."""
    return functools.reduce(jnp.maximum, map(jnp.abs, rows))


def _scaled(rows: tuple[Array, ...]) -> tuple[Array, ...]:
    return tuple(unit * row for unit, row in zip(UNITS, rows, strict=True))


def _newton_step(tangent: Array, residual: tuple[Array, ...], shift: Array):
    """Newton step in scaled coordinates, five rows, and whether the tangent was definite."""
    units = jnp.asarray(UNITS).reshape(5, *(1,) * shift.ndim)
    tangent = tangent * units[:, None] * units[None]
    _, pivots = solve(symmetric(tangent), residual)
    definite = functools.reduce(jnp.logical_and, [pivot > 0 for pivot in pivots])
    diagonal = [tangent[i, i] for i in range(5)]
    # Gershgorin: adding this much makes the matrix positive definite in any case.
    spread = jnp.sum(jnp.abs(tangent), axis=1)
    needed = functools.reduce(
        jnp.maximum, [s - jnp.abs(d) - d for s, d in zip(spread, diagonal, strict=True)]
    )
    extra = jnp.where(definite, shift, jnp.maximum(shift, jnp.clip(needed + 1.0, 1.0)))
    identity = jnp.eye(5).reshape(5, 5, *(1,) * shift.ndim)
    step, _ = solve(tangent + extra * identity, tuple(-row for row in _scaled(residual)))
    return step, definite
