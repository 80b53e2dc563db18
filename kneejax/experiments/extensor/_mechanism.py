"""What the extensor mechanism does: tendon, moment arm, and the forces on the tibia by part."""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._motion import Motion
from kneejax.geometry import FEMUR_AND_TIBIA, PATELLA, TIBIA, Vector, scale
from kneejax.mechanics import QUADRICEPS, Knee, Load, add_lane_axis, pull_of
from kneejax.numerics import compiled, numpy_for
from kneejax.statics import Settled, Stations, differentiable, force_along

TENDON = "patellar tendon"


def forces_on_tibia(motion: Motion, contact_force: np.ndarray) -> dict[str, np.ndarray]:
    """Part -> what it does to the tibia along the tibia's own axes, `(poses, 3)`, N.

    Args:
        motion: balances of a knee of three bones.
        contact_force: of all contacts on their second bone in its axes, `(poses, contacts, 3)`.

    Returns:
        Ligaments by name, the patellar tendon as one, the contacts, muscles and loads. They sum to
        zero where the knee balances.
    """
    knee = motion.knee
    found = _pulls(knee, motion.stations, motion.settled)
    ligaments, muscles, loads = (np.moveaxis(np.asarray(x), 0, -1) for x in found)
    every = (knee.ligaments, ligaments), (knee.muscles, muscles)
    answer = {
        name: force
        for parts, forces in every
        if parts is not None
        for name, pair, force in zip(parts.names, parts.bodies, forces, strict=True)
        if pair == FEMUR_AND_TIBIA
    }
    answer[TENDON] = ligaments[tendon_rows(knee)].sum(axis=0)
    for k, contact in enumerate(knee.contacts):
        if contact.bodies == FEMUR_AND_TIBIA:
            answer[knee.contact_names[k]] = contact_force[:, k]
    every_load = (*knee.loads, *motion.stations.loads)
    acting = [load for load in every_load if isinstance(load, Load)]
    for load, force in zip(acting, loads, strict=True):
        answer[load.name] = answer.get(load.name, 0.0) + force
    return answer


def tendon_of(motion: Motion) -> Array:
    """Size of what the patellar tendon does to the tibia, `(poses,)`, N."""
    ligaments, _, _ = _pulls(motion.knee, motion.stations, motion.settled)
    rows = tendon_rows(motion.knee)
    xp = numpy_for(ligaments)
    return xp.linalg.norm(xp.asarray(ligaments)[:, rows].sum(axis=1), axis=0)


def tendon_rows(knee: Knee) -> np.ndarray:
    """Which ligaments are the patellar tendon's."""
    return np.array([k for k, p in enumerate(knee.ligaments.bodies) if p == (PATELLA, TIBIA)], int)


@compiled()
def _pulls(knee: Knee, stations: Stations, settled: Settled) -> tuple[Array, Array, Array]:
    """Forces of fibres, muscles and loads in tibia axes, `(3, parts, poses)` each."""
    lanes, state = stations.load(add_lane_axis(knee)), settled.state
    tibia = state.tibia.placement

    def turned(force: Vector) -> Array:
        return jnp.stack(jnp.broadcast_arrays(*tibia.turn_back(force)))

    ligaments = turned(lanes.ligaments.forces(state))
    nothing = jnp.zeros((3, 0, *state.shape))
    muscles = nothing
    if lanes.muscles is not None:
        muscles = turned(scale(lanes.muscles.tension, lanes.muscles.unit_pulls(state)))
    forces = [tibia.turn_back(x.wrench(tibia).force) for x in lanes.loads if isinstance(x, Load)]
    loads = [jnp.stack(jnp.broadcast_arrays(*force, settled.q[0])[:3]) for force in forces]
    return ligaments, muscles, jnp.stack(loads, axis=1) if loads else nothing


class ByPull(NamedTuple):
    """What a stronger quadriceps does at flexions that are held.

    Attributes:
        moment: about the flexion axis that holds them, `(poses,)`, N mm: that of extension.
        arm: how fast it grows with the pull, `(poses,)`, mm. As both are mixed derivatives of one
            energy, this is also how fast the quadriceps becomes longer with flexion while all that
            is free stays balanced: the moment arm by virtual work.
        q: how fast the free coordinates move with the pull, `(free, poses)`.
        meeting: likewise the meeting points, `(n, 2, poses)`.
    """

    moment: Array
    arm: Array
    q: Array
    meeting: Array


@compiled()
def by_pull(knee: Knee, stations: Stations, settled: Settled) -> ByPull:
    """See `ByPull`: exact, from the stiffness that a balance already has."""
    more = jnp.zeros(len(stations))

    def answer(pull: Array) -> tuple[Array, Array, Array]:
        loads = (*stations.loads, pull_of(QUADRICEPS, pull))
        lanes = dataclasses.replace(stations, loads=loads).load(add_lane_axis(knee))
        there = differentiable(lanes, stations.prescribed, settled)
        meeting = there.meeting[:, 0], there.meeting[:, 1]
        moment = force_along(lanes, there.state, meeting, ("flexion",))[0]
        return moment, there.q, there.meeting

    (moment, *_), (arm, q, meeting) = jax.jvp(answer, (more,), (jnp.ones_like(more),))
    return ByPull(moment, arm, q, meeting)
