"""Study files: what a calibration is to do, in readable YAML."""

from __future__ import annotations

import dataclasses
import os
import re
from pathlib import Path

import numpy as np

from kneejax.files._bundled import bundled_knees, bundled_measurements
from kneejax.files.reading import Field, InputProblem, load_yaml
from kneejax.files.tables import FEMORAL, read_poses
from kneejax.geometry import COLUMNS, CONVENTIONS, FREE_COORDINATES
from kneejax.mechanics import RANGES, range_of_parameter

#: Which parameters are free in which order: stiffnesses then slack lengths (I), the other way
#: round (II), all at once (III).
PROCEDURES = ("I", "II", "III")
#: How the search is done.
METHODS = ("least_squares", "lbfgsb")
#: What a balance may be at fault for, and a study may count as a failure.
FAULTS = (
    "outside_region", "overstretched", "way_flipped", "past_wrap", "wrap_inside", "unstable",
    "dislocated",
)  # fmt: skip
#: Bounds of a quantity where a study gives none.
DEFAULT_BOUNDS = {"stiffness": (300.0, 10000.0), "reference_strain": (-0.2, 0.2)}
#: Weight of a squared error per mm^2 and per degree^2 where a study gives none.
DEFAULT_WEIGHTS = {"mm": 1.0, "deg": 8.0}

_PARAMETER = re.compile(r"[A-Za-z*?][\w*?+-]*(\.[\w*?]+)*")
_MOST_VALUES = 10_000
_MOST_STARTS = 1000


@dataclasses.dataclass(frozen=True)
class Measured:
    """Poses that were measured.

    Attributes:
        file: the CSV table.
        convention: what its columns mean, one of `kneejax.geometry.CONVENTIONS`.
        columns: column of the package -> column of the file, where names differ.
        source: who measured it.
        mirror: whether its signs are those of a left knee in axes with Z to the person's right:
            adduction, internal rotation and lateral shift then change sign.
    """

    file: Path
    convention: str
    columns: dict[str, str]
    source: str
    mirror: bool


@dataclasses.dataclass(frozen=True)
class Synthetic:
    """Poses that the model itself makes, with noise, to see whether they lead back.

    Attributes:
        parameters: parameter -> value that makes the data.
        flexion_deg: shape `(n,)`.
        noise_mm: standard deviation of the noise on translations.
        noise_deg: standard deviation of the noise on rotations.
        seed: of the noise.
    """

    parameters: dict[str, float]
    flexion_deg: np.ndarray
    noise_mm: float
    noise_deg: float
    seed: int


@dataclasses.dataclass(frozen=True)
class Study:
    """What a calibration is to do; names of parameters are not checked yet.

    Attributes:
        title: for reports.
        knee: name of a bundled knee or path of a knee file.
        measured: poses that were measured, or None.
        synthetic: poses to be made, or None; exactly one of the two is given.
        parameters: names or wildcards of what is free.
        start: name or wildcard -> value where the search begins.
        bounds: name, wildcard or quantity -> lower and upper bound; where several apply, the last
            one counts (defaults stand first).
        weights: free coordinate -> weight of its squared error, per mm^2 or per degree^2.
        procedures: of `I`, `II`, `III`, in the order of the study.
        starts: number of starts of the search.
        seed: of the further starts.
        noise_mm: standard deviation of the measurement's displacements; None where it is not
            stated and must be estimated. Synthetic poses know their own.
        noise_deg: of its rotations; likewise.
        frame_offset: free coordinates whose constant offset between measured and model frames is
            free too.
        method: `least_squares` or `lbfgsb`.
        flexion_deg: lower and upper limit of the measured poses to use, or None.
        overrides: name or wildcard -> value that stays fixed (`set` in the file).
        failures: of `FAULTS`, those for which a pose counts for nothing and a command ends with
            exit status 1; empty where the study leaves that to the package.
        path: the file.
    """

    title: str
    knee: str
    measured: Measured | None
    synthetic: Synthetic | None
    parameters: tuple[str, ...]
    start: dict[str, float]
    bounds: dict[str, tuple[float, float]]
    weights: dict[str, float]
    procedures: tuple[str, ...]
    starts: int
    seed: int
    noise_mm: float | None
    noise_deg: float | None
    frame_offset: tuple[str, ...]
    method: str
    flexion_deg: tuple[float, float] | None
    overrides: dict[str, float]
    failures: tuple[str, ...]
    path: Path


