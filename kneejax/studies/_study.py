"""A study: a knee, a motion, and what is to be found out. Checked whole before anything moves."""

from __future__ import annotations

import dataclasses
import functools
import os
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.files import knee_with, parse_flexion, said_of
from kneejax.files.reading import Field, InputProblem
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import METHODS, PROCEDURES, USUAL_PROCEDURES
from kneejax.inference.fit import DEFAULT_WEIGHTS
from kneejax.mechanics import (
    NAMED_LOADS,
    RANGES,
    Knee,
    Load,
    Range,
    load_called,
    load_of,
    range_of_parameter,
)
from kneejax.numerics import check_installed
from kneejax.parameters import (
    QUANTITIES,
    Selection,
    select,
    start_within,
    stated,
    stated_bounds,
)
from kneejax.statics import Status, failures_of

#: What a balance may be at fault for, and a study may count as a failure.
FAULTS = tuple(s.word for s in Status if s.converged and s is not Status.BALANCED)

_PARAMETER = re.compile(r"[A-Za-z*?][\w*?+-]*(\.[\w*?]+)*")
_MOST_STARTS = 1000


@dataclasses.dataclass(frozen=True)
class Synthetic:
    """Poses that the model itself makes, with noise, to see whether they lead back.

    Attributes:
        parameters: parameter -> value that makes the data, in its own unit.
        flexion_deg: prescribed angles, `(n,)`, or a text such as `0:120:5`.
        noise_mm: standard deviation of the noise on displacements.
        noise_deg: standard deviation of the noise on rotations.
        seed: of the noise.
    """

    parameters: Mapping[str, float]
    flexion_deg: np.ndarray
    noise_mm: float = 0.0
    noise_deg: float = 0.0
    seed: int = 0


