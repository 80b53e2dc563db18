"""Balances with their exact derivatives by what varies, for many variants at many load cases."""

__all__ = ["Own", "Slopes", "balance_with_slopes"]

import dataclasses
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee
from kneejax.numerics import beside, compiled, on_all_cores
from kneejax.statics._equilibria import Equilibria, equilibrium_of
from kneejax.statics._equilibrium import differentiable
from kneejax.statics._load_cases import LoadCases, Vary, in_lanes
from kneejax.statics._many import balance_many, balance_near
from kneejax.statics._status import converged

#: Lanes of a call: XLA makes a slower program of fewer (four ligaments: 1.3 ms with 32 lanes, 2.6
#: with 64, 0.6 with 128).
_LANES = 128
#: Fields of `Slopes` that load cases have.
_BY_LOAD_CASE = ("q", "jacobian", "contact_points", "tangent", "status")
#: Leaves in which knees differ, by their places; arrays begin with the knee.
Own = Mapping[int, np.ndarray]


class Slopes(eqx.Module):
    """Balanced poses and their derivatives; arrays begin with variant and load case.

    Attributes:
        values: what varies, `(variants, p)`.
        q: free coordinates `(variants, load_cases, free)`, rad and mm; NaN where there is no
            balance.
        jacobian: of them by the values, `(variants, load_cases, free, p)`.
        contact_points: parameters of the points where surfaces meet, `(variants, load_cases, n,
            2)`.
        tangent: stiffness, `(variants, load_cases, free, free)`.
        status: `Status` values, `(variants, load_cases)`.
        knee: of several knees that which each variant is of, `(variants,)`; zeros by default.
    """

    values: np.ndarray
    q: np.ndarray
    jacobian: np.ndarray
    contact_points: np.ndarray
    tangent: np.ndarray
    status: np.ndarray
    knee: np.ndarray = dataclasses.field(default=None)  # pyright: ignore[reportAssignmentType]

    def __post_init__(self) -> None:
        if self.knee is None:
            self.knee = np.zeros(len(self.values), int)

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, load_cases)`."""
        return converged(self.status)

    def take(self, rows) -> "Slopes":
        """Some of the variants, in the order of `rows`."""
        return jax.tree.map(lambda x: x[rows], self)

    def at(self, rows) -> "Slopes":
        """All variants at some of the load cases, in the order of `rows`."""
        some = {name: getattr(self, name)[:, rows] for name in _BY_LOAD_CASE}
        return dataclasses.replace(self, **some)

    @classmethod
    def joined(cls, parts: "Sequence[Slopes]", places: Sequence[np.ndarray]) -> "Slopes":
        """The same variants at all load cases, from one or more parts that were balanced apart,
        and the places of each part's load cases among all."""
        order = np.argsort(np.concatenate(places))
        every = {x: np.concatenate([getattr(y, x) for y in parts], axis=1) for x in _BY_LOAD_CASE}
        return dataclasses.replace(parts[0], **{name: x[:, order] for name, x in every.items()})

    def put(self, rows, others: "Slopes") -> None:
        """Replace some of the variants in place."""
        for old, new in zip(jax.tree.leaves(self), jax.tree.leaves(others), strict=True):
            old[rows] = new


@dataclasses.dataclass(frozen=True)
class _OfOwnKnee:
    """Makes variants of several knees of one structure: the value is what is a knee's own, and what
    varies."""

    vary: Vary

    def __call__(self, knee: Knee, value: Any) -> Knee:
        own, rest = value
        leaves, structure = jax.tree.flatten(knee)
        here = [own.get(place, leaf) for place, leaf in enumerate(leaves)]
        return self.vary(jax.tree.unflatten(structure, here), rest)


@compiled(static_argnums=(0,), effort="most")
def _slopes(vary: Vary, knee: Knee, values, own, load_cases: LoadCases, known: dict[str, Any]):
    """Derivatives of the free coordinates by each lane's values, `(lanes, free, p)`."""
    equilibrium = equilibrium_of(load_cases, known)

    def poses(x):
        lanes = load_cases.load(in_lanes(knee, vary, (own, x) if own else x))
        return differentiable(lanes, load_cases.prescribed, equilibrium).q

    q, push = jax.linearize(poses, values)
    (free, lanes), size = q.shape, values.shape[1]
    if size <= free:
        # Lanes do not touch each other: one direction moves the same number of all of them.
        units = jnp.broadcast_to(jnp.eye(size)[:, None], (size, *values.shape))
        return jnp.moveaxis(jax.vmap(push, out_axes=-1)(units), 1, 0)
    # Fewer rows than columns: what is asked for row by row takes less of everything.
    units = jnp.broadcast_to(jnp.eye(free)[..., None], (free, free, lanes))
    pull = jax.linear_transpose(push, values)
    return jnp.moveaxis(jax.vmap(lambda row: pull(row)[0])(units), 1, 0)


def balance_with_slopes(
    knee: Knee,
    vary: Vary,
    values: np.ndarray,
    load_cases: LoadCases,
    near: Slopes | None = None,
    own: Own | None = None,
) -> Slopes:
    """Balance variants of a knee at load cases, with exact derivatives by their values.

    Args:
        knee: gives all numbers that do not vary.
        vary: see `balance_many`; its value is a vector here.
        values: `(variants, p)`.
        load_cases: as in `balance_many`.
        near: of near values, one variant each, to predict from; by default each variant is
            followed as in `balance_many`.
        own: of several knees of one structure and reference pose the numbers in which they differ;
            each variant is of the knee that `near` says, or without it of the one of its place.

    Returns:
        The `Slopes`; a node without a balance is NaN by itself.
    """
    values, load_cases = np.asarray(values, float), load_cases.of(knee)
    which = near.knee if near is not None else np.arange(len(values)) if own else None
    mine = {leaf: x[which] for leaf, x in own.items()} if own else None
    every: Any = (mine, values) if own else values
    vary = _OfOwnKnee(vary) if own else vary
    marks = jax.tree.map(np.asarray, load_cases.plain())
    count, size = len(values), len(load_cases)

    def some(found: Equilibria, first: int) -> np.ndarray:
        rows = np.minimum(np.arange(first, first + _LANES), count * size - 1)
        at = jax.tree.map(lambda x: x[rows % size], marks)
        here = {name: np.moveaxis(x[rows], 0, -1) for name, x in found.in_nodes().items()}
        numbers = jax.tree.map(lambda x: x[rows // size], (values, mine))
        return np.asarray(_slopes(vary, knee, *numbers, at, here))

    if near is not None:
        q = near.q + np.einsum("vscp,vp->vsc", near.jacobian, values - near.values)
        found = balance_near(knee, vary, every, load_cases, q, near.contact_points)
    else:
        # Whatever it computes: the program compiles while that of the balances does.
        nothing = Equilibria.nothing((count, size), marks, knee.patch_count, forces=True)
        with beside(some, nothing, 0):
            found = balance_many(knee, vary, every, load_cases, forces=True)
    parts = on_all_cores(partial(some, found), range(0, count * size, _LANES))
    jacobian = np.concatenate(parts)[: count * size].reshape(count, size, -1, values.shape[1])
    return Slopes(
        values, found.q, jacobian, found.contact_points, found.forces["tangent"], found.status,
        which,
    )  # fmt: skip