def read_study(path: str | os.PathLike[str]) -> Study:
    """Read a study file.

    Args:
        path: the file; paths in it are relative to its folder.

    Returns:
        The study, with defaults filled in.

    Raises:
        InputProblem: the file or one that it names cannot be read, or a field is missing,
            unknown or out of range.

    Example:
        >>> from kneejax.files import study_path
        >>> study = read_study(study_path("paper1"))
        >>> study.knee, study.parameters
        ('four_ligament', ('*.stiffness', '*.reference_strain'))
    """
    study = Field(os.fspath(path), "", load_yaml(path, "a study file"))
    study.mapping(
        ("title", "knee", "parameters"),
        (
            "measured", "synthetic", "start", "bounds", "weights", "procedures", "starts", "seed",
            "noise_mm", "noise_deg", "frame_offset", "method", "flexion_deg", "set", "failures",
        ),
    )
    given = [name for name in ("measured", "synthetic") if name in study]
    if len(given) != 1:
        value = " and ".join(given) or "neither"
        raise InputProblem(study.file, "measured", value, "exactly one of measured, synthetic")
    folder = Path(path).parent
    made = _synthetic(study["synthetic"]) if "synthetic" in study else None
    return Study(
        title=study["title"].text(),
        knee=_knee(study["knee"], folder),
        measured=_measured(study["measured"], folder) if "measured" in study else None,
        synthetic=made,
        parameters=_distinct(study["parameters"], _parameter),
        start=_values(study["start"]) if "start" in study else {},
        bounds=_bounds(study),
        weights=_weights(study),
        procedures=_distinct(study["procedures"], lambda item: item.choice(PROCEDURES))
        if "procedures" in study
        else ("II", "I", "III"),
        starts=study["starts"].integer(1, _MOST_STARTS) if "starts" in study else 1,
        seed=study["seed"].integer(0) if "seed" in study else 0,
        noise_mm=_noise(study, "noise_mm", made.noise_mm if made else 0.0),
        noise_deg=_noise(study, "noise_deg", made.noise_deg if made else 0.0),
        frame_offset=_frame_offset(study),
        method=study["method"].choice(METHODS) if "method" in study else METHODS[0],
        flexion_deg=study["flexion_deg"].interval(RANGES["flexion_deg"])
        if "flexion_deg" in study
        else None,
        overrides=_values(study["set"]) if "set" in study else {},
        failures=_distinct(study["failures"], lambda item: item.choice(FAULTS))
        if "failures" in study
        else (),
        path=Path(path),
    )


