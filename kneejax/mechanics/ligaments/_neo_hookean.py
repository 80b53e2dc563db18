"""A fibre of an incompressible neo-Hookean band: the second law of a ligament.

In uniaxial tension such a material carries, by area before stretching, `E / 3 (l - l^-2)` at a
stretch `l`: slope `E` where it begins, a third of it when it is long. Below a stretch of one a
fibre is slack. The corner there is rounded by putting the rounded positive part of the strain,
`p = (e + sqrt(e^2 + w^2)) / 2`, in the place of the strain; since `e = p - w^2 / (4 p)`, tension
has its energy in closed form.

Source: Treloar, The Physics of Rubber Elasticity; paper 4 has its ligaments of this material.
"""

import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.numerics import positive_part


def exact_tension(strain: ArrayLike, stiffness: ArrayLike) -> Array:
    """Tension with the corner at slack.

    Args:
        strain: length over slack length, minus one.
        stiffness: Young's modulus times the cross-section, N per unit strain.

    Returns:
        Tension in N.

    Example:
        >>> [round(float(exact_tension(e, 3000.0)), 3) for e in (-0.1, 0.0, 0.01, 0.1)]
        [0.0, 0.0, 29.704, 273.554]
    """
    stretch = 1.0 + jnp.maximum(jnp.asarray(strain, float), 0.0)
    return stiffness / 3.0 * (stretch - stretch**-2)


def tension(strain: ArrayLike, stiffness: ArrayLike, width: ArrayLike) -> Array:
    """Tension, with a rounded corner.

    Args:
        strain: length over slack length, minus one.
        stiffness: N per unit strain, where the fibre is just taut.
        width: of the rounding, in strain; positive.

    Returns:
        Tension in N, infinitely differentiable; within `stiffness * width / 2` of `exact_tension`.

    Example:
        >>> round(float(tension(0.01, 3000.0, 1e-3)), 2)
        29.78
    """
    p = positive_part(jnp.asarray(strain, float), width)
    return stiffness / 3.0 * p * (3.0 + p * (3.0 + p)) / jnp.square(1.0 + p)


def stiffness_at(strain: ArrayLike, stiffness: ArrayLike, width: ArrayLike) -> Array:
    """Slope of the tension over strain, in N per unit strain. Arguments as `tension`."""
    p = positive_part(jnp.asarray(strain, float), width)
    rate = jnp.square(p) / (jnp.square(p) + jnp.square(0.5 * jnp.asarray(width)))
    return stiffness / 3.0 * (1.0 + 2.0 * (1.0 + p) ** -3) * rate


def energy(
    strain: ArrayLike, stiffness: ArrayLike, width: ArrayLike, slack_length: ArrayLike
) -> Array:
    """Energy of a fibre, in N mm, up to a constant: its slope by length is the tension.

    Args:
        strain: length over slack length, minus one.
        stiffness: N per unit strain, where the fibre is just taut.
        width: of the rounding, in strain.
        slack_length: mm.
    """
    p = positive_part(jnp.asarray(strain, float), width)
    inverse, soft = 1.0 / (1.0 + p), jnp.square(0.5 * jnp.asarray(width))
    bulk = 0.5 * p * p * (3.0 + p) * inverse
    corner = soft * (3.0 * jnp.log(p) - 2.0 * jnp.log1p(p) + inverse)
    return stiffness / 3.0 * slack_length * (bulk + corner)


def slack_length_from_force(
    reference_length: ArrayLike, reference_force: ArrayLike, stiffness: ArrayLike, width: ArrayLike
) -> Array:
    """Slack length of a fibre that carries a given force at a given length.

    Args:
        reference_length: length at the reference pose, mm.
        reference_force: tension there, N; positive.
        stiffness: N per unit strain, where the fibre is just taut.
        width: of the rounding, in strain.

    Returns:
        Slack length, mm; differentiable twice.

    Example:
        >>> slack = slack_length_from_force(33.0, 273.554, 3000.0, 1e-5)
        >>> round(float(slack), 3)
        30.0
    """
    relative = jnp.asarray(reference_force, float) / stiffness

    def improved(p: Array) -> Array:
        # By the rounded strain the tension is concave and increasing: Newton ends from below.
        excess = p * (3.0 + p * (3.0 + p)) / (3.0 * jnp.square(1.0 + p)) - relative
        return p - 3.0 * excess / (1.0 + 2.0 * (1.0 + p) ** -3)

    found = lax.stop_gradient(lax.fori_loop(0, 8, lambda _, p: improved(p), relative))
    p = improved(improved(found))
    strain = p - jnp.square(0.5 * jnp.asarray(width)) / p
    return jnp.asarray(reference_length, float) / (1.0 + strain)
