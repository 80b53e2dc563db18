"""Several nodes one after the other in each of many lanes: the program that all batches run.

A lane predicts its next node from the last three and searches it. A node that a few Newton steps
do not balance goes on from there in the next round, and stops its lane when that does not help.
All of it is one compiled loop: with a call for each node, Python between the calls took as long as
the balances (a map of 101 x 101 points: 3.4 s, and 1.4 to 1.7 s with this; benchmarks/map.py).
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.mechanics import Knee
from kneejax.statics._compiled import compiled
from kneejax.statics._newton import UNITS, EnergyNewton, Guess
from kneejax.statics._settle import search_one, with_meeting
from kneejax.statics._stations import Stations
from kneejax.statics._status import Status
from kneejax.statics._variants import with_numbers

_ACCURACY_MM = 1e-7


class Nodes(eqx.Module):
    """What lies ahead of each lane; arrays begin with place and lane.

    Attributes:
        numbers: leaves of the knee that vary, by their places in it, `(places, lanes, ...)`.
        stations: likewise.
        q: coordinates from which distances are predicted, `(places, lanes, 5)`.
        meeting: likewise, `(places, lanes, n, 2)`.
        even: whether the last two strides and this one are alike, `(places, lanes)`.
        reach: mm (rotations at 30 mm) that the distance from the motion may change by on the way
            to a node, `(places, lanes)`; what lies farther is another branch.
        length: places of each lane, `(lanes,)`; none where a lane is not needed.
        led: whether a lane's path has been near a balance, `(lanes,)`. The search of a node
            that nothing leads to may not go on: it would end anywhere.
        begun: whether a balance lies behind a lane, `(lanes,)`; from elsewhere any way is long.
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any
    even: Any
    reach: Any
    length: Any
    led: Any
    begun: Any


class Memory(eqx.Module):
    """What a lane knows of its way so far; arrays end in lanes.

    Attributes:
        away_q: distances `(3, 5, lanes)` at the last three nodes, the latest first.
        away_meeting: likewise, `(3, n, 2, lanes)`.
        known: nodes balanced in a row.
        tangent: stiffness at the last node, `(5, 5, lanes)`; zero where it is not known.
        rounds: spent so far on a node that is not finished.
        steps: Newton steps in them.
        left_q: where the last of them stopped, `(5, lanes)`.
        left_meeting: likewise, `(n, 2, lanes)`.
    """

    away_q: Any
    away_meeting: Any
    known: Any
    tangent: Any
    rounds: Any
    steps: Any
    left_q: Any
    left_meeting: Any


class Patience(eqx.Module):
    """How long to search: Newton steps of a round, the part of all lanes that must ask before
    tangents are computed anew, and rounds that a node may go on after its first."""

    steps: int
    least_share: float
    rounds: int


class Reached(eqx.Module):
    """What became of the nodes; arrays begin with the round and end in lanes.

    Attributes:
        place: of the node that ended in this round; -1 where none did.
        q: `(rounds, 5, lanes)`.
        meeting: `(rounds, n, 2, lanes)`.
        status: `(rounds, lanes)`.
        steps: Newton steps of all rounds spent on the node.
    """

    place: Array
    q: Array
    meeting: Array
    status: Array
    steps: Array


