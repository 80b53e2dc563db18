"""Balanced poses and their exact derivatives: the one solve of the package.

The derivative of a balanced pose with respect to any number of the knee follows from the implicit
function theorem, in the rule below and nowhere else: a dense solve per lane, with lanes that failed
set to NaN and no influence on the others.
"""

__all__ = ["Equilibrium", "differentiable", "needs_float64", "solve_equilibrium", "with_tangent"]

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import optimistix as optx
from jax import Array, lax

from kneejax.geometry import Pose, Prescribed, State, free_of
from kneejax.mechanics import Knee, displacement
from kneejax.numerics import as_known, compiled, identity, ruled, solve, unknown_where
from kneejax.statics._balance import Balance, balance, force_derivative
from kneejax.statics._newton import EnergyNewton, Guess, SearchState, look, newton_step_left
from kneejax.statics._status import ContactFaults, Status, converged, worst_fault

_SEARCH = EnergyNewton()
# Backstop of the solver's loop; a search ends by its own `most_steps`.
_MOST_ROUNDS = 256


class Equilibrium(eqx.Module):
    """Balanced poses of one or many knees; arrays end in lanes.

    Attributes:
        prescribed: coordinate -> its value, `(lanes,)`, rad or mm.
        q: free coordinates `(free, lanes)`, rad and mm, in the order of `kneejax.geometry.free_of`;
            NaN where the search failed.
        contact_points: parameters of the points where surfaces meet, `(n, 2, lanes)`; without
            derivatives.
        residual: unbalanced force left, `(free, lanes)`, N mm per rad and N.
        tangent: stiffness `(free, free, lanes)`.
        reaction: what holds the prescribed coordinates, in the order of their names, `(prescribed,
            lanes)`, N mm and N; of derivatives it knows nothing, `force_along` does.
        coupling: its derivative by the free ones, `(prescribed, free, lanes)`.
        pivots: of the scaled symmetric tangent; all positive where the pose is stable.
        depth: of each patch, `(n, lanes)`, mm.
        status: `Status` value.
        fault: the pose at which the search ended, balanced or not, taken by itself; `Status` value.
        left_mm: how far the search ended from a balance: the Newton step that is left, mm
            (rotations at 30 mm).
        steps: Newton steps taken.
        bodies: that move.
    """

    prescribed: Prescribed
    q: Array
    contact_points: Array
    residual: Array
    tangent: Array
    reaction: Array
    coupling: Array
    pivots: Array
    depth: Array
    status: Array
    fault: Array
    left_mm: Array
    steps: Array
    bodies: tuple[str, ...] = eqx.field(static=True)

    @property
    def state(self) -> State:
        """Where all bones are."""
        return State.of(self.prescribed, self.q, self.bodies)

    @property
    def pose(self) -> Pose:
        """Where the tibia is."""
        return self.state.tibia

    @property
    def converged(self) -> Array:
        """Where forces balance."""
        return converged(self.status)

    @property
    def stable(self) -> Array:
        """Where the tangent stiffness is positive definite as well."""
        return self.converged & jnp.all(self.pivots > 0, axis=0)


def solve_equilibrium(
    knee: Knee, prescribed: Prescribed, guess: Guess, search: EnergyNewton = _SEARCH
) -> Equilibrium:
    """Find the balance near a guess.

    Args:
        knee: leaves end in a lane axis (see `kneejax.mechanics.add_lane_axis`).
        prescribed: coordinate -> its value, `(lanes,)`, rad or mm; all others are free.
        guess: where to start; nothing is differentiated through it. A pose that is NaN is replaced
            by the knee's reference pose.
        search: how to find the balance.

    Returns:
        The balance, differentiable by every leaf of the knee and by what is prescribed (forward
        mode and, as the rule is linear, reverse mode); NaN with NaN derivatives where it failed.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    still = lax.stop_gradient((knee, prescribed, guess))
    return differentiable(knee, prescribed, _search(*still, search))


def needs_float64() -> None:
    """Raise `RuntimeError` where JAX computes in single precision.

    Energies, which decide what is downhill, are then rounded to 1e-4 N mm.

    Example:
        >>> needs_float64()
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "kneejax needs float64: call jax.config.update('jax_enable_x64', True) before anything"
        )


def differentiable(knee: Knee, prescribed: Prescribed, found: Equilibrium) -> Equilibrium:
    """A balance that has been found, as a function of the knee and of what is prescribed.

    Its derivative needs no search, so one compiled search serves every choice of parameters.

    Args:
        knee: with which it was found; leaves end in a lane axis.
        prescribed: with which it was found.
        found: the balance.

    Returns:
        The same balance, differentiable as `solve_equilibrium` is.
    """
    found = lax.stop_gradient(found)
    q = ruled(_following, found.q, knee, prescribed, found)
    return dataclasses.replace(found, prescribed=prescribed, q=q)


