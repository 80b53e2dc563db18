"""The nonlinear spring of a ligament fibre, its damper, and the strain at which it tears.

Slack below zero strain, a parabola up to the transition strain, a line above (Blankevoort 1991).
The smooth law replaces the two corners of the tension's slope by a rounded positive part of width
`w`. It integrates twice in closed form, so tension and energy are exact derivatives of each
other, and a slack fibre keeps a small gradient, which lets a calibration pull it tight.

Two conventions, each named by its unit:

- `damping_N_s`: as OpenSim 4.6 damps a `Blankevoort1991Ligament`. Force is the coefficient times
  the rate of strain while a fibre lengthens, faded in over the first percent of strain.
- `damping_N_s_per_mm`: force per rate of length, while a fibre lengthens or shortens (paper 2,
  section 3.1; `critical_damping`), faded in alike: paper 2 does not say what a slack fibre does.
"""

__all__ = [
    "FAILURE_SOURCE", "Dampers", "FibreFaults", "critical_damping", "damping_force", "tautness",
    "usual_failure_strain",
]

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.numerics import branch, numpy_for, positive_part, safe_sqrt


def exact_tension(strain: ArrayLike, stiffness: ArrayLike, transition_strain: ArrayLike) -> Array:
    """Tension by the published law.

    Args:
        strain: length over slack length, minus one.
        stiffness: N per unit strain.
        transition_strain: strain where the parabola meets the line (`2 eps_l`).

    Returns:
        Tension in N. Once continuously differentiable.

    Source: paper 1, Eq 2 (corrected); Blankevoort and Huiskes (1991).

    Example:
        >>> [round(float(exact_tension(e, 2000.0, 0.06)), 4) for e in (-0.1, 0.01, 0.06, 0.08)]
        [0.0, 1.6667, 60.0, 100.0]
    """
    strain, toe = jnp.asarray(strain, float), jnp.asarray(transition_strain, float)
    parabola = 0.5 * strain * strain / toe
    line = strain - 0.5 * toe
    return stiffness * jnp.where(strain <= 0, 0.0, jnp.where(strain < toe, parabola, line))


def tension(
    strain: ArrayLike, stiffness: ArrayLike, transition_strain: ArrayLike, width: ArrayLike
) -> Array:
    """Tension by the smooth law.

    Args:
        strain: length over slack length, minus one.
        stiffness: N per unit strain.
        transition_strain: strain where the parabola meets the line.
        width: rounding of the two corners, in strain; positive.

    Returns:
        Tension in N, infinitely differentiable for `width > 0`. Its largest distance from the
        published law is `largest_tension_error`.

    Example:
        >>> import jax
        >>> float(jax.grad(tension)(-0.01, 2000.0, 0.06, 0.001)) > 0.0
        True
    """
    strain, toe = jnp.asarray(strain, float), jnp.asarray(transition_strain, float)
    return stiffness / toe * (_ramp(strain, width) - _ramp(strain - toe, width))


def stiffness_at(
    strain: ArrayLike, stiffness: ArrayLike, transition_strain: ArrayLike, width: ArrayLike
) -> Array:
    """Slope of the smooth tension over strain, in N per unit strain. Arguments as `tension`."""
    strain, toe = jnp.asarray(strain, float), jnp.asarray(transition_strain, float)
    return stiffness / toe * (positive_part(strain, width) - positive_part(strain - toe, width))


def energy(
    strain: ArrayLike,
    stiffness: ArrayLike,
    transition_strain: ArrayLike,
    width: ArrayLike,
    slack_length: ArrayLike,
) -> Array:
    """Energy of a fibre by the smooth law, in N mm, up to a constant.

    Args:
        strain: length over slack length, minus one.
        stiffness: N per unit strain.
        transition_strain: strain where the parabola meets the line.
        width: rounding of the two corners, in strain.
        slack_length: mm.
    """
    strain, toe = jnp.asarray(strain, float), jnp.asarray(transition_strain, float)
    return stiffness * slack_length / toe * (_bowl(strain, width) - _bowl(strain - toe, width))