@dataclasses.dataclass(frozen=True, eq=False)
class Study:
    """What is asked of a knee and a motion: all that a study file says, as objects.

    Everything is checked when a study is made: names are those of the knee, numbers are in their
    ranges, bounds hold the start. `kneejax.read_study` makes one from a file, and `kneejax.run`
    runs it.

    Attributes:
        title: for reports.
        knee: with the values that stay fixed.
        parameters: names or wildcards of what is free.
        measured: measured poses, `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and
            mm; None for synthetic ones.
        synthetic: poses to be made; at most one of the two is given, and neither needs to be where
            there are tests.
        tests: under load that were made (`kneejax.MeasuredTest`), each by a name of its own.
        start: name or wildcard -> value where the search begins; the knee's own otherwise.
        bounds: name, `*.quantity` or quantity -> lower and upper bound; a name counts before a
            wildcard, that before a quantity, and usual bounds hold for the rest.
        weights: free coordinate, or `mm` or `deg` -> weight of its squared error, per mm^2 or per
            degree^2; those of paper 1 otherwise. Later: one for each free coordinate.
        procedures: of `I`, `II`, `III`; the first is the answer, others are there to compare.
        starts: number of starts of procedure III.
        seed: of the further starts.
        prior: name, `*.quantity` or quantity -> standard deviation of a normal prior around the
            start, of a calibration. Needs `noise_mm` and `noise_deg`; of weights then counts only
            which are zero.
        noise_mm: standard deviation of the measurement's displacements; None where it is not known
            and must be estimated. Synthetic poses know their own.
        noise_deg: of its rotations; likewise.
        frame_offset: free coordinates whose constant offset between measured and model frames is
            free too; True for all five.
        method: `least_squares` or `lbfgsb`.
        failures: words of statuses for which a pose counts for nothing and a command ends with
            exit status 1; empty for the package's choice.
        loads: name of a load (`kneejax.mechanics.NAMED_LOADS`) -> its size at each pose, or one
            for all, in the unit of its name. Poses were measured, or are made, under them.
        origin: what else a file says, recorded with results: `knee`, `measured`, `tests`,
            `flexion_deg`, `overrides`.
        file: where the study stands, for errors.

    Raises:
        InputProblem: a field is not what it should be.
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, or a method that is not installed.

    Example:
        >>> import kneejax as kj
        >>> poses = [[30.0, 0.0, 2.0, 1.0, 0.0, 0.5], [60.0, 1.0, 4.0, 2.0, -1.0, 0.5]]
        >>> study = Study("Two poses", kj.load_knee("four_ligament"), ["*.stiffness"], poses)
        >>> study.limits["ACL.stiffness"], study.frame_offset
        ((300.0, 10000.0), ())
    """

    title: str
    knee: Knee = dataclasses.field(repr=False)
    parameters: Sequence[str]
    measured: np.ndarray | None = None
    synthetic: Synthetic | None = None
    tests: Sequence[MeasuredTest] = ()
    start: Mapping[str, float] = dataclasses.field(default_factory=dict)
    bounds: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    weights: Mapping[str, float] = dataclasses.field(default_factory=dict)
    procedures: Sequence[str] = USUAL_PROCEDURES
    starts: int = 1
    seed: int = 0
    prior: Mapping[str, float] = dataclasses.field(default_factory=dict)
    noise_mm: float | None = None
    noise_deg: float | None = None
    frame_offset: bool | Sequence[str] = ()
    method: str = next(iter(METHODS))
    failures: Sequence[str] = ()
    loads: Mapping[str, float | Sequence[float]] = dataclasses.field(default_factory=dict)
    origin: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    file: str = "study"

    def __post_init__(self) -> None:
        """Check everything; what is given is kept in one form."""
        given = {f.name: _plain(getattr(self, f.name)) for f in dataclasses.fields(self)}
        place = Field(self.file, "", given)
        for name, value in _checked(place).items():
            object.__setattr__(self, name, value)
        for name, sizes in self.loads.items():
            if len(sizes) not in (1, len(self.flexion_deg)):
                place = Field(self.file, f"loads.{name}", f"{len(sizes)} sizes")
                raise place.problem(f"one for all poses, or {len(self.flexion_deg)}, one for each")
        if self.starts > 1 and "III" not in self.procedures:
            raise place["starts"].problem("1: only procedure III has several starts")
        with said_of(self.file):
            bounded = [name for name in self.bounds if name not in QUANTITIES]
            for name in (*self.truth, *self.start, *bounded):
                select(self.knee, [name])
            # Of these, too, a value may lead to a knee that there is not.
            knee_with(self.knee, self.truth, self.file)
            knee, selection = self.knee_at_start, self.selection
            start_within(knee, selection, *stated_bounds(knee, selection, self.bounds))
            stated(selection, self.prior, "prior")
            if self.prior and None in self.noise:
                expected = "noise_mm and noise_deg too, against which a prior counts"
                raise Field(self.file, "prior", ", ".join(self.prior)).problem(expected)
            if self.method == "lbfgsb":
                check_installed("jaxopt", "lbfgsb")

    @functools.cached_property
    def selection(self) -> Selection:
        """The free parameters."""
        return select(self.knee, tuple(self.parameters))

    @functools.cached_property
    def knee_at_start(self) -> Knee:
        """The knee where a search begins."""
        return knee_with(self.knee, self.start, self.file)

    @functools.cached_property
    def limits(self) -> dict[str, tuple[float, float]]:
        """Free parameter -> lower and upper bound, in its own unit."""
        lower, upper = stated_bounds(self.knee_at_start, self.selection, self.bounds)
        pairs = zip(lower.tolist(), upper.tolist(), strict=True)
        return dict(zip(self.selection.names, pairs, strict=True))

    @property
    def truth(self) -> dict[str, float]:
        """Parameter -> value that makes synthetic poses; empty for measured ones."""
        return dict(self.synthetic.parameters) if self.synthetic else {}

    @property
    def flexion_deg(self) -> np.ndarray:
        """Of the poses, `(n,)`, degrees; those of tests are not among them."""
        if self.synthetic is not None:
            return self.synthetic.flexion_deg
        return np.empty(0) if self.measured is None else self.measured[:, 0]

    @property
    def acting(self) -> tuple[Load, ...]:
        """The loads at the poses; none where none acts."""
        sizes = {name: np.asarray(numbers) for name, numbers in self.loads.items()}
        return (load_of(**sizes),) if sizes else ()

    @property
    def noise(self) -> tuple[float | None, float | None]:
        """Standard deviations in mm and degrees: as stated, or as synthetic poses are made."""
        made = self.synthetic or Synthetic({}, np.empty(0))
        pairs = ((self.noise_mm, made.noise_mm), (self.noise_deg, made.noise_deg))
        mm, deg = ((own or None) if stated is None else stated for stated, own in pairs)
        return mm, deg

    @property
    def weight_vector(self) -> np.ndarray:
        """Weights in the order of the free coordinates, `(5,)`, per degree^2 and per mm^2."""
        return np.array([self.weights[name] for name in FREE_COORDINATES])

    @property
    def counted_failures(self) -> tuple[Status, ...]:
        """Statuses of balances that count for nothing."""
        return failures_of(self.failures)

    @property
    def knee_name(self) -> str:
        """Name or file of the knee, as the study states it."""
        return str(self.origin.get("knee", self.knee.name))

    def settings(self) -> dict[str, Any]:
        """Everything needed to run the study again, as plain numbers and words."""
        mm, deg = self.noise
        elsewhere = {
            "origin", "file", "measured", "tests", "noise_mm", "noise_deg", "flexion_deg",
        }  # fmt: skip
        names = [f.name for f in dataclasses.fields(self) if f.name not in elsewhere]
        plain = {name: _plain(getattr(self, name)) for name in names}
        named = [{"name": test.name} for test in self.tests]
        origin = {"measured": None, "tests": named, "flexion_deg": None, "overrides": {}}
        origin |= dict(self.origin)
        return plain | {
            "noise_mm": mm, "noise_deg": deg, **_plain(origin), "knee": self.knee_name,
            "path": os.path.abspath(self.file) if os.path.isfile(self.file) else self.file,
        }  # fmt: skip


