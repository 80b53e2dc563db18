"""A test under load, as data."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.mechanics import NAMED_LOADS, Load, load_of


@dataclasses.dataclass(frozen=True)
class LabTest:
    """A load that grows, falls and turns at some flexions, and the coordinate that is observed.

    Attributes:
        name: what tables and figures call it.
        full: name of a load -> its size where the path is at 1; see
            `kneejax.mechanics.NAMED_LOADS`. The first one is that over which curves are drawn.
        observed: coordinate that is read, one of `kneejax.geometry.COORDINATES`; translations are
            those of Grood and Suntay, along which the loads act.
        flexion_deg: prescribed angles.
        path: part of the full load at each step, -1 to 1.
        constant: loads that act throughout; the neutral pose is the one under them.
        point_mm: where forces act, in the tibia's frame.

    Example:
        >>> test = LabTest("drawer", {"anterior_N": 100.0}, "anterior", (30.0,), (0.0, 0.5, 1.0))
        >>> test.load("anterior_N").tolist()
        [0.0, 50.0, 100.0]
    """

    name: str
    full: Mapping[str, float]
    observed: str
    flexion_deg: tuple[float, ...]
    path: tuple[float, ...]
    constant: Mapping[str, float] = dataclasses.field(default_factory=dict)
    point_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self):
        for field, names in (("full", self.full), ("constant", self.constant)):
            unknown = [name for name in names if name not in NAMED_LOADS]
            if unknown:
                known = ", ".join(NAMED_LOADS)
                raise ValueError(f"LabTest.{field} names {unknown[0]!r}; expected one of {known}")
        if not self.full:
            raise ValueError("LabTest.full is empty; expected at least one load")
        if self.observed not in COORDINATES or self.observed == "flexion":
            known = ", ".join(list(COORDINATES)[1:])
            raise ValueError(f"LabTest.observed is {self.observed!r}; expected one of {known}")
        if not self.flexion_deg or not self.path:
            raise ValueError("LabTest needs at least one flexion and one step")

    @property
    def driven_by(self) -> str:
        """Name of the load over which curves are drawn."""
        return next(iter(self.full))

    def load(self, name: str, path: np.ndarray | None = None) -> np.ndarray:
        """Size of a load at every step, `(steps,)`, that acts throughout included."""
        part = np.asarray(self.path if path is None else path, float)
        return self.constant.get(name, 0.0) + self.full.get(name, 0.0) * part

    def loads(self, part: np.ndarray) -> list[Load]:
        """What acts at these parts of the full load, `(n,)`: what does not change, what grows."""
        point = np.tile(self.point_mm, (len(part), 1))
        kinds = (self.constant, np.ones(len(part))), (self.full, part)
        return [
            load_of(**{name: sizes.get(name, 0.0) * along for name in NAMED_LOADS}, point=point)
            for sizes, along in kinds
        ]


def load_cycle(steps: int = 20, both: bool = False) -> tuple[float, ...]:
    """A load that grows to its full size and falls again, in equal steps.

    Args:
        steps: from nothing to the full load.
        both: whether the opposite load grows and falls after it.

    Returns:
        Parts of the full load; the first and the last are 0.

    Raises:
        ValueError: fewer steps than one.

    Example:
        >>> load_cycle(2, both=True)
        (0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0, -0.5, 0.0)
    """
    if steps < 1:
        raise ValueError(f"steps is {steps}; expected at least 1")
    up = [k / steps for k in range(1, steps + 1)]
    half = [*up, *reversed(up[:-1]), 0.0]
    return 0.0, *half, *([-part if part else 0.0 for part in half] if both else [])
