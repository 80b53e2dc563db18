"""Laws in closed form as they were published, which the smooth ones stand for."""

import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.mechanics import cartilage_law
from kneejax.numerics import branch


def exact_stiffness(strain: ArrayLike, stiffness: ArrayLike, transition_strain: ArrayLike) -> Array:
    """Slope of the published tension over strain, in N per unit strain. Continuous."""
    return stiffness * jnp.clip(jnp.asarray(strain, float) / transition_strain, 0.0, 1.0)


def exact_energy(
    strain: ArrayLike,
    stiffness: ArrayLike,
    transition_strain: ArrayLike,
    slack_length: ArrayLike,
) -> Array:
    """Energy of a fibre by the published law, N mm. Twice continuously differentiable."""
    strain, toe = jnp.asarray(strain, float), jnp.asarray(transition_strain, float)
    parabola = strain**3 / (6.0 * toe)
    line = 0.5 * (strain - 0.5 * toe) ** 2 + toe * toe / 24.0
    per_length = jnp.where(strain <= 0, 0.0, jnp.where(strain < toe, parabola, line))
    return stiffness * slack_length * per_length


def patch_force(law: str, c: ArrayLike) -> Array:
    """Resultant over `pi K a b` of an elliptical patch with relative depth `c` at its centre.

    Args:
        law: one of `LAWS`.
        c: relative depth at the centre.

    Source: paper 3, Eq 15 (ratio); the others by the same integral.
    """
    c = jnp.asarray(c, float)
    if law == "linear":
        return 0.5 * c
    # The mean of the pressure over 0..s is the energy density, divided by s.
    mean = lambda x: cartilage_law.relative_energy(law, x) / x  # noqa: E731
    return branch(c > 0, mean, lambda x: 0.5 * x, c, inside=0.5, outside=0.5)
