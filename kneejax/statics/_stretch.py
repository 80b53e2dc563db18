"""Many lanes, each walking nodes of its own at its own pace: the program that all batches run.

A lane predicts its next node from the last three and searches it; where that does not balance in a
few looks it searches once more, with patience, from where nothing is extrapolated.

Every turn of the one compiled loop is a look of all lanes, each at its own node. A lane waits for
the others only for a tangent, which costs as much as two looks, for one lane or for all. Lanes that
searched node by node together took as long as the slowest, and Figures 3 to 10 twice the time.
"""

from __future__ import annotations

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.mechanics import Knee
from kneejax.statics._compiled import compiled
from kneejax.statics._newton import UNITS, EnergyNewton, Guess, SearchState, look
from kneejax.statics._settle import described, with_meeting
from kneejax.statics._stations import Stations
from kneejax.statics._status import Status, converged
from kneejax.statics._variants import with_numbers

_ACCURACY_MM = 1e-7
#: Looks for a node that nothing leads to (its search may not go on: it would end anywhere), for
#: one that is predicted, and for one that was lost.
_SHORT, _QUICK, _PATIENT = 5, 15, 80
#: Part of the lanes that must wait for a tangent.
_WAITING = 0.5
#: Turns in which a node may end, for each place of a stretch.
_ENDS = 2


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
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any
    even: Any
    reach: Any
    length: Any


class Memory(eqx.Module):
    """What a lane knows of its way so far; arrays end in lanes.

    Attributes:
        away_q: distances `(3, 5, lanes)` at the last three nodes, the latest first.
        away_meeting: likewise, `(3, n, 2, lanes)`.
        known: nodes balanced in a row.
        lost: nodes lost in a row.
        led: whether the path has been near a balance.
        begun: whether a balance lies behind; from elsewhere any way is long.
        wary: whether the next node is not to be predicted, since one was lost.
        tangent: stiffness at the last node, `(5, 5, lanes)`; zero where it is not known.
        steps: looks spent so far on a node that is not finished.
    """

    away_q: Any
    away_meeting: Any
    known: Any
    lost: Any
    led: Any
    begun: Any
    wary: Any
    tangent: Any
    steps: Any


class Reached(eqx.Module):
    """What became of the nodes; arrays begin with the turn and end in lanes.

    Attributes:
        place: of the node that ended in this turn; -1 where none did.
        q: `(turns, 5, lanes)`.
        meeting: `(turns, n, 2, lanes)`.
        status: `(turns, lanes)`.
        steps: looks of all searches for the node.
    """

    place: Array
    q: Array
    meeting: Array
    status: Array
    steps: Array


class _Walk(eqx.Module):
    """State of the loop: turns in which nodes ended, the place of each lane, whether it goes on and
    searches with patience, the node it searches and where it looks next."""

    turns: Array
    place: Array
    goes: Array
    patient: Array
    memory: Memory
    node: tuple[dict[int, Array], Stations]
    y: Guess
    state: SearchState
    log: Reached


