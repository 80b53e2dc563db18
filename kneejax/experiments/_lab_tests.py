"""A test under load, as data, and the usual ones by name."""

__all__ = ["HELD", "READY", "LabTest", "lab_tests", "load_cycle"]

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from kneejax.geometry import COORDINATES, coordinate
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
        if self.observed not in [*COORDINATES][1:]:
            known = ", ".join([*COORDINATES][1:])
            raise WrongValue("observed", repr(self.observed), f"one of {known}")
        for field in ("flexion_deg", "path"):
            if not getattr(self, field):
                raise WrongValue(field, "nothing", "a number at least")
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


_USUAL_DEG = tuple(range(0, 91, 15))


class Ready(NamedTuple):
    """A kind of test."""

    says: str  # what is done, in a phrase
    # Load -> its share of the force or moment that is asked for, with its sense.
    full: Mapping[str, float]
    observed: str  # see `LabTest`
    size: float = 100.0  # of that force, N, or moment, N m, where none is asked for
    flexion_deg: tuple[float, ...] = _USUAL_DEG  # where no angles are asked for

    @property
    def turns(self) -> bool:
        """Whether a moment is asked for, not a force."""
        return all(NAMED_LOADS[name].unit == "N m" for name in self.full)


#: Name of a test -> what it is.
READY = {
    "drawer": Ready("the tibia is drawn forwards", {"anterior_N": 1.0}, "anterior"),
    "lachman": Ready("the same, nearly straight", {"anterior_N": 1.0}, "anterior",
                     flexion_deg=(20.0,)),
    "torsion": Ready("the tibia is turned inwards", {"internal_Nm": 1.0}, "internal_rotation", 5.0),
    "varus-valgus": Ready("the tibia is turned into varus", {"varus_Nm": 1.0}, "adduction", 10.0),
    "compression": Ready("the tibia is pressed against the femur", {"compression_N": 1.0},
                         "superior", 500.0),
    "distraction": Ready("the tibia is pulled away from the femur", {"compression_N": -1.0},
                         "superior", 50.0),
    "pivot": Ready("valgus, with half as much internal torque",
                   {"varus_Nm": -1.0, "internal_Nm": 0.5}, "anterior", 10.0),
}  # fmt: skip
#: Tests of which an envelope consists, with their part of the moment that is asked for.
_ENVELOPE = {"drawer": 1.0, "varus-valgus": 1.0, "torsion": 0.5}


def lab_tests(
    name: str, flexion_deg: Iterable[float] | None = None, *, force_N: float | None = None,
    moment_Nm: float | None = None, displacement_mm: float | None = None,
    rotation_deg: float | None = None, held: Iterable[str] = (), both: bool = False,
    steps: int = 20, constant: Mapping[str, float] | None = None,
    point_mm: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> tuple[LabTest, ...]:  # fmt: skip
    """The tests of a name; all but an envelope are one.

    Args:
        name: one of `READY`, or `envelope`: drawer, varus-valgus and, with half of the moment,
            torsion, each both ways.
        flexion_deg: 0 to 90 degrees in steps of 15 by default, 20 degrees for `lachman`.
        force_N: full force of a test by force; 100 N by default, 500 of compression, 50 of
            distraction.
        moment_Nm: full moment of a test by moment; 10 N m by default, 5 of torsion.
        displacement_mm: how far a machine moves the tibia in a drawer or lachman, whose force is
            read then, in the place of a force that is given.
        rotation_deg: how far it turns the tibia in torsion or varus-valgus, likewise.
        held: rotations that it holds where they are in the neutral pose, of `adduction` and
            `internal_rotation`.
        both: whether the opposite load follows.
        steps: from nothing to the full load.
        constant: loads that act throughout, e.g. `{"compression_N": 300.0}`.
        point_mm: where forces act, in the tibia's frame; its origin by default.

    Raises:
        ValueError: an unknown name, a force for a test by moment and the reverse, both a load and
            a displacement, or a displacement of a test that is by load alone.

    Example:
        >>> (test,) = lab_tests("lachman", steps=4)
        >>> test.flexion_deg, test.full, len(test.path)
        ((20.0,), {'anterior_N': 100.0}, 9)
    """
    moved = {"displacement_mm": displacement_mm, "rotation_deg": rotation_deg}
    moved = {key: size for key, size in moved.items() if size is not None}
    if name == "envelope":
        if moved:
            raise WrongValue(next(iter(moved)), name, "a test that a machine can drive")
        angles = None if flexion_deg is None else tuple(flexion_deg)
        full = 10.0 if moment_Nm is None else moment_Nm
        sizes = {kind: {"moment_Nm": part * full} for kind, part in _ENVELOPE.items()}
        sizes["drawer"] = {"force_N": force_N}
        given = {"held": held, "steps": steps, "constant": constant, "point_mm": point_mm}
        each = (lab_tests(kind, angles, both=True, **sizes[kind], **given) for kind in _ENVELOPE)
        return tuple(test for (test,) in each)
    if name not in READY:
        raise WrongValue("test", repr(name), f"one of {', '.join(READY)}")
    kind = READY[name]
    wanted, wrong = ("moment_Nm", "force_N") if kind.turns else ("force_N", "moment_Nm")
    size, other = (moment_Nm, force_N) if kind.turns else (force_N, moment_Nm)
    if other is not None:
        raise WrongValue(wrong, name, f"{wanted}, which this test takes")
    full = {load: part * (kind.size if size is None else size) for load, part in kind.full.items()}
    displacement = None
    if moved:
        wanted = "rotation_deg" if coordinate(kind.observed).unit == "deg" else "displacement_mm"
        if kind.observed not in MOVED_BY_MACHINE or len(kind.full) > 1:
            raise WrongValue(next(iter(moved)), name, "a test that a machine can drive")
        for wrong in moved:
            if wrong != wanted:
                raise WrongValue(wrong, name, f"{wanted}, which this test takes")
        if size is not None:
            raise WrongValue(wanted, f"{name} with a load too", "one of the two")
        full, displacement = {}, moved[wanted]
    angles = kind.flexion_deg if flexion_deg is None else flexion_deg
    return (LabTest(
        name, full, kind.observed, tuple(float(x) for x in angles), load_cycle(steps, both),
        dict(constant or {}), point_mm, displacement, tuple(held),
    ),)  # fmt: skip