def _plain(value: Any) -> Any:
    """Lists, dictionaries and numbers of Python, as a file would give them."""
    if isinstance(value, Synthetic):
        return _plain(vars(value))
    if isinstance(value, Mapping):
        return {name: _plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, MeasuredTest):
        return value
    return [_plain(one) for one in value] if isinstance(value, list | tuple) else value


def _checked(study: Field) -> dict[str, Any]:
    """Every field of a study in its one form."""
    if not isinstance(study.value["knee"], Knee):
        raise study["knee"].problem("a knee, as kneejax.load_knee gives")
    given = [name for name in ("measured", "synthetic") if study.value[name] is not None]
    tests = study.value["tests"]
    if len(given) > 1 or not (given or tests):
        value = " and ".join(given) or "neither"
        expected = "exactly one of measured, synthetic" + ", or tests" * (not given)
        raise Field(study.file, "measured", value).problem(expected)
    return {
        "title": study["title"].text(),
        "measured": _poses(study["measured"]) if "measured" in given else None,
        "synthetic": _synthetic(study["synthetic"]) if "synthetic" in given else None,
        "tests": _tests(study),
        "parameters": _distinct(study["parameters"], _parameter),
        "start": parameter_values(study["start"]),
        "bounds": {
            name: limits.interval(range_of_parameter(name))
            for name, limits in _by_parameter(study["bounds"])
        },
        "weights": _weights(study["weights"]),
        "procedures": _distinct(study["procedures"], lambda item: item.choice(PROCEDURES)),
        "starts": study["starts"].integer(1, _MOST_STARTS),
        "seed": study["seed"].integer(0),
        "prior": {
            name: _deviation(sd, range_of_parameter(name))
            for name, sd in _by_parameter(study["prior"])
        },
        "noise_mm": _noise(study["noise_mm"], "noise_mm"),
        "noise_deg": _noise(study["noise_deg"], "noise_deg"),
        "frame_offset": _frame_offset(study["frame_offset"]),
        "method": study["method"].choice(METHODS),
        "failures": _distinct(study["failures"], lambda item: item.choice(FAULTS), empty=True),
        "loads": _loads(study["loads"]),
    }


def _tests(study: Field) -> tuple[MeasuredTest, ...]:
    """Tests under load, no two of one name, each no better known than the poses can say."""
    tests = tuple(study.value["tests"])
    for number, test in enumerate(tests):
        if not isinstance(test, MeasuredTest):
            raise study["tests"].problem("tests as kneejax.MeasuredTest makes them")
        place = Field(study.file, f"tests[{number}].name", test.name)
        if test.name in [one.name for one in tests[:number]]:
            raise place.problem("every name once")
        for unit, sd in (("mm", test.sd_mm), ("deg", test.sd_deg)):
            own = Field(study.file, f"tests[{number}].sd_{unit}", sd)
            if sd is None:
                continue
            if not (np.isfinite(sd) and sd > 0):
                raise own.problem("a standard deviation above 0")
            if study.value[f"noise_{unit}"] is None and study.value["synthetic"] is None:
                expected = f"noise_{unit} of the study too, against which tests are weighed"
                raise own.problem(expected)
    return tests


def _poses(field: Field) -> np.ndarray:
    expected = "poses, (n, 6): degrees and mm, all finite"
    try:
        table = np.asarray(field.value, float)
    except (TypeError, ValueError):
        raise field.problem(expected) from None
    if table.ndim != 2 or table.shape[1] != len(COLUMNS) or not len(table):
        raise Field(field.file, field.path, f"shape {table.shape}").problem(expected)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise Field(field.file, f"{field.path}[{row}]", "not finite").problem(expected)
    return table