def with_tangent(knee: Knee, prescribed: Prescribed, found: Equilibrium) -> Equilibrium:
    """A balance with the tangent exactly there, arguments as `differentiable`: that of its search
    is a last step away, too far for a cable that becomes taut within 0.1 micrometre."""
    knee, prescribed, found = lax.stop_gradient((knee, prescribed, found))
    tangent = balance(knee, prescribed, found.q, found.contact_points).tangent
    return dataclasses.replace(found, tangent=tangent)


@compiled(static_argnums=(3,))
def _search(knee: Knee, prescribed: Prescribed, guess: Guess, search: EnergyNewton) -> Equilibrium:
    # One lane that starts from NaN would end the search of all.
    reference = knee.at_reference.at(free_of(prescribed, knee.bodies))
    q = jnp.where(jnp.isnan(guess.q), jnp.broadcast_to(reference, guess.q.shape), guess.q)
    knee, near = knee.for_many_poses(), guess.contact_points
    if near is None:
        near = jnp.full((knee.patch_count, 2, *q.shape[1:]), jnp.nan)
    solution = optx.root_find(
        look,
        search,
        q,
        (knee, prescribed, near),
        has_aux=True,
        max_steps=_MOST_ROUNDS,
        throw=False,
    )
    here: SearchState = solution.aux
    left_mm, pivots = newton_step_left(here.there.tangent, here.there.residual, here.scales)
    fault = fault_of(knee, prescribed, here, pivots)
    status = jnp.where(here.done, fault, int(Status.NOT_CONVERGED))
    return Equilibrium(
        prescribed, jnp.where(converged(status), solution.value, jnp.nan),
        here.best.contact_points, **forces_of(here.there), pivots=pivots, status=status,
        fault=fault, left_mm=left_mm, steps=here.count, bodies=knee.bodies,
    )  # fmt: skip


def forces_of(here: Balance) -> dict[str, Array]:
    """The fields of `Equilibrium` that a look has computed."""
    return dict(
        residual=jnp.stack(here.residual),
        tangent=here.tangent,
        reaction=jnp.stack(here.reaction) if here.reaction else here.coupling[:, 0],
        coupling=here.coupling,
        depth=here.forces.depth,
    )


def fault_of(knee: Knee, prescribed: Prescribed, here: SearchState, pivots: Array) -> Array:
    """What the pose at which a search ended is by itself, balanced or not; `Status` values."""
    state, forces = State.of(prescribed, here.best.q, knee.bodies), here.there.forces
    found = []
    for row, contact in enumerate(one for one in knee.contacts if one.has_patch):
        depth, known = forces.depth[row], forces.known[row]
        touches = depth > 0
        outside, deep = touches & ~known, depth >= contact.layer_thickness
        # Off the fitted surfaces a shape says nothing, and that has been said.
        flat = touches & known & forces.flat[row]
        # Two that meet within the layer where both are known have their solids on either side.
        through = contact.passed_through(state.between(contact.bodies)) & (deep | ~known)
        found.append(ContactFaults(depth, outside, deep, flat, through))
    if (points := forces.points) is not None:
        through = jnp.zeros_like(points.lost)
        for bed in knee.over_points:
            through |= jnp.any(bed.passed_through(state.between(bed.bodies)), axis=0)
        deep = points.too_deep | points.lost
        found.append(ContactFaults(points.depth, points.outside, deep, deep & False, through))
    stable = jnp.where(jnp.all(pivots > 0, axis=0), int(Status.BALANCED), int(Status.UNSTABLE))
    worst = worst_fault(found, forces.fibres, displacement(knee, state.tibia))
    return jnp.maximum(stable, worst).astype(int)


def _following(q, primals, tangents):
    # What the rule reads of the balance follows it in turn: so further derivatives are exact, too.
    knee, prescribed, found = primals
    failed, size = ~found.converged, len(q)
    # Anywhere, where there is no balance: what is computed there goes nowhere.
    held = knee, prescribed, jnp.where(failed, 0.0, q), found.contact_points
    change = force_derivative(*held, *tangents[:2])
    tangent = as_known(lambda *held: balance(*held).tangent, found.tangent, *held)
    tangent = jnp.where(failed, identity(size, q.ndim - 1), tangent)
    d_q, _ = solve(tangent, -change)
    return q, unknown_where(failed, jnp.stack(d_q))
