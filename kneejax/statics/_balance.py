"""Forces and tangent stiffness at a pose.

The free coordinates `q` (5) are joined by the meeting points `s` of the contacts (2 each), which
are determined by `q` through "the slope of the gap is zero". A patch's wrench is the derivative of
its energy along `(q, s(q))` already (`mechanics/_patch_force.py`), so the tangent is the derivative
of the wrenches along the same path: nothing has to be differentiated through a search. All arrays
end in lanes.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax

from kneejax.geometry import Pose, Vector
from kneejax.mechanics import Contact, Knee, Pressed, Wrench, generalised_force


class Forces(eqx.Module):
    """What holds a pose.

    Attributes:
        energy: N mm.
        load: generalised force of the loads, `(5, lanes)`.
        drift: derivative of the meeting points by the coordinates: for each of the five the two
            parameters' `(n, lanes)`.
        tilt: slope of the gap that is left at the meeting points, `(n, lanes)`, mm per mm.
        depth: there, `(n, lanes)`, mm.
        point: the meeting points in the tibial surfaces' frames, each component `(n, lanes)`, mm.
    """

    energy: Array
    load: Array
    drift: tuple[tuple[Array, Array], ...]
    tilt: Array
    depth: Array
    point: Vector


class Balance(eqx.Module):
    """What holds a pose, and how stiffly.

    Attributes:
        residual: unbalanced generalised force, `(5, lanes)`: N mm per rad twice, then N thrice.
        tangent: derivative of the residual, `(5, 5, lanes)`: row force, column coordinate.
        forces: see `Forces`.
    """

    residual: Array
    tangent: Array
    forces: Forces


def force(
    knee: Knee, flexion: Array, q: Array, meeting: tuple[Array, Array]
) -> tuple[Array, Forces]:
    """Unbalanced generalised force, and what it is made of.

    Args:
        knee: leaves end in a lane axis.
        flexion: rad, `(lanes,)`.
        q: `(5, lanes)`, rad and mm.
        meeting: parameters of the converged meeting points, two arrays `(n, lanes)`.

    Returns:
        Residual `(5, lanes)` and `Forces`.
    """
    residual, forces = rows_of_force(knee, flexion, q, meeting)
    return jnp.stack(residual), forces


def rows_of_force(
    knee: Knee, flexion: Array, q: Array, meeting: tuple[Array, Array]
) -> tuple[tuple[Array, ...], Forces]:
    """As `force`, the residual in five rows of lanes."""
    pose = Pose.from_state(flexion, q)
    wrenches, energy, pressed = knee.press(pose, meeting)
    rows = _unbalanced(knee, pose, Wrench.total(wrenches))
    return rows, _forces(knee, pose, energy, pressed)


def balance(
    knee: Knee, flexion: Array, q: Array, meeting: tuple[Array, Array]
) -> Balance:
    """Residual and tangent at a pose. Arguments as `force`."""

    def wrenches(q_: Array, meeting_: tuple[Array, Array]):
        parts, *rest = knee.press(Pose.from_state(flexion, q_), meeting_)
        return parts, rest

    parts, push, (energy, pressed) = jax.linearize(wrenches, q, meeting, has_aux=True)
    pose, total = Pose.from_state(flexion, q), Wrench.total(parts)
    forces = _forces(knee, pose, energy, pressed)
    units = jnp.eye(5).reshape((5, 5) + (1,) * (q.ndim - 1)) + jnp.zeros_like(q)
    follow = tuple(jnp.stack(rows) for rows in zip(*forces.drift, strict=True))
    # All directions at once: 0.30 ms over 64 lanes, one after the other 0.37. Over points they go
    # one after the other: every coefficient would be copied five times, and nothing is gained.
    pushed = jax.vmap(push) if knee.patch_count else lambda *way: lax.map(lambda w: push(*w), way)
    changes = Wrench.total(pushed(units, follow), axis=1)
    elastic = -jnp.stack(generalised_force(pose, pose.placement, changes))

    def turning(direction: Array) -> Array:
        """The wrenches and loads stand still, the coordinates' axes turn."""
        return jax.jvp(
            lambda q_: jnp.stack(_unbalanced(knee, Pose.from_state(flexion, q_), total)),
            (q,),
            (direction,),
        )[1]

    tangent = elastic + jax.vmap(turning, out_axes=1)(units)
    return Balance(jnp.stack(_unbalanced(knee, pose, total)), tangent, forces)


def force_derivative(
    knee: Knee,
    flexion: Array,
    q: Array,
    meeting: tuple[Array, Array],
    knee_tangent: Knee,
    flexion_tangent: Array,
) -> tuple[Array, Array]:
    """Derivative of the residual, at fixed `q`, along a change of the knee and of flexion.

    Args:
        knee: as in `balance`; likewise `flexion`, `q`, `meeting`.
        knee_tangent: change of every leaf.
        flexion_tangent: change of flexion.

    Returns:
        Change of the residual `(5, lanes)` and of the meeting points, two arrays `(n, lanes)`.
    """
    tangents, follow = (knee_tangent, flexion_tangent), jax.tree.map(jnp.zeros_like, meeting)
    if knee.patch_count:

        def slopes(knee_: Knee, flexion_: Array):
            tibia = Pose.from_state(flexion_, q).placement
            gap = knee_.map_patches(Contact.gap, tibia, meeting)
            return gap.slope, gap

        _, moved, gap = jax.jvp(slopes, (knee, flexion), tangents, has_aux=True)
        follow = gap.newton(*moved)

    def residual(knee_: Knee, flexion_: Array, meeting_: tuple[Array, Array]) -> Array:
        return force(knee_, flexion_, q, meeting_)[0]

    _, change = jax.jvp(residual, (knee, flexion, meeting), (*tangents, follow))
    return change, follow


def force_derivative_without_patches(
    knee: Knee, flexion: Array, q: Array, knee_tangent: Knee
) -> Array:
    """Derivative of the residual along a change that leaves patches and flexion alone.

    Args:
        knee: as in `balance`; likewise `flexion`, `q`.
        knee_tangent: change of every leaf; that of the patches is not read.

    Returns:
        Change of the residual `(5, lanes)`.
    """
    pose = Pose.from_state(flexion, q)

    def residual(knee_: Knee) -> Array:
        wrench = Wrench.total(knee_.press_without_patches(pose)[0])
        return jnp.stack(_unbalanced(knee_, pose, wrench))

    return jax.jvp(residual, (knee,), (knee_tangent,))[1]


def _unbalanced(knee: Knee, pose: Pose, wrench: Wrench) -> tuple[Array, ...]:
    """Generalised force that neither the knee's wrench nor the loads balance, five rows."""
    work = generalised_force(pose, pose.placement, wrench)
    return tuple(-w - load for w, load in zip(work, knee.load_work(pose), strict=True))


def _forces(knee: Knee, pose: Pose, energy: Array, pressed: Pressed | None) -> Forces:
    load = knee.load_work(pose)
    if pressed is None:
        none = jnp.zeros((0, *jnp.shape(pose.adduction)))
        return Forces(energy, load, ((none, none),) * 5, none, none, (none,) * 3)
    gap = pressed.gap
    moved = (generalised_force(pose, pose.placement, w) for w in pressed.slope_wrenches)
    drift = tuple(gap.newton(a, b) for a, b in zip(*moved, strict=True))
    return Forces(energy, load, drift, gap.tilt, gap.depth, gap.point)
