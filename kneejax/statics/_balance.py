"""Forces and tangent stiffness at a pose.

The free coordinates `q` are joined by the meeting points `s` of the contacts (2 each), which
are determined by `q` through "the slope of the gap is zero". A patch's wrench is the derivative of
its energy along `(q, s(q))` already (`mechanics/contact/_patch_force.py`), so the tangent is the
derivative of the wrenches along the same path: nothing has to be differentiated through a search.
All arrays end in lanes.
"""

from __future__ import annotations

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import Prescribed, State, Vector, free_of
from kneejax.mechanics import (
    OFF_SURFACE_MM,
    Contact,
    FibreFaults,
    Held,
    Knee,
    PointFaults,
    Pressed,
    Wrenches,
    generalised_force,
)
from kneejax.numerics import identity, jvp_of_moved


class Forces(eqx.Module):
    """What holds a pose.

    Attributes:
        energy: N mm.
        load: generalised force of the loads on the free coordinates, `(free, lanes)`.
        drift: derivative of the meeting points by the free coordinates: for each of them the two
            parameters' `(n, lanes)`.
        miss: how far off the meeting points are, to first order, `(n, lanes)`, mm.
        depth: there, `(n, lanes)`, mm.
        point: the meeting points in the tibial surfaces' frames, each component `(n, lanes)`, mm.
        meeting: their parameters after one Newton step towards the smallest gap, two `(n, lanes)`.
        flat: whether no elliptical patch fits there, `(n, lanes)`.
        known: whether all of the patch lies where both surfaces are known, `(n, lanes)`.
        points: what is wrong with the contacts over points together; None without any.
        fibres: what is wrong with any fibre.
    """

    energy: Array
    load: Array
    drift: tuple[tuple[Array, Array], ...]
    miss: Array
    depth: Array
    point: Vector
    meeting: tuple[Array, Array]
    flat: Array
    known: Array
    points: PointFaults | None
    fibres: FibreFaults


class Balance(eqx.Module):
    """What holds a pose, and how stiffly.

    Attributes:
        residual: unbalanced generalised force on the free coordinates, `(free, lanes)`: N mm per
            rad of a rotation, N of a translation.
        tangent: derivative of the residual, `(free, free, lanes)`: row force, column coordinate.
        forces: see `Forces`.
    """

    residual: Array
    tangent: Array
    forces: Forces


def force(
    knee: Knee, prescribed: Prescribed, q: Array, meeting: tuple[Array, Array]
) -> tuple[Array, Forces]:
    """Unbalanced generalised force, and what it is made of.

    Args:
        knee: leaves end in a lane axis.
        prescribed: coordinate -> its value, `(lanes,)`, rad or mm; all others are free.
        q: the free ones, `(free, lanes)`, rad and mm, in the order of `kneejax.geometry.free_of`.
        meeting: parameters of the converged meeting points, two arrays `(n, lanes)`.

    Returns:
        Residual `(free, lanes)` and `Forces`.
    """
    residual, forces = rows_of_force(knee, prescribed, q, meeting)
    return jnp.stack(residual[: len(q)]), forces


def rows_of_force(
    knee: Knee, prescribed: Prescribed, q: Array, meeting: tuple[Array, Array]
) -> tuple[tuple[Array, ...], Forces]:
    """As `force`, the residual in rows of lanes; below, likewise what holds the prescribed ones, in
    the order of their names."""
    state, free = _where(knee, prescribed, q)
    held = knee.press(state, meeting)
    every = *free, *sorted(prescribed)
    return _unbalanced(knee, state, held.wrenches, every), _forces(knee, state, held, free)


def force_along(
    knee: Knee, state: State, meeting: tuple[Array, Array], names: tuple[str, ...]
) -> Array:
    """Unbalanced generalised force along any coordinates, `(names, lanes)`.

    Args:
        knee: as in `force`; likewise `meeting`.
        state: where the bodies are.
        names: of the coordinates, free or prescribed.
    """
    return jnp.stack(_unbalanced(knee, state, knee.press(state, meeting).wrenches, names))


def balance(knee: Knee, prescribed: Prescribed, q: Array, meeting: tuple[Array, Array]) -> Balance:
    """Residual and tangent at a pose. Arguments as `force`."""

    residual, forces, tangent = linearised(
        lambda q_, both: rows_of_force(knee, prescribed, q_, (both[:, 0], both[:, 1])),
        q,
        jnp.stack(meeting, axis=1),
    )
    free = slice(len(q))
    return Balance(jnp.stack(residual[free]), tangent()[free], forces)


