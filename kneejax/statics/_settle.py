"""Balanced poses and their exact derivatives: the one solve of the package.

Lanes march from a pose that is known to the flexion that is wanted, in small steps with a secant
predictor, so that each stays on the branch of its knee. The derivative of a balanced pose by any
number of the knee follows from the implicit function theorem, in the rule below and nowhere else:
a dense solve per lane, with lanes that failed set to NaN and no influence on the others.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero
from jax.typing import ArrayLike

from kneejax.geometry import Placement, Pose
from kneejax.mechanics import Contact, Knee, displacement
from kneejax.numerics import compiled, instantiate, solve
from kneejax.statics._balance import (
    force_derivative,
    force_derivative_without_patches,
)
from kneejax.statics._faults import ContactFaults, Faults
from kneejax.statics._newton import (
    UNITS,
    EnergyNewton,
    Guess,
    SearchState,
    look,
)
from kneejax.statics._softness import newton_step_left
from kneejax.statics._status import Status, converged

#: How the balance of one pose is found unless a caller says otherwise.
SEARCH = EnergyNewton()
#: Flexion between two poses on the way, rad.
STRIDE = np.deg2rad(5.0)
# Backstop of the solver's loop; a search ends by its own `most_steps`.
_MOST_ROUNDS = 256


class Settled(eqx.Module):
    """Balanced poses of one or many knees; arrays end in lanes.

    Attributes:
        flexion: rad.
        q: free coordinates `(5, lanes)`, rad and mm; NaN where the search failed.
        meeting: parameters of the meeting points `(n, 2, lanes)`.
        residual: unbalanced force left, `(5, lanes)`, N mm per rad and N.
        tangent: stiffness `(5, 5, lanes)`.
        drift: derivative of the meeting points by `q`, `(5, n, 2, lanes)`.
        pivots: of the scaled symmetric tangent; all positive where the pose is stable.
        depth: of each patch, `(n, lanes)`, mm.
        status: `Status` value.
        fault: the pose at which the search ended, balanced or not, taken by itself; `Status` value.
        left_mm: how far the search ended from a balance: the Newton step that is left, mm
            (rotations at 30 mm).
        steps: Newton steps taken.
    """

    flexion: Array
    q: Array
    meeting: Array
    residual: Array
    tangent: Array
    drift: Array
    pivots: Array
    depth: Array
    status: Array
    fault: Array
    left_mm: Array
    steps: Array

    @property
    def pose(self) -> Pose:
        """The poses."""
        return Pose.from_state(self.flexion, self.q)

    @property
    def converged(self) -> Array:
        """Where forces balance."""
        return converged(self.status)

    @property
    def stable(self) -> Array:
        """Where the tangent stiffness is positive definite as well."""
        return self.converged & jnp.all(self.pivots > 0, axis=0)


def settle(
    knee: Knee,
    flexion: Array,
    guess: Guess,
    start: Array | None = None,
    count: ArrayLike = 1,
    search: EnergyNewton = SEARCH,
) -> Settled:
    """Find the balance at prescribed flexion, marching there from a guess.

    Args:
        knee: leaves end in a lane axis (see `kneejax.mechanics.add_lane_axis`).
        flexion: rad, `(lanes,)`.
        guess: where to start; nothing is differentiated through it.
        start: flexion at which the guess holds, `(lanes,)`; `flexion` itself by default.
        count: number of poses on the way, the last included. With `count=1` the search begins
            at the guess; with more (`poses_on_the_way`), lanes walk from `start` to `flexion` in
            strides of 5 degrees, the first search at `start`.
        search: how to find the balance of one pose.

    Returns:
        The balance, differentiable by every leaf of the knee and by flexion (forward mode and,
        as the rule is linear, reverse mode); NaN with NaN derivatives where it failed.

    Raises:
        RuntimeError: float64 is switched off.
    """
    needs_float64()
    start = flexion if start is None else start
    still = lax.stop_gradient((knee, flexion, guess, start))
    return differentiable(knee, flexion, _search(*still, jnp.asarray(count), search))


def needs_float64() -> None:
    """Raise `RuntimeError` where JAX computes in single precision.

    Energies, which decide what is downhill, are then rounded to 1e-4 N mm.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "kneejax needs float64: call jax.config.update('jax_enable_x64', True) before anything"
        )