def _synthetic(field: Field) -> Synthetic:
    angles = field["flexion_deg"]
    if isinstance(angles.value, str):
        flexion = parse_flexion(angles.value, field.file, angles.path)
    else:
        flexion = np.array(angles.numbers(allowed=RANGES["flexion_deg"]))
    return Synthetic(
        parameters=parameter_values(field["parameters"]),
        flexion_deg=flexion,
        noise_mm=field["noise_mm"].number(RANGES["noise_mm"]),
        noise_deg=field["noise_deg"].number(RANGES["noise_deg"]),
        seed=field["seed"].integer(0),
    )


def parameter_values(field: Field) -> dict[str, float]:
    """Values by name or wildcard, each one that such a parameter can have.

    Args:
        field: of a mapping from a parameter to its value.

    Raises:
        InputProblem: something else stands there.
    """
    return {name: value.number(range_of_parameter(name)) for name, value in _by_parameter(field)}


def _by_parameter(field: Field) -> list[tuple[str, Field]]:
    """Names and fields of a mapping whose names are parameters or wildcards."""
    if not isinstance(field.value, dict):
        raise field.problem("a mapping from a parameter to its value")
    for name in field.value:
        _parameter(Field(field.file, field.path, name))
    return [(name, field[name]) for name in field.value]


def _parameter(field: Field) -> str:
    name = field.text()
    if not _PARAMETER.fullmatch(name):
        raise field.problem("a name such as ACL.stiffness, or a wildcard such as *.stiffness")
    return name


def _loads(field: Field) -> dict[str, list[float]]:
    """Sizes by name, one or several each."""
    if not isinstance(field.value, dict):
        raise field.problem(f"a mapping from one of {', '.join(NAMED_LOADS)} to its sizes")
    found = {}
    for name in field.value:
        if name not in NAMED_LOADS:
            near, known = load_called(name) or NAMED_LOADS, f"one of {', '.join(NAMED_LOADS)}"
            raise InputProblem(field.file, field.path, name, known, near)
        sizes = field[name]
        many = isinstance(sizes.value, list)
        found[name] = list(sizes.numbers(allowed=RANGES[name])) if many else [
            sizes.number(RANGES[name])
        ]  # fmt: skip
    return found


def _weights(field: Field) -> dict[str, float]:
    field.mapping((), ("mm", "deg", *FREE_COORDINATES))
    given = {name: field[name].number(RANGES["weight"]) for name in field.value}
    weights = {}
    for column, usual in zip(COLUMNS[1:], DEFAULT_WEIGHTS.tolist(), strict=True):
        name, unit = column.rsplit("_", 1)
        weights[name] = given.get(name, given.get(unit, usual))
    if not any(weights.values()):
        raise field.problem("a weight above 0 for at least one coordinate")
    return weights


def _deviation(field: Field, allowed: Range | None) -> float:
    sd = field.number(allowed and allowed.spread)
    if not sd > 0:
        raise field.problem("a standard deviation above 0")
    return sd


def _noise(field: Field, name: str) -> float | None:
    if field.value is None:
        return None
    noise = field.number(RANGES[name])
    if not noise > 0:
        raise field.problem("a standard deviation above 0; leave it out to have it estimated")
    return noise


def _frame_offset(field: Field) -> tuple[str, ...]:
    if isinstance(field.value, bool):
        return FREE_COORDINATES if field.value else ()
    if not isinstance(field.value, list):
        raise field.problem(f"true, false, or a list of {', '.join(FREE_COORDINATES)}")
    return _distinct(field, _offset_coordinate, empty=True)


def _offset_coordinate(item: Field) -> str:
    if item.value == "flexion":
        raise item.problem(
            f"one of {', '.join(FREE_COORDINATES)}; flexion is prescribed as it was measured, so "
            "it can have no offset: correct the measured column instead"
        )
    return item.choice(FREE_COORDINATES)


def _distinct(
    field: Field, read: Callable[[Field], str], *, empty: bool = False
) -> tuple[str, ...]:
    """Entries of a list, none of them twice."""
    found: list[str] = []
    for item in () if empty and field.value == [] else field.items("names"):
        name = read(item)
        if name in found:
            raise item.problem("every name once")
        found.append(name)
    return tuple(found)