def linearised(
    force_at: Callable[[Array, Array], tuple[tuple[Array, ...], Forces]],
    q: Array,
    meeting: Array,
) -> tuple[tuple[Array, ...], Forces, Callable[[], Array]]:
    """Forces at a pose, and their tangent for those who want it.

    The tangent goes on from what the forces have computed already: computed by itself it would
    cost all of that again, and as much memory to compile (0.1 GB in a search).

    Args:
        force_at: of `q` and `meeting`, the residual in rows, and `Forces`.
        q: `(free, lanes)`, rad and mm.
        meeting: parameters of the meeting points, `(n, 2, lanes)`.

    Returns:
        Residual, `Forces`, and a function that computes the tangent, `(rows, free, lanes)`.
    """
    residual, push, forces = jax.linearize(force_at, q, meeting, has_aux=True)

    def tangent() -> Array:
        units = identity(len(q), q.ndim - 1) + jnp.zeros_like(q)
        follow = jnp.stack([jnp.stack(pair, axis=1) for pair in forces.drift])
        return jnp.stack(jax.vmap(push)(units, follow))

    return residual, forces, tangent


def force_derivative(
    knee: Knee,
    prescribed: Prescribed,
    q: Array,
    meeting: tuple[Array, Array],
    knee_tangent: Knee,
    prescribed_tangent: Prescribed,
) -> tuple[Array, Array]:
    """Derivative of the residual, `q` fixed, along a change of the knee and of what is prescribed.

    Args:
        knee: as in `balance`; likewise `prescribed`, `q`, `meeting`.
        knee_tangent: change of every leaf, a `SymbolicZero` where it stays: nothing is compiled for
            that.
        prescribed_tangent: likewise, of what is prescribed.

    Returns:
        Change of the residual `(free, lanes)` and of the meeting points, two arrays `(n, lanes)`.
    """
    tangents, follow = (knee_tangent, prescribed_tangent), jax.tree.map(jnp.zeros_like, meeting)
    if knee.patch_count:

        def slopes(knee_: Knee, prescribed_: Prescribed):
            state, _ = _where(knee_, prescribed_, q)
            gap = knee_.map_patches(Contact.gap, state, meeting)
            return gap.slope, gap

        (_, gap), (moved, _) = jvp_of_moved(slopes, (knee, prescribed), tangents)
        follow = gap.newton(*moved)

    def residual(knee_: Knee, prescribed_: Prescribed, meeting_: tuple[Array, Array]) -> Array:
        return force(knee_, prescribed_, q, meeting_)[0]

    _, change = jvp_of_moved(residual, (knee, prescribed, meeting), (*tangents, follow))
    return change, follow


def force_derivative_without_contacts(
    knee: Knee, prescribed: Prescribed, q: Array, knee_tangent: Knee
) -> Array:
    """Derivative of the residual along a change that leaves contacts and poses alone.

    Args:
        knee: as in `balance`; likewise `prescribed`, `q`.
        knee_tangent: as in `force_derivative`.

    Returns:
        Change of the residual `(free, lanes)`.
    """
    state, free = _where(knee, prescribed, q)

    def residual(knee_: Knee) -> Array:
        wrenches = knee_.pull(state)[0]
        return jnp.stack(_unbalanced(knee_, state, wrenches, free))

    return jvp_of_moved(residual, (knee,), (knee_tangent,))[1]


def _where(knee: Knee, prescribed: Prescribed, q: Array) -> tuple[State, tuple[str, ...]]:
    """Where the bones are, and the names of the free coordinates."""
    return State.of(prescribed, q, knee.bodies), free_of(prescribed, knee.bodies)


def _unbalanced(
    knee: Knee, state: State, wrenches: Wrenches, free: tuple[str, ...]
) -> tuple[Array, ...]:
    """Generalised force that neither the knee's wrenches nor the loads balance, one row each."""
    work = knee.work_of(wrenches, state, free)
    return tuple(-w - load for w, load in zip(work, knee.load_work(state, free), strict=True))


def _forces(knee: Knee, state: State, held: Held, free: tuple[str, ...]) -> Forces:
    load, pressed, faults = knee.load_work(state, free), held.patches, (held.points, held.fibres)
    if pressed is None:
        none = jnp.zeros((0, *state.shape))
        drift, point, pair = ((none, none),) * len(free), (none,) * 3, (none, none)
        return Forces(
            held.energy, load, drift, none, none, point, pair, none > 0, none > 0, *faults
        )
    gap = pressed.gap
    moved = (_slopes_moved(knee, state, pressed, k, free) for k in (0, 1))
    drift = tuple(gap.newton(a, b) for a, b in zip(*moved, strict=True))
    met = pressed.miss, gap.depth, gap.point, pressed.renewed
    fits = ~gap.has_ellipse, pressed.off <= OFF_SURFACE_MM
    return Forces(held.energy, load, drift, *met, *fits, *faults)


def _slopes_moved(
    knee: Knee, state: State, pressed: Pressed, slope: int, free: tuple[str, ...]
) -> tuple[Array, ...]:
    """Change of one slope of each patch's gap by the free coordinates, `(n, lanes)` each."""
    found, order = [], []
    for pair, rows in knee.patches.items():
        wrench = pressed.of(rows).slope_wrenches[slope]
        found.append(generalised_force(state, pair, wrench, free))
        order += rows
    if len(found) == 1:
        return found[0]
    back = jnp.argsort(jnp.array(order))
    return tuple(jnp.concatenate(row)[back] for row in zip(*found, strict=True))
