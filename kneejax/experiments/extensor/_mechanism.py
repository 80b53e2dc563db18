"""What the extensor mechanism does: tendon, moment arm, and the forces on the tibia by part."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments._motion import Motion
from kneejax.geometry import FEMUR_AND_TIBIA, PATELLA, TIBIA, Vector
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import compiled
from kneejax.statics import Settled, Stations, differentiable

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
    rows = [k for k, pair in enumerate(knee.ligaments.bodies) if pair == (PATELLA, TIBIA)]
    answer[TENDON] = ligaments[rows].sum(axis=0)
    for k, contact in enumerate(knee.contacts):
        if contact.bodies == FEMUR_AND_TIBIA:
            answer[knee.contact_names[k]] = contact_force[:, k]
    every_load = (*knee.loads, *motion.stations.loads)
    acting = [load for load in every_load if isinstance(load, Load) and not load.line]
    for load, force in zip(acting, loads, strict=True):
        answer[load.name] = answer.get(load.name, 0.0) + force
    return answer


@compiled()
def _pulls(knee: Knee, stations: Stations, settled: Settled) -> tuple[Array, Array, Array]:
    """Forces of fibres, muscles and loads in tibia axes, `(3, parts, poses)` each."""
    lanes, state = stations.load(add_lane_axis(knee)), settled.state
    tibia = state.tibia.placement

    def turned(tension: Array, unit: Vector) -> Array:
        return jnp.stack(jnp.broadcast_arrays(*tibia.turn_back(tuple(tension * x for x in unit))))

    ligaments = turned(lanes.ligaments.tension(state), lanes.ligaments.unit_pulls(state))
    nothing = jnp.zeros((3, 0, *state.shape))
    muscles = nothing
    if lanes.muscles is not None:
        muscles = turned(lanes.muscles.tension, lanes.muscles.unit_pulls(state))
    forces = [tibia.turn_back(x.wrench(tibia).force) for x in lanes.loads if isinstance(x, Load)]
    loads = [jnp.stack(jnp.broadcast_arrays(*force, settled.q[0])[:3]) for force in forces]
    return ligaments, muscles, jnp.stack(loads, axis=1) if loads else nothing


@compiled()
def arm_and_tendon(knee: Knee, stations: Stations, settled: Settled) -> tuple[Array, Array]:
    """Moment arm of the quadriceps by virtual work, mm, and force of the tendon, N, `(poses,)`.

    The arm is the rate at which the quadriceps becomes longer with flexion while all that is free
    stays balanced: exactly how much the moment about the flexion axis grows with its pull, since
    both are mixed derivatives of one energy.
    """
    lanes = stations.load(add_lane_axis(knee))
    muscles = lanes.muscles
    assert muscles is not None
    heads = np.array(muscles.quadriceps)
    tension = muscles.tension[heads]
    share = tension / jnp.sum(tension, axis=0)

    def length(flexion: Array) -> Array:
        prescribed = {**stations.prescribed, "flexion": flexion}
        state = differentiable(lanes, prescribed, settled).state
        return jnp.sum(share * muscles.length(state)[heads], axis=0)

    flexion = stations.prescribed["flexion"]
    _, arm = jax.jvp(length, (flexion,), (jnp.ones_like(flexion),))
    state = settled.state
    rows = np.array([k for k, p in enumerate(knee.ligaments.bodies) if p == (PATELLA, TIBIA)])
    tension = lanes.ligaments.tension(state)[rows]
    pull = jnp.sum(tension * jnp.stack(lanes.ligaments.unit_pulls(state))[:, rows], axis=1)
    return arm, jnp.sqrt(jnp.sum(pull**2, axis=0))
