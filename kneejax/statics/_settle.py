"""Balanced poses and their exact derivatives: the one solve of the package.

Lanes march from a pose that is known to the flexion that is wanted, in small steps with a secant
predictor, so that each stays on the branch of its knee. The derivative of a balanced pose by any
number of the knee follows from the implicit function theorem, in the rule below and nowhere else:
a dense solve per lane, with lanes that failed set to NaN and no influence on the others.
"""

from __future__ import annotations

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array, lax
from jax.custom_derivatives import SymbolicZero
from jax.typing import ArrayLike

from kneejax.geometry import Pose
from kneejax.mechanics import Contact, Knee
from kneejax.statics._balance import energy_force_derivative, force_derivative
from kneejax.statics._elimination import solve, symmetric
from kneejax.statics._newton import UNITS, EnergyNewton, Guess, improve_meeting, look
from kneejax.statics._status import Status

#: Steps of the search at one pose.
MAX_STEPS = 40


#: Flexion between two poses on the way, rad.
_STRIDE = np.deg2rad(5.0)


class Settled(eqx.Module):
    """Balanced poses of one or many knees; arrays end in lanes.

    Attributes:
        flexion: rad.
        q: free coordinates `(5, lanes)`, rad and mm; NaN where the search failed.
        meeting: parameters of the meeting points `(n, 2, lanes)`.
        residual: unbalanced force left before the last step, `(5, lanes)`, N mm per rad and N.
        tangent: stiffness `(5, 5, lanes)`.
        drift: derivative of the meeting points by `q`, `(5, n, 2, lanes)`.
        pivots: of the scaled symmetric tangent; all positive where the pose is stable.
        depth: of each patch, `(n, lanes)`, mm.
        status: `Status` value.
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
    steps: Array

    @property
    def pose(self) -> Pose:
        """The poses."""
        return Pose.from_state(self.flexion, self.q)

    @property
    def converged(self) -> Array:
        """Where forces balance."""
        return self.status < Status.TOO_DEEP

    @property
    def stable(self) -> Array:
        """Where the tangent stiffness is positive definite as well."""
        return self.converged & jnp.all(self.pivots > 0, axis=0)


def settle(
    knee: Knee,
    flexion: Array,
    guess: Guess,
    start: Array | None = None,
    count: Array | int = 1,
    max_steps: int = MAX_STEPS,
) -> Settled:
    """Find the balance at prescribed flexion, marching there from a guess.

    Args:
        knee: leaves end in a lane axis (see `kneejax.mechanics.add_lane_axis`).
        flexion: rad, `(lanes,)`.
        guess: where to start; nothing is differentiated through it.
        start: flexion at which the guess holds, `(lanes,)`; `flexion` itself by default.
        count: number of poses on the way, the last included. With `count=1` the search begins
            at the guess; with more, lanes walk from `start` to `flexion`, the first search at
            `start`.
        max_steps: Newton steps before a pose of a lane is given up.

    Returns:
        The balance, differentiable by every leaf of the knee and by flexion (forward mode and,
        as the rule is linear, reverse mode); NaN with NaN derivatives where it failed.

    Raises:
        RuntimeError: float64 is switched off.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "kneejax needs float64: call jax.config.update('jax_enable_x64', True) before anything"
        )
    guess, start = lax.stop_gradient((guess, flexion if start is None else start))
    q, meeting, rest = _settle(knee, flexion, guess, start, jnp.asarray(count), max_steps)
    return Settled(flexion, q, meeting, **rest)


def poses_on_the_way(start: ArrayLike, flexion: ArrayLike) -> int:
    """Number of poses for `settle` to march from one flexion (rad) to another, by 5 degrees."""
    return int(np.ceil(np.max(np.abs(np.asarray(flexion) - np.asarray(start))) / _STRIDE)) + 1


def first_guess(knee: Knee, flexion: Array) -> Guess:
    """The knee's reference pose at a flexion, with meeting points searched from scratch."""
    pose = knee.reference_pose
    q = jnp.stack(jnp.broadcast_arrays(*pose.state, flexion)[:5])
    return with_meeting(knee, flexion, q)


def with_meeting(knee: Knee, flexion: Array, q: Array) -> Guess:
    """A guess at a pose, with meeting points searched from scratch."""
    if not knee.patch_count:
        return Guess(q, jnp.zeros((0, 2) + q.shape[1:]))
    tibia = Pose.from_state(flexion, q).placement
    empty = jnp.zeros((knee.patch_count, 2) + q.shape[1:])
    start = knee.map_patches(lambda c, t, _: Contact.first_meeting(c, t), tibia, empty)
    return Guess(
        q, lax.fori_loop(0, 8, lambda _, m: improve_meeting(knee, flexion, q, m, 1), start)
    )


