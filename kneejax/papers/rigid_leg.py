"""The leg that is raised in paper 3's own form: an elastic knee under a rigid patella.

Tibia, patella, pull and multipliers are one system of equations, whose root is the held leg.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments import Shank, evaluate, passive_flexion
from kneejax.geometry import FREE_COORDINATES, TIBIA, Pose, State, scales
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import compiled, traced
from kneejax.papers.rigid_patella import SCALES, RigidPatella
from kneejax.parameters import fibre_rows
from kneejax.statics import force_along

#: Before the unknowns of the patella: the tibia's free coordinates, and the pull, N.
_TIBIA = len(FREE_COORDINATES)
_PULL, _FIRST = _TIBIA, _TIBIA + 1
#: What is left over at a root, N; steps of a search at most, and how long one may be: 1 mm, 1 N/N.
_ENOUGH_N, _MOST_STEPS, _LONGEST = 1e-8, 40, 3.0
#: The quadriceps' arm where nothing is known of it, mm, and N of pull that count as 1.
_ARM_MM, _PULL_N = 40.0, 100.0
#: Forces on a patella by the pull where nothing is known of them: medial, lateral, tendon.
_NEAR_FORCES = (0.2, 0.4, 1.0)


@dataclasses.dataclass(frozen=True)
class RigidLeg:
    """A leg held by its quadriceps over a rigid patella, and its forces; arrays begin with the
    pose.

    Attributes:
        flexion_deg: `(poses,)`.
        tibia: its pose.
        patella: its pose, degrees and mm, `(poses, 6)`.
        quadriceps_N: pull, `(poses,)`; NaN where there is no root.
        tendon_N: `(poses,)`.
        contact_N: of the medial and the lateral facet, `(poses, 2)`; negative where the facet would
            have to hold on to the groove, so that the two rigid contacts are none.
        patellofemoral_N: their resultant, `(poses,)`.
        arm_mm: how fast the extension moment grows with the pull, `(poses,)`.
        tension: group of ligaments or ligament -> its tension, `(poses,)`, N.
        shear: part -> what it does to the tibia forwards along the tibia's own axis, `(poses,)`, N.
        unknowns: all that was solved for, see `held_by_rigid_patella`.
    """

    flexion_deg: np.ndarray
    tibia: Pose
    patella: np.ndarray
    quadriceps_N: np.ndarray
    tendon_N: np.ndarray
    contact_N: np.ndarray
    patellofemoral_N: np.ndarray
    arm_mm: np.ndarray
    tension: dict[str, np.ndarray]
    shear: dict[str, np.ndarray]
    unknowns: np.ndarray

    @property
    def held(self) -> np.ndarray:
        """Where a quadriceps that pulls holds the leg, `(poses,)`."""
        return self.quadriceps_N > 0.0

    def where_held(self, values: np.ndarray) -> np.ndarray:
        """The same, NaN where the quadriceps would have to push."""
        return np.where(self.held, values, np.nan)

    @property
    def doubts(self) -> list[str]:
        """Where the leg has no balance, and where a facet would have to hold on to the groove."""
        off = self.held & (self.contact_N < 0.0).any(axis=1)
        doubtful = {"No held leg was found": np.isnan(self.quadriceps_N),
                    "The patella touches one facet only": off}  # fmt: skip
        return [f"{what} at {', '.join(f'{x:g}' for x in self.flexion_deg[where])} degrees."
                for what, where in doubtful.items() if where.any()]  # fmt: skip


def rigid_leg(
    knee: Knee, patella: RigidPatella, start: Pose, flexion_deg: np.ndarray, shank: Shank
) -> RigidLeg:
    """Hold a leg at each flexion.

    Args:
        knee: tibia and femur, without a line that stands for the patella.
        patella: on it.
        start: of the patella, near its balance at the first flexion.
        flexion_deg: in order from a flexion at which the patella rides in the groove.
        shank: what is held.

    Returns:
        The leg; NaN where no balance was found.
    """
    flexion, weight = jnp.deg2rad(jnp.asarray(flexion_deg, float)), shank.load()
    begin = _beginnings(knee, patella, start, flexion_deg, weight)
    unknowns, slope = _searched(knee, patella, weight, flexion, begin)
    table = np.asarray(unknowns)
    pull, own = table[:, _PULL], table[:, _FIRST:]
    tibia = State.of({"flexion": flexion}, unknowns[:, :_TIBIA].T).tibia
    there = Pose(*(unknowns[:, _FIRST + k] for k in range(6)))
    attached = jnp.stack(tuple(tibia.placement.apply(tuple(patella.tibial_attachment))))
    along = np.asarray(patella.tendon(there.placement, attached))
    tendon = pull * own[:, 12]
    normals = [facet.frame.placement.turn((0.0, 1.0, 0.0)) for facet in patella.facets]
    pressed = own[:, 10:12, None] * np.array([[float(x) for x in one] for one in normals])
    # The arm, all else balanced: row `_TIBIA` of the derivative is the moment about the flexion
    # axis, at its scale; column `_PULL` the pull.
    slope, every = np.asarray(slope), np.arange(slope.shape[-1])
    others, kept = every != _PULL, every != _TIBIA
    moves = np.linalg.solve(slope[:, kept][:, :, others], slope[:, kept, _PULL, None])[..., 0]
    grows = slope[:, _TIBIA, _PULL] - np.einsum("ij,ij->i", slope[:, _TIBIA, others], moves)

    def forwards(force: Iterable[ArrayLike]) -> np.ndarray:
        return np.asarray(tibia.placement.turn_back(tuple(map(jnp.asarray, force)))[0])

    found, fibres = evaluate(knee, tibia), knee.ligaments.names
    tension = np.asarray(found.tension).T
    pulls = tension * forwards(add_lane_axis(knee.ligaments).unit_pulls(State({TIBIA: tibia})))
    shear = {
        "patellar tendon": forwards(tendon * along / np.linalg.norm(along, axis=0)),
        "contact": np.asarray(found.contact_force)[:, :, 0].sum(axis=1),
        "weight": forwards(x + 0.0 * flexion for x in weight.force),
        **dict(zip(fibres, pulls, strict=True)),
    }
    each = {name: tension[fibre_rows(knee, name)].sum(axis=0)
            for name in (*(group for group, _ in knee.groups), *fibres)}  # fmt: skip
    return RigidLeg(
        np.asarray(flexion_deg, float), tibia, np.asarray(there.to_table()), pull, tendon,
        pull[:, None] * own[:, 10:12], pull * np.linalg.norm(pressed.sum(axis=1), axis=1),
        grows / scales(["flexion"])[0], each, shear, table,
    )  # fmt: skip


def held_by_rigid_patella(
    knee: Knee, patella: RigidPatella, weight: Load, flexion: Array, near: Array
) -> Array:
    """Where a leg is held, as unknowns of tibia, pull and patella.

    Args:
        knee: as in `rigid_leg`; likewise `patella`. Its contacts are sums over points.
        weight: of the leg.
        flexion: rad, `(poses,)`.
        near: where to search, `(poses, unknowns)`.

    Returns:
        The unknowns, `(poses, unknowns)`: the tibia's free coordinates, rad and mm, the pull, N,
        those of the patella; differentiable by every number but `near`.
    """
    still = jax.lax.stop_gradient((knee, patella, weight, flexion))
    found, slope = _searched(*still, near)
    # One step from a root by the slope there has the root's derivative, two the second as well.
    unknowns = found
    for _ in range(2 if traced(knee, patella, weight, flexion) else 1):
        left = _unbalanced_at(knee, patella, weight, flexion, unknowns)
        unknowns = unknowns - jnp.linalg.solve(slope, left[..., None])[..., 0]
    return unknowns


def _searched(knee, patella, weight, flexion, near: Array) -> tuple[Array, Array]:
    """The roots, and the derivatives of what vanishes there; both NaN where there is none."""
    unknowns, units = np.asarray(near), np.array(_UNITS)
    lost, slope = np.ones(len(unknowns), bool), np.zeros((*unknowns.shape, len(units)))
    for _ in range(_MOST_STEPS):
        # Numbers that no program has handed out: for those it would be compiled anew.
        left, slope = map(np.asarray, _linear(knee, patella, weight, flexion, unknowns))
        lost = ~(np.abs(left).max(axis=-1) < _ENOUGH_N)
        if not lost.any():
            break
        step = np.linalg.solve(slope, -left[..., None])[..., 0]
        size = np.abs(step / units).max(axis=-1, keepdims=True)
        unknowns = unknowns + step * np.minimum(1.0, _LONGEST / size)
    unknowns = np.where(lost[:, None], np.nan, unknowns)
    return jnp.asarray(unknowns), jnp.asarray(np.where(lost[:, None, None], np.nan, slope))


@compiled()
def _unbalanced_at(knee, patella, weight, flexion, unknowns: Array) -> Array:
    return jax.vmap(functools.partial(_unbalanced, knee, patella, weight))(flexion, unknowns)


@compiled()
def _linear(knee, patella, weight, flexion, unknowns: Array) -> tuple[Array, Array]:
    """What is unbalanced, `(poses, n)`, and its derivative by the unknowns, `(poses, n, n)`."""

    def one(a: Array, x: Array) -> tuple[Array, Array]:
        left = functools.partial(_unbalanced, knee, patella, weight, a)
        # One direction after the other: all at once would copy every point of a contact for each
        # of them, and compile for minutes.
        ways = jnp.eye(len(x))
        return left(x), jax.lax.map(lambda way: jax.jvp(left, (x,), (way,))[1], ways).T

    return jax.vmap(one)(flexion, unknowns)


#: What counts as 1 of each unknown.
_UNITS = (*scales(FREE_COORDINATES), _PULL_N, *SCALES)
#: What is balanced on the tibia.
_BALANCED = (*FREE_COORDINATES, "flexion")


def _unbalanced(knee, patella, weight, flexion, unknowns: Array) -> Array:
    """What vanishes where the leg is held: forces on the tibia, the moment about the flexion axis,
    and all of the patella."""
    pull, own = unknowns[_PULL], unknowns[_FIRST:]
    state = State.of({"flexion": flexion[None]}, unknowns[:_TIBIA, None])
    point = state.tibia.placement.apply(tuple(patella.tibial_attachment))
    attached = jnp.stack([jnp.ravel(x)[0] for x in jnp.broadcast_arrays(*point)])
    along = patella.tendon(Pose(*own[:6]).placement, attached)
    tendon = Load(pull * own[12] * along / jnp.linalg.norm(along), point=patella.tibial_attachment)
    left = force_along(add_lane_axis(knee), state, None, _BALANCED)[:, 0]
    for load in (weight, tendon):
        left = left - jnp.stack([x[0] for x in add_lane_axis(load).work(state, _BALANCED)])
    return jnp.concatenate([left * jnp.array(scales(_BALANCED)), patella.stationary(own, attached)])


def _beginnings(
    knee: Knee, patella: RigidPatella, start: Pose, flexion_deg: np.ndarray, weight: Load
) -> Array:
    """Near the held leg: the knee under its weight and the tendon of a patella that rides
    on the tibia's passive motion."""
    # A first pull: of a tibia that only flexes about its own origin.
    turn = np.deg2rad(flexion_deg)
    bent = State({TIBIA: Pose(jnp.asarray(turn), *[jnp.zeros(len(turn))] * 5)})
    carried = np.maximum(np.asarray(weight.work(bent, ("flexion",))[0]) / _ARM_MM, 1.0)
    passive = passive_flexion(knee, flexion_deg)
    attached = np.stack(
        [np.broadcast_to(np.asarray(x), len(carried))
         for x in passive.pose.placement.apply(tuple(patella.tibial_attachment))], axis=1,
    )  # fmt: skip
    coordinates = jnp.stack([jnp.ravel(jnp.asarray(x))[0] for x in jax.tree.leaves(start)])
    touch = [jnp.stack([0.0 * x, x]) for x in (jnp.mean(g.width) for g in patella.groove)]
    near = jnp.concatenate([coordinates, *touch, jnp.array(_NEAR_FORCES)])
    solve, rows, ways = jax.jit(RigidPatella.balanced), [], []
    for place in map(jnp.asarray, attached):
        here = solve(patella, place, near)
        near = jnp.where(jnp.all(jnp.isfinite(here)), here, near)
        rows.append(near)
        ways.append(patella.tendon(Pose(*near[:6]).placement, place))
    own, along = np.array(rows), np.array(ways)
    along *= (carried * own[:, 12] / np.linalg.norm(along, axis=1))[:, None]
    tendon = Load(along, np.zeros_like(along), np.tile(patella.tibial_attachment, (len(along), 1)))
    loaded = passive_flexion(knee, flexion_deg, [weight, tendon])
    return jnp.asarray(np.c_[np.asarray(loaded.equilibrium.q).T, carried, own])
