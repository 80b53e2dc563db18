"""Many lanes, each walking nodes of its own at its own pace: the program that all batches run.

A lane predicts its next node from the last three and searches it. Where that finds nothing, or
something farther from the last balance than one branch leads, the way there is divided: half of it
first, then as much as goes well. What ends there has no balance that is connected with the last.

Every turn of the one compiled loop is a look of all lanes, each at its own node. A lane waits for
the others only for a tangent, which costs as much as two looks, for one lane or for all. Lanes that
searched node by node together took as long as the slowest, and Figures 3 to 10 twice the time.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.geometry import Prescribed, scales
from kneejax.mechanics import Knee, Load
from kneejax.numerics import compiled
from kneejax.statics._newton import EnergyNewton, Guess, SearchState, look
from kneejax.statics._settle import fault_of, holding, with_meeting
from kneejax.statics._softness import softness_of
from kneejax.statics._status import Status, converged
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._variants import with_numbers

_ACCURACY_MM = 1e-7
#: Looks for a node that nothing leads to (its search may not go on: it would end anywhere), for
#: one that is predicted, for a part of the way, and for one that was lost.
_SHORT, _QUICK, _PART, _PATIENT = 5, 15, 25, 80
#: A part of the way that took more looks than this is not followed by a longer one.
_EASY = 8
#: Part of the lanes that must wait for a tangent.
_WAITING = 0.5
#: Turns in which a node may end, for each place of a stretch.
_ENDS = 2
#: Least part of a stride that is tried before a node is given up; of one along which a load grows.
_FINEST, _FINEST_LOADED = 2.0**-3, 2.0**-14
#: How far from where it was expected a balance may be found, mm (rotations at 30 mm): one branch is
#: smooth, and comes as near as one likes in shorter strides; another one does not.
_MISSED_MM = 1.0
#: How far a knee may move while a load grows by one step, mm (rotations at 30 mm).
_LOADED_MM = 2.0


class Nodes(eqx.Module):
    """What lies ahead of each lane; arrays begin with place and lane.

    Attributes:
        numbers: leaves of the knee that vary, by their places in it, `(places, lanes, ...)`.
        stations: likewise.
        q: coordinates from which distances are predicted, `(places, lanes, free)`.
        meeting: likewise, `(places, lanes, n, 2)`.
        even: whether the last two strides and this one are alike, `(places, lanes)`.
        reach: mm (rotations at 30 mm) that the distance from the motion may change by on the way
            to a node, `(places, lanes)`; what lies farther is another branch.
        loading: whether loads change on the way to a node, `(places, lanes)`.
        first: how many nodes of its path a lane has behind it, `(lanes,)`.
        length: places of each lane, `(lanes,)`; none where a lane is not needed.
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any
    even: Any
    reach: Any
    loading: Any
    first: Any
    length: Any


class Place(eqx.Module):
    """Where lanes stand between their nodes; arrays begin with the lane.

    Attributes:
        numbers: as in `Nodes`, `(lanes, ...)`.
        stations: likewise.
        q: likewise, `(lanes, free)`.
        meeting: likewise, `(lanes, n, 2)`.
    """

    numbers: dict[int, Any]
    stations: Stations
    q: Any
    meeting: Any

    def towards(self, there: Place, part: Array) -> Place:
        """A part of the straight way to another place."""

        def between(here: Array, end: Array) -> Array:
            share = _in_front(part, end)
            return jnp.where(share >= 1.0, end, here + share * (end - here))

        way = jax.tree.map(between, self, there)
        # A force that grows acts where it will act.

        def points(place: Place) -> list[Array]:
            return [load.point for load in place.stations.loads if isinstance(load, Load)]

        return eqx.tree_at(points, way, points(there))


class Memory(eqx.Module):
    """What a lane knows of its way so far; arrays end in lanes, those of `last` begin with them.

    Attributes:
        away_q: distances `(3, free, lanes)` at the last three balances, the latest first.
        away_meeting: likewise, `(3, n, 2, lanes)`.
        when: how far along the path they were, in nodes, `(3, lanes)`.
        last: the place of the latest.
        known: balances in a row, of nodes or on the way to them.
        lost: nodes lost in a row.
        led: whether the path has been near a balance.
        begun: whether a balance lies behind; from elsewhere any way is long.
        based: whether `last` is where the path comes from, so that the way can be divided.
        wary: whether the next search is not to be predicted, since one was lost.
        aim: part of the way from `last` to the next node that is tried.
        tangent: stiffness at the latest balance, `(free, free, lanes)`; zero where it is not known.
        softness: see `softness_of`, at the latest balance.
        steps: looks spent so far on a node that is not finished.
    """

    away_q: Any
    away_meeting: Any
    when: Any
    last: Place
    known: Any
    lost: Any
    led: Any
    begun: Any
    based: Any
    wary: Any
    aim: Any
    tangent: Any
    softness: Any
    steps: Any


