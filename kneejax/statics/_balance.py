"""Forces and tangent stiffness at a pose.

Contacts find the points where their surfaces meet by themselves, near those that are handed in.
All arrays end in lanes.
"""

__all__ = ["Balance", "balance", "force", "force_along", "force_derivative"]

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.custom_derivatives import SymbolicZero

from kneejax.geometry import Prescribed, State, free_of
from kneejax.mechanics import OFF_SURFACE_MM, FibreFaults, Held, Knee, PointFaults, Wrenches
from kneejax.numerics import identity, jvp_of_moved


class Forces(eqx.Module):
    """Energy, loads and contacts of a pose."""

    energy: Array  # N mm
    load: Array  # generalised force of the loads on the free coordinates, `(free, lanes)`
    depth: Array  # of each patch, `(n, lanes)`, mm
    contact_points: Array  # parameters of the point where its surfaces meet, `(n, 2, lanes)`
    flat: Array  # whether no elliptical patch fits there, `(n, lanes)`
    known: Array  # whether all of the patch lies where both surfaces are known, `(n, lanes)`
    points: PointFaults | None  # of the contacts over points together; None without any
    fibres: FibreFaults  # of any fibre


class Balance(eqx.Module):
    """Forces at a pose and their derivative.

    Attributes:
        residual: unbalanced generalised force on the free coordinates, in rows `(lanes,)`: N mm per
            rad of a rotation, N of a translation.
        reaction: likewise on the prescribed ones, in the order of their names.
        tangent: derivative of the residual, `(free, free, lanes)`: row force, column coordinate.
        coupling: that of the reaction by the free ones, `(prescribed, free, lanes)`.
        forces: energy, loads and contacts.
    """

    residual: tuple[Array, ...]
    reaction: tuple[Array, ...]
    tangent: Array
    coupling: Array
    forces: Forces


def force(
    knee: Knee, prescribed: Prescribed, q: Array, near: Array | None = None
) -> tuple[Array, Forces]:
    """Unbalanced generalised force, and what it is made of.

    Args:
        knee: leaves end in a lane axis.
        prescribed: coordinate -> its value, `(lanes,)`, rad or mm; all others are free.
        q: the free ones, `(free, lanes)`, rad and mm, in the order of `kneejax.geometry.free_of`.
        near: see `Knee.press`, `(n, 2, lanes)`.

    Returns:
        Residual `(free, lanes)` and `Forces`.
    """
    residual, forces = rows_of_force(knee, prescribed, q, near)
    return jnp.stack(residual[: len(q)]), forces


def rows_of_force(
    knee: Knee, prescribed: Prescribed, q: Array, near: Array | None = None
) -> tuple[tuple[Array, ...], Forces]:
    """As `force`, the residual in rows of lanes; below, the reactions in the order of names."""
    state, free = State.of(prescribed, q, knee.bodies), free_of(prescribed, knee.bodies)
    held = knee.press(state, near)
    every = *free, *sorted(prescribed)
    return _unbalanced(knee, state, held.wrenches, every), _forces(knee, state, held, free)


def force_along(knee: Knee, state: State, near: Array | None, names: tuple[str, ...]) -> Array:
    """Unbalanced generalised force along any coordinates, `(names, lanes)`.

    Args:
        knee: as in `force`; likewise `near`.
        state: where the bodies are.
        names: of the coordinates, free or prescribed.
    """
    return jnp.stack(_unbalanced(knee, state, knee.press(state, near).wrenches, names))


def balance(knee: Knee, prescribed: Prescribed, q: Array, near: Array | None = None) -> Balance:
    """Residual and tangent at a pose. Arguments as `force`."""
    return linearised(lambda x: rows_of_force(knee, prescribed, x, near), q)


def linearised(force_at: Callable[[Array], tuple[tuple[Array, ...], Forces]], q: Array) -> Balance:
    """Forces of a function as `rows_of_force` at `q`, with their tangent, which goes on from what
    they have computed already."""
    rows, push, forces = jax.linearize(force_at, q, has_aux=True)
    units, free = identity(len(q), q.ndim - 1) + jnp.zeros_like(q), len(q)
    slopes = jnp.stack(jax.vmap(push)(units))
    return Balance(rows[:free], rows[free:], slopes[:free], slopes[free:], forces)


def force_derivative(
    knee: Knee,
    prescribed: Prescribed,
    q: Array,
    near: Array | None,
    knee_tangent: Knee,
    prescribed_tangent: Prescribed,
) -> Array:
    """Derivative of the residual, `q` fixed, along a change of the knee and of what is prescribed.

    Args:
        knee: as in `force`; likewise `prescribed`, `q`, `near`.
        knee_tangent: change of every leaf, a `SymbolicZero` where it stays: nothing is compiled for
            that.
        prescribed_tangent: likewise, of what is prescribed.

    Returns:
        Change of the residual, `(free, lanes)`.
    """
    state, free = State.of(prescribed, q, knee.bodies), free_of(prescribed, knee.bodies)
    of_contacts = jax.tree.leaves((knee_tangent.contacts, prescribed_tangent))
    contacts_stay = all(isinstance(x, SymbolicZero) for x in of_contacts)

    def residual(knee_: Knee, prescribed_: Prescribed) -> Array:
        # Fibres alone compile in a tenth of the time, and over points what is known to vanish
        # would be differentiated through the thorough search of every ray.
        if contacts_stay:
            return jnp.stack(_unbalanced(knee_, state, knee_.pull(state)[0], free))
        return force(knee_, prescribed_, q, near)[0]

    return jvp_of_moved(residual, (knee, prescribed), (knee_tangent, prescribed_tangent))[1]


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
        nowhere = jnp.zeros((0, 2, *state.shape))
        return Forces(held.energy, load, none, nowhere, none > 0, none > 0, *faults)
    gap = pressed.gap
    fits = ~gap.has_ellipse, pressed.off <= OFF_SURFACE_MM
    met = gap.depth, jnp.stack(pressed.contact_point, axis=1)
    return Forces(held.energy, load, *met, *fits, *faults)
