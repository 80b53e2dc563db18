"""Whether a test in the laboratory can be made, and in which sense it moves."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from kneejax.experiments._lab_test import MOVED_BY_MACHINE, LabTest, load_cycle
from kneejax.experiments._measured_test import MeasuredTest
from kneejax.geometry import COORDINATES, FREE_COORDINATES, coordinate
from kneejax.mechanics import NAMED_LOADS
from kneejax.numerics import WrongValue

_USUAL_DEG = tuple(range(0, 91, 15))


@dataclasses.dataclass(frozen=True)
class Ready:
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
    given = {"held": held, "steps": steps, "constant": constant, "point_mm": point_mm}
    moved = {"displacement_mm": displacement_mm, "rotation_deg": rotation_deg}
    moved = {key: size for key, size in moved.items() if size is not None}
    if name == "envelope":
        if moved:
            raise WrongValue(next(iter(moved)), name, "a test that a machine can drive")
        angles = None if flexion_deg is None else tuple(flexion_deg)
        full = 10.0 if moment_Nm is None else moment_Nm
        sizes = {kind: {"moment_Nm": part * full} for kind, part in _ENVELOPE.items()}
        sizes["drawer"] = {"force_N": force_N}
        each = (lab_tests(kind, angles, both=True, **sizes[kind], **given) for kind in _ENVELOPE)
        return tuple(test for (test,) in each)
    if name not in READY:
        raise WrongValue("test", repr(name), f"one of {', '.join(READY)}")
    kind = READY[name]
    size, other = (moment_Nm, force_N) if kind.turns else (force_N, moment_Nm)
    if other is not None:
        wanted, wrong = ("moment_Nm", "force_N") if kind.turns else ("force_N", "moment_Nm")
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
        displacement = moved[wanted]
    angles = kind.flexion_deg if flexion_deg is None else flexion_deg
    path, angles = load_cycle(steps, both), tuple(float(x) for x in angles)
    test = LabTest(
        name, {} if moved else full, kind.observed, angles, path, dict(constant or {}), point_mm,
        displacement, tuple(held),
    )  # fmt: skip
    return (test,)


#: Of the work over that of a curve in which load and displacement are in proportion; below minus
#: this a curve falls, whatever its noise.
_FALLS = 0.7
#: Along a curve a coordinate changes by more than this, mm or degrees, or it tells no sense; and by
#: so many of its standard deviations.
_LEAST, _DEVIATIONS = 1.0, 4.0
#: Part of the largest change of load below which another one counts as constant.
_CONSTANT = 0.1
#: N that count as much as one N m, for that comparison.
_ARM = 20.0


class AgainstLoad(NamedTuple):
    """A curve along which the tibia moves against the load."""

    load: str  # its name
    coordinate: str  # on which it does work
    flexion_deg: float  # of the curve
    loads: tuple[float, float]  # the least and the largest of the curve, N or N m
    values: tuple[float, float]  # of the coordinate there, mm or degrees


def against_load(test: MeasuredTest) -> AgainstLoad | None:
    """The first curve of a test along which the tibia moves against its load; None without any.

    A knee in stable balance gives way to a load: the coordinate on which the load does work rises
    with it. A curve that falls would give energy away: a column has the other sense.

    Args:
        test: as it was measured. Knees in motion, forces at another point than the tibia's origin
            and muscles whose pull changes are not judged.
    """
    changing = any(np.ptp(pull) > 0 for pull in test.tensions.values())
    if test.frames is not None or changing or not test.loads:
        return None
    curve = test.curve
    order = np.argsort(test.flexion_deg, kind="stable")
    every = (_falls(test, order[curve[order] == number]) for number in np.unique(curve))
    return next((found for found in every if found is not None), None)


def _falls(test: MeasuredTest, rows: np.ndarray) -> AgainstLoad | None:
    """Whether one curve falls under the load that changes along it, if it is only one."""
    # What is counted from the unloaded pose is nothing there.
    zero = np.zeros(int(test.counted_from == "unloaded"))
    loads = {name: np.r_[zero, sizes[rows]] for name, sizes in test.loads.items()}
    arm = {name: _ARM if name.endswith("_Nm") else 1.0 for name in loads}
    change = {name: arm[name] * np.ptp(sizes) for name, sizes in loads.items()}
    acting = [name for name in loads if change[name] > _CONSTANT * max(change.values())]
    if len(acting) != 1 or (any(test.point_mm) and acting[0].endswith("_N")):
        return None
    name = acting[0]
    column = next(x for x in NAMED_LOADS[name].also_called if x in COORDINATES)
    values = np.r_[zero, test.observed[rows, FREE_COORDINATES.index(column)]]
    load, values = loads[name][np.isfinite(values)], values[np.isfinite(values)]
    if not len(load) or not np.ptp(load) > 0:
        return None
    force, moved = load - load.mean(), values - values.mean()
    work, full = float(force @ moved), float(np.linalg.norm(force) * np.linalg.norm(moved))
    along = abs(work) / float(force @ force) * np.ptp(load)
    sd = test.sd_deg if COORDINATES[column].unit == "deg" else test.sd_mm
    if work >= -_FALLS * full or along <= max(_LEAST, _DEVIATIONS * (sd or 0.0)):
        return None
    ends = [int(np.argmin(load)), int(np.argmax(load))]
    low, high = load[ends].tolist()
    flexion = float(test.flexion_deg[rows[0]])
    return AgainstLoad(name, column, flexion, (low, high), tuple(values[ends].tolist()))