def read_measured(study: Study) -> np.ndarray:
    """Read the measured poses of a study.

    Args:
        study: one that has measured poses.

    Returns:
        Shape `(n, 6)`, degrees and mm, in the package's convention, mirrored if the study says
        so, only those within its limits of flexion.

    Raises:
        InputProblem: the table is faulty, or no pose lies within the limits.
        ValueError: the study has synthetic poses.

    Example:
        >>> from kneejax.files import study_path
        >>> read_measured(read_study(study_path("paper1")))
        Traceback (most recent call last):
        ValueError: the study makes synthetic poses; there is no table to read
    """
    measured = study.measured
    if measured is None:
        raise ValueError("the study makes synthetic poses; there is no table to read")
    table = read_poses(measured.file, measured.convention, measured.columns)
    if measured.mirror:
        table = table * [1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    if study.flexion_deg is None:
        return table
    lower, upper = study.flexion_deg
    # Limits include poses that a conversion moved by rounding.
    inside = (table[:, 0] >= lower - 1e-6) & (table[:, 0] <= upper + 1e-6)
    if not inside.any():
        expected = f"limits within {table[:, 0].min():g} and {table[:, 0].max():g}, as measured"
        raise InputProblem(study.path, "flexion_deg", f"{lower:g} to {upper:g}", expected)
    return table[inside]


def parse_flexion(text: str, file: str = "--flexion", field: str = "flexion_deg") -> np.ndarray:
    """Flexion angles from `FROM:TO:STEP`, both ends included, or from a comma separated list.

    Args:
        text: e.g. `0:120:5` or `0,30,60`; degrees.
        file: where the text stands, for the error.
        field: likewise.

    Returns:
        Shape `(n,)`, degrees.

    Raises:
        InputProblem: the text is something else, the step leads away from the end, or an angle
            is out of range.

    Example:
        >>> parse_flexion("0:20:5").tolist()
        [0.0, 5.0, 10.0, 15.0, 20.0]
    """
    place = Field(file, field, text)
    expected = f"FROM:TO:STEP or a comma separated list, {RANGES['flexion_deg']}"
    is_range = ":" in text
    try:
        numbers = [float(part) for part in text.split(":" if is_range else ",")]
    except ValueError:
        raise place.problem(expected) from None
    if not is_range:
        return _angles(place, numbers)
    if len(numbers) != 3 or not np.isfinite(numbers).all():
        raise place.problem(expected)
    first, last, step = numbers
    _angles(place, [first, last])
    if step == 0 or (last - first) / step < 0:
        raise place.problem("a step that leads from the first angle to the last")
    count = np.floor((last - first) / step + 1e-9) + 1
    if count > _MOST_VALUES:
        raise place.problem(f"at most {_MOST_VALUES} angles")
    return first + step * np.arange(int(count))


def _angles(place: Field, numbers) -> np.ndarray:
    if not all(RANGES["flexion_deg"].holds(x) for x in numbers):
        raise place.problem(f"angles {RANGES['flexion_deg']}")
    return np.array(numbers, float)


def _knee(field: Field, folder: Path) -> str:
    name = field.text()
    known = bundled_knees()
    if name in known:
        return name
    path = folder / name
    if not path.is_file():
        expected = f"a bundled knee ({', '.join(known) or 'none'}) or a knee file; not at {path}"
        raise field.problem(expected, known)
    return os.fspath(path)


def _measured(field: Field, folder: Path) -> Measured:
    field.mapping(("file", "source"), ("convention", "columns", "mirror"))
    columns = {}
    if "columns" in field:
        renamed = field["columns"].mapping((), COLUMNS)
        columns = {name: renamed[name].text() for name in renamed.value}
    convention = field["convention"].choice(CONVENTIONS) if "convention" in field else FEMORAL
    mirror = field["mirror"].boolean() if "mirror" in field else False
    path = _table(field["file"], folder)
    return Measured(path, convention, columns, field["source"].text(), mirror)


def _table(field: Field, folder: Path) -> Path:
    path = folder / field.text()
    if path.is_file():
        return path
    known = bundled_measurements()
    if field.value in known:
        return known[field.value].path
    raise field.problem(f"a CSV table or a bundled measurement; not at {path}", known)


def _synthetic(field: Field) -> Synthetic:
    field.mapping(("parameters", "flexion_deg"), ("noise_mm", "noise_deg", "seed"))
    angles = field["flexion_deg"]
    if isinstance(angles.value, str):
        flexion = parse_flexion(angles.value, field.file, angles.path)
    else:
        flexion = np.array(angles.numbers(allowed=RANGES["flexion_deg"]))
    return Synthetic(
        parameters=_values(field["parameters"]),
        flexion_deg=flexion,
        noise_mm=field["noise_mm"].number(RANGES["noise_mm"]) if "noise_mm" in field else 0.0,
        noise_deg=field["noise_deg"].number(RANGES["noise_deg"]) if "noise_deg" in field else 0.0,
        seed=field["seed"].integer(0) if "seed" in field else 0,
    )


def _parameter(field: Field) -> str:
    name = field.text()
    if not _PARAMETER.fullmatch(name):
        raise field.problem("a name such as ACL.stiffness, or a wildcard such as *.stiffness")
    return name


def _by_parameter(field: Field) -> list[tuple[str, Field]]:
    """Names and fields of a mapping whose names are parameters or wildcards."""
    if not isinstance(field.value, dict):
        raise field.problem("a mapping from a parameter to its value")
    for name in field.value:
        _parameter(Field(field.file, field.path, name))
    return [(name, field[name]) for name in field.value]


def _values(field: Field) -> dict[str, float]:
    return {name: value.number(range_of_parameter(name)) for name, value in _by_parameter(field)}


def _bounds(study: Field) -> dict[str, tuple[float, float]]:
    given = _by_parameter(study["bounds"]) if "bounds" in study else []
    stated = {name: value.interval(range_of_parameter(name)) for name, value in given}
    return {**{x: limits for x, limits in DEFAULT_BOUNDS.items() if x not in stated}, **stated}


def _weights(study: Field) -> dict[str, float]:
    given = {}
    if "weights" in study:
        field = study["weights"].mapping((), (*DEFAULT_WEIGHTS, *FREE_COORDINATES))
        given = {name: field[name].number(RANGES["weight"]) for name in field.value}
    each = {**DEFAULT_WEIGHTS, **given}
    units = {column.rsplit("_", 1)[0]: column.rsplit("_", 1)[1] for column in COLUMNS}
    weights = {name: each.get(name, each[units[name]]) for name in FREE_COORDINATES}
    if not any(weights.values()):
        raise study["weights"].problem("a weight above 0 for at least one coordinate")
    return weights


def _noise(study: Field, name: str, made: float) -> float | None:
    """As stated, or as synthetic poses were made."""
    if name not in study:
        return made or None
    noise = study[name].number(RANGES[name])
    if not noise > 0:
        raise study[name].problem("a standard deviation above 0; leave it out to have it estimated")
    return noise


def _frame_offset(study: Field) -> tuple[str, ...]:
    field = study["frame_offset"] if "frame_offset" in study else None
    if field is None or field.value is False:
        return ()
    if field.value is True:
        return FREE_COORDINATES
    if not isinstance(field.value, list):
        raise field.problem(f"true, false, or a list of {', '.join(FREE_COORDINATES)}")
    return _distinct(field, _offset_coordinate)


def _offset_coordinate(item: Field) -> str:
    if item.value == "flexion":
        raise item.problem(
            f"one of {', '.join(FREE_COORDINATES)}; flexion is prescribed as it was measured, so "
            "it can have no offset: correct the measured column instead"
        )
    return item.choice(FREE_COORDINATES)


def _distinct(field: Field, read) -> tuple[str, ...]:
    """Entries of a list, none of them twice."""
    found: list[str] = []
    for item in field.items("names"):
        name = read(item)
        if name in found:
            raise item.problem("every name once")
        found.append(name)
    return tuple(found)