@compiled()
def walk_stretch(
    knee: Knee, nodes: Nodes, memory: Memory, patience: Patience
) -> tuple[Reached, Memory]:
    """Walk all lanes along their places, each at its own pace, until all have stopped or as many
    rounds are over as there are places.

    Args:
        knee: without a lane axis.
        nodes: what lies ahead.
        memory: of what lies behind.
        patience: how long to search.

    Returns:
        What became of the nodes, and the memory with which to go on.
    """
    places, lanes = nodes.even.shape
    search = EnergyNewton(
        atol=_ACCURACY_MM, most_steps=patience.steps, least_share=patience.least_share
    )

    def searched(place: Array, memory: Memory, going: Array):
        # A lane that has stopped repeats what another does, so that none waits for it.
        lane = jnp.where(going, jnp.arange(lanes), jnp.argmax(going))
        at = place[lane], lane
        here = jax.tree.map(lambda x: x[at], (nodes.numbers, nodes.stations))
        own = jnp.moveaxis(nodes.q[at], 0, -1), jnp.moveaxis(nodes.meeting[at], 0, -1)
        trusted, goes_on = jnp.where(nodes.even[at], memory.known[lane], 0), memory.rounds[lane] > 0
        behind = (memory.away_q, memory.left_q), (memory.away_meeting, memory.left_meeting)
        q, meeting = (
            jnp.where(goes_on, left[..., lane], own + _extrapolated(away[..., lane], trusted))
            for own, (away, left) in zip(own, behind, strict=True)
        )
        knees = here[1].load(with_numbers(knee, here[0]))
        guess = Guess(q, meeting, memory.tangent[..., lane])
        reached, rest = search_one(knees, here[1].flexion, guess, search)
        units = jnp.asarray(UNITS)[:, None]
        change = jnp.max(jnp.abs(reached.q - own[0] - memory.away_q[0][:, lane]) / units, axis=0)
        begun = nodes.begun[lane] | (memory.known[lane] > 0)
        far = begun & (rest["status"] < Status.TOO_DEEP) & (change > nodes.reach[at])
        status = jnp.where(far, Status.NOT_CONVERGED, rest["status"])
        return reached, rest | {"status": status}, own, far

    def round_of_searches(state):
        count, place, stopped, memory, log = state
        going = ~stopped & (place < nodes.length)
        found, rest, own, far = searched(place, memory, going)
        status, steps = rest["status"], memory.steps + rest["steps"]
        good = going & (status < Status.TOO_DEEP)
        finite = jnp.all(jnp.isfinite(found.q), axis=0)
        led = nodes.led | (memory.known > 0)
        more = going & ~good & ~far & led & (memory.rounds < patience.rounds) & finite
        ended = going & ~more
        entry = Reached(jnp.where(ended, place, -1), found.q, found.meeting, status, steps)
        log = jax.tree.map(lambda rows, row: rows.at[count].set(row), log, entry)
        memory = Memory(
            away_q=_pushed(memory.away_q, found.q - own[0], good),
            away_meeting=_pushed(memory.away_meeting, found.meeting - own[1], good),
            known=memory.known + good,
            tangent=jnp.where(good | more, rest["tangent"], jnp.where(ended, 0.0, memory.tangent)),
            rounds=jnp.where(more, memory.rounds + 1, jnp.where(ended, 0, memory.rounds)),
            steps=jnp.where(more, steps, jnp.where(ended, 0, memory.steps)),
            left_q=jnp.where(more, found.q, memory.left_q),
            left_meeting=jnp.where(more, found.meeting, memory.left_meeting),
        )
        return count + 1, place + good, stopped | (ended & ~good), memory, log

    def unfinished(state):
        count, place, stopped, *_ = state
        return (count < places) & jnp.any(~stopped & (place < nodes.length))

    start = jnp.zeros(lanes, int)
    log = Reached(
        jnp.full((places, lanes), -1),
        jnp.zeros((places, 5, lanes)),
        jnp.zeros((places, *memory.left_meeting.shape)),
        jnp.zeros((places, lanes), int),
        jnp.zeros((places, lanes), int),
    )
    state = jnp.asarray(0), start, jnp.zeros(lanes, bool), memory, log
    *_, memory, log = lax.while_loop(unfinished, round_of_searches, state)
    return log, memory


@compiled()
def first_meeting(
    knee: Knee, numbers: dict[int, Any], stations: Stations, q: Array
) -> Array:
    """Meeting points searched from scratch, `(n, 2, lanes)`; arguments begin with the lane.

    A program of its own: in `walk_stretch` it would cost a tenth more memory while compiling.
    """
    knees = stations.load(with_numbers(knee, numbers)).for_many_poses()
    return with_meeting(knees, stations.flexion, jnp.moveaxis(q, 0, -1)).meeting


def _pushed(away: Array, latest: Array, good: Array) -> Array:
    """Distances with the latest one in front, in lanes that are good."""
    return jnp.where(good, jnp.concatenate([latest[None], away[:2]]), away)


def _extrapolated(away: Array, known: Array) -> Array:
    """The next distance: a parabola through three nodes, a line through two, or the last."""
    last, before, first = away
    ahead = jnp.where(known > 2, 2 * last - 3 * before + first, last - before)
    return last + jnp.where(known > 1, ahead, 0.0)
