"""Steps through time, one after the other: balances of a knee with inertia, and their derivative.

A motion is found first (`found`: a search in every step) and then followed (`follow`: the same
steps as functions of every number, by the implicit rule of statics, without a search). So one
compiled search serves every choice of what is differentiated. Going backwards, each step is
computed anew from the moments before it: memory grows with the moments, not with the mechanics.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.dynamics._history import History, Moment, Step
from kneejax.dynamics._moving import MovingKnee
from kneejax.geometry import Prescribed, coordinates_of, free_of, scales
from kneejax.mechanics import Load
from kneejax.numerics import compiled
from kneejax.statics import (
    EnergyNewton,
    Guess,
    Settled,
    converged,
    differentiable,
    settle,
)

#: mm; what a step may leave of its search. Its own error is larger in any motion of interest.
SEARCH = EnergyNewton(atol=1e-9)


class Given(eqx.Module):
    """What is given of a motion; the first axis of all but the start counts the steps.

    Attributes:
        q: of all coordinates at the start, `(6 bodies, lanes)`, rad and mm.
        rate: of them, rad/s and mm/s.
        length_s: of each step, `(steps,)`; those of no length at the end are not taken.
        ratio: of each step to the one before.
        loads: at the end of each step; arrays `(steps, 3, lanes)`.
        held: coordinate -> its value at the end of each step, `(steps, lanes)`.
    """

    q: Array
    rate: Array
    length_s: Array
    ratio: Array
    loads: tuple[Load, ...]
    held: Prescribed

    @property
    def steps(self) -> Step:
        """All of them."""
        return Step(self.length_s, self.ratio, self.loads, dict(self.held))


class Moments(eqx.Module):
    """A motion: what is known at the end of each step, `(steps, ..., lanes)`.

    Attributes:
        known: see `Moment`; NaN from where a step could not be taken.
        meeting: points where contacts meet.
        status: of the step; that of the one that could not be taken is kept to the end.
        looks: of its search.
        surprise: how far the step ended from where it was expected, mm (rotations at 30 mm): its
            error is a part of that.
    """

    known: Moment
    meeting: Array
    status: Array
    looks: Array
    surprise: Array


def march(moving: MovingKnee, given: Given) -> Moments:
    """Compute a motion.

    Args:
        moving: leaves end in a lane axis.
        given: what is given.

    Returns:
        The motion, differentiable by every number of the knee and of what is given, forward and
        backward; the lengths of steps are fixed.
    """
    still = lax.stop_gradient((moving, given))
    return follow(moving, given, found(*still))


@compiled()
def found(moving: MovingKnee, given: Given) -> Settled:
    """The balance of every step; the first axis counts them."""

    def advance(carry, step: Step):
        history, ended = carry
        step, idle = _filled(step)

        def taken():
            settled = _searched(moving, history, step)
            return settled, _moved_on(moving, history, step, settled, ended)

        def rested():
            settled = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)
            return settled, history

        shape = jax.eval_shape(lambda: _searched(moving, history, step))
        settled, history = lax.cond(jnp.all(ended) | idle, rested, taken)
        return (history, ended | ~converged(settled.status)), settled

    first = _beginning(moving, given)
    nothing = jnp.zeros(given.q.shape[1:], bool)
    return lax.scan(advance, (first, nothing), given.steps)[1]


@compiled()
def follow(moving: MovingKnee, given: Given, settled: Settled) -> Moments:
    """The motion whose balances were found, as a function of all that it depends on."""

    @jax.checkpoint  # pyright: ignore[reportPrivateImportUsage]
    def advance(carry, each: tuple[Step, Settled]):
        history, ended, status = carry
        (step, idle), balance = _filled(each[0]), each[1]
        ended = ended | idle
        knee = history.knee_of(moving, step)
        balance = differentiable(knee, step.held, balance)
        after = _moved_on(moving, history, step, balance, ended)
        status = jnp.where(ended, status, balance.status)
        ended = ended | ~converged(balance.status)
        off = (after.last.q - history.guess(step)) / scale
        surprise = jnp.max(jnp.abs(off), axis=0)
        known = jax.tree.map(lambda x: jnp.where(ended, jnp.nan, x), after.last)
        rows = Moments(known, after.meeting, status, balance.steps, surprise)
        return (after, ended, status), rows

    lanes = given.q.shape[1:]
    scale = jnp.array(scales(coordinates_of(moving.knee.bodies)))[:, None]
    begin = _beginning(moving, given), jnp.zeros(lanes, bool), jnp.zeros(lanes, int)
    return lax.scan(advance, begin, (given.steps, settled))[1]


def _beginning(moving: MovingKnee, given: Given) -> History:
    first = Moment.at_first(moving, given.q, given.rate)
    lanes, count = given.q.shape[1:], moving.knee.patch_count
    free = len(free_of(given.held, moving.knee.bodies))
    nowhere = jnp.full((count, 2, *lanes), jnp.nan)
    return History(first, first, nowhere, jnp.zeros((free, free, *lanes)))


def _filled(step: Step) -> tuple[Step, Array]:
    """A step, and whether it only fills up an array (`Grid.filled`): it has no length."""
    idle = step.length_s == 0.0
    return dataclasses.replace(step, length_s=jnp.where(idle, 1.0, step.length_s)), idle


def _searched(moving: MovingKnee, history: History, step: Step) -> Settled:
    """The balance at the end of a step."""
    names = coordinates_of(moving.knee.bodies)
    expected = dict(zip(names, history.guess(step), strict=True))
    q = jnp.stack([expected[name] for name in free_of(step.held, moving.knee.bodies)])
    guess = Guess(q, history.meeting, history.tangent)
    return settle(history.knee_of(moving, step), step.held, guess, SEARCH)


def _moved_on(
    moving: MovingKnee, history: History, step: Step, settled: Settled, ended: Array
) -> History:
    """The history with a step's end in it, in lanes where the motion goes on."""
    names = coordinates_of(moving.knee.bodies)
    goes_on = ~ended & converged(settled.status)
    # Nothing is made of coordinates that are NaN: their derivatives would be so everywhere.
    q = jnp.where(goes_on, settled.state.at(names), history.last.q)
    moment = history.after(moving, step, q)
    there = History(moment, history.last, settled.meeting, settled.tangent)
    return jax.tree.map(lambda new, old: jnp.where(goes_on, new, old), there, history)
