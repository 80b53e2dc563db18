"""The fields of a study: what may stand in each, its unit, its default and what it means."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import PlainValidator, ValidationInfo

from kneejax.files.reading import Field
from kneejax.quantities import RANGES
from kneejax.studies._checked import (
    UNITS,
    Angles,
    Choice,
    Convention,
    Distinct,
    Flag,
    Interval,
    Intervals,
    LoadName,
    OrObject,
    Parameter,
    Part,
    Seed,
    Text,
    Values,
    by_parameter,
    deviation,
    entries,
    folder_of,
    mapping_of,
    reads,
    said,
    whole,
    within,
)
from kneejax.studies._lab_tests import StudyTest

if TYPE_CHECKING:
    from numpy import ndarray

    from kneejax.experiments import MeasuredTest
    from kneejax.inference import Stage
    from kneejax.mechanics import Knee
else:
    ndarray = Knee = MeasuredTest = Stage = Any

_COLUMNS = ("flexion_deg", *(f"{name}_{unit}" for name, unit in UNITS.items()))
#: Weights of squared errors per degree^2 and per mm^2 where nobody says so: those of paper 1.
_WEIGHTS = {"deg": 8.0, "mm": 1.0}
Procedure = Literal["I", "II", "III", "S"]
Fault = Literal[
    "outside_region", "overstretched", "way_flipped", "past_wrap", "wrap_inside", "unstable",
    "dislocated",
]  # fmt: skip


def _table(value: Any, info: ValidationInfo) -> str:
    """The path of a table of measured poses."""
    from kneejax.files import bundled_measurements

    field = Field("", "", value)
    path = folder_of(info) / field.text()
    if os.path.isfile(path):
        return os.fspath(path)
    every = bundled_measurements()
    known = {name: one for name, one in every.items() if one.use == "poses"}
    if field.value in known:
        return os.fspath(known[field.value].path)
    if field.value in every:
        other = "a table under tests" if every[field.value].use == "test" else "conditions alone"
        raise field.problem(f"measured poses; {field.value} is {other}")
    raise field.problem(f"a CSV table or a bundled measurement; not at {path}", known)


def _poses(field: Field) -> ndarray | None:
    """Poses that are given as numbers, `(n, 6)`."""
    import numpy as np

    if field.value is None:
        return None
    expected = "poses, (n, 6): degrees and mm, all finite"
    if isinstance(field.value, str | int | float):
        raise field.problem(f"a mapping with the fields file, source, or {expected}")
    try:
        table = np.asarray(field.value, float)
    except (TypeError, ValueError):
        raise field.problem(expected) from None
    if table.ndim != 2 or table.shape[1] != len(_COLUMNS) or not len(table):
        raise Field("", "", f"shape {table.shape}").problem(expected)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise Field("", f"[{row}]", "not finite").problem(expected)
    return table


def _knee(value: Any, info: ValidationInfo) -> Any:
    """A knee as it is; of a name the bundled one, or the whole path of a file."""
    from kneejax.files import bundled_knees

    field, known = Field("", "", value), bundled_knees()
    if value is None or isinstance(value, list | dict | float | int):
        raise field.problem("a text, or a knee, as kneejax.load_knee gives")
    if not isinstance(value, str):
        return value
    name = field.text()
    if name in known:
        return name
    path = folder_of(info) / name
    if not os.path.isfile(path):
        expected = f"a bundled knee ({', '.join(known) or 'none'}) or a knee file; not at {path}"
        raise field.problem(expected, known)
    return os.path.abspath(path)  # results are read elsewhere


def _weights(value: Any) -> dict[str, float]:
    """Of coordinates; one of a coordinate counts before one of its unit, and where one is above
    0, those that are not given are of paper 1."""
    if value == "paper1":
        return {name: _WEIGHTS[unit] for name, unit in UNITS.items()}
    known = ("mm", "deg", *UNITS)
    kind = f"paper1, or a mapping with the fields {', '.join(known)}"
    given = mapping_of(lambda f, _: f.number(RANGES["weight"]), kind, known)(value)
    usual = _WEIGHTS if any(given.values()) else {}
    weights = {
        name: given.get(name, given.get(unit, usual.get(unit))) for name, unit in UNITS.items()
    }
    if all(weight == 0 for weight in weights.values()):
        raise Field("", "", value).problem("a weight above 0 for at least one coordinate")
    return {name: weight for name, weight in weights.items() if weight is not None}


def _prior(value: Any, info: ValidationInfo) -> Any:
    """Standard deviations by name; of a text the whole path of the file that has them."""
    if not isinstance(value, str):
        return by_parameter(deviation)(value)
    path = folder_of(info) / value.strip()
    if not os.path.isfile(path):
        expected = f"a mapping, or the prior.yaml of a cohort; not at {path}"
        raise Field("", "", value).problem(expected)
    return os.fspath(path)


def _noise(field: Field, name: str) -> float | None:
    noise = None if field.value is None else field.number(RANGES[name])
    if noise == 0:
        raise field.problem("a standard deviation above 0; leave it out to have it estimated")
    return noise


def _sizes(field: Field, name: str) -> list[float]:
    many = isinstance(field.value, list)
    return [*field.numbers(allowed=RANGES[name])] if many else [field.number(RANGES[name])]


def _load_name(field: Field, _: Any) -> str:
    known = get_args(LoadName)
    if field.value not in known:
        from kneejax.mechanics import load_called, load_opposite_to

        meant = load_opposite_to(str(field.value))
        near = f"{meant} of the opposite sign" if meant else load_called(field.value) or known
        raise field.problem(f"one of {', '.join(known)}", near)
    return field.value


def _frame_offset(field: Field) -> list[Any]:
    if isinstance(field.value, bool):
        return [*UNITS] if field.value else []
    if not isinstance(field.value, list | tuple):
        raise field.problem(f"true, false, or a list of {', '.join(UNITS)}")
    return [*field.value]


def _offset(field: Field) -> str:
    if field.value == "flexion":
        raise field.problem(
            f"one of {', '.join(UNITS)}; flexion is prescribed as it was measured, so it can have "
            "no offset: correct the measured column instead"
        )
    return field.choice(UNITS)


_columns = mapping_of(
    lambda field, _: field.text(), f"a mapping with the fields {', '.join(_COLUMNS)}", _COLUMNS
)
_loads = mapping_of(
    _sizes, f"a mapping from one of {', '.join(get_args(LoadName))} to its sizes", _load_name
)


class Measured(Part):
    """A table of measured poses, as a study names it."""

    file: Annotated[str, PlainValidator(_table)] = said(
        "CSV table, relative to the study's folder, or a bundled measurement"
    )
    source: Text = said("who measured it")
    convention: Convention = said("what its coordinates mean", "femoral")
    columns: Annotated[dict[str, str], PlainValidator(_columns)] = said(
        "column of a pose -> what the table calls it", dict
    )
    mirror: Flag = said("whether a left knee was measured in axes with Z to the right", False)


class Synthetic(Part):
    """Poses that the model itself makes, with noise, to see whether they lead back."""

    parameters: Values = said("parameter -> value that makes the data")
    flexion_deg: Angles = said("prescribed angles, or a text such as 0:120:5")
    noise_mm: Annotated[float, within("noise_mm")] = said("deviation of displacements' noise", 0.0)
    noise_deg: Annotated[float, within("noise_deg")] = said("deviation of rotations' noise", 0.0)
    seed: Seed = said("of the noise", 0)


class StudyStage(Part):
    """A part of the search of procedure S: what is free in it, and which data count."""

    parameters: Annotated[tuple[Parameter, ...], entries("names", empty=True), Distinct] = said(
        "names or wildcards that are free; all if empty", ()
    )
    data: Annotated[tuple[Text, ...], entries("names", empty=True), Distinct] = said(
        "`poses` and names of tests that count; all if empty", ()
    )


class StudyFields(Part):
    """All that a study file may say, or Python in its place."""

    title: Text = said("for reports")
    knee: Annotated[Knee, PlainValidator(_knee)] = said(
        "a bundled knee or a knee file, with the values that stay fixed", repr=False
    )
    parameters: Annotated[tuple[Parameter, ...], entries("names"), Distinct] = said(
        "names or wildcards of what is free"
    )
    measured: Annotated[ndarray | None, OrObject(Measured, _poses)] = said(
        "measured poses, degrees and mm; not beside synthetic ones", None
    )
    synthetic: Synthetic | None = said(
        "poses to be made; where there are tests, neither these nor measured ones need to be", None
    )
    tests: Annotated[
        tuple[Annotated[MeasuredTest, OrObject(StudyTest)], ...], entries("tests", empty=True)
    ] = said("under load that were made, each by a name of its own", ())
    patella: Flag | None = said("whether the knee is that of three bones, where it has one", None)
    start: Values = said(
        "name or wildcard -> value where the search begins; the knee's own otherwise", dict
    )
    bounds: Intervals = said(
        "name, `*.quantity` or quantity -> lower and upper bound; a name counts before a wildcard, "
        "that before a quantity, and usual bounds hold for the rest", dict,
    )  # fmt: skip
    weights: Annotated[dict[str, float], PlainValidator(_weights)] = said(
        "free coordinate, or `mm` or `deg` -> weight of its squared error, per mm^2 or per "
        "degree^2, in place of one over the squared noise; 0 for one that does not count; or "
        "`paper1`", dict,
    )  # fmt: skip
    prior: Annotated[dict[str, float], PlainValidator(_prior)] = said(
        "name, `*.quantity` or quantity -> standard deviation of a normal prior around the start, "
        "or the prior.yaml of a cohort; needs noise_mm and noise_deg, and of weights then counts "
        "only which are zero", dict,
    )  # fmt: skip
    procedures: Annotated[
        tuple[Annotated[Procedure, Choice()], ...], entries("names", empty=True), Distinct
    ] = said(
        "the first is the answer, others are there to compare; `S` alone where there are stages", ()
    )
    stages: Annotated[
        tuple[Annotated[Stage, OrObject(StudyStage)], ...], entries("stages", empty=True)
    ] = said("of procedure S, in turn", ())
    starts: Annotated[int, whole(1, 1000)] = said(
        "of procedure III: the knee's own, then draws from the prior, or between the bounds where "
        "there is none", 1,
    )  # fmt: skip
    seed: Seed = said("of the further starts", 0)
    noise_mm: Annotated[float | None, reads(lambda f: _noise(f, "noise_mm"))] = said(
        "standard deviation of measured displacements; estimated where it is not known, while "
        "synthetic poses know their own", None,
    )  # fmt: skip
    noise_deg: Annotated[float | None, reads(lambda f: _noise(f, "noise_deg"))] = said(
        "standard deviation of measured rotations; likewise", None
    )
    frame_offset: Annotated[
        tuple[Annotated[str, reads(_offset)], ...], reads(_frame_offset), Distinct
    ] = said(
        "free coordinates whose constant offset between measured and model frames is free too; "
        "true for all five", (),
    )  # fmt: skip
    method: Annotated[Literal["least_squares", "lbfgsb"], Choice()] = said(
        "of the search; `lbfgsb` needs jaxopt and takes long", "least_squares"
    )
    cycles: Annotated[int, whole(1, 1000)] = said(
        "how often procedures I and II may go through their two steps", 1
    )
    failures: Annotated[
        tuple[Annotated[Fault, Choice()], ...], entries("names", empty=True), Distinct
    ] = said(
        "statuses for which a pose counts for nothing and a command ends with exit status 1; the "
        "package's choice if empty", (),
    )  # fmt: skip
    loads: Annotated[dict[str, list[float]], PlainValidator(_loads)] = said(
        "load -> its size at each pose, or one for all, in the unit of its name", dict
    )
    flexion_limits_deg: Interval | None = said(
        "between which measured poses count", None, alias="flexion_deg"
    )
    set: Values = said("parameter -> value of the knee that stays fixed", dict)


#: Names that a study file may hold.
STUDY_FIELDS = tuple(field.alias or name for name, field in StudyFields.model_fields.items())
#: What a balance may be at fault for, and a study may count as a failure.
FAULTS = get_args(Fault)
