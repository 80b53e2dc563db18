"""Variants of a knee, as the numbers in which they differ from it, and what acts on them.

What may vary is a function of the caller's. If searches took it along, each choice of parameters
would compile them anew (9 s); they take the numbers that it changes, and stiffness and slack length
of all ligaments always, so that one program serves every choice among those.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.flatten_util import ravel_pytree

from kneejax.mechanics import Knee
from kneejax.statics._load_cases import LoadCases

#: A function `(knee, value) -> knee` of the same structure; hashable, since it steers compiling.
Vary = Callable[[Knee, Any], Knee]

#: Variants whose numbers are computed in one call.
_CHUNK = 256


@dataclasses.dataclass(frozen=True)
class Variants:
    """Variants of one knee.

    Attributes:
        knee: gives all numbers that do not vary; without a lane axis. Where contacts do not vary,
            their points are placed.
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
        nothing = jax.tree.map(lambda _: False, knee)
        of_contacts = jax.tree.map(lambda _: True, knee.contacts)
        marks = jax.tree.leaves(dataclasses.replace(nothing, contacts=of_contacts))
        still = not any(marks[leaf] for leaf in numbers)
        return cls(knee.for_many_poses() if still else knee, numbers, count)

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


class Case(NamedTuple):
    """A load case of a knee of its own: the numbers that vary by their places, what acts there."""

    numbers: dict[int, Any]
    load_cases: LoadCases

    def of(self, rows: Array) -> Case:
        """Those of rows `(numbers, lanes)`, which were made of cases like this one."""
        return jax.vmap(ravel_pytree(self)[1], in_axes=-1, out_axes=-1)(rows)

    def knees(self, knee: Knee) -> Knee:
        """With their loads; of a case whose arrays end in lanes."""
        return self.load_cases.added_to(with_numbers(knee, self.numbers)).for_many_poses()

    def rows_of_numbers(self) -> np.ndarray:
        """Which rows are numbers of the knee."""
        return self._rows_of(self.numbers)

    def rows_of_flexion(self) -> np.ndarray:
        """Which row is flexion, where that is prescribed."""
        return self._rows_of(self.load_cases.prescribed.get("flexion"))

    def rows_of_points(self) -> np.ndarray:
        """Which rows say where a load acts."""
        return self._rows_of([load.places for load in self.load_cases.loads])

    def _rows_of(self, some: Any) -> np.ndarray:
        chosen = {id(x) for x in jax.tree.leaves(some)}
        return in_rows(jax.tree.map(lambda x: np.full(np.shape(x), id(x) in chosen), self), 0)


def in_rows(tree: Any, axes: int) -> Any:
    """All numbers of arrays that begin with the same axes, beside each other: `(..., numbers)`."""
    leaves = jax.tree.leaves(tree)
    numpy = np if all(isinstance(x, np.ndarray) for x in leaves) else jnp
    return numpy.concatenate([x.reshape(*x.shape[:axes], -1) for x in leaves], axis=-1)
