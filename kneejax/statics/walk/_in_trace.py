"""A motion while JAX traces the knee: the same walk, every station a lane of its own.

Routes cannot be laid where numbers are not known yet. So each lane goes all the way to its own
station by itself: from the reference pose in strides of 5 degrees, and then under its loads, one
after the other. Where the knee does not balance at its reference pose, a lane that found nothing
goes by way of 45 degrees, from where the knee may be followed back.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.geometry import scales
from kneejax.mechanics import Knee
from kneejax.statics._settle import Settled, shapes_of_holding
from kneejax.statics._status import Status, converged
from kneejax.statics._stiffness import newton_step_left
from kneejax.statics.walk._places import (
    Memory,
    Nodes,
    Place,
    Reached,
    in_rows,
    packed,
    unpacked,
)
from kneejax.statics.walk._routes import STRIDE, longest_stride_mm
from kneejax.statics.walk._stations import Stations
from kneejax.statics.walk._stretch import first_meeting, walk_stretch

#: Nodes of a stretch.
_PLACES = 32
#: Lost nodes in a row after which a lane is given up.
_GIVE_UP = 5
#: Strides of the way around.
_AROUND = 9


class _Trip(eqx.Module):
    """Where lanes are on their ways: how many strides of a way around they take, how many nodes lie
    behind them, whether they are over, whether they balanced at home and at the end of the stem,
    what they remember, packed, and what they found at their stations."""

    around: Array
    place: Array
    over: Array
    at_home: Array
    on_stem: Array
    memory: Array
    found: Settled


def walked_in_trace(knee: Knee, stations: Stations) -> Settled:
    """Balance a knee at stations where flexion alone is prescribed.

    Args:
        knee: without a lane axis; nothing is differentiated through the walk.
        stations: in any order.

    Returns:
        The balances, a lane each; NaN where there is none.
    """
    stages, stations = len(stations.loads), stations.of(knee).plain()
    begin = _nothing_behind(knee, stations)
    none = jnp.zeros(len(stations), int)

    def a_stretch(trip: _Trip) -> _Trip:
        nodes, stem = _ahead(knee, stations, stages, trip)
        log, memory = walk_stretch(knee, nodes, trip.memory, jnp.asarray(_GIVE_UP), jnp.asarray(0))
        reached = unpacked(log, Reached.like(len(stations.free), knee.patch_count))

        def balanced(place: Array) -> Array:
            there = (reached.place == place - trip.place) & (nodes.length > 0)
            return jnp.any(there & converged(reached.status), axis=0)

        at_home, on_stem = trip.at_home | balanced(none), trip.on_stem | balanced(stem - 1)
        place = trip.place + jnp.sum(reached.place >= 0, axis=0)
        arrived = ~trip.over & (place == stem + stages)
        found = _at_the_end(stations, reached, nodes.length, on_stem)
        found = _choose(arrived, found, trip.found)
        over = arrived | trip.over | (memory[0] >= _GIVE_UP)
        # Once more, by way of the detour.
        anew = over & ~at_home & (trip.around == 0) & ~found.converged
        return _Trip(
            jnp.where(anew, _AROUND, trip.around),
            jnp.where(anew, 0, place),
            over & ~anew,
            at_home,
            on_stem & ~anew,
            jnp.where(anew, begin, memory),
            found,
        )

    no = jnp.zeros(len(stations), bool)
    trip = _Trip(none, none, no, no, no, begin, _nowhere(knee, stations))
    return lax.while_loop(lambda trip: ~jnp.all(trip.over), a_stretch, trip).found


def _ahead(knee: Knee, stations: Stations, stages: int, trip: _Trip) -> tuple[Nodes, Array]:
    """The next nodes of each lane, and how many there are on its stem."""
    begin, goal = knee.reference_pose.flexion, stations.flexion
    turn = begin + trip.around * STRIDE

    def flexion_at(place: Array) -> Array:
        back = jnp.maximum(place - trip.around, 0) * STRIDE
        outwards = begin + jnp.maximum(place, 0) * STRIDE
        return jnp.where(place <= trip.around, outwards, turn + jnp.clip(goal - turn, -back, back))

    stem = trip.around + jnp.ceil(jnp.abs(goal - turn) / STRIDE - 1e-9).astype(int) + 1
    place = trip.place + jnp.arange(_PLACES)[:, None]
    here, last, before = (flexion_at(place - k) for k in range(3))
    bend, alike = jnp.abs(here - last), jnp.abs(here - 2.0 * last + before) <= 1e-6 * STRIDE
    loading = place >= stem
    q = knee.at_reference.at(stations.free)
    there = Place(
        {},
        Stations({"flexion": here}, _grown(stations, place - stem, stages), bodies=stations.bodies),
        jnp.broadcast_to(q, (*here.shape, len(q))),
        jnp.zeros((*here.shape, knee.patch_count, 2)),
    )
    nodes = Nodes(
        jax.tree.map(lambda x: x[0, 0], there),
        in_rows(there, 2),
        even=(alike | (place < 2)) & ~loading,
        reach=jnp.where(bend > 0, longest_stride_mm(jnp.rad2deg(bend)), jnp.inf),
        loading=loading,
        first=trip.place.astype(float),
        length=jnp.where(trip.over, 0, jnp.minimum(stem + stages - trip.place, _PLACES)),
    )
    return nodes, stem


def _grown(stations: Stations, stage: Array, stages: int):
    """Loads of the stages so far, in full; none on the stem, whose stages are negative."""
    parts = [jnp.where(stage >= k, 1.0, 0.0) for k in range(max(stages, 1))]
    grown = (x.times(part) for x, part in zip(stations.loads, parts, strict=True))
    return tuple(load.at_each(stage.shape) for load in grown)


def _nothing_behind(knee: Knee, stations: Stations) -> Array:
    """The memory of lanes at the reference pose, with the meeting points there, packed."""
    at_home = jnp.broadcast_to(knee.reference_pose.flexion, stations.flexion.shape)
    home = dataclasses.replace(
        stations,
        prescribed={"flexion": at_home},
        loads=_grown(stations, jnp.full(len(stations), -1), len(stations.loads)),
    )
    own = knee.at_reference.at(stations.free)
    lanes, free = len(stations), len(own)
    q, met = jnp.broadcast_to(own, (lanes, free)), jnp.zeros((lanes, knee.patch_count, 2))
    last = Place({}, home, q, met)
    here = in_rows(last, 1).T
    like = jax.tree.map(lambda x: x[0], last)
    meeting = first_meeting(knee, like, here, jnp.zeros((free, lanes)))
    no, nothing = jnp.zeros(lanes, bool), jnp.zeros(lanes, int)
    behind = Memory(
        lost=nothing,
        away_q=jnp.zeros((3, free, lanes)),
        away_meeting=jnp.broadcast_to(meeting, (3, *meeting.shape)),
        when=jnp.zeros((3, lanes)),
        last=here,
        known=nothing,
        begun=no,
        based=no,
        wary=no,
        aim=jnp.ones(lanes),
        softness=jnp.full(lanes, jnp.inf),
        steps=nothing,
    )
    return packed(behind)


def _choose(lanes: Array, new, old):
    """The one in some lanes, the other elsewhere; arrays end in lanes."""
    return jax.tree.map(lambda x, y: jnp.where(lanes, x, y), new, old)


def _at_the_end(stations: Stations, reached: Reached, length: Array, on_stem: Array) -> Settled:
    """What each lane found at its station; nothing where it lost the knee without its loads."""
    lane = jnp.arange(len(stations))
    when = jnp.argmax(reached.place == length - 1, axis=0)
    at_end = jax.tree.map(lambda x: jnp.moveaxis(x[when, ..., lane], 0, -1), reached)
    left_mm, pivots = newton_step_left(
        at_end.holding["tangent"], at_end.holding["residual"], scales(stations.free)
    )
    status = jnp.where(on_stem, at_end.status, int(Status.NOT_CONVERGED))
    return Settled(
        stations.prescribed,
        jnp.where(converged(status), at_end.q, jnp.nan),
        at_end.meeting,
        **at_end.holding,
        pivots=pivots,
        status=status,
        fault=at_end.fault,
        left_mm=left_mm,
        steps=at_end.steps,
        bodies=stations.bodies,
    )


def _nowhere(knee: Knee, stations: Stations) -> Settled:
    """No balance in any lane."""
    lanes, free, patches = len(stations), len(stations.free), knee.patch_count
    lost = jnp.full(lanes, int(Status.NOT_CONVERGED))
    nothing = {
        name: jnp.zeros((*shape, lanes)) for name, shape in shapes_of_holding(free, patches).items()
    }
    return Settled(
        stations.prescribed,
        jnp.full((free, lanes), jnp.nan),
        jnp.full((patches, 2, lanes), jnp.nan),
        **nothing,
        pivots=jnp.full((free, lanes), jnp.nan),
        status=lost,
        fault=lost,
        left_mm=jnp.full(lanes, jnp.nan),
        steps=jnp.zeros(lanes, int),
        bodies=stations.bodies,
    )
