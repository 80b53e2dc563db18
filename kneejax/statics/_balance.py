"""Forces and tangent stiffness at a pose, as exact derivatives of the energy.

The free coordinates `q` (5) are joined by the meeting points `s` of the contacts (2 each), which
are determined by `q` through "the slope of the gap is zero". With the multiplier that makes the
energy blind to a shift of `s`,

    L(q, s) = energy(q, s) + multiplier . slope(q, s),

the force is the partial derivative of `L` by `q`, and the tangent its second derivative along
`(q, s(q))`: nothing has to be differentiated through a search. All arrays end in lanes.
"""

from __future__ import annotations

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import Pose
from kneejax.mechanics import Gap, Knee


class Balance(eqx.Module):
    """What holds a pose, and how stiffly.

    Attributes:
        energy: N mm.
        residual: unbalanced generalised force, `(5, lanes)`: N mm per rad twice, then N thrice.
        load: generalised force of the loads, `(5, lanes)`.
        tangent: derivative of the residual, `(5, 5, lanes)`: row force, column coordinate.
        drift: derivative of the meeting points by the coordinates, `(5, n, 2, lanes)`.
        gap: the gaps at the meeting points.
    """

    energy: Array
    residual: Array
    load: Array
    tangent: Array
    drift: Array
    gap: Gap


def force(knee: Knee, flexion: Array, q: Array, meeting: Array) -> tuple[Array, Array]:
    """Unbalanced generalised force `(5, lanes)` and energy; arguments as `balance`."""
    pull, multiplier, energy, _ = _pull_back(knee, flexion, q, meeting)
    by_q, _ = pull((jnp.ones_like(energy), multiplier))
    return by_q - knee.load_work(Pose.from_state(flexion, q)), energy


def balance(knee: Knee, flexion: Array, q: Array, meeting: Array) -> Balance:
    """Residual and tangent at a pose.

    Args:
        knee: leaves end in a lane axis.
        flexion: rad, `(lanes,)`.
        q: `(5, lanes)`, rad and mm.
        meeting: `(n, 2, lanes)`, converged meeting points.

    Returns:
        A `Balance`.
    """
    pull, multiplier, energy, gap = _pull_back(knee, flexion, q, meeting)
    by_q, _ = pull((jnp.ones_like(energy), multiplier))
    load = knee.load_work(Pose.from_state(flexion, q))
    drift = _drift(knee, flexion, q, meeting)

    def column(direction: Array, follow: Array) -> Array:
        def forces(q_: Array, meeting_: Array):
            return _lagrangian_slopes(knee, flexion, q_, meeting_, multiplier)

        _, change = jax.jvp(forces, (q, meeting), (direction, follow))
        return _with_meeting(drift, change)

    tangent = jax.vmap(column, out_axes=1)(_units(q), drift)
    # Blind to first order to what is left of the search for the meeting points.
    energy = energy + jnp.sum(multiplier * gap.slope, axis=(0, 1))
    return Balance(energy, by_q - load, load, tangent, drift, gap)


#: `balance` traced once for all who call it with arrays of one shape: tracing takes a second.
traced_balance = jax.jit(balance, inline=True)


def force_derivative(
    knee: Knee,
    flexion: Array,
    q: Array,
    meeting: Array,
    drift: Array,
    knee_tangent: Knee,
    flexion_tangent: Array,
) -> tuple[Array, Array]:
    """Derivative of the residual, at fixed `q`, along a change of the knee and of flexion.

    Args:
        knee: as in `balance`; likewise `flexion`, `q`, `meeting`.
        drift: from `balance`.
        knee_tangent: change of every leaf.
        flexion_tangent: change of flexion.

    Returns:
        Change of the residual `(5, lanes)` and of the meeting points `(n, 2, lanes)`.
    """
    tangents = (knee_tangent, flexion_tangent)
    _, multiplier, _, gap = _pull_back(knee, flexion, q, meeting)
    _, moved = jax.jvp(lambda k, f: _gap_slopes(k, f, q, meeting), (knee, flexion), tangents)
    follow = -jax.vmap(Gap.newton)(gap, moved)

    def forces(knee_: Knee, flexion_: Array, meeting_: Array):
        return _lagrangian_slopes(knee_, flexion_, q, meeting_, multiplier)

    _, change = jax.jvp(forces, (knee, flexion, meeting), (*tangents, follow))
    return _with_meeting(drift, change), follow


