"""What is known of many balances: variants of a knee at load cases."""

__all__ = ["Equilibria", "equilibrium_of"]

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import numpy as np
from jax import Array

from kneejax.geometry import FREE_COORDINATES, TIBIA, coordinate, scales, table_units
from kneejax.statics._equilibrium import Equilibrium
from kneejax.statics._load_cases import LoadCases
from kneejax.statics._newton import newton_step_left
from kneejax.statics._status import Status, converged

#: Fields of `Equilibrium` that a continuation finds, and those that are forces and stiffness.
_FOUND = ("q", "contact_points", "status", "fault", "steps")
_FORCES = ("residual", "tangent", "reaction", "coupling", "depth")


class Equilibria(eqx.Module):
    """Balanced poses of variants at load cases; arrays of NumPy that begin with the axes of the
    values.

    Attributes:
        q: free coordinates `(variants, load_cases, free)`, rad and mm; NaN where there is no
            balance.
        contact_points: parameters of the points where surfaces meet, `(variants, load_cases, n,
            2)`.
        status: `Status` values, `(variants, load_cases)`.
        steps: Newton steps taken, of all searches, `(variants, load_cases)`.
        reached: part of a load case's last load under which the knee still balanced on the way to
            it, `(variants, load_cases)`: 1 where it is found.
        fault: the pose at which the last search ended, balanced or not, taken by itself; `Status`
            values.
        softness: least force by the step that it makes, N/mm, at the last balance before a load
            case or where the search ended.
        forces: forces and stiffness, fields of `Equilibrium` by name, `(variants, load_cases,
            ...)`; those of the last search where there is no balance; empty where nobody asked.
        free: names of the free coordinates.
    """

    q: np.ndarray
    contact_points: np.ndarray
    status: np.ndarray
    steps: np.ndarray
    reached: np.ndarray
    fault: np.ndarray
    softness: np.ndarray
    forces: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    free: tuple[str, ...] = eqx.field(static=True, default=FREE_COORDINATES)

    @classmethod
    def nothing(
        cls, shape: tuple[int, ...], load_cases: LoadCases, patches: int, forces: bool
    ) -> "Equilibria":
        """Nothing known yet: every pose counts as not balanced."""
        shapes, lost = shapes_of_record(load_cases, patches), int(Status.NOT_CONVERGED)
        unknown = {name: np.full((*shape, *shapes[name]), np.nan)
                   for name in ("q", "contact_points", *(_FORCES if forces else ()))}  # fmt: skip
        return cls(
            unknown.pop("q"),
            unknown.pop("contact_points"),
            np.full(shape, lost, np.int8),
            np.zeros(shape, np.int32),
            np.zeros(shape),
            np.full(shape, lost, np.int8),
            np.full(shape, np.nan),
            unknown,
            load_cases.free,
        )

    def note(self, where: Any, record: Mapping[str, Any]) -> None:
        """Write down what became of some of them, see `shapes_of_record`, in place."""
        good = np.asarray(converged(record["status"]))
        for name in ("q", "contact_points"):
            values = np.where(good, record[name], np.nan)
            getattr(self, name)[where] = np.moveaxis(values, -1, 0)
        for name in ("status", "fault", "softness"):
            getattr(self, name)[where] = record[name]
        np.add.at(self.steps, where, record["steps"].astype(np.int32))  # two ways may end at one
        self.reached[where] = np.where(good, 1.0, record["way"])
        for name, values in self.forces.items():
            values[where] = np.moveaxis(record[name], -1, 0)

    def put(self, where: Any, others: "Equilibria") -> None:
        """Replace some of them, in place."""
        for old, new in zip(jax.tree.leaves(self), jax.tree.leaves(others), strict=True):
            old[where] = new

    def at(self, *where: Any) -> "Equilibria":
        """The balances at some of the variants and load cases, as NumPy indexes."""
        return jax.tree.map(lambda x: x[where], self)

    def in_nodes(self) -> dict[str, np.ndarray]:
        """What `equilibrium_of` makes balances of, one node after the other; forces must be
        known."""
        every = {name: getattr(self, name) for name in _FOUND} | self.forces
        axes = self.status.ndim
        return {name: x.reshape(self.status.size, *x.shape[axes:]) for name, x in every.items()}

    @property
    def table(self) -> np.ndarray:
        """Free coordinates of the tibia in degrees and mm, `(variants, load_cases, free)`."""
        own = [name for name in self.free if coordinate(name).body == TIBIA]
        return self.q[..., : len(own)] * table_units(own)

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, load_cases)`."""
        return converged(self.status)


def shapes_of_record(load_cases: LoadCases, patches: int) -> dict[str, tuple[int, ...]]:
    """What is recorded where a path is through with a load case, without lanes: its place on the
    path, -1 where none ended; fields of `Equilibrium`; the part of the way to it at which the last
    equilibrium was, and its softness."""
    free, held = len(load_cases.free), len(load_cases.prescribed)
    numbers = dict.fromkeys(("place", "status", "fault", "steps", "way", "softness"), ())
    return numbers | {
        "q": (free,), "contact_points": (patches, 2), "residual": (free,),
        "tangent": (free, free), "reaction": (held,), "coupling": (held, free), "depth": (patches,),
    }  # fmt: skip


def of_record(rows: Any, shapes: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    """The numbers of records `(numbers, lanes)` by name; arrays end in lanes."""
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = zip(shapes.items(), np.r_[0, ends[:-1]], ends, strict=True)
    return {name: rows[a:b].reshape(*shape, rows.shape[-1]) for (name, shape), a, b in parts}


@jax.jit
def equilibrium_of(load_cases: LoadCases, nodes: Mapping[str, Array]) -> Equilibrium:
    """Balances that were found, as what the derivative follows.

    Args:
        load_cases: of each node.
        nodes: see `Equilibria.in_nodes`, but arrays end in lanes.

    Returns:
        One lane a node.
    """
    units = scales(load_cases.free)
    left_mm, pivots = newton_step_left(nodes["tangent"], nodes["residual"], units)
    return Equilibrium(
        load_cases.prescribed, **nodes, left_mm=left_mm, pivots=pivots, bodies=load_cases.bodies
    )
