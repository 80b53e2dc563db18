"""Balances with their exact derivatives by what varies, for many variants at many load cases."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee
from kneejax.numerics import compiled, on_all_cores
from kneejax.statics._batch import balance_many, balance_near
from kneejax.statics._equilibria import Equilibria, equilibrium_of
from kneejax.statics._equilibrium import differentiable
from kneejax.statics._load_cases import LoadCases, Vary, in_lanes
from kneejax.statics._status import converged

#: Lanes of a call: XLA makes a slower program of fewer (four ligaments: 1.3 ms with 32 lanes, 2.6
#: with 64, 0.6 with 128).
_LANES = 128
#: Fields of `Slopes` that load cases do not have.
_BY_VARIANT = ("values", "knee")
#: Leaves in which knees differ, by their places; arrays begin with the knee.
Own = Mapping[int, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Slopes:
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
            object.__setattr__(self, "knee", np.zeros(len(self.values), int))

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, load_cases)`."""
        return converged(self.status)

    def take(self, rows) -> Slopes:
        """Some of the variants, in the order of `rows`."""
        return Slopes(*(getattr(self, f.name)[rows] for f in dataclasses.fields(self)))

    def at(self, rows) -> Slopes:
        """All variants at some of the load cases, in the order of `rows`."""
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        return Slopes(**{k: x if k in _BY_VARIANT else x[:, rows] for k, x in arrays.items()})

    @classmethod
    def joined(cls, parts: Sequence[Slopes], places: Sequence[np.ndarray]) -> Slopes:
        """The same variants at all load cases, from what was balanced apart.

        Args:
            parts: one or more.
            places: of each part's load cases among all.
        """
        order = np.argsort(np.concatenate(places))
        names = [f.name for f in dataclasses.fields(cls) if f.name not in _BY_VARIANT]
        every = {k: np.concatenate([getattr(x, k) for x in parts], axis=1) for k in names}
        own = {k: getattr(parts[0], k) for k in _BY_VARIANT}
        return cls(**own, **{k: x[:, order] for k, x in every.items()})

    def put(self, rows, others: Slopes) -> None:
        """Replace some of the variants in place."""
        for field in dataclasses.fields(self):
            getattr(self, field.name)[rows] = getattr(others, field.name)


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
    marks = jax.tree.map(np.asarray, load_cases.plain())
    which = np.arange(len(values)) if own and near is None else None if near is None else near.knee
    every: Any = values
    if own:
        vary, every = _OfOwnKnee(vary), ({leaf: x[which] for leaf, x in own.items()}, values)
    if near is not None:
        step = values - near.values
        q = near.q + np.einsum("vscp,vp->vsc", near.jacobian, step)
        found = balance_near(knee, vary, every, load_cases, q, near.contact_points)
    else:
        found = balance_many(knee, vary, every, load_cases, holding=True)
    return dataclasses.replace(_with_slopes(knee, vary, every, marks, found), knee=which)


def _with_slopes(
    knee: Knee, vary: Vary, every: Any, load_cases: LoadCases, found: Equilibria
) -> Slopes:
    """Nodes dealt to lanes, calls of `_LANES` to threads."""
    own, values = every if isinstance(vary, _OfOwnKnee) else (None, every)
    count, size = found.status.shape
    nodes = found.in_nodes()

    def some(first: int):
        rows = np.minimum(np.arange(first, first + _LANES), count * size - 1)
        at = jax.tree.map(lambda x: x[rows % size], load_cases)
        here = {name: np.moveaxis(x[rows], 0, -1) for name, x in nodes.items()}
        numbers = jax.tree.map(lambda x: x[rows // size], (values, own))
        return np.asarray(_slopes(vary, knee, *numbers, at, here))

    parts = on_all_cores(some, range(0, count * size, _LANES))
    slope = np.concatenate(parts)[: count * size].reshape(count, size, -1, values.shape[1])
    return Slopes(
        values, found.q, slope, found.contact_points, found.holding["tangent"], found.status
    )
