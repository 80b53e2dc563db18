"""A globalised Newton search for balance, one decision per lane, as an optimistix root finder.

Plain Newton on the forces finds wrong branches (a knee turned by 166 degrees has been seen). Here
every step must not raise the energy, the loads held during the step, so the search runs downhill
to a stable balance. Where the tangent is not positive definite, or a step was refused, a multiple
of the identity is added to it. Lanes decide alone: one bad lane slows the others but never
changes them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array

from kneejax.geometry import Pose
from kneejax.mechanics import Contact, Knee
from kneejax.statics._balance import Balance, traced_balance
from kneejax.statics._elimination import solve, symmetric

#: Rad and mm that count as one unit of a free coordinate: 1 mm at 30 mm from the centre.
UNITS = (1.0 / 30.0, 1.0 / 30.0, 1.0, 1.0, 1.0)
_LONGEST_STEP = 3.0
_IMPROVEMENTS = 2
# Relative rounding that an energy difference may show near the solution.
_ROUNDING = 1e-11
# Step, mm, below which falling forces are enough to accept it.
_CLOSE = 1e-3


class Guess(eqx.Module):
    """Free coordinates `(5, lanes)` and meeting points `(n, 2, lanes)` of a search."""

    q: Array
    meeting: Array


def look(guess: Guess, args: tuple[Knee, Array]) -> tuple[Array, tuple[Balance, Array]]:
    """The function whose root is sought: unbalanced force, with what the search needs besides."""
    knee, flexion = args
    meeting = improve_meeting(knee, flexion, guess.q, guess.meeting, _IMPROVEMENTS)
    here = traced_balance(knee, flexion, guess.q, meeting)
    return here.residual, (here, meeting)


def improve_meeting(knee: Knee, flexion: Array, q: Array, meeting: Array, steps: int) -> Array:
    """Newton steps of the contacts' meeting points at a pose."""
    if not knee.patch_count:
        return meeting
    tibia = Pose.from_state(flexion, q).placement
    for _ in range(steps):
        meeting = knee.map_patches(Contact.improved, tibia, meeting)
    return meeting


class _State(eqx.Module):
    guess: Guess
    balance: Balance
    shift: Array
    step: Array
    done: Array
    count: Array
    seen: Array


class EnergyNewton(optx.AbstractRootFinder):
    """Newton's method on the forces that never climbs in energy.

    Attributes:
        rtol: unused; the search ends by the size of a step.
        atol: step, in mm (rotations count at 30 mm), below which a lane is at rest. The step is
            still taken: convergence is quadratic, so what remains is far smaller.
    """

    rtol: float = 0.0
    atol: float = 1e-7
    norm: ClassVar[Callable[..., Any]] = optx.max_norm

    def init(self, fn, y, args, options, f_struct, aux_struct, tags) -> _State:
        if options:
            raise ValueError(f"EnergyNewton: unknown options {sorted(options)}; it takes none")
        lanes = y.q.shape[1:]
        here, _ = aux_struct
        nothing = Balance(**{
            field: eqx.filter_eval_shape(lambda x: x, getattr(here, field))
            for field in ("energy", "residual", "load", "tangent", "drift", "gap")
        })
        zeros = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), nothing)
        return _State(
            guess=y,
            balance=zeros,
            shift=jnp.zeros(lanes),
            step=jnp.zeros_like(y.q),
            done=jnp.zeros(lanes, bool),
            count=jnp.zeros(lanes, int),
            seen=jnp.asarray(False),
        )

    def step(self, fn, y, args, options, state, tags):
        _, (here, meeting) = fn(y, args)
        units = _units(y.q)
        accept = ~state.done & (self._is_lower(here, y.q, state) | ~state.seen)

        def choose(new, old):
            return jnp.where(accept, new, old)

        guess = Guess(choose(y.q, state.guess.q), choose(meeting, state.guess.meeting))
        current = jax.tree.map(choose, here, state.balance)
        shift = jnp.where(accept, 0.1 * state.shift, jnp.maximum(8.0 * state.shift, 1.0))
        shift = jnp.where(shift < 1e-3, 0.0, shift)
        step, definite = _newton_step(current, shift, units)
        size = jnp.max(jnp.abs(step), axis=0)
        step = step * jnp.minimum(1.0, _LONGEST_STEP / jnp.where(size > 0, size, 1.0))
        # A shift that is small against the stiffness does not hide how far the solution is.
        met = jnp.all((current.gap.tilt < 1e-6) | (current.gap.depth < -1.0), axis=0)
        done = state.done | (accept & definite & (size < self.atol) & (shift < 1.0) & met)
        state = _State(
            guess=guess,
            balance=current,
            shift=shift,
            step=jnp.where(state.done, state.step, step),
            done=done,
            count=state.count + ~state.done,
            seen=jnp.asarray(True),
        )
        return self._trial(state), state, (here, meeting)

    def _trial(self, state: _State) -> Guess:
        q_step = state.step * _units(state.guess.q)
        drift = state.balance.drift
        follow = jnp.sum(drift * q_step.reshape(5, 1, 1, *q_step.shape[1:]), axis=0)
        return Guess(state.guess.q + q_step, state.guess.meeting + follow)

    def _is_lower(self, here: Balance, q: Array, state: _State) -> Array:
        before = state.balance
        work = jnp.sum(before.load * (q - state.guess.q), axis=0)
        climb = here.energy - before.energy - work
        scale = jnp.abs(before.energy) + jnp.abs(here.energy) + 1.0
        finite = jnp.isfinite(here.energy) & jnp.all(jnp.isfinite(here.tangent), axis=(0, 1))
        # Close to the solution energy differences drown in rounding; the forces do not.
        units = _units(q)
        force = jnp.max(jnp.abs(here.residual * units), axis=0)
        calmer = force < 0.5 * jnp.max(jnp.abs(before.residual * units), axis=0)
        close = jnp.max(jnp.abs(state.step), axis=0) < _CLOSE
        return finite & ((climb <= _ROUNDING * scale) | (close & calmer))

    def terminate(self, fn, y, args, options, state, tags):
        return jnp.all(state.done), optx.RESULTS.successful

    def postprocess(self, fn, y, aux, args, options, state, tags, result):
        return self._trial(state), (state.balance, state.done, state.count), {}


def _newton_step(here: Balance, shift: Array, units: Array) -> tuple[Array, Array]:
    """Newton step in scaled coordinates and whether the tangent was positive definite."""
    tangent = here.tangent * units[:, None] * units[None]
    residual = here.residual * units
    _, pivots = solve(symmetric(tangent), residual)
    definite = jnp.all(pivots > 0, axis=0)
    diagonal = jnp.stack([tangent[i, i] for i in range(5)])
    # Gershgorin: adding this much makes the matrix positive definite in any case.
    spread = jnp.sum(jnp.abs(tangent), axis=1) - jnp.abs(diagonal)
    needed = jnp.max(spread - diagonal, axis=0) + 1.0
    extra = jnp.where(definite, shift, jnp.maximum(shift, jnp.clip(needed, 1.0)))
    identity = jnp.eye(5).reshape(5, 5, *(1,) * shift.ndim)
    step, _ = solve(tangent + extra * identity, -residual)
    return step, definite


def _units(q: Array) -> Array:
    return jnp.asarray(UNITS).reshape(5, *(1,) * (q.ndim - 1))