def largest_tension_error(
    stiffness: ArrayLike, transition_strain: ArrayLike, width: ArrayLike
) -> Array:
    """Largest distance of the smooth tension from the published one, in N.

    It is reached half way up the parabola, where both corners pull the same way:
    about `k w^2 / (2 eps_t) (1/2 + ln(eps_t / w))`, quadratic in `w` up to the logarithm.

    Args:
        stiffness: N per unit strain.
        transition_strain: strain where the parabola meets the line.
        width: rounding of the two corners, in strain.

    Example:
        >>> round(float(largest_tension_error(5000.0, 0.03, 0.001)), 3)
        0.325
    """
    middle = 0.5 * jnp.asarray(transition_strain, float)
    smooth = tension(middle, stiffness, transition_strain, width)
    return jnp.abs(smooth - exact_tension(middle, stiffness, transition_strain))


def slack_length_from_strain(reference_length: ArrayLike, reference_strain: ArrayLike) -> Array:
    """Slack length of a fibre that has a given strain at a given length.

    Args:
        reference_length: length at the reference pose, mm.
        reference_strain: strain there.

    Source: paper 1, Eq 4.
    """
    xp = numpy_for(reference_length, reference_strain)
    length, strain = (xp.asarray(x, float) for x in (reference_length, reference_strain))
    return jnp.asarray(length / (1.0 + strain), float)


def slack_length_from_force(
    reference_length: ArrayLike,
    reference_force: ArrayLike,
    stiffness: ArrayLike,
    transition_strain: ArrayLike,
    width: ArrayLike,
) -> Array:
    """Slack length of a fibre that carries a given force at a given length, by the smooth law.

    The published law is inverted in closed form; Newton's rule then carries the strain over to
    the smooth law. Its last two steps are differentiated: from a strain that solves the equation
    they have the first three derivatives of the solution.

    Args:
        reference_length: length at the reference pose, mm.
        reference_force: tension there, N; positive.
        stiffness: N per unit strain.
        transition_strain: strain where the parabola meets the line.
        width: rounding of the two corners, in strain.
    """
    toe = jnp.asarray(transition_strain, float)
    relative = jnp.asarray(reference_force, float) / stiffness
    strain = branch(
        relative < 0.5 * toe,
        lambda f: safe_sqrt(2.0 * f * toe),
        lambda f: f + 0.5 * toe,
        relative,
        inside=0.001,
        outside=0.1,
    )

    def improved(strain: Array) -> Array:
        # The smooth law is convex and increasing: from the right Newton cannot overshoot.
        excess = tension(strain, stiffness, toe, width) - relative * stiffness
        return strain - excess / stiffness_at(strain, stiffness, toe, width)

    found = lax.stop_gradient(lax.fori_loop(0, 8, lambda _, x: improved(x), strain))
    return slack_length_from_strain(reference_length, improved(improved(found)))


def _ramp(x: Array, width: ArrayLike) -> Array:
    """Integral of the smooth positive part."""
    root = jnp.sqrt(x * x + jnp.square(width))
    return 0.25 * (x * (x + root) + jnp.square(width) * jnp.arcsinh(x / width))


def _bowl(x: Array, width: ArrayLike) -> Array:
    """Integral of `_ramp`."""
    square, soft = x * x + jnp.square(width), 0.25 * jnp.square(width)
    root = jnp.sqrt(square)
    return (x**3 + square * root) / 12.0 + soft * (x * jnp.arcsinh(x / width) - root)


#: Strain at which a fibre is damped in full (OpenSim 4.6).
FULL_STRAIN = 0.01


def tautness(strain: ArrayLike) -> Array:
    """Part of its damping that a fibre has: 0 where slack, 1 from 1 % of strain on.

    Args:
        strain: length over slack length, minus one.

    Returns:
        A polynomial of degree 5 between, twice continuously differentiable.

    Source: OpenSim 4.6, `Blankevoort1991Ligament`.

    Example:
        >>> [float(tautness(e)) for e in (-0.1, 0.005, 0.02)]
        [0.0, 0.5, 1.0]
    """
    x = jnp.clip(jnp.asarray(strain, float) / FULL_STRAIN, 0.0, 1.0)
    return x * x * x * (10.0 + x * (6.0 * x - 15.0))