def differentiable(knee: Knee, flexion: Array, found: Settled) -> Settled:
    """A balance that has been found, as a function of the knee and of flexion.

    By the implicit function theorem the derivative of a balance needs no search. So one compiled
    search serves every choice of parameters, and each choice compiles its derivative only.

    Args:
        knee: with which it was found; leaves end in a lane axis.
        flexion: at which it was found, rad, `(lanes,)`.
        found: the balance.

    Returns:
        The same balance, differentiable as `settle` is.
    """
    q, meeting = _followed(knee, flexion, lax.stop_gradient(found))
    return dataclasses.replace(found, flexion=flexion, q=q, meeting=meeting)


def poses_on_the_way(start: ArrayLike, flexion: ArrayLike) -> Array:
    """Number of poses for `settle` to march from one flexion (rad) to another, by 5 degrees; more
    do not change what is found."""
    bend = jnp.max(jnp.abs(jnp.asarray(flexion) - start))
    return jnp.ceil(bend / STRIDE - 1e-9).astype(int) + 1


def longest_stride_mm(bend_deg):
    """How far a knee moves at most while it bends: what lies farther is another branch.

    In 61,000 strides of 5 degrees of 3,072 random knees (stiffness within 90 %, strains within 0.1)
    their distance from the motion of the knee itself changed by less than 4.7 mm on one branch; a
    search that had left it ended 7.9 to 10.6 mm away, and 3.3 mm and more after strides of 3
    degrees. The bundled knees' own motion is within 2.7 mm in 5 degrees.

    Args:
        bend_deg: change of flexion, an array of JAX or NumPy.

    Returns:
        mm, rotations at 30 mm (a turn of 9 degrees counts 5 mm).
    """
    return abs(bend_deg).clip(1.0)


def first_guess(knee: Knee, flexion: Array) -> Guess:
    """The knee's reference pose at a flexion; `settle` looks for the meeting points."""
    q = jnp.stack(jnp.broadcast_arrays(*knee.reference_pose.state, flexion)[:5])
    return Guess(q, jnp.full((knee.patch_count, 2, *jnp.shape(flexion)), jnp.nan, float))


def with_meeting(knee: Knee, flexion: Array, q: Array) -> Guess:
    """A guess at a pose, with meeting points searched from scratch."""
    if not knee.patch_count:
        return Guess(q, jnp.zeros((0, 2) + q.shape[1:]))
    tibia = Pose.from_state(flexion, q).placement
    empty = jnp.zeros((knee.patch_count,) + q.shape[1:])
    start = knee.map_patches(lambda c, t, _: Contact.first_meeting(c, t), tibia, empty)
    found = lax.fori_loop(
        0, 8, lambda _, meeting: knee.map_patches(Contact.improved, tibia, meeting), start
    )
    return Guess(q, jnp.stack(found, axis=1))


def _found(knee: Knee, flexion: Array, guess: Guess, search: EnergyNewton):
    guess = Guess(guess.q, jnp.nan_to_num(guess.meeting), guess.tangent)
    solution = optx.root_find(
        look,
        search,
        guess,
        (knee, flexion),
        has_aux=True,
        max_steps=_MOST_ROUNDS,
        throw=False,
    )
    return solution.value, solution.aux