def _search(
    knee: Knee, flexion: Array, guess: Guess, start: Array, count: Array, max_steps: int
):
    def pose(k: Array, before):
        guess, last, _ = before
        part = jnp.where(count > 1, k / jnp.maximum(count - 1, 1), 1.0)
        here = start + part * (flexion - start)
        # Secant predictor from the third pose on.
        predicted = Guess(jnp.where(k > 1, 2.0 * guess.q - last, guess.q), guess.meeting)
        q, meeting, rest = _search_once(knee, here, predicted, max_steps)
        lost = rest["status"] >= Status.TOO_DEEP
        found = Guess(jnp.where(lost, guess.q, q), jnp.where(lost, guess.meeting, meeting))
        return found, jnp.where(lost, found.q, guess.q), rest

    shapes = jax.eval_shape(partial(_search_once, max_steps=max_steps), knee, flexion, guess)
    rest = jax.tree.map(lambda s: jnp.zeros(s.shape, s.dtype), shapes[2])
    found, _, rest = lax.fori_loop(0, count, pose, (guess, guess.q, rest))
    failed = rest["status"] >= Status.TOO_DEEP
    return jnp.where(failed, jnp.nan, found.q), found.meeting, rest


@partial(jax.jit, static_argnames="max_steps", inline=True)
def _search_once(knee: Knee, flexion: Array, guess: Guess, max_steps: int):
    solution = optx.root_find(
        look,
        EnergyNewton(),
        guess,
        (knee, flexion),
        has_aux=True,
        max_steps=max_steps,
        throw=False,
    )
    here, done, count = solution.aux  # pyright: ignore[reportAssignmentType]
    units = jnp.asarray(UNITS).reshape(5, *(1,) * (guess.q.ndim - 1))
    scaled = symmetric(here.tangent) * units[:, None] * units[None]
    _, pivots = solve(scaled, here.residual * units)
    rest = dict(
        residual=here.residual,
        tangent=here.tangent,
        drift=here.drift,
        pivots=pivots,
        depth=here.gap.depth,
        status=_status(knee, done, pivots, here.gap, solution.value.meeting),
        steps=count,
    )
    return solution.value.q, solution.value.meeting, rest


def _status(knee: Knee, done: Array, pivots: Array, gap, meeting: Array) -> Array:
    status = jnp.where(jnp.all(pivots > 0, axis=0), Status.BALANCED, Status.UNSTABLE)
    patches = [contact for contact in knee.contacts if contact.has_patch]
    for row, contact in enumerate(patches):
        here = jax.tree.map(lambda x, row=row: x[row], gap)
        touching = here.depth > 0
        unknown = touching & ~contact.is_known(here, meeting[row])
        status = jnp.where(unknown & (status < 1), Status.OUTSIDE_REGION, status)
        deep = here.depth >= contact.layer_thickness
        status = jnp.where(deep, Status.TOO_DEEP, status)
    return jnp.where(done, status, Status.NOT_CONVERGED).astype(int)


_settle = jax.custom_jvp(_search, nondiff_argnums=(5,))


def _settle_jvp(max_steps, primals, tangents):
    knee, flexion, *_ = primals
    q, meeting, rest = _settle(*primals, max_steps)
    d_knee, d_flexion, *_ = tangents
    change, follow = _force_change(knee, flexion, q, meeting, rest["drift"], d_knee, d_flexion)
    failed = rest["status"] >= Status.TOO_DEEP
    identity = jnp.eye(5).reshape(5, 5, *(1,) * (q.ndim - 1))
    tangent = jnp.where(failed, identity, rest["tangent"])
    d_q, _ = solve(tangent, -jnp.where(failed, 0.0, change))
    d_q = jnp.where(failed, jnp.nan, d_q)
    moved = jnp.sum(rest["drift"] * d_q.reshape(5, 1, 1, *q.shape[1:]), axis=0)
    still = jax.tree.map(_no_tangent, rest)
    return (q, meeting, rest), (d_q, follow + moved, still)


_settle.defjvp(_settle_jvp, symbolic_zeros=True)


def _force_change(knee, flexion, q, meeting, drift, d_knee, d_flexion):
    """Change of the unbalanced force; what is not perturbed is not differentiated.

    A calibration of ligaments perturbs no contact: its derivative then needs the ligaments'
    energy alone, which compiles in a tenth of the time.
    """
    contacts_still = all(isinstance(t, SymbolicZero) for t in jax.tree.leaves(d_knee.contacts))
    nowhere = jnp.nan_to_num(q)
    if contacts_still and isinstance(d_flexion, SymbolicZero):
        change = energy_force_derivative(knee, flexion, nowhere, _instantiate(d_knee))
        return change, jnp.zeros_like(meeting)
    return force_derivative(
        knee, flexion, nowhere, meeting, drift, _instantiate(d_knee), _instantiate(d_flexion)
    )


def _instantiate(tree):
    return jax.tree.map(
        lambda t: jnp.zeros(t.shape, t.dtype) if isinstance(t, SymbolicZero) else t,
        tree,
        is_leaf=lambda t: isinstance(t, SymbolicZero),
    )


def _no_tangent(x: Array):
    if jnp.issubdtype(x.dtype, jnp.floating):
        return jnp.zeros_like(x)
    return np.zeros(x.shape, jax.dtypes.float0)
