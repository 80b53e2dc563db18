"""Many lanes, each walking nodes of its own at its own pace: the program that all batches run.

A lane predicts its next node from the last three and searches it. Where that finds nothing, or
something farther from the last balance than one branch leads, the way there is divided: half of it
first, then as much as goes well. What ends there has no balance that is connected with the last.

Every turn of the one compiled loop is a look of all lanes, each at its own node. Lanes that
searched node by node together took as long as the slowest, and Figures 3 to 10 twice the time.
"""

from __future__ import annotations

import dataclasses
import functools
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.geometry import Prescribed, scales
from kneejax.mechanics import Knee
from kneejax.numerics import compiled
from kneejax.statics._newton import EnergyNewton, Guess, Phase, SearchState, look
from kneejax.statics._settle import fault_of, holding, with_meeting
from kneejax.statics._status import Status, converged
from kneejax.statics._stiffness import softness_of
from kneejax.statics.walk._places import Memory, Nodes, Place, Reached, packed, unpacked

#: Last step of a search, mm (rotations at 30 mm).
_ACCURACY_MM = 1e-9
#: Looks for a node that is predicted, for a part of the way, and for one that was lost or is not
#: predicted.
_QUICK, _PART, _PATIENT = 15, 25, 80
#: A part of the way that took more looks than this is not followed by a longer one.
_EASY = 8
#: Turns in which a node may end, for each place of a stretch.
_ENDS = 2
#: Least part of a stride that is tried before a node is given up; of one along which a load grows.
_FINEST, _FINEST_LOADED = 2.0**-3, 2.0**-14
#: How far from where it was expected a balance may be found, mm (rotations at 30 mm): one branch is
#: smooth, and comes as near as one likes in shorter strides; another one does not.
_MISSED_MM = 1.0
#: How far a knee may move while a load grows by one step, mm (rotations at 30 mm).
_LOADED_MM = 2.0


class _Walk(eqx.Module):
    """State of the loop: turns in which nodes ended, the place of each lane, whether it goes on and
    searches with patience, where it searches, packed, and looks next."""

    turns: Array
    place: Array
    goes: Array
    patient: Array
    memory: Memory
    here: Array
    y: Guess
    state: SearchState
    log: Array | None


@compiled()
def walk_stretch(
    knee: Knee, nodes: Nodes, memory: Array, give_up: Array, fewest: Array
) -> tuple[Array, Array]:
    """Walk all lanes along their places, each at its own pace.

    Args:
        knee: without a lane axis.
        nodes: what lies ahead.
        memory: of what lies behind, packed.
        give_up: lost nodes in a row after which a lane stops.
        fewest: lanes that must go on, or the walk ends; those that are on their way to a node begin
            it anew with the next call.

    Returns:
        What became of the nodes, and the memory with which to go on, both packed.
    """
    stretch, turns = _Stretch(knee, nodes, give_up), _ENDS * nodes.even.shape[0]

    def unfinished(walk: _Walk) -> Array:
        going = jnp.sum(walk.goes)
        return (walk.turns < turns) & (going > 0) & (going >= fewest)

    walk, nothing = stretch.begun(unpacked(memory, Memory.like(nodes.like)))
    turn = _entry(walk, nothing)
    log = jnp.broadcast_to(turn, (turns, *turn.shape))
    walk = lax.while_loop(
        unfinished, partial(stretch.a_look, nothing), dataclasses.replace(walk, log=log)
    )
    return walk.log, packed(walk.memory)


def _entry(walk: _Walk, verdict: dict[str, Array]) -> Array:
    """A turn of the log; one by one the writing of its numbers took 2 % of a turn."""
    held = holding(walk.state)
    return packed(Reached(q=walk.y.q, meeting=walk.y.meeting, holding=held, **verdict))


