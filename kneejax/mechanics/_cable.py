"""A cable of given length on the heads of the quadriceps, whose pull is a result."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.numerics import positive_part

#: N/mm. A cable is as stiff as poses can be told apart: 1e-9 mm, to which they are found, are
#: 1e-4 N of its pull, and ten times the stiffest cartilage.
CABLE_N_PER_MM = 1e5
#: N: over such pulls it becomes slack, as a cable cannot push.
_ROUNDING_N, _LEAST_N = 1.0, 0.05


class Cable(eqx.Module):
    """A motor that gives the quadriceps its length (paper 3, Eq 20).

    Heads share its pull as they share their tension at rest, and its length is the mean of theirs
    with the same shares: pull times a change of it is the work that it does. It stretches by a
    hundredth of a micrometre for each N by which its pull differs from what was expected. From
    step to step through time that is next to nothing: the pull is the multiplier of a given length.

    Attributes:
        length: that the motor gives, mm, `(...)`.
        expected: pull at which the cable has that length, N, `(...)`.
    """

    length: Array
    expected: Array

    def pull(self, length: Array) -> Array:
        """N, at a length of the quadriceps, mm; 0 where the cable is slack."""
        return CABLE_N_PER_MM * positive_part(self._stretch(length), _ROUNDING_N / CABLE_N_PER_MM)

    def energy(self, length: Array) -> Array:
        """Potential of the pull, N mm."""
        x, w = self._stretch(length), _ROUNDING_N / CABLE_N_PER_MM
        inner = x * (x + jnp.sqrt(x * x + w * w)) + w * w * jnp.arcsinh(x / w)
        return 0.25 * CABLE_N_PER_MM * inner

    def _stretch(self, length: Array) -> Array:
        """Of the cable, mm, counted so that it pulls as expected where it has its length."""
        y = jnp.maximum(self.expected, _LEAST_N) / CABLE_N_PER_MM
        w = _ROUNDING_N / CABLE_N_PER_MM
        return length - self.length + y - w * w / (4.0 * y)
