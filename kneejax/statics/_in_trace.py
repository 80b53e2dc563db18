"""A motion while JAX traces the knee: the same continuation, every load case a path of its own.

Paths cannot be shared where numbers are not known yet. So each goes all the way to its own load
case: from the reference pose in strides of 5 degrees, and then under its loads, one after the
    other.
Where the knee does not balance at its reference pose, a path that found nothing goes once more by
way of 45 degrees, from where the knee may be followed back.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.mechanics import Knee
from kneejax.statics._continuation import Behind, Continuation
from kneejax.statics._equilibria import equilibrium_of, of_record, shapes_of_record
from kneejax.statics._equilibrium import Equilibrium
from kneejax.statics._flexion_paths import STRIDE
from kneejax.statics._load_cases import LoadCases
from kneejax.statics._status import Status, converged
from kneejax.statics._variants import Case, in_rows

#: Load cases without an equilibrium in a row after which a path ends.
_GIVE_UP = 5
#: Strides of the way around, and of all ways at most: half a turn of the knee.
_AROUND, _MOST = 9, 36


def continued_in_trace(knee: Knee, load_cases: LoadCases) -> Equilibrium:
    """Balance a knee at load cases where flexion alone is prescribed.

    Args:
        knee: without a lane axis; nothing is differentiated through the search.
        load_cases: in any order, within half a turn of the reference pose.

    Returns:
        The balances, a lane each; NaN where there is none.
    """
    knee = knee.for_many_poses()
    stages, load_cases = len(load_cases.loads), load_cases.of(knee).plain()
    lanes, free = len(load_cases), load_cases.free
    q = jnp.broadcast_to(knee.at_reference.at(free)[:, None], (len(free), lanes))
    contact_points = jnp.full((knee.patch_count, 2, lanes), jnp.nan)
    like = Case({}, jax.tree.map(lambda x: x[0], load_cases))
    shapes = shapes_of_record(load_cases, knee.patch_count)

    def a_trip(trip: tuple[Array, Array, Array]) -> tuple[Array, Array, Array]:
        again, goes, found = trip
        cases, length = _cases(knee, load_cases, stages, again * _AROUND)
        length = jnp.where(goes, length, 0)
        behind = Behind.at(cases[0].T, q, contact_points, jnp.zeros(lanes, int))
        end = Continuation(knee, like, cases, length, jnp.asarray(_GIVE_UP)).run(behind, None)
        # What ended before its load case says nothing of it, nor where the ways end before it.
        record = of_record(end.record, shapes)
        here = (record["place"] == length - 1) & (length <= len(cases))
        record["status"] = jnp.where(here, record["status"], float(Status.NOT_CONVERGED))
        there = jnp.concatenate([x.reshape(-1, lanes) for x in record.values()])
        found = jnp.where(goes, there, found)
        return again + 1, goes & ~converged(record["status"]) & ~end.at_first, found

    size = sum(len(jnp.zeros(shape).reshape(-1)) for shape in shapes.values())
    trip = jnp.asarray(0), jnp.ones(lanes, bool), jnp.zeros((size, lanes))
    _, _, found = lax.while_loop(lambda x: (x[0] < 2) & jnp.any(x[1]), a_trip, trip)
    record = of_record(found, shapes)
    good = converged(record["status"])
    nodes = {name: record[name] for name in record if name not in ("place", "way", "softness")}
    for name in ("status", "fault", "steps"):
        nodes[name] = nodes[name].astype(int)
    return equilibrium_of(load_cases, nodes | {"q": jnp.where(good, record["q"], jnp.nan)})


def _cases(knee: Knee, load_cases: LoadCases, stages: int, around: Array) -> tuple[Array, Array]:
    """Load cases of each path in rows, `(places, lanes, numbers)`, by way of so many strides
    around; and how many there are."""
    begin, goal = knee.reference_pose.flexion, load_cases.flexion
    turn, place = begin + around * STRIDE, jnp.arange(2 * _AROUND + _MOST + stages)[:, None]
    strides = jnp.ceil(jnp.abs(goal - turn) / STRIDE - 1e-9).astype(int)
    back = jnp.maximum(place - around, 0) * STRIDE
    bent = jnp.where(
        place <= around, begin + place * STRIDE, turn + jnp.clip(goal - turn, -back, back)
    )
    stage = place - around - strides
    grown = tuple(
        load.times(jnp.where(stage > k, 1.0, 0.0)).at_each(stage.shape)
        for k, load in enumerate(load_cases.loads)
    )
    cases = dataclasses.replace(load_cases, prescribed={"flexion": bent}, loads=grown)
    return in_rows(({}, cases), 2), around + strides + 1 + stages
