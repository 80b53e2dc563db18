"""What is known of many balances: variants of a knee at stations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jax import Array

from kneejax.geometry import FREE_COORDINATES, TIBIA, coordinate, scales, table_units
from kneejax.statics._settle import Settled, shapes_of_holding
from kneejax.statics._stations import Stations
from kneejax.statics._status import Status, converged
from kneejax.statics._stiffness import newton_step_left

#: Fields of `Settled` that a continuation finds, besides what holds a balance.
_FOUND = ("q", "meeting", "status", "fault", "steps")


@dataclasses.dataclass(frozen=True)
class Balances:
    """Balanced poses of variants at stations; arrays begin with the axes of the values.

    Attributes:
        q: free coordinates `(variants, stations, free)`, rad and mm; NaN where there is no balance.
        meeting: parameters of the points where surfaces meet, `(variants, stations, n, 2)`.
        status: `Status` values, `(variants, stations)`.
        steps: Newton steps taken, of all searches, `(variants, stations)`.
        reached: part of a station's last load under which the knee still balanced on the way to
            it, `(variants, stations)`: 1 where it is found.
        fault: the pose at which the last search ended, balanced or not, taken by itself; `Status`
            values.
        softness: see `softness_of`, at the last balance before a station or where the search ended.
        holding: what holds the balances, fields of `Settled` by name, `(variants, stations, ...)`;
            those of the last search where there is none; empty where nobody asked.
        free: names of the free coordinates.
    """

    q: np.ndarray
    meeting: np.ndarray
    status: np.ndarray
    steps: np.ndarray
    reached: np.ndarray
    fault: np.ndarray
    softness: np.ndarray
    holding: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    free: tuple[str, ...] = FREE_COORDINATES

    @classmethod
    def nothing(
        cls, shape: tuple[int, ...], stations: Stations, patches: int, holding: bool
    ) -> Balances:
        """Nothing known yet: every pose counts as not balanced."""
        free, held = stations.free, len(stations.prescribed)
        sizes = shapes_of_holding(len(free), held, patches) if holding else {}
        lost = int(Status.NOT_CONVERGED)
        return cls(
            np.full((*shape, len(free)), np.nan),
            np.full((*shape, patches, 2), np.nan),
            np.full(shape, lost, np.int8),
            np.zeros(shape, np.int32),
            np.zeros(shape),
            np.full(shape, lost, np.int8),
            np.full(shape, np.nan),
            {name: np.full((*shape, *size), np.nan) for name, size in sizes.items()},
            free,
        )

    def note(self, where: Any, record: Mapping[str, Any]) -> None:
        """Write down what became of some of them, see `shapes_of_record`, in place."""
        good = np.asarray(converged(record["status"]))
        for name in ("q", "meeting"):
            values = np.moveaxis(record[name], -1, 0)
            unknown = ~good.reshape(-1, *(1,) * (values.ndim - 1))
            getattr(self, name)[where] = np.where(unknown, np.nan, values)
        for name in ("status", "fault", "softness"):
            getattr(self, name)[where] = record[name]
        self.steps[where] += record["steps"].astype(int)
        self.reached[where] = np.where(good, 1.0, record["way"])
        for name, values in self.holding.items():
            values[where] = np.moveaxis(record[name], -1, 0)

    def put(self, where: Any, others: Balances) -> None:
        """Replace some of them, in place."""
        for field in dataclasses.fields(self):
            if field.name == "holding":
                for name, values in others.holding.items():
                    self.holding[name][where] = values
            elif field.name != "free":
                getattr(self, field.name)[where] = getattr(others, field.name)

    def at(self, *where: Any) -> Balances:
        """The balances at some of the variants and stations, as NumPy indexes."""
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        free = arrays.pop("free")
        return Balances(**jax.tree.map(lambda x: x[where], arrays), free=free)

    def shaped(self, shape: tuple[int, ...]) -> Balances:
        """The same with other leading axes of the variants."""
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        free = arrays.pop("free")
        return Balances(
            **jax.tree.map(lambda x: x.reshape(*shape, *x.shape[1:]), arrays), free=free
        )

    def in_nodes(self) -> dict[str, np.ndarray]:
        """What `settled_of` makes balances of, one node after the other; holding must be known."""
        every = {name: getattr(self, name) for name in _FOUND} | self.holding
        axes = self.status.ndim
        return {name: x.reshape(self.status.size, *x.shape[axes:]) for name, x in every.items()}

    @property
    def table(self) -> np.ndarray:
        """Free coordinates of the tibia in degrees and mm, `(variants, stations, free)`."""
        own = [name for name in self.free if coordinate(name).body == TIBIA]
        return self.q[..., : len(own)] * table_units(own)

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, stations)`."""
        return converged(self.status)


def shapes_of_record(stations: Stations, patches: int) -> dict[str, tuple[int, ...]]:
    """What is recorded where a path is through with a load case, without lanes: its place on the
    path, -1 where none ended; as in `Settled`, q, the contact points, status, fault and how many
    looks it took; the part of the way to it at which the last equilibrium was; `softness_of` it;
    and what holds it."""
    numbers = ("place", "status", "fault", "steps", "way", "softness")
    free, held = len(stations.free), len(stations.prescribed)
    nothing: dict[str, tuple[int, ...]] = dict.fromkeys(numbers, ())
    return nothing | {"q": (free,), "meeting": (patches, 2)} | shapes_of_holding(
        free, held, patches
    )


def of_record(rows: Any, shapes: dict[str, tuple[int, ...]]) -> dict[str, Any]:
    """The numbers of records `(numbers, lanes)` by name; arrays end in lanes."""
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes.values()])
    parts = zip(shapes.items(), np.r_[0, ends[:-1]], ends, strict=True)
    return {name: rows[a:b].reshape(*shape, rows.shape[-1]) for (name, shape), a, b in parts}


@jax.jit
def settled_of(stations: Stations, nodes: Mapping[str, Array]) -> Settled:
    """Balances that were found, as what the derivative follows.

    Args:
        stations: of each node.
        nodes: see `Balances.in_nodes`, but arrays end in lanes.

    Returns:
        One lane a node.
    """
    units = scales(stations.free)
    left_mm, pivots = newton_step_left(nodes["tangent"], nodes["residual"], units)
    return Settled(
        stations.prescribed, **nodes, left_mm=left_mm, pivots=pivots, bodies=stations.bodies
    )