@compiled()
def walk_stretch(
    knee: Knee, nodes: Nodes, memory: Memory, give_up: Array, fewest: Array
) -> tuple[Reached, Memory]:
    """Walk all lanes along their places, each at its own pace.

    Args:
        knee: without a lane axis.
        nodes: what lies ahead.
        memory: of what lies behind.
        give_up: lost nodes in a row after which a lane stops.
        fewest: lanes that must go on, or the walk ends; those that are on their way to a node begin
            it anew with the next call.

    Returns:
        What became of the nodes, and the memory with which to go on.
    """
    places, lanes = nodes.even.shape

    def at(place: Array) -> tuple[Array, Array]:
        return jnp.minimum(place, places - 1), jnp.arange(lanes)

    def own(at: tuple[Array, Array]) -> tuple[Array, Array]:
        return jnp.moveaxis(nodes.q[at], 0, -1), jnp.moveaxis(nodes.meeting[at], 0, -1)

    def loaded(node) -> tuple[Knee, Array]:
        numbers, stations = node
        return stations.load(with_numbers(knee, numbers)).for_many_poses(), stations.flexion

    def begin(place: Array, memory: Memory):
        """The nodes at these places, and where their searches begin."""
        there = at(place)
        here = jax.tree.map(lambda x: x[there], (nodes.numbers, nodes.stations))
        known = jnp.where(nodes.even[there] & ~memory.wary, memory.known, 0)
        q, meeting = (
            near + _extrapolated(away, known)
            for near, away in zip(own(there), (memory.away_q, memory.away_meeting), strict=True)
        )
        # What is not predicted may be far: to try it quickly first would be in vain.
        patient = memory.led & (known < 2)
        return here, Guess(q, meeting, memory.tangent), patient

    def a_look(walk: _Walk) -> _Walk:
        memory = walk.memory
        looks = jnp.where(walk.patient, _PATIENT, jnp.where(memory.led, _QUICK, _SHORT))
        search = EnergyNewton(atol=_ACCURACY_MM, most_steps=looks, waiting=_WAITING)
        args = loaded(walk.node)
        y, state, _ = search.step(look, walk.y, args, {}, walk.state, frozenset())
        walk = eqx.tree_at(lambda w: (w.y, w.state), walk, (y, state))
        ended = walk.goes & state.ended
        return lax.cond(jnp.any(ended), lambda: nodes_end(walk, ended), lambda: walk)

    def nodes_end(walk: _Walk, ended: Array) -> _Walk:
        memory, found, there = walk.memory, walk.y, at(walk.place)
        own_q, own_meeting = own(there)
        _, _, rest = described(*loaded(walk.node), found, walk.state)
        status = rest["status"]
        change = (found.q - own_q - memory.away_q[0]) / jnp.asarray(UNITS)[:, None]
        far = memory.begun & (jnp.max(jnp.abs(change), axis=0) > nodes.reach[there])
        status = jnp.where(far & converged(status), Status.NOT_CONVERGED, status)
        good = ended & converged(status)
        again = ended & ~good & memory.led & ~walk.patient
        over = ended & ~again
        gone = over & ~good
        steps = memory.steps + rest["steps"]
        place = jnp.where(over, walk.place, -1)
        entry = Reached(place, found.q, found.meeting, status, steps)
        log = jax.tree.map(lambda rows, row: rows.at[walk.turns].set(row), walk.log, entry)
        lost = jnp.where(good, 0, memory.lost + (gone & memory.led))
        tangent = jnp.where(good, rest["tangent"], jnp.where(ended, 0.0, memory.tangent))
        memory = Memory(
            away_q=_pushed(memory.away_q, found.q - own_q, good),
            away_meeting=_pushed(memory.away_meeting, found.meeting - own_meeting, good),
            known=jnp.where(gone, 0, memory.known + good),
            lost=lost,
            led=memory.led | good,
            begun=memory.begun | good,
            # What was lost may have been led astray by its prediction.
            wary=jnp.where(ended, again | (lost > 0), memory.wary),
            tangent=tangent,
            steps=jnp.where(over, 0, jnp.where(again, steps, memory.steps)),
        )
        place = walk.place + over
        goes = walk.goes & (place < nodes.length) & (lost < give_up)
        here, guess, patient = begin(place, memory)
        begins = ended & goes
        state = walk.state.anew(begins, guess)
        y = jax.tree.map(lambda new, old: jnp.where(begins, new, old), guess, walk.y)
        here = jax.tree.map(
            lambda new, old: jnp.where(_in_front(begins, new), new, old), here, walk.node
        )
        patient = jnp.where(begins, patient, walk.patient)
        return _Walk(walk.turns + 1, place, goes, patient, memory, here, y, state, log)

    def unfinished(walk: _Walk) -> Array:
        going = jnp.sum(walk.goes)
        return (walk.turns < len(walk.log.place)) & (going > 0) & (going >= fewest)

    start, goes = jnp.zeros(lanes, int), nodes.length > 0
    here, guess, patient = begin(start, memory)
    turns = _ENDS * places
    log = Reached(
        jnp.full((turns, lanes), -1),
        jnp.zeros((turns, 5, lanes)),
        jnp.zeros((turns, *guess.meeting.shape)),
        jnp.zeros((turns, lanes), int),
        jnp.zeros((turns, lanes), int),
    )
    _, shapes = jax.eval_shape(look, guess, loaded(here))
    state = EnergyNewton().init(look, guess, None, {}, None, shapes, frozenset())
    state = eqx.tree_at(lambda s: s.ended, state, ~goes)
    walk = _Walk(jnp.asarray(0), start, goes, patient, memory, here, guess, state, log)
    walk = lax.while_loop(unfinished, a_look, walk)
    return walk.log, walk.memory


@compiled()
def first_meeting(
    knee: Knee, numbers: dict[int, Any], stations: Stations, q: Array
) -> Array:
    """Meeting points searched from scratch, `(n, 2, lanes)`; arguments begin with the lane.

    A program of its own: in `walk_stretch` it would cost a tenth more memory while compiling.
    """
    knees = stations.load(with_numbers(knee, numbers)).for_many_poses()
    return with_meeting(knees, stations.flexion, jnp.moveaxis(q, 0, -1)).meeting


def _in_front(lanes: Array, like: Array) -> Array:
    """Lanes as the first axis of an array."""
    return lanes.reshape(-1, *(1,) * (like.ndim - 1))


def _pushed(away: Array, latest: Array, good: Array) -> Array:
    """Distances with the latest one in front, in lanes that are good."""
    return jnp.where(good, jnp.concatenate([latest[None], away[:2]]), away)


def _extrapolated(away: Array, known: Array) -> Array:
    """The next distance: a parabola through three nodes, a line through two, or the last."""
    last, before, first = away
    ahead = jnp.where(known > 2, 2 * last - 3 * before + first, last - before)
    return last + jnp.where(known > 1, ahead, 0.0)
