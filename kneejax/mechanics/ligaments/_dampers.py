"""What resists the stretching of fibres during a step through time.

Two conventions, each named by its unit:

- `damping_N_s`: as OpenSim 4.6 damps a `Blankevoort1991Ligament`. Force is the coefficient times
  the rate of strain while a fibre lengthens, faded in over the first percent of strain.
- `damping_N_s_per_mm`: force per rate of length, while a fibre lengthens or shortens (paper 2,
  section 3.1; `critical_damping`), faded in alike: paper 2 does not say what a slack fibre does.
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.numerics import safe_sqrt

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
    """
    return lengthening * jnp.maximum(rate_mm_s, 0.0) + both_ways * rate_mm_s
