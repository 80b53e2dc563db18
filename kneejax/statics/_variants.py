"""Variants of a knee, as the numbers in which they differ from it.

What may vary is a function of the caller's. If searches took it along, each choice of parameters
would compile them anew (9 s); they take the numbers that it changes, and stiffness and slack length
of all ligaments always, so that one program serves every choice among those.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee

#: A function `(knee, value) -> knee` of the same structure; hashable, since it steers compiling.
Vary = Callable[[Knee, Any], Knee]

#: Variants whose numbers are computed in one call.
_CHUNK = 256


@dataclasses.dataclass(frozen=True)
class Variants:
    """Variants of one knee.

    Attributes:
        knee: gives all numbers that do not vary; without a lane axis.
        numbers: leaves of the knee that vary, by their places; arrays begin with the variant.
        count: of the variants.
    """

    knee: Knee
    numbers: dict[int, np.ndarray]
    count: int

    @classmethod
    def of(cls, knee: Knee, vary: Vary, values: Any) -> Variants:
        """Variants by their values, whose leaves begin with the variant."""
        values = jax.tree.map(np.asarray, values)
        count, parts = len(jax.tree.leaves(values)[0]), []
        for first in range(0, count, _CHUNK):
            rows = np.minimum(np.arange(first, first + _CHUNK), count - 1)
            some = jax.tree.map(lambda x, rows=rows: x[rows], values)
            parts.append(_numbers(vary, knee, some))
        leaves = parts[0] if parts else {}
        numbers = {leaf: np.concatenate([part[leaf] for part in parts])[:count] for leaf in leaves}
        return cls(knee, numbers, count)

    def __len__(self) -> int:
        return self.count

    def take(self, rows: np.ndarray) -> Variants:
        """Some of the variants."""
        return Variants(self.knee, {k: x[rows] for k, x in self.numbers.items()}, len(rows))


@partial(jax.jit, static_argnums=0)
def _numbers(vary: Vary, knee: Knee, values: Any) -> dict[int, jax.Array]:
    def of_one(value: Any) -> dict[int, jax.Array]:
        springs = knee.ligaments.stiffness, knee.ligaments.slack_length
        pairs = zip(jax.tree.leaves(knee), jax.tree.leaves(vary(knee, value)), strict=True)
        # A number that `vary` leaves alone is handed through as the very same array.
        return {
            leaf: new
            for leaf, (old, new) in enumerate(pairs)
            if old is not new or any(old is spring for spring in springs)
        }

    return jax.vmap(of_one)(values)


def with_numbers(knee: Knee, numbers: Mapping[int, Any]) -> Knee:
    """A knee whose leaves end in lanes, one lane for all where a number does not vary.

    Args:
        knee: without a lane axis.
        numbers: leaves that vary, by their places; arrays end in lanes.

    Returns:
        The knee.
    """
    leaves, structure = jax.tree.flatten(knee)
    lanes = (
        numbers[place] if place in numbers else jnp.asarray(x)[..., None]
        for place, x in enumerate(leaves)
    )
    return jax.tree.unflatten(structure, lanes)


def in_lanes(knee: Knee, vary: Vary, values: Any) -> Knee:
    """The knee with a lane for each value; numbers that do not vary have one lane for all, but
    stiffness and slack length of all ligaments have their own.

    Args:
        knee: without a lane axis.
        vary: see `Vary`.
        values: leaves begin with the lane.

    Returns:
        A knee whose leaves end in lanes.
    """
    numbers = _numbers(vary, knee, values)
    return with_numbers(knee, {leaf: jnp.moveaxis(x, 0, -1) for leaf, x in numbers.items()})
