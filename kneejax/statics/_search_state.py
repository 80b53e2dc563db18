"""What a search knows: where it began, its best point so far, and what a look has made of it."""

from __future__ import annotations

import dataclasses
import enum
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.statics._balance import Forces
from kneejax.statics._scaled import lift


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


class Phase(enum.IntEnum):
    """Where a lane's search stands."""

    SEARCHING = 0
    #: The pose is at rest; the lane waits for the tangent there, and a last step.
    AT_REST = 1
    FOUND = 2
    LOST = 3


class SearchState(eqx.Module):
    """Of a search; arrays end in lanes.

    Attributes:
        guess: the best point so far.
        residual: unbalanced force there, in rows.
        forces: what it is made of.
        lift: N/mm that make its tangent positive definite.
        kept: whether its tangent belongs to an earlier point.
        asks: whether the tangent is wanted anew.
        still: whether the next look is at the best point once more.
        miss: how far off meeting points were at the look before, mm, where there is another at the
            same pose; infinite elsewhere.
        shift: N/mm added to the tangent, beyond its lift.
        step: the last one, in rows, mm (rotations at 30 mm).
        phase: `Phase` values.
        count: looks so far.
        scales: rad and mm of each free coordinate that count as 1 mm.
    """

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
    phase: Array
    count: Array
    scales: tuple[float, ...] = eqx.field(static=True)

    @property
    def searches(self) -> Array:
        """Lanes that look for a pose at rest."""
        return self.phase == Phase.SEARCHING

    @property
    def rests(self) -> Array:
        """Lanes that wait for the tangent."""
        return self.phase == Phase.AT_REST

    @property
    def done(self) -> Array:
        """Lanes whose pose is at rest."""
        return self.rests | (self.phase == Phase.FOUND)

    @property
    def ended(self) -> Array:
        """Lanes that look no more."""
        return self.phase >= Phase.FOUND

    def anew(self, lanes: Array, guess: Guess) -> SearchState:
        """With a search that begins at a guess in some lanes."""
        first = begun(guess, self.forces, self.scales)
        return jax.tree.map(lambda new, old: jnp.where(lanes, new, old), first, self)

    def at(self, lanes: Array, here: Seen) -> SearchState:
        """With what was seen in some lanes as the best point; the tangent stays."""

        def choose(new, old):
            return jnp.where(lanes, new, old)

        guess = Guess(
            choose(here.guess.q, self.guess.q),
            choose(here.guess.meeting, self.guess.meeting),
            self.guess.tangent,
        )
        seen, best = (here.residual, here.forces), (self.residual, self.forces)
        residual, forces = jax.tree.map(choose, seen, best)
        return dataclasses.replace(self, guess=guess, residual=residual, forces=forces)


class Seen(NamedTuple):
    """What a look has seen: the point, the unbalanced force there, and what it is made of."""

    guess: Guess
    residual: tuple[Array, ...]
    forces: Forces


class Verdict(NamedTuple):
    """What becomes of a look, by lane.

    Attributes:
        accept: the pose is the best so far.
        again: another look at the same pose, from better meeting points.
        refused: the step is too long or leads uphill.
        ends: the last look at a pose at rest.
        anew: whether this look computes tangents; one for all lanes.
        in_vain: accepted at the best point, where a tangent was wanted that is not computed.
    """

    accept: Array
    again: Array
    refused: Array
    ends: Array
    anew: Array
    in_vain: Array


def begun(guess: Guess, forces: Forces, scales: tuple[float, ...]) -> SearchState:
    """A search before its first look; the forces give shapes."""
    lanes = guess.q.shape[1:]
    no, nothing = jnp.zeros(lanes, bool), (jnp.zeros(lanes),) * len(scales)
    return SearchState(
        guess=guess,
        residual=nothing,
        forces=forces,
        lift=lift(guess.tangent, scales),
        kept=jnp.ones(lanes, bool),
        asks=jnp.all(guess.tangent == 0.0, axis=(0, 1)),
        still=no,
        miss=jnp.full(lanes, jnp.inf),
        shift=jnp.zeros(lanes),
        step=nothing,
        phase=jnp.full(lanes, int(Phase.SEARCHING)),
        count=jnp.zeros(lanes, int),
        scales=scales,
    )
