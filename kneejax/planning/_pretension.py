"""How long a graft is without load that carries a given tension where it is fixed.

While it is tightened, a graft pulls with the tension that the surgeon gives it, whatever its
length: the knee is balanced with that. There the graft's length is known, and with its law its
slack length, in closed form. Fixed with that length, it pulls at the same pose with the same force:
no second search.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments import passive_flexion
from kneejax.mechanics import Knee, ligament_law
from kneejax.planning._followed import Protocol, follow
from kneejax.planning._reconstruction import (
    BUNDLE_NUMBERS,
    TRANSITION_STRAIN,
    TRANSITION_WIDTH,
    Reconstruction,
)
from kneejax.statics import Slopes


@dataclasses.dataclass(frozen=True)
class Fixed:
    """Grafts that were fixed under a tension.

    Attributes:
        slack_mm: zero-load length of each bundle, `(variants, bundles)`; NaN where the knee has no
            balance with the grafts pulling.
        slope: its derivative by the numbers of the variants under tension,
            `(variants, bundles, numbers)`; None where none was asked for.
        status: `Status` values of the balances at fixation, `(variants,)`.
        near: the balances, to predict others from; None where no slope was asked for.
    """

    slack_mm: np.ndarray
    slope: np.ndarray | None
    status: np.ndarray
    near: Slopes | None


def slack_length(length_mm: ArrayLike, tension_N: ArrayLike, stiffness_N: ArrayLike) -> Array:
    """Zero-load length of a graft that carries a tension at a length.

    Args:
        length_mm: between its ends.
        tension_N: there, positive.
        stiffness_N: N per unit strain.

    Returns:
        mm, differentiable by all three.

    Example:
        >>> short = slack_length(30.0, 80.0, 7140.0)
        >>> tension = ligament_law.tension(30.0 / short - 1.0, 7140.0, 0.06, 0.0001)
        >>> round(float(tension), 9)
        80.0
    """
    return ligament_law.slack_length_from_force(
        length_mm, tension_N, stiffness_N, TRANSITION_STRAIN, TRANSITION_WIDTH
    )


def fix(
    plan: Reconstruction,
    ends: np.ndarray,
    tension_N: np.ndarray,
    flexion_deg: float,
    *,
    slopes: bool = False,
    near: Slopes | None = None,
    grid: tuple[int, int] | None = None,
) -> Fixed:
    """Fix the grafts of many variants, each under its own tension.

    Args:
        plan: the knee and its grafts.
        ends: femoral and tibial, `(variants, bundles, 6)`, mm.
        tension_N: of each bundle, `(variants, bundles)`.
        flexion_deg: at which they are fixed.
        slopes: whether derivatives are wanted.
        near: of near variants, to begin from.
        grid: rows and columns in which the variants stand, see `follow`.

    Returns:
        The fixed grafts.
    """
    values = plan.value(ends, tension_N=tension_N, elastic=False)
    at_fixation = Protocol(np.array([flexion_deg]), (), 0.0)
    pulled = follow(plan, values, at_fixation, slopes=slopes, near=near, grid=grid)
    grafts = plan.rows(plan.bundles)
    length = pulled.length_mm[:, 0, grafts]
    by_length = np.zeros((*length.shape, values.shape[1]))
    if pulled.slopes is not None:
        by_length = pulled.slopes["length_mm"][:, 0, grafts]
    by_tension, bundle = np.zeros_like(by_length), np.arange(len(grafts))
    by_tension[:, bundle, BUNDLE_NUMBERS * (1 + bundle)] = 1.0
    stiffness = np.array(plan.stiffness_N)
    slack, slope = map(np.asarray, _slack(length, tension_N, stiffness, by_length, by_tension))
    return Fixed(slack, slope if slopes else None, pulled.status[:, 0], pulled.near)


@jax.jit
def _slack(length, tension_N, stiffness_N, *by):
    """Slack lengths, and their derivatives from those of lengths and tensions by numbers."""

    def law(length: Array, tension_N: Array) -> Array:
        return slack_length(length, tension_N, stiffness_N)

    return jax.vmap(lambda *by: jax.jvp(law, (length, tension_N), by), -1, (None, -1))(*by)


def fixed_knee(
    plan: Reconstruction, ends: ArrayLike, tension_N: ArrayLike, flexion_deg: ArrayLike
) -> Knee:
    """The reconstructed knee of one variant, as JAX sees it: differentiable by all arguments.

    Args:
        plan: the knee and its grafts.
        ends: femoral and tibial, `(bundles, 6)`, mm.
        tension_N: of each bundle, `(bundles,)`.
        flexion_deg: at which the grafts are fixed.
    """
    ends, tension = jnp.asarray(ends, float), jnp.asarray(tension_N, float)
    stiffness, nothing = jnp.array(plan.stiffness_N), jnp.zeros(len(plan.bundles))

    def numbers(slack: Array, spring: Array, pull: Array) -> Array:
        each = jnp.stack([slack, spring, pull], axis=1)
        return jnp.concatenate([jnp.zeros(1), jnp.hstack([ends, each]).ravel()])

    tight = plan.vary(plan.knee, numbers(nothing + 1.0, nothing, tension))
    pose = passive_flexion(tight, jnp.atleast_1d(flexion_deg)).equilibrium.state
    at_fixation = jax.tree.map(lambda x: x[0], pose)
    length = tight.ligaments.length(at_fixation)[jnp.array(plan.vary.grafts)]
    slack = slack_length(length, tension, stiffness)
    return plan.vary(plan.knee, numbers(slack, stiffness, nothing))