class Reached(eqx.Module):
    """What became of the nodes; arrays begin with the turn and end in lanes.

    Attributes:
        place: of the node that ended in this turn; -1 where none did.
        q: `(turns, free, lanes)`.
        meeting: `(turns, n, 2, lanes)`.
        status: `(turns, lanes)`.
        fault: see `Settled`, of the last search.
        steps: looks of all searches for the node.
        way: how far along the path the last balance was, in nodes, `(turns, lanes)`.
        softness: see `softness_of`; there, or where the search ended if that is less and not far;
            at the node if it is balanced.
        holding: fields of `Settled` by name, of the last search: those that a look computes.
    """

    place: Array
    q: Array
    meeting: Array
    status: Array
    fault: Array
    steps: Array
    way: Array
    softness: Array
    holding: dict[str, Array]

    def packed(self) -> Array:
        """All numbers of one turn, `(numbers, lanes)`: one by one their writing took 2 % of it."""
        leaves = jax.tree.leaves(self)
        return jnp.concatenate([x.reshape(-1, x.shape[-1]).astype(float) for x in leaves])

    def unpacked(self, log: np.ndarray | Array) -> Reached:
        """All turns of a log, whose turns are like this one."""
        leaves, kinds = jax.tree.flatten(self)
        ends = np.cumsum([x.size // x.shape[-1] for x in leaves])
        shaped = [
            log[:, end - x.size // x.shape[-1] : end].reshape(len(log), *x.shape).astype(x.dtype)
            for x, end in zip(leaves, ends, strict=True)
        ]
        return jax.tree.unflatten(kinds, shaped)


class _Walk(eqx.Module):
    """State of the loop: turns in which nodes ended, the place of each lane, whether it goes on and
    searches with patience, where it searches and looks next."""

    turns: Array
    place: Array
    goes: Array
    patient: Array
    memory: Memory
    here: Place
    y: Guess
    state: SearchState
    log: Array | None


@compiled()
def walk_stretch(
    knee: Knee, nodes: Nodes, memory: Memory, give_up: Array, fewest: Array
) -> tuple[Array, Reached, Memory]:
    """Walk all lanes along their places, each at its own pace.

    Args:
        knee: without a lane axis.
        nodes: what lies ahead.
        memory: of what lies behind.
        give_up: lost nodes in a row after which a lane stops.
        fewest: lanes that must go on, or the walk ends; those that are on their way to a node begin
            it anew with the next call.

    Returns:
        What became of the nodes, packed, and one turn of it, for `Reached.unpacked`; and the memory
        with which to go on.
    """
    places, lanes = nodes.even.shape
    units = scales(nodes.stations.free)

    def at(place: Array) -> tuple[Array, Array]:
        return jnp.minimum(place, places - 1), jnp.arange(lanes)

    def node(place: Array) -> Place:
        every = nodes.numbers, nodes.stations, nodes.q, nodes.meeting
        return Place(*jax.tree.map(lambda x: x[at(place)], every))

    def loaded(here: Place) -> tuple[Knee, Prescribed]:
        knees = here.stations.load(with_numbers(knee, here.numbers))
        return knees.for_many_poses(), here.stations.prescribed

    def when(place: Array, memory: Memory) -> Array:
        """How far along its path a lane is where it aims at."""
        return memory.when[0] + memory.aim * (nodes.first + place + 1.0 - memory.when[0])

    def begin(place: Array, memory: Memory) -> tuple[Place, Guess, Array]:
        """Where lanes aim at, and where their searches begin."""
        here = memory.last.towards(node(place), memory.aim)
        known = jnp.where(memory.wary, 0, memory.known)
        ahead = when(place, memory)
        q, meeting = (
            jnp.moveaxis(near, 0, -1) + _extrapolated(away, memory.when, ahead, known)
            for near, away in (
                (here.q, memory.away_q), (here.meeting, memory.away_meeting),
            )
        )  # fmt: skip
        # What is not predicted may be far: to try it quickly first would be in vain.
        patient = memory.led & (known < 2)
        return here, Guess(q, meeting, memory.tangent), patient

    def a_look(before: _Walk) -> _Walk:
        walk, memory = before, before.memory
        few = jnp.where(memory.aim < 1.0, _PART, jnp.where(memory.led, _QUICK, _SHORT))
        looks = jnp.where(walk.patient, _PATIENT, few)
        search = EnergyNewton(atol=_ACCURACY_MM, most_steps=looks, waiting=_WAITING)
        args = loaded(walk.here)
        y, state, _ = search.step(look, walk.y, args, {}, walk.state, frozenset())
        walk = eqx.tree_at(lambda w: (w.y, w.state, w.log), walk, (y, state, None))
        ended = walk.goes & state.ended
        after, verdict = lax.cond(
            jnp.any(ended), lambda: searches_end(walk, ended), lambda: (walk, nothing)
        )
        # Written outside of the branch, which would copy the whole log; in one piece.
        entry = Reached(**dict(q=y.q, meeting=y.meeting, holding=holding(state)) | verdict)
        log = lax.dynamic_update_index_in_dim(before.log, entry.packed(), walk.turns, 0)
        return dataclasses.replace(after, log=log)

    def searches_end(walk: _Walk, ended: Array) -> tuple[_Walk, dict[str, Array]]:
        memory, found, there = walk.memory, walk.y, at(walk.place)
        loading, here = nodes.loading[there], walk.here
        own_q, own_meeting = (jnp.moveaxis(x, 0, -1) for x in (here.q, here.meeting))
        softness, pivots = softness_of(walk.state.guess.tangent, units)
        fault = fault_of(*loaded(here), walk.state, pivots)
        status = jnp.where(walk.state.done, fault, int(Status.NOT_CONVERGED))
        ahead = when(walk.place, memory)
        # A load moves the knee itself as well: what counts is how far this one has moved.
        last_q = jnp.where(loading, jnp.moveaxis(memory.last.q, 0, -1), own_q)
        change = (found.q - last_q - memory.away_q[0]) / jnp.asarray(units)[:, None]
        stride = ahead - memory.when[0]
        reach = jnp.where(loading, _LOADED_MM, jnp.maximum(1.0, nodes.reach[there] * stride))
        far = memory.begun & (jnp.max(jnp.abs(change), axis=0) > reach)
        expected = _extrapolated(memory.away_q, memory.when, ahead, memory.known)
        miss = (found.q - own_q - expected) / jnp.asarray(units)[:, None]
        far |= (memory.known > 1) & (jnp.max(jnp.abs(miss), axis=0) > _MISSED_MM)
        astray = far | (loading & ~(softness > 0.0))
        status = jnp.where(astray & converged(status), Status.NOT_CONVERGED, status)
        good = ended & converged(status)
        finest = jnp.where(loading, _FINEST_LOADED, _FINEST)
        again = ended & ~good & memory.led & ~walk.patient & ~(loading & memory.based)
        shorter = ended & ~good & ~again & memory.based & (0.5 * stride >= finest)
        lost = ended & ~(good | shorter | again)
        arrived = good & (memory.aim >= 1.0)
        over = arrived | lost
        looks, steps = walk.state.count, memory.steps + walk.state.count
        # What ends beside a turning point may be so soft that no balance is told from it.
        behind = jnp.where(~far & (softness < memory.softness), softness, memory.softness)
        verdict = dict(
            place=jnp.where(over, walk.place, -1),
            status=status,
            fault=fault,
            steps=steps,
            way=memory.when[0],
            softness=jnp.where(good, softness, behind),
        )
        place = walk.place + over
        # A longer part where one went well; a node that follows begins with as long a stride.
        easy = jnp.where(looks <= _EASY, 2.0, 1.0)
        rest_of_way = jnp.where(arrived, 1.0, nodes.first + walk.place + 1.0 - ahead)
        longer = jnp.minimum(1.0, easy * stride / jnp.where(good, rest_of_way, 1.0))
        aim = jnp.where(shorter, 0.5 * memory.aim, jnp.where(lost, 1.0, memory.aim))
        lost_in_a_row = jnp.where(arrived, 0, memory.lost + (lost & memory.led))
        uneven = over & ~nodes.even[at(place)]
        known = memory.known + good
        tangent = jnp.where(again, 0.0, memory.tangent)
        memory = Memory(
            away_q=_pushed(memory.away_q, found.q - own_q, good),
            away_meeting=_pushed(memory.away_meeting, found.meeting - own_meeting, good),
            when=_pushed(memory.when, ahead, good),
            last=_where(good, here, memory.last),
            known=jnp.where(uneven, jnp.minimum(known, 1), known),
            lost=lost_in_a_row,
            led=memory.led | good,
            begun=memory.begun | good,
            based=memory.based | good,
            # What was lost may have been led astray by its prediction.
            wary=jnp.where(ended, ~good, memory.wary),
            aim=jnp.where(good, longer, aim),
            tangent=jnp.where(good, walk.state.guess.tangent, tangent),
            softness=jnp.where(good, softness, memory.softness),
            steps=jnp.where(over, 0, jnp.where(ended, steps, memory.steps)),
        )
        goes = walk.goes & (place < nodes.length) & (lost_in_a_row < give_up)
        new, guess, patient = begin(place, memory)
        begins = ended & goes
        state = walk.state.anew(begins, guess)
        y = jax.tree.map(lambda new, old: jnp.where(begins, new, old), guess, walk.y)
        patient = jnp.where(begins, patient | again, walk.patient)
        turns = walk.turns + jnp.any(over)
        here = _where(begins, new, here)
        return _Walk(turns, place, goes, patient, memory, here, y, state, None), verdict

    def unfinished(walk: _Walk) -> Array:
        going = jnp.sum(walk.goes)
        return (walk.turns < turns) & (going > 0) & (going >= fewest)

    start, goes = jnp.zeros(lanes, int), nodes.length > 0
    known = jnp.where(nodes.even[0], memory.known, jnp.minimum(memory.known, 1))
    memory = eqx.tree_at(lambda m: m.known, memory, known)
    here, guess, patient = begin(start, memory)
    _, shapes = jax.eval_shape(look, guess, loaded(here))
    state = EnergyNewton().init(look, guess, loaded(here), {}, None, shapes, frozenset())
    state = eqx.tree_at(lambda s: s.ended, state, ~goes)
    walk = _Walk(jnp.asarray(0), start, goes, patient, memory, here, guess, state, None)
    _, nothing = jax.tree.map(jnp.zeros_like, jax.eval_shape(searches_end, walk, goes))
    nothing["place"] -= 1
    turns = _ENDS * places
    row = Reached(**dict(q=guess.q, meeting=guess.meeting, holding=holding(state)) | nothing)
    log = jnp.broadcast_to(row.packed(), (turns, *row.packed().shape))
    walk = lax.while_loop(unfinished, a_look, dataclasses.replace(walk, log=log))
    return walk.log, row, walk.memory


@compiled()
def first_meeting(
    knee: Knee, numbers: dict[int, Any], stations: Stations, q: Array
) -> Array:
    """Meeting points searched from scratch, `(n, 2, lanes)`; arguments begin with the lane.

    A program of its own: in `walk_stretch` it would cost a tenth more memory while compiling.
    """
    knees = stations.load(with_numbers(knee, numbers)).for_many_poses()
    return with_meeting(knees, stations.prescribed, jnp.moveaxis(q, 0, -1)).meeting


def _in_front(lanes: Array, like: Array) -> Array:
    """Lanes as the first axis of an array."""
    return lanes.reshape(-1, *(1,) * (like.ndim - 1))


def _where(lanes: Array, new: Place, old: Place) -> Place:
    return jax.tree.map(lambda x, y: jnp.where(_in_front(lanes, x), x, y), new, old)


def _pushed(rows: Array, latest: Array, good: Array) -> Array:
    """Rows with the latest one in front, in lanes that are good."""
    return jnp.where(good, jnp.concatenate([latest[None], rows[:-1]]), rows)


def _extrapolated(away: Array, when: Array, ahead: Array, known: Array) -> Array:
    """The distance ahead: a parabola through three balances, a line through two, or the last."""
    last, before, first = away

    def slope(later: Array, earlier: Array, gap: Array) -> Array:
        return (later - earlier) / jnp.where(gap != 0.0, gap, 1.0)

    line = slope(last, before, when[0] - when[1])
    bend = slope(line, slope(before, first, when[1] - when[2]), when[0] - when[2])
    bend = jnp.where(known > 2, bend * (ahead - when[1]), 0.0)
    return last + jnp.where(known > 1, (line + bend) * (ahead - when[0]), 0.0)
