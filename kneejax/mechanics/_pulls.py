"""Lines and muscles of a knee that pull more than they do at rest."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike


class Pull(eqx.Module):
    """Tension that is added to lines or muscles of a knee, as a load that grows like any other.

    Its lines grow together. Only where a knee is balanced (`kneejax.statics.LoadCases`).

    Attributes:
        tension: that is added to each, shape `(..., lines)`, N.
        ends: where each begins, in the femur's frame, and ends, in that of the bone it pulls, shape
            `(..., lines, 2, 3)`, mm: a muscle that comes from the pelvis begins elsewhere in the
            femur at each angle of the hip. Of muscles only; None where they stay where they are.
        lines: names of the knee's lines and muscles; `QUADRICEPS` stands for all its heads.
    """

    tension: Array
    ends: Array | None
    lines: tuple[str, ...] = eqx.field(static=True)

    def __init__(self, tension: ArrayLike, lines: tuple[str, ...], ends: ArrayLike | None = None):
        self.tension = jnp.asarray(tension, float)
        self.ends = None if ends is None else jnp.asarray(ends, float)
        self.lines = tuple(lines)

    @property
    def sizes(self) -> Array:
        """How much pulls, `(..., lines)`, N."""
        return self.tension

    @property
    def places(self) -> tuple[Array, ...]:
        """Where it pulls: what stays while it grows."""
        return () if self.ends is None else (self.ends,)

    def times(self, part: ArrayLike) -> Pull:
        """A part of it, `(...)` or one."""
        return dataclasses.replace(self, tension=jnp.asarray(part)[..., None] * self.tension)

    def at_each(self, shape: tuple[int, ...]) -> Pull:
        """Once for each of `shape` load cases."""
        ends = self.ends
        if ends is not None:
            ends = jnp.broadcast_to(ends, (*shape, *ends.shape[-3:]))
        tension = jnp.broadcast_to(self.tension, (*shape, len(self.lines)))
        return dataclasses.replace(self, tension=tension, ends=ends)


def pull_of(line: str, tension_N: ArrayLike) -> Pull:
    """Tension that is added to one of a knee's lines.

    Args:
        line: its name, e.g. `patellar_tendon`; a muscle's, or `QUADRICEPS`.
        tension_N: one, or `(n,)` for `kneejax.statics.LoadCases`.

    Example:
        >>> pull_of("patellar_tendon", [0.0, 50.0]).tension.tolist()
        [[0.0], [50.0]]
    """
    return Pull(jnp.asarray(tension_N, float)[..., None], (line,))