class _Judged(NamedTuple):
    """Searches that have ended, by lane.

    Attributes:
        good: a balance on the branch of the last one.
        again: searched once more, with patience.
        shorter: half the way is tried.
        lost: the node is given up.
        status: `Status` values.
        fault: of the pose at which the search ended.
        softness: there.
        behind: softness there, or at the last balance.
        ahead: how far along the path the search was, in nodes.
    """

    good: Array
    again: Array
    shorter: Array
    lost: Array
    status: Array
    fault: Array
    softness: Array
    behind: Array
    ahead: Array


class _Stretch(NamedTuple):
    """The rules of a walk: the knee, what lies ahead of each lane, and when a lane gives up."""

    knee: Knee
    nodes: Nodes
    give_up: Array

    @property
    def units(self) -> tuple[float, ...]:
        """rad and mm of each free coordinate that count as 1 mm."""
        return scales(self.nodes.like.stations.free)

    def read(self, here: Array) -> Place:
        """A place that was packed."""
        return unpacked(here, self.nodes.like)

    def loaded(self, here: Array) -> tuple[Knee, Prescribed]:
        """Knees with their loads, and what is prescribed to them."""
        place = self.read(here)
        return place.loaded(self.knee), place.stations.prescribed

    def towards(self, last: Array, place: Array, part: Array) -> Array:
        """A part of the straight way to the node at a place of each lane."""
        end = self.nodes.places[self.nodes.at(place)].T
        way = jnp.where(part >= 1.0, end, last + part * (end - last))
        # A force that grows acts where it will act.
        return jnp.where(self.nodes.like.rows_of_points()[:, None], end, way)

    def when(self, place: Array, memory: Memory) -> Array:
        """How far along its path a lane is where it aims at."""
        full = self.nodes.first + place + 1.0 - memory.when[0]
        return memory.when[0] + memory.aim * full

    def aimed(self, place: Array, memory: Memory) -> tuple[Array, Guess, Array]:
        """Where lanes aim at, where their searches begin, and whether with patience."""
        here = self.towards(memory.last, place, memory.aim)
        known = jnp.where(memory.wary, 0, memory.known)
        ahead = self.when(place, memory)
        own = self.read(here)
        behind = memory.away_q, memory.away_meeting
        q, meeting = (_extrapolated(x, memory.when, ahead, known) for x in behind)
        # What is not predicted may be far: to try it quickly first would be in vain.
        patient = known < 2
        return here, Guess(own.q + q, own.meeting + meeting), patient

    def begun(self, memory: Memory) -> tuple[_Walk, dict[str, Array]]:
        """The walk before its first look, and what is written down where nothing has ended."""
        nodes, lanes = self.nodes, self.nodes.even.shape[1]
        start, goes = jnp.zeros(lanes, int), nodes.length > 0
        known = jnp.where(nodes.even[0], memory.known, jnp.minimum(memory.known, 1))
        memory = dataclasses.replace(memory, known=known)
        here, guess, patient = self.aimed(start, memory)
        args = self.loaded(here)
        _, shapes = jax.eval_shape(look, guess, args)
        state = EnergyNewton().init(look, guess, args, {}, None, shapes, frozenset())
        phase = jnp.where(goes, state.phase, int(Phase.LOST))
        state = dataclasses.replace(state, phase=phase)
        walk = _Walk(jnp.asarray(0), start, goes, patient, memory, here, guess, state, None)
        _, nothing = jax.tree.map(jnp.zeros_like, jax.eval_shape(self.searches_end, walk, goes))
        nothing["place"] -= 1
        return walk, nothing

    def a_look(self, nothing: dict[str, Array], before: _Walk) -> _Walk:
        """One look of all lanes, and what follows where searches end."""
        memory = before.memory
        few = jnp.where(memory.aim < 1.0, _PART, _QUICK)
        looks = jnp.where(before.patient, _PATIENT, few)
        search = EnergyNewton(atol=_ACCURACY_MM, most_steps=looks)
        args = self.loaded(before.here)
        y, state, _ = search.step(look, before.y, args, {}, before.state, frozenset())
        walk = dataclasses.replace(before, y=y, state=state, log=None)
        ended = walk.goes & ~state.searches
        after, verdict = lax.cond(
            jnp.any(ended), lambda: self.searches_end(walk, ended), lambda: (walk, nothing)
        )
        # Written outside of the branch, which would copy the whole log; in one piece.
        log = lax.dynamic_update_index_in_dim(
            before.log, _entry(walk, verdict), walk.turns, 0
        )
        return dataclasses.replace(after, log=log)

    def searches_end(self, walk: _Walk, ended: Array) -> tuple[_Walk, dict[str, Array]]:
        """Judge what lanes have found, and send them on."""
        judged = self.judged(walk, ended)
        arrived = judged.good & (walk.memory.aim >= 1.0)
        over = arrived | judged.lost
        steps = walk.memory.steps + walk.state.count
        verdict = dict(
            place=jnp.where(over, walk.place, -1),
            status=judged.status,
            fault=judged.fault,
            steps=steps,
            way=walk.memory.when[0],
            softness=jnp.where(judged.good, judged.softness, judged.behind),
        )
        place = walk.place + over
        memory = self.remembered(walk, judged, ended, over)
        goes = walk.goes & (place < self.nodes.length) & (memory.lost < self.give_up)
        new, guess, patient = self.aimed(place, memory)
        begins = ended & goes
        state = walk.state.anew(begins, guess)
        y = jax.tree.map(lambda new, old: jnp.where(begins, new, old), guess, walk.y)
        patient = jnp.where(begins, patient | judged.again, walk.patient)
        turns, here = walk.turns + jnp.any(over), jnp.where(begins, new, walk.here)
        return _Walk(turns, place, goes, patient, memory, here, y, state, None), verdict

    def judged(self, walk: _Walk, ended: Array) -> _Judged:
        """Whether what lanes have found is on their branch, and what to do where it is not."""
        memory, found, there = walk.memory, walk.y, self.nodes.at(walk.place)
        loading, units = self.nodes.loading[there], jnp.asarray(self.units)[:, None]
        own_q, last_own_q = (self.read(place).q for place in (walk.here, memory.last))
        softness, pivots = softness_of(walk.state.tangent, self.units)
        fault = fault_of(*self.loaded(walk.here), walk.state, pivots)
        status = jnp.where(walk.state.done, fault, int(Status.NOT_CONVERGED))
        ahead = self.when(walk.place, memory)
        # A load moves the knee itself as well: what counts is how far this one has moved.
        last_q = jnp.where(loading, last_own_q, own_q)
        change = (found.q - last_q - memory.away_q[0]) / units
        stride = ahead - memory.when[0]
        reach = jnp.where(loading, _LOADED_MM, jnp.maximum(1.0, self.nodes.reach[there] * stride))
        far = memory.begun & (jnp.max(jnp.abs(change), axis=0) > reach)
        far |= (memory.known > 1) & (_missed(memory, ahead, found.q - own_q, units) > _MISSED_MM)
        astray = converged(status) & (far | (loading & ~(softness > 0.0)))
        status = jnp.where(astray, Status.NOT_CONVERGED, status)
        good = ended & converged(status)
        finest = jnp.where(loading, _FINEST_LOADED, _FINEST)
        divides = memory.based & (0.5 * stride >= finest)
        # A balance that lies far is mostly the right one, which another search finds once more:
        # half of the way tells.
        again = ended & ~good & ~walk.patient & ~(loading & memory.based) & ~(astray & divides)
        shorter = ended & ~good & ~again & divides
        lost = ended & ~(good | shorter | again)
        # What ends beside a turning point may be so soft that no balance is told from it.
        behind = jnp.where(~far & (softness < memory.softness), softness, memory.softness)
        # Where the least part of a load leads to a balance elsewhere, nothing held this one.
        behind = jnp.where(astray & loading, 0.0, behind)
        return _Judged(good, again, shorter, lost, status, fault, softness, behind, ahead)

    def remembered(self, walk: _Walk, judged: _Judged, ended: Array, over: Array) -> Memory:
        """What lanes know after their searches."""
        memory, found, own = walk.memory, walk.y, self.read(walk.here)
        good, ahead = judged.good, judged.ahead
        arrived = good & over
        # A longer part where one went well; a node that follows begins with as long a stride.
        easy = jnp.where(walk.state.count <= _EASY, 2.0, 1.0)
        rest_of_way = jnp.where(arrived, 1.0, self.nodes.first + walk.place + 1.0 - ahead)
        stride = ahead - memory.when[0]
        longer = jnp.minimum(1.0, easy * stride / jnp.where(good, rest_of_way, 1.0))
        aim = jnp.where(judged.lost, 1.0, memory.aim)
        aim = jnp.where(judged.shorter, 0.5 * memory.aim, aim)
        uneven = over & ~self.nodes.even[self.nodes.at(walk.place + over)]
        known = memory.known + good
        steps = jnp.where(ended, memory.steps + walk.state.count, memory.steps)
        return Memory(
            away_q=_pushed(memory.away_q, found.q - own.q, good),
            away_meeting=_pushed(memory.away_meeting, found.meeting - own.meeting, good),
            when=_pushed(memory.when, ahead, good),
            last=jnp.where(good, walk.here, memory.last),
            known=jnp.where(uneven, jnp.minimum(known, 1), known),
            lost=jnp.where(arrived, 0, memory.lost + judged.lost),
            begun=memory.begun | good,
            based=memory.based | good,
            # What was lost may have been led astray by its prediction.
            wary=jnp.where(ended, ~good, memory.wary),
            aim=jnp.where(good, longer, aim),
            softness=jnp.where(good, judged.softness, memory.softness),
            steps=jnp.where(over, 0, steps),
        )


