"""Maps of two parameters: what they hold, and the condition of each point."""

__all__ = ["BlockStore", "Condition", "ParameterMap", "worst_condition"]

import dataclasses
import enum
from collections.abc import Collection, Mapping
from typing import Any, Protocol

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.numerics import Named
from kneejax.statics import FAILURES, Status, converged, fails


class Condition(enum.IntEnum):
    """Outcome of the motion at a grid point: the worst over its poses.

    Attributes:
        sentence: what that means.
    """

    SOUND = 0, "balanced, stable and physiological at every pose"
    OUTSIDE_REGION = 1, "equilibrium found, but contact lies off the fitted cartilage at some pose"
    UNPHYSIOLOGICAL = (
        2,
        "equilibrium found, but unphysiological: farther from the baseline motion than knees move, "
        "dislocated, or at a fault that the study counts as a failure",
    )
    UNSTABLE = 3, "forces balance, but a small push would move the knee away at some pose"
    NO_BALANCE = 4, "no balance at some pose"

    sentence: str

    def __new__(cls, value: int, sentence: str) -> "Condition":
        member = int.__new__(cls, value)
        member._value_ = value
        member.sentence = sentence
        return member

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()


def worst_condition(
    status: np.ndarray, unphysiological: np.ndarray, failures: Collection[Status] = FAILURES
) -> np.ndarray:
    """What became of motions: the worst `Condition` over the poses, the last axis of `Status`
    values and of where they are unphysiological; `failures` are statuses that count for nothing."""
    failed = fails(status, failures) | (status == Status.DISLOCATED)
    condition = np.zeros(np.shape(status)[:-1], np.int8)
    worst = [
        (status == Status.OUTSIDE_REGION, Condition.OUTSIDE_REGION),
        (unphysiological | failed, Condition.UNPHYSIOLOGICAL),
        (status == Status.UNSTABLE, Condition.UNSTABLE),
        (~converged(status), Condition.NO_BALANCE),
    ]
    for where, what in worst:
        condition[where.any(axis=-1)] = what
    return condition


class BlockStore(Protocol):
    """Keeps the finished blocks of a map, so that it can go on where it was stopped."""

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """The arrays of a finished block, or None."""
        ...

    def save(self, name: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep the arrays of a finished block."""
        ...


@dataclasses.dataclass(frozen=True)
class ParameterMap(Named):
    """Objective and partial objectives over two parameters.

    Attributes:
        names: of the parameters along x and y.
        units: of the parameters.
        x: values of the first, `(nx,)`.
        y: values of the second, `(ny,)`.
        objective: weighted sum of squares, `(ny, nx)`; NaN where a pose has no balance.
        partial_objectives: unweighted sums of squares by coordinate, mm^2 or degree^2,
            `(5, ny, nx)`, in the order of `kneejax.geometry.FREE_COORDINATES`.
        condition: `Condition` values, `(ny, nx)`.
        lost: number of poses without a balance, `(ny, nx)`.
        start: values of the two in the knee itself, or those of `at`.
        start_objective: objective there; NaN where a pose has no balance.
        left_out: number of measured poses that count nowhere, since the knee itself has no
            balance there.
        weights: of the objective, `(5,)`, per degree^2 and per mm^2.
    """

    names: tuple[str, str]
    units: tuple[str, str]
    x: np.ndarray
    y: np.ndarray
    objective: np.ndarray
    partial_objectives: np.ndarray
    condition: np.ndarray
    lost: np.ndarray
    start: tuple[float, float]
    start_objective: float
    left_out: int
    weights: np.ndarray

    @property
    def drawn(self) -> np.ndarray:
        """Where the map may be coloured, `(ny, nx)`."""
        return self.condition <= Condition.OUTSIDE_REGION

    @property
    def minimum(self) -> tuple[float, float, float] | None:
        """Values of the two and the objective at the best grid point that may be coloured."""
        if not self.drawn.any():
            return None
        best = np.where(self.drawn, self.objective, np.inf)
        row, column = np.unravel_index(np.argmin(best), best.shape)
        return float(self.x[column]), float(self.y[row]), float(best[row, column])

    def _named(self) -> dict[str, tuple]:
        column, row = self.names
        axes, squares = (row, column), ["degree2", "degree2", "mm2", "mm2", "mm2"]
        flags = {"flag_values": np.arange(len(Condition), dtype=np.int8),
                 "flag_meanings": " ".join(one.word for one in Condition)}  # fmt: skip
        places = zip((column, row), (self.x, self.y), self.units, self.start, strict=True)
        partial = zip(FREE_COORDINATES, self.partial_objectives, squares, strict=True)
        return {
            "objective": (axes, self.objective, {"units": "1", "long_name": "weighted squares"}),
            **{name: (axes, values, {
                "units": unit, "long_name": f"sum of squared errors of {name.replace('_', ' ')}"})
               for name, values, unit in partial},
            "condition": (axes, self.condition.astype(np.int8), flags),
            "poses_without_balance": (axes, self.lost.astype(np.int32), "1"),
            **{name: ((name,), values, {"units": unit or "1", "start": own})
               for name, values, unit, own in places},
        }  # fmt: skip

    def _about(self) -> dict[str, Any]:
        named = zip(FREE_COORDINATES, self.weights, strict=True)
        weights = {f"weight_{name}": float(weight) for name, weight in named}
        own = {"start_objective": self.start_objective, "poses_left_out": self.left_out}
        return {**own, **weights}