@compiled(static_argnums=(5,))
def _search(
    knee: Knee, flexion: Array, guess: Guess, start: Array, count: Array, search: EnergyNewton
) -> Settled:
    def at(k: Array) -> Array:
        """Flexion after so many strides, which do not depend on how far other lanes go."""
        far = jnp.where(count > 1, k * STRIDE, jnp.inf)
        return start + jnp.clip(flexion - start, -far, far)

    def pose(k: Array, before):
        guess, last, found, known = before
        here, stride, former = at(k), at(k) - at(k - 1), at(k - 1) - at(k - 2)
        arrived = (k > 0) & (stride == 0.0)
        # Secant predictor from the third pose on.
        secant = jnp.where((k > 1) & (former != 0.0), stride / jnp.where(former, former, 1.0), 0.0)
        q = guess.q + secant * (guess.q - last)
        predicted = Guess(q, _known_meeting(knee, here, q, guess.meeting), guess.tangent)
        value, new = _found(knee, here, predicted, search)
        moved = jnp.max(jnp.abs(value.q - guess.q) / units, axis=0)
        strayed = known & (moved > furthest)
        new = eqx.tree_at(lambda f: f.done, new, new.done & ~strayed)
        # A lane that is lost may have lost its meeting points: it looks for them from scratch.
        lost = Guess(guess.q, jnp.full_like(guess.meeting, jnp.nan), guess.tangent)
        there = jax.tree.map(lambda x, y: jnp.where(new.done, x, y), value, lost)
        there, new = jax.tree.map(
            lambda x, y: jnp.where(arrived & found.done, x, y), (guess, found), (there, new)
        )
        return there, jnp.where(new.done, guess.q, there.q), new, known | new.done

    units = jnp.asarray(UNITS).reshape(5, *(1,) * (guess.q.ndim - 1))
    furthest = longest_stride_mm(jnp.rad2deg(jnp.clip(flexion - start, -STRIDE, STRIDE)))
    # One lane that starts from NaN would end the search of all.
    astray, reference = jnp.isnan(guess.q), first_guess(knee, flexion).q
    knee = knee.for_many_poses()
    guess = Guess(
        jnp.where(astray, reference, guess.q), guess.meeting, jnp.nan_to_num(guess.tangent)
    )
    _, shapes = jax.eval_shape(look, guess, (knee, flexion))
    begin = search.init(look, guess, (knee, flexion), {}, None, shapes, frozenset())
    nowhere = jnp.zeros(guess.q.shape[1:], bool)
    found, _, state, _ = lax.fori_loop(0, count, pose, (guess, guess.q, begin, nowhere))
    q, meeting, rest = described(knee, flexion, found, state)
    return Settled(flexion, q, meeting, **rest)


def _known_meeting(knee: Knee, flexion: Array, q: Array, meeting: Array) -> Array:
    """The meeting points, searched from scratch in lanes where they are NaN."""
    unknown = jnp.any(jnp.isnan(meeting), axis=(0, 1))

    def searched() -> Array:
        return jnp.where(unknown, with_meeting(knee, flexion, q).meeting, meeting)

    return lax.cond(jnp.any(unknown), searched, lambda: meeting)


def described(knee: Knee, flexion: Array, found: Guess, here: SearchState):
    """Coordinates (NaN where they are no balance), meeting points, and the rest of `Settled`."""
    left_mm, pivots = newton_step_left(here.guess.tangent, here.residual)
    fault = fault_of(knee, flexion, here, pivots)
    status = jnp.where(here.done, fault, int(Status.NOT_CONVERGED))
    rest = holding(here) | dict(
        pivots=pivots, status=status, fault=fault, left_mm=left_mm, steps=here.count
    )
    return jnp.where(converged(status), found.q, jnp.nan), found.meeting, rest


def holding(here: SearchState) -> dict[str, Array]:
    """What holds a balance: the fields of `Settled` that a look has computed."""
    return dict(
        residual=jnp.stack(here.residual),
        tangent=here.guess.tangent,
        drift=jnp.stack([jnp.stack(pair, axis=1) for pair in here.forces.drift]),
        depth=here.forces.depth,
    )


