"""Three pressure laws of an elastic layer on rigid bone, and what resists its compression.

With `s` the depth over the layer's thickness and `K` the layer's confined modulus:

| law    | pressure        | energy per area             |
|--------|-----------------|-----------------------------|
| linear | `K s`           | `K h s^2 / 2`               |
| log    | `-K ln(1 - s)`  | `K h ((1 - s) ln(1 - s) + s)` |
| ratio  | `K s / (1 - s)` | `-K h (s + ln(1 - s))`      |

Sources: Blankevoort (1991); paper 3, Eqs 13 to 15 (Eq 15 integrates the ratio law, not Eq 13).
The log and ratio laws have no value at or beyond `s = 1`: there every function returns NaN, which
the solver refuses and the status reports.

As OpenSim 4.6 damps an `ElasticFoundationForce`: the elastic force is multiplied by one plus the
dissipation times the rate of the overlap, at each point, and a contact never pulls. The name of
the number is `dissipation_s_per_mm` (OpenSim's is in s/m).
"""

__all__ = ["ContactDamper", "contact_damping_force"]

from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.numerics import branch, positive_part

#: The pressure laws by name.
LAWS = ("linear", "log", "ratio")

# Below this relative depth the patch integrals are summed as a series: their closed forms
# subtract numbers that agree in ever more digits. 10 terms leave 1e-15 relative at the switch.
_SERIES_BELOW = 0.04
_TERMS = 10


def confined_modulus(youngs_modulus: ArrayLike, poisson_ratio: ArrayLike) -> Array:
    """Modulus of a thin layer that cannot bulge sideways, in the unit of `youngs_modulus`.

    Args:
        youngs_modulus: E, MPa.
        poisson_ratio: nu, below 0.5.

    Source: paper 3, Eq 14 (with the E that print lost).

    Example:
        >>> round(float(confined_modulus(5.0, 0.45)), 4)
        18.9655
    """
    e, nu = jnp.asarray(youngs_modulus, float), jnp.asarray(poisson_ratio, float)
    return e * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


def touching(depth: Array, onset_width: Array) -> Array:
    """From 0 apart to 1 in touch: the slope of the rounded depth, `positive_part`, by the depth."""
    root = jnp.sqrt(depth * depth + onset_width * onset_width)
    return positive_part(depth, onset_width) / root


def relative_pressure(law: str, s: ArrayLike) -> Array:
    """Pressure over the confined modulus at relative depth `s`."""
    s = jnp.asarray(s, float)
    if law == "linear":
        return s
    return _within(s, (lambda x: -jnp.log1p(-x)) if law == "log" else (lambda x: x / (1.0 - x)))


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def relative_energy(law: str, s: ArrayLike) -> Array:
    """Energy per area over `K h` at relative depth `s`. Arguments as `relative_pressure`."""
    s = jnp.asarray(s, float)
    if law == "linear":
        return 0.5 * s * s
    return _by_series_or(s, law, over_patch=False)


@relative_energy.defjvp
def _relative_energy_jvp(law: str, primals, tangents):
    return relative_energy(law, *primals), relative_pressure(law, *primals) * tangents[0]


@partial(jax.custom_jvp, nondiff_argnums=(0,))
def patch_energy(law: str, c: ArrayLike) -> Array:
    """Integral of `relative_energy` from 0 to `c`.

    Over an elliptical patch with relative depth `c` at its centre the depth falls off as
    `s = c (1 - x^2 / a^2 - y^2 / b^2)`, so the mean energy is this integral, divided by `c`.
    """
    c = jnp.asarray(c, float)
    if law == "linear":
        return c * c * c / 6.0
    return _by_series_or(c, law, over_patch=True)


# Stated: traced through the series, values and slopes would share every term of it, and be a kernel
# for each.
@patch_energy.defjvp
def _patch_energy_jvp(law: str, primals, tangents):
    return patch_energy(law, *primals), relative_energy(law, *primals) * tangents[0]


def _series(c: Array, law: str, over_patch: bool) -> Array:
    total = jnp.zeros_like(c)
    for n in range(_TERMS + 1, 1, -1):
        weight = 1.0 / (n * (n - 1)) if law == "log" else 1.0 / n
        total = total * c + (weight / (n + 1) if over_patch else weight)
    return total * c * c * (c if over_patch else 1.0)


def _closed(c: Array, law: str, over_patch: bool) -> Array:
    logarithm, rest = jnp.log1p(-c), 1.0 - c
    if not over_patch:
        return rest * logarithm + c if law == "log" else -(c + logarithm)
    if law == "log":
        return 0.25 * (rest * rest - 1.0) + 0.5 * (c * c - rest * rest * logarithm)
    return rest * logarithm + c - 0.5 * c * c


def _by_series_or(c: Array, law: str, over_patch: bool) -> Array:
    return branch(
        jnp.abs(c) < _SERIES_BELOW,
        lambda x: _series(x, law, over_patch),
        lambda x: _within(x, lambda y: _closed(y, law, over_patch)),
        c,
        inside=0.01,
        outside=0.5,
    )


def _within(s: Array, function) -> Array:
    return branch(s < 1.0, function, lambda x: jnp.nan * x, s, inside=0.5, outside=0.5)


class ContactDamper(eqx.Module):
    """A contact's damper as it is in one implicit step; arrays `(...)` of a patch, `(points, ...)`
    of points.

    The rate of an overlap is `per_s` times how far it is from `before`, and the elastic force is
    the one that is expected, so that a damper is a spring for as long as the step lasts.

    Attributes:
        dissipation: s/mm.
        pressing: elastic force that is expected at the end of the step, N.
        before: mm; no rate where the overlap is this.
        per_s: 1/s.
    """

    dissipation: Array
    pressing: Array
    before: Array
    per_s: Array

    def force(self, overlap: Array) -> Array:
        """N, at given overlaps; as much as the elastic force takes away at most."""
        return contact_damping_force(self._rate(overlap), self.dissipation, self.pressing)

    def energy(self, overlap: Array) -> Array:
        """Potential of the force, N mm."""
        rate = self._rate(overlap)
        pulls = self.dissipation * rate < -1.0
        least = jnp.where(pulls, self.dissipation, -1.0)
        beyond = -rate - 0.5 / least
        within = 0.5 * self.dissipation * rate * rate
        return self.pressing / self.per_s * jnp.where(pulls, beyond, within)

    def _rate(self, overlap: Array) -> Array:
        return self.per_s * (overlap - self.before)


def contact_damping_force(rate_mm_s: Array, dissipation: Array, pressing_N: Array) -> Array:
    """What a damped contact presses with besides its elastic force, N.

    Args:
        rate_mm_s: at which the overlap grows.
        dissipation: s/mm.
        pressing_N: the elastic force.

    Source: OpenSim 4.6, `ElasticFoundationForce`: `k a x (1 + c v)`, not less than zero.

    Example:
        >>> [float(contact_damping_force(v, 0.02, 100.0)) for v in (10.0, -10.0, -80.0)]
        [20.0, -20.0, -100.0]
    """
    return pressing_N * jnp.maximum(dissipation * rate_mm_s, -1.0)