def energy_force_derivative(knee: Knee, flexion: Array, q: Array, knee_tangent: Knee) -> Array:
    """Derivative of the residual along a change that leaves contacts and flexion alone.

    Args:
        knee: as in `balance`; likewise `flexion`, `q`.
        knee_tangent: change of every leaf; that of the contacts is not read.

    Returns:
        Change of the residual `(5, lanes)`.
    """

    def forces(knee_: Knee) -> Array:
        def energy(q_: Array) -> Array:
            return jnp.sum(knee_.energy_without_patches(Pose.from_state(flexion, q_)))

        return jax.grad(energy)(q) - knee_.load_work(Pose.from_state(flexion, q))

    return jax.jvp(forces, (knee,), (knee_tangent,))[1]


@partial(jax.jit, inline=True)
def _energy_at(knee: Knee, flexion: Array, q: Array, meeting: Array) -> tuple[Array, Gap]:
    """Energy and gaps. Jitted so that Python runs through the mechanics once, not once for each
    of the six derivatives that `balance` takes: that halves the time to trace it."""
    return knee.energy_at(Pose.from_state(flexion, q), meeting)


def _pull_back(knee: Knee, flexion: Array, q: Array, meeting: Array):
    """Pull-back of energy and gap slopes to `(q, s)`, the multiplier, energy and gaps."""

    def parts(q_: Array, meeting_: Array):
        energy, gap = _energy_at(knee, flexion, q_, meeting_)
        return (energy, gap.slope), gap

    (energy, slope), pull, gap = jax.vjp(parts, q, meeting, has_aux=True)
    _, by_meeting = pull((jnp.ones_like(energy), jnp.zeros_like(slope)))
    return pull, -jax.vmap(Gap.newton)(gap, by_meeting), energy, gap


def _lagrangian_slopes(knee, flexion, q, meeting, multiplier) -> tuple[Array, Array]:
    """Derivatives of `L` by `q` and `s` (loads included in the first), the multiplier held."""

    def lagrangian(q_: Array, meeting_: Array) -> Array:
        energy, gap = _energy_at(knee, flexion, q_, meeting_)
        return jnp.sum(energy) + jnp.sum(multiplier * gap.slope)

    by_q, by_meeting = jax.grad(lagrangian, (0, 1))(q, meeting)
    return by_q - knee.load_work(Pose.from_state(flexion, q)), by_meeting


def _gap_slopes(knee: Knee, flexion: Array, q: Array, meeting: Array) -> Array:
    _, gap = _energy_at(knee, flexion, q, meeting)
    return gap.slope


def _drift(knee: Knee, flexion: Array, q: Array, meeting: Array) -> Array:
    _, gap = _energy_at(knee, flexion, q, meeting)

    def follow(direction: Array) -> Array:
        _, moved = jax.jvp(lambda x: _gap_slopes(knee, flexion, x, meeting), (q,), (direction,))
        return -jax.vmap(Gap.newton)(gap, moved)

    return jax.vmap(follow)(_units(q))


def _units(q: Array) -> Array:
    return jnp.eye(5).reshape((5, 5) + (1,) * (q.ndim - 1)) + jnp.zeros_like(q)


def _with_meeting(drift: Array, change: tuple[Array, Array]) -> Array:
    """Change of `dL/dq` plus that of `dL/ds` seen through the drift of the meeting points."""
    by_q, by_meeting = change
    return by_q + jnp.sum(drift * by_meeting, axis=(1, 2))