@compiled(optimised=False)
def first_meeting(knee: Knee, like: Place, here: Array, away_q: Array) -> Array:
    """Meeting points searched from scratch, as distances from the own motion, `(n, 2, lanes)`.

    A program of its own: in `walk_stretch` it would cost a tenth more memory while compiling.

    Args:
        knee: without a lane axis.
        like: see `Nodes`.
        here: where lanes are, packed.
        away_q: how far from the own motion, `(free, lanes)`.
    """
    place = unpacked(here, like)
    prescribed = place.stations.prescribed
    met = with_meeting(place.loaded(knee), prescribed, place.q + away_q).meeting
    return met - place.meeting


def _pushed(rows: Array, latest: Array, good: Array) -> Array:
    """Rows with the latest one in front, in lanes that are good."""
    return jnp.where(good, jnp.concatenate([latest[None], rows[:-1]]), rows)


def _missed(memory: Memory, ahead: Array, away_q: Array, units: Array) -> Array:
    """How far a balance is from where the last ones lead, mm: round a corner a parabola leads
    astray that a line, or the last balance itself, does not."""

    def miss(of: int) -> Array:
        known = jnp.minimum(memory.known, of)
        expected = _extrapolated(memory.away_q, memory.when, ahead, known)
        return jnp.max(jnp.abs((away_q - expected) / units), axis=0)

    return functools.reduce(jnp.minimum, map(miss, (1, 2, 3)))


def _extrapolated(away: Array, when: Array, ahead: Array, known: Array) -> Array:
    """Distance ahead: a parabola through three balances, a line, or the last."""
    last, before, first = away

    def slope(later: Array, earlier: Array, gap: Array) -> Array:
        return (later - earlier) / jnp.where(gap != 0.0, gap, 1.0)

    line = slope(last, before, when[0] - when[1])
    bend = slope(line, slope(before, first, when[1] - when[2]), when[0] - when[2])
    bend = jnp.where(known > 2, bend * (ahead - when[1]), 0.0)
    return last + jnp.where(known > 1, (line + bend) * (ahead - when[0]), 0.0)