def critical_damping(stiffness: ArrayLike, slack_length: ArrayLike, mass_kg: ArrayLike) -> Array:
    """Damping at which a mass on a fibre just does not swing, N s/mm.

    Args:
        stiffness: N per unit strain.
        slack_length: mm; stiffness over it is the spring constant, N/mm.
        mass_kg: that the fibre holds.

    Source: paper 2, section 3.1: `sqrt(4 k m)`, with `k` in N/mm (its Table 1 gives kN per unit
    strain).

    Example:
        >>> round(float(critical_damping(4500.0, 30.0, 4.0)), 3)
        1.549
    """
    per_mm = jnp.asarray(stiffness, float) / jnp.asarray(slack_length, float)
    return safe_sqrt(4.0 * per_mm * 1e-3 * jnp.asarray(mass_kg, float))


class Dampers(eqx.Module):
    """Dampers of fibres as they are in one implicit step; arrays `(n, ...)`, one row a fibre.

    The rate of a length is `per_s` times how far it is from `before`, so that a damper is a
    spring for as long as the step lasts.

    Attributes:
        lengthening: N s/mm, of fibres that become longer.
        both_ways: N s/mm.
        before: mm; no rate where the length is this.
        per_s: 1/s.
    """

    lengthening: Array
    both_ways: Array
    before: Array
    per_s: Array

    def tension(self, length: Array) -> Array:
        """N, at given lengths; negative where a taut fibre is held back from shortening."""
        return damping_force(self.per_s * (length - self.before), self.lengthening, self.both_ways)

    def energy(self, length: Array) -> Array:
        """Potential of the tension, N mm."""
        rate = self.per_s * (length - self.before)
        faster = jnp.maximum(rate, 0.0)
        return 0.5 / self.per_s * (self.lengthening * faster * faster + self.both_ways * rate**2)


def damping_force(rate_mm_s: Array, lengthening: Array, both_ways: Array) -> Array:
    """Tension of dampers, N.

    Args:
        rate_mm_s: at which fibres become longer.
        lengthening: N s/mm while they do.
        both_ways: N s/mm.

    Example:
        >>> import jax.numpy as jnp
        >>> damping_force(jnp.array([2.0, -2.0]), jnp.array(1.5), jnp.array(0.1)).round(3).tolist()
        [3.2, -0.2]
    """
    return lengthening * jnp.maximum(rate_mm_s, 0.0) + both_ways * rate_mm_s


#: Strain at which ligaments failed in tension, human tissue: the kind, as it stands in a fibre's
#: name, and its mean. Fascicle-bone units of cruciate and lateral collateral ligaments: 15.0 %
#: (Butler, Kay and Stouffer, J Biomech 19, 1986); the medial collateral along its fibres: 17.1 %
#: (Quapp and Weiss, J Biomech Eng 120, 1998); the posterior cruciate's main bundle: 18.0 % (Race
#: and Amis, J Biomech 27, 1994).
FAILURE_STRAIN = {"PCL": 0.18, "MCL": 0.17, "ACL": 0.15, "LCL": 0.15}
#: Who measured them, in a line for a knee file.
FAILURE_SOURCE = "published (Butler 1986; Quapp and Weiss 1998; Race and Amis 1994)"
#: Of any other: Butler's mean of knee ligaments.
USUAL_FAILURE_STRAIN = 0.15


class FibreFaults(eqx.Module):
    """What is wrong with any fibre of a knee, each of the shape of the poses.

    Attributes:
        overstretched: strained beyond its failure strain.
        past_wrap: touches its cylinder beyond the cylinder's length.
        wrap_inside: has an end inside its obstacle.

    Example:
        >>> import jax.numpy as jnp
        >>> no = jnp.array([False])
        >>> FibreFaults(overstretched=~no, past_wrap=no, wrap_inside=no).overstretched.tolist()
        [True]
    """

    overstretched: Array
    past_wrap: Array
    wrap_inside: Array


def usual_failure_strain(names: Sequence[str]) -> np.ndarray:
    """Published failure strain of fibres, by the kind that their names tell.

    Args:
        names: of the fibres.

    Returns:
        Shape `(n,)`.

    Example:
        >>> usual_failure_strain(["ACLam1", "PCL", "pCAP3"]).tolist()
        [0.15, 0.18, 0.15]
    """
    return np.array([_of(name.upper()) for name in names], float)


def _of(name: str) -> float:
    known = (strain for kind, strain in FAILURE_STRAIN.items() if kind in name)
    return next(known, USUAL_FAILURE_STRAIN)
