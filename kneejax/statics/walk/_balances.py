"""What is known of many balances: variants of a knee at stations."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import numpy as np
from jax import Array

from kneejax.geometry import FREE_COORDINATES, TIBIA, coordinate, scales, table_units
from kneejax.statics._settle import Settled
from kneejax.statics._status import converged
from kneejax.statics._stiffness import newton_step_left
from kneejax.statics.walk._paths import Found
from kneejax.statics.walk._stations import Stations

#: Fields of `Settled` that a walk finds, besides what holds a balance.
_FOUND = ("q", "meeting", "status", "fault", "steps")


@dataclasses.dataclass(frozen=True)
class Balances:
    """Balanced poses of variants at stations; arrays begin with the axes of the values.

    Attributes:
        q: free coordinates `(variants, stations, free)`, rad and mm; NaN where there is no balance.
        meeting: parameters of the meeting points, `(variants, stations, n, 2)`.
        status: `Status` values, `(variants, stations)`.
        steps: Newton steps taken, `(variants, stations)`.
        reached: part of a station's last load under which the knee still balanced on the way to
            it, `(variants, stations)`: 1 where it is found.
        fault: the pose at which the last search ended, balanced or not, taken by itself; `Status`
            values.
        holding: what holds the balances, fields of `Settled` by name, `(variants, stations, ...)`;
            those of the last search where there is none; of `own_motion` only.
        free: names of the free coordinates.
    """

    q: np.ndarray
    meeting: np.ndarray
    status: np.ndarray
    steps: np.ndarray
    reached: np.ndarray
    fault: np.ndarray
    holding: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    free: tuple[str, ...] = FREE_COORDINATES

    @classmethod
    def of(cls, found: Found, shape: tuple[int, ...], free: tuple[str, ...]) -> Balances:
        """What was found, with the leading axes of the values."""
        reached = np.where(found.known, 1.0, 0.0)
        arrays = (
            found.q, found.meeting, found.status, found.steps, reached, found.fault,
            found.holding or {},
        )  # fmt: skip
        shaped = jax.tree.map(lambda x: np.reshape(x, (*shape, *x.shape[1:])), arrays)
        return cls(*shaped, free=free)

    def at(self, *where: Any) -> Balances:
        """The balances at some of the variants and stations, as NumPy indexes."""
        arrays = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        free = arrays.pop("free")
        return Balances(**jax.tree.map(lambda x: x[where], arrays), free=free)

    def in_nodes(self) -> dict[str, np.ndarray]:
        """What `settled_of` makes balances of, one node after the other; holding must be known."""
        every = {name: getattr(self, name) for name in _FOUND} | self.holding
        axes = self.status.ndim
        return {name: x.reshape(self.status.size, *x.shape[axes:]) for name, x in every.items()}

    def only(self, nodes: np.ndarray, status: np.ndarray) -> Balances:
        """The same with nothing known but some nodes, `(variants, stations)`, and a status where
        they are none."""

        def kept(x: np.ndarray) -> np.ndarray:
            return np.where(nodes.reshape(*nodes.shape, *(1,) * (x.ndim - 2)), x, np.nan)

        return dataclasses.replace(
            self,
            q=kept(self.q),
            meeting=kept(self.meeting),
            status=np.where(nodes, self.status, status),
        )

    @property
    def table(self) -> np.ndarray:
        """Free coordinates of the tibia in degrees and mm, `(variants, stations, free)`."""
        own = [name for name in self.free if coordinate(name).body == TIBIA]
        return self.q[..., : len(own)] * table_units(own)

    @property
    def converged(self) -> np.ndarray:
        """Where forces balance, `(variants, stations)`."""
        return converged(self.status)


@jax.jit
def settled_of(stations: Stations, nodes: Mapping[str, Array]) -> Settled:
    """Balances that a walk has found, as what the derivative follows.

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