def fault_of(knee: Knee, flexion: Array, here: SearchState, pivots: Array) -> Array:
    """What the pose at which a search ended is by itself, balanced or not; `Status` values."""
    stable = jnp.where(jnp.all(pivots > 0, axis=0), int(Status.BALANCED), int(Status.UNSTABLE))
    return jnp.maximum(stable, _faults(knee, flexion, here).status).astype(int)


def _faults(knee: Knee, flexion: Array, here: SearchState) -> Faults:
    """What is wrong with the poses, from what their search has computed already."""
    pose, forces = Pose.from_state(flexion, here.guess.q), here.forces
    tibia, found, row = pose.placement, [], 0
    for contact in knee.contacts:
        if contact.has_patch:
            depth, known = forces.depth[row], forces.known[row]
            touches = depth > 0
            outside, deep = touches & ~known, depth >= contact.layer_thickness
            # Off the fitted surfaces a shape says nothing, and that has been said.
            flat = touches & known & forces.flat[row]
            through = _passed_through(contact, tibia, deep | ~known)
            row += 1
        else:
            sampled = contact.sample(tibia)
            faults = contact.faults(tibia, sampled)
            deep, outside = faults.too_deep | faults.lost, faults.outside
            depth, flat = jnp.max(sampled.depth, axis=0), jnp.zeros_like(deep)
            through = contact.passed_through(tibia)
        found.append(ContactFaults(depth, outside, deep, flat, through))
    return Faults.of(found, forces.fibres, displacement(knee, pose))


def _passed_through(contact: Contact, tibia: Placement, odd: Array) -> Array:
    """Whether a condyle is on the wrong side of its plateau, of poses that are odd.

    Two surfaces that meet within the layer where both are known have their solids on either side:
    the middle of the condyle lies a radius above. Asked of every pose a third of all that is done
    where a search ends was this.
    """
    return lax.cond(
        jnp.any(odd), lambda: odd & contact.passed_through(tibia), lambda: jnp.zeros_like(odd)
    )


@jax.custom_jvp
def _followed(knee: Knee, flexion: Array, found: Settled) -> tuple[Array, Array]:
    """Coordinates and meeting points of a balance, which follow the knee and flexion."""
    return found.q, found.meeting


def _followed_jvp(primals, tangents):
    knee, flexion, found = primals
    d_knee, d_flexion, _ = tangents
    change, follow = _force_change(knee, flexion, found.q, found.meeting, d_knee, d_flexion)
    failed = ~found.converged
    identity = jnp.eye(5).reshape(5, 5, *(1,) * (found.q.ndim - 1))
    tangent = jnp.where(failed, identity, found.tangent)
    d_q, _ = solve(tangent, -jnp.where(failed, 0.0, change))
    d_q = jnp.where(failed, jnp.nan, jnp.stack(d_q))
    moved = jnp.sum(found.drift * d_q.reshape(5, 1, 1, *found.q.shape[1:]), axis=0)
    return (found.q, found.meeting), (d_q, follow + moved)


_followed.defjvp(_followed_jvp, symbolic_zeros=True)


def _force_change(knee, flexion, q, meeting, d_knee, d_flexion):
    """Change of the unbalanced force; what is not perturbed is not differentiated.

    A calibration of ligaments perturbs no contact: its derivative then needs the ligaments'
    energy alone, which compiles in a tenth of the time.
    """
    contacts_still = all(isinstance(t, SymbolicZero) for t in jax.tree.leaves(d_knee.contacts))
    nowhere = jnp.nan_to_num(q)
    if contacts_still and isinstance(d_flexion, SymbolicZero):
        change = force_derivative_without_patches(knee, flexion, nowhere, instantiate(d_knee))
        return change, jnp.zeros_like(meeting)
    change, follow = force_derivative(
        knee,
        flexion,
        nowhere,
        (meeting[:, 0], meeting[:, 1]),
        instantiate(d_knee),
        instantiate(d_flexion),
    )
    return change, jnp.stack(follow, axis=1)
