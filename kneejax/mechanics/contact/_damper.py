"""What resists the compression of cartilage during a step through time.

As OpenSim 4.6 damps an `ElasticFoundationForce`: the elastic force is multiplied by one plus the
dissipation times the rate of the overlap, at each point, and a contact never pulls. The name of
the number is `dissipation_s_per_mm` (OpenSim's is in s/m).
"""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array


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
