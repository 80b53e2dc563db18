"""A test under load, as data."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.mechanics import NAMED_LOADS, Load, load_called, load_of, load_words
from kneejax.numerics import WrongValue

#: What a machine can move -> the coordinate that it prescribes. Its force is a named load then,
#: whose work goes along that coordinate alone.
MOVED_BY_MACHINE = {
    "anterior": "drawer", "internal_rotation": "internal_rotation", "adduction": "adduction"
}
#: Rotations that a machine can hold during a test.
HELD = ("adduction", "internal_rotation")


@dataclasses.dataclass(frozen=True)
class LabTest:
    """What is done to a knee at some flexions, in steps, and the coordinate that is observed.

    Either loads grow, fall and turn (`full`), or a machine moves the observed coordinate itself
    and its force is read (`displacement`).

    Attributes:
        name: what tables and figures call it.
        full: name of a load -> its size where the path is at 1; see
            `kneejax.mechanics.NAMED_LOADS`. The first one is that over which curves are drawn.
            Empty where a machine moves the tibia.
        observed: coordinate that is read, one of `kneejax.geometry.COORDINATES`; translations are
            those of Grood and Suntay, along which the loads act.
        flexion_deg: prescribed angles.
        path: part of the full load or displacement at each step, -1 to 1.
        constant: loads that act throughout; the neutral pose is the one under them.
        point_mm: where forces act, in the tibia's frame. A machine that moves the tibia holds its
            origin.
        displacement: how far a machine moves what is observed from the neutral pose where the path
            is at 1, mm or degrees; None in a test by load.
        held: rotations that a machine holds where they are in the neutral pose.

    Raises:
        ValueError: a name that is none, nothing to do, or what contradicts itself.

    Example:
        >>> test = LabTest("drawer", {"anterior_N": 100.0}, "anterior", (30.0,), (0.0, 0.5, 1.0))
        >>> test.words
        'anterior force 100 N'
        >>> machine = LabTest("drawer", {}, "anterior", (30.0,), (0.0, 1.0), displacement=5.0)
        >>> machine.words, machine.driven_by
        ('anterior translation 5 mm', 'anterior_N')
    """

    name: str
    full: Mapping[str, float]
    observed: str
    flexion_deg: tuple[float, ...]
    path: tuple[float, ...]
    constant: Mapping[str, float] = dataclasses.field(default_factory=dict)
    point_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    displacement: float | None = None
    held: tuple[str, ...] = ()

    def __post_init__(self):
        for field, names in (("full", self.full), ("constant", self.constant)):
            unknown = [name for name in names if name not in NAMED_LOADS]
            if unknown:
                raise WrongValue(field, repr(unknown[0]), f"one of {', '.join(NAMED_LOADS)}")
        if bool(self.full) == (self.displacement is not None):
            raise WrongValue("full", str(dict(self.full)), "a load, or a displacement instead")
        if self.observed not in COORDINATES or self.observed == "flexion":
            known = ", ".join([*COORDINATES][1:])
            raise WrongValue("observed", repr(self.observed), f"one of {known}")
        if not self.flexion_deg or not self.path:
            empty = "path" if self.flexion_deg else "flexion_deg"
            raise WrongValue(empty, "nothing", "a number at least")
        if self.displacement is not None and self.observed not in MOVED_BY_MACHINE:
            wrong, known = f"of {self.observed}", ", ".join(MOVED_BY_MACHINE)
            raise WrongValue("displacement", wrong, f"one of {known}")
        for name in self.held:
            if name not in HELD:
                raise WrongValue("held", repr(name), f"of {', '.join(HELD)}")
            if name == self.observed or load_called(name) in self.full:
                raise WrongValue("held", repr(name), "no coordinate that the test itself moves")

    @property
    def driven_by(self) -> str:
        """Name of the load over which curves are drawn; a machine's is read, not given."""
        named = load_called(self.observed) if self.displacement is not None else None
        return named or next(iter(self.full))

    @property
    def size(self) -> float:
        """Where the path is at 1: of the load, N or N m, or of the displacement, mm or degrees."""
        return self.full[self.driven_by] if self.displacement is None else self.displacement

    @property
    def unit(self) -> str:
        """Of `size`."""
        by_load = self.displacement is None
        return NAMED_LOADS[self.driven_by].unit if by_load else COORDINATES[self.observed].unit

    @property
    def words(self) -> str:
        """What is done, in clinical words."""
        done = load_words(self.full)
        if self.displacement is not None:
            done = f"{COORDINATES[self.observed].phrase} {self.displacement:g} {self.unit}"
        both = " and the opposite" if min(self.path) < 0 < max(self.path) else ""
        held = "".join(f", {COORDINATES[name].phrase} held" for name in self.held)
        beside = f", with {load_words(self.constant)}" if self.constant else ""
        return f"{done}{both}{held}{beside}"

    @property
    def machine(self) -> tuple[str, ...]:
        """Coordinates that a machine holds or moves, by the names of what is prescribed."""
        moved = () if self.displacement is None else (MOVED_BY_MACHINE[self.observed],)
        return (*moved, *self.held)

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
        raise WrongValue("steps", str(steps), "at least 1")
    up = [k / steps for k in range(1, steps + 1)]
    half = [*up, *reversed(up[:-1]), 0.0]
    return 0.0, *half, *([-part if part else 0.0 for part in half] if both else [])
