"""The fields of a study: what may stand in each, its unit, its default and what it means."""

__all__ = ["FAULTS", "STUDY_FIELDS", "Synthetic"]

import os
from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args

from pydantic import PlainValidator, ValidationInfo

from kneejax.files import reading
from kneejax.files.reading import Part, Text, entries, meaning, reads, within, wrong
from kneejax.quantities import QUANTITIES, RANGES
from kneejax.studies import _fields
from kneejax.studies._fields import LOAD_NAMES, UNITS, Angles, OrObject, Parameter, Seed, Values
from kneejax.studies._lab_tests import StudyTest

if TYPE_CHECKING:
    from numpy import ndarray

    from kneejax.experiments import MeasuredTest
    from kneejax.inference import Stage
    from kneejax.mechanics import Knee
else:
    ndarray = Knee = MeasuredTest = Stage = Any

_COLUMNS = ("flexion_deg", *(f"{name}_{unit}" for name, unit in UNITS.items()))
#: A list of names, each once, or an empty one.
Names = (entries("names", empty=True), reading.Distinct)
#: Weights of squared errors per degree^2 and per mm^2 where nobody says so: those of paper 1.
_WEIGHTS = {"deg": 8.0, "mm": 1.0}
Procedure = Literal["I", "II", "III", "S"]
Fault = Literal["outside_region", "overstretched", "way_flipped", "past_wrap", "wrap_inside",
                "unstable", "dislocated"]  # fmt: skip


def _table(value: Any, info: ValidationInfo) -> str:
    """The path of a table of measured poses."""
    from kneejax.files import bundled_measurements

    every = bundled_measurements()
    known = {name: one for name, one in every.items() if one.use == "poses"}
    path = reading.folder_of(info) / reading.text(value)
    if os.path.isfile(path):
        return os.fspath(path)
    if value in known:
        return os.fspath(known[value].path)
    if value in every:
        other = "a table under tests" if every[value].use == "test" else "conditions alone"
        raise wrong(value, f"measured poses; {value} is {other}")
    return _fields.file_named(value, info, "a CSV table or a bundled measurement", known)


def _poses(value: Any) -> ndarray | None:
    """Poses that are given as numbers, `(n, 6)`."""
    import numpy as np

    if value is None:
        return None
    expected = "poses, (n, 6): degrees and mm, all finite"
    if isinstance(value, str | int | float):
        raise wrong(value, f"a mapping with the fields file, source, or {expected}")
    try:
        table = np.asarray(value, float)
    except (TypeError, ValueError):
        raise wrong(value, expected) from None
    if table.ndim != 2 or table.shape[1] != len(_COLUMNS) or not len(table):
        raise wrong(f"shape {table.shape}", expected)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise wrong("not finite", expected, at=f"[{row}]")
    return table


def _knee(value: Any, info: ValidationInfo) -> Any:
    """A knee as it is; of a name the bundled one, or the whole path of a file."""
    from kneejax.files import bundled_knees

    known = bundled_knees()
    if value is None or isinstance(value, list | dict | float | int):
        raise wrong(value, "a text, or a knee, as kneejax.load_knee gives")
    if not isinstance(value, str):
        return value
    if reading.text(value) in known:
        return reading.text(value)
    kind = f"a bundled knee ({', '.join(known) or 'none'}) or a knee file"
    # The whole path, since results are read elsewhere.
    return os.path.abspath(_fields.file_named(value, info, kind, known))


def _weights(value: Any) -> dict[str, float]:
    """Of coordinates; one of a coordinate counts before one of its unit, and where one is above
    0, those that are not given are of paper 1."""
    if value == "paper1":
        return {name: _WEIGHTS[unit] for name, unit in UNITS.items()}
    known = ("mm", "deg", *UNITS)
    kind = f"paper1, or a mapping with the fields {', '.join(known)}"
    given = reading.mapping_of(lambda x, _: reading.number(x, RANGES["weight"]), kind, known)(value)
    usual = _WEIGHTS if any(given.values()) else {}
    weights = {name: given.get(name, given.get(unit, usual.get(unit)))
               for name, unit in UNITS.items()}
    if all(weight == 0 for weight in weights.values()):
        raise wrong(value, "a weight above 0 for at least one coordinate")
    return {name: weight for name, weight in weights.items() if weight is not None}


def _prior(value: Any, info: ValidationInfo) -> Any:
    """Standard deviations by name; of a text the whole path of the file that has them."""
    if not isinstance(value, str):
        return reading.by_parameter(reading.deviation)(value)
    return _fields.file_named(value, info, "a mapping, or the prior.yaml of a cohort")


def _noise(value: Any, name: str) -> float | None:
    noise = None if value is None else reading.number(value, RANGES[name])
    if noise == 0:
        raise wrong(value, "a standard deviation above 0; leave it out to have it estimated")
    return noise


def _sizes(value: Any, name: str) -> list[float]:
    many = isinstance(value, list)
    allowed = RANGES[name]
    return [*reading.numbers(value, None, allowed)] if many else [reading.number(value, allowed)]


def _load_name(value: Any) -> str:
    if value not in LOAD_NAMES:
        from kneejax.mechanics import load_called, load_opposite_to

        meant = load_opposite_to(str(value))
        near = f"{meant} of the opposite sign" if meant else load_called(value) or LOAD_NAMES
        raise wrong(value, LOAD_NAMES, near)
    return value


def _frame_offset(value: Any) -> list[Any]:
    if isinstance(value, bool):
        return [*UNITS] if value else []
    if not isinstance(value, list | tuple):
        raise wrong(value, f"true, false, or a list of {', '.join(UNITS)}")
    return [*value]


def _offset(value: Any) -> str:
    if value == "flexion":
        raise wrong(value, f"one of {', '.join(UNITS)}; flexion is prescribed as it was measured, "
                           "so it can have no offset: correct the measured column instead")
    return reading.choice(value, UNITS)


_columns = reading.mapping_of(lambda value, _: reading.text(value),
                              f"a mapping with the fields {', '.join(_COLUMNS)}, or loads",
                              (*_COLUMNS, *LOAD_NAMES))
_loads = reading.mapping_of(
    _sizes, f"a mapping from one of {', '.join(LOAD_NAMES)} to its sizes", _load_name)


class Measured(Part):
    """A table of measured poses, as a study names it."""

    file: Annotated[str, PlainValidator(_table)] = meaning(
        "CSV table, relative to the study's folder, or a bundled measurement")
    source: Text = meaning("who measured it")
    convention: _fields.Convention = meaning("what its coordinates mean", "femoral")
    columns: Annotated[dict[str, str], PlainValidator(_columns)] = meaning(
        "column of a pose, or a load -> what the table calls it", dict)
    mirror: reading.Flag = meaning("whether a left knee was measured in axes with Z to the right",
                                   False)


class Synthetic(Part):
    """Poses that the model itself makes, with noise, to see whether they lead back.

    Example:
        >>> from kneejax import Synthetic
        >>> made = Synthetic(parameters={"ACL.stiffness": 4000.0}, flexion_deg="0:90:30")
        >>> made.flexion_deg.tolist()
        [0.0, 30.0, 60.0, 90.0]
    """

    parameters: Values = meaning("parameter -> value that makes the data")
    flexion_deg: Angles = meaning("prescribed angles, or a text such as 0:120:5")
    noise_mm: reading.Number = meaning("deviation of positions' noise", 0.0)
    noise_deg: reading.Number = meaning("deviation of rotations' noise", 0.0)
    seed: Seed = meaning("of the noise", 0)


class StudyStage(Part):
    """A part of the search of procedure S: what is free in it, and which data count."""

    parameters: Annotated[tuple[Parameter, ...], *Names] = meaning(
        "names or wildcards that are free; all if empty", ())
    data: Annotated[tuple[Text, ...], *Names] = meaning(
        "`poses` and names of tests that count; all if empty", ())


class StudyFields(Part):
    """All that a study file may say, or Python in its place."""

    title: Text = meaning("for reports")
    knee: Annotated[Knee, PlainValidator(_knee)] = meaning(
        "a bundled knee or a knee file, with the values that stay fixed", repr=False)
    parameters: Annotated[tuple[Parameter, ...], entries("names"), reading.Distinct] = meaning(
        "names or wildcards of what is free")
    measured: Annotated[ndarray | None, OrObject(Measured, _poses)] = meaning(
        "measured poses, degrees and mm; not beside synthetic ones", None)
    synthetic: Synthetic | None = meaning(
        "poses to be made; where there are tests, neither these nor measured ones need to be", None)
    tests: Annotated[
        tuple[Annotated[MeasuredTest, OrObject(StudyTest)], ...], entries("tests", empty=True)
    ] = meaning("under load that were made, each by a name of its own", ())
    patella: reading.Flag | None = meaning(
        "whether the knee is that of three bones, where it has one", None)
    start: Values = meaning(
        "name or wildcard -> value where the search begins; the knee's own otherwise", dict)
    bounds: _fields.Intervals = meaning(
        "name, `*.quantity` or quantity -> lower and upper bound; a name counts before a wildcard, "
        "that before a quantity, and usual bounds hold for the rest", dict)
    weights: Annotated[dict[str, float], PlainValidator(_weights)] = meaning(
        "free coordinate, or `mm` or `deg` -> weight of its squared error, per mm^2 or per "
        "degree^2, in place of one over the squared noise; 0 for one that does not count; or "
        "`paper1`", dict)
    prior: Annotated[dict[str, float], PlainValidator(_prior)] = meaning(
        "name, `*.quantity` or quantity -> standard deviation of a normal prior around the start, "
        "or the prior.yaml of a cohort; needs noise_mm and noise_deg, and of weights then counts "
        "only which are zero", dict)
    attachment_sd_mm: Annotated[float, within("noise_mm")] = meaning(
        "standard deviation with which attachments of a knee file were digitised: the prior of "
        "those that are free without one, beside noise_mm and noise_deg; 0 for none",
        QUANTITIES["femoral_attachment"].scale_of(0.0))
    procedures: Annotated[tuple[Annotated[Procedure, reading.Choice()], ...], *Names] = meaning(
        "the first is the answer, others are there to compare; `S` alone where there are stages",
        ())
    stages: Annotated[
        tuple[Annotated[Stage, OrObject(StudyStage)], ...], entries("stages", empty=True)
    ] = meaning("of procedure S, in turn", ())
    starts: Annotated[int, reads(reading.whole, 1, 1000)] = meaning(
        "of procedure III: the knee's own, then draws from the prior, or between the bounds where "
        "there is none", 1)
    seed: Seed = meaning("of the further starts", 0)
    noise_mm: Annotated[float | None, reads(_noise, "noise_mm")] = meaning(
        "standard deviation of measured displacements; estimated where it is not known, while "
        "synthetic poses know their own", None)
    noise_deg: Annotated[float | None, reads(_noise, "noise_deg")] = meaning(
        "standard deviation of measured rotations; likewise", None)
    frame_offset: Annotated[
        tuple[Annotated[str, reads(_offset)], ...], reads(_frame_offset), reading.Distinct
    ] = meaning(
        "free coordinates whose constant offset between measured and model frames is free too; "
        "true for all five", ())
    method: Annotated[Literal["least_squares", "lbfgsb"], reading.Choice()] = meaning(
        "of the search; `lbfgsb` needs jaxopt and takes long", "least_squares")
    cycles: Annotated[int, reads(reading.whole, 1, 1000)] = meaning(
        "how often procedures I and II may go through their two steps", 1)
    failures: Annotated[tuple[Annotated[Fault, reading.Choice()], ...], *Names] = meaning(
        "statuses for which a pose counts for nothing and a command ends with exit status 1; the "
        "package's choice if empty", ())
    loads: Annotated[dict[str, list[float]], PlainValidator(_loads)] = meaning(
        "load -> its size at each pose, or one for all, in the unit of its name", dict)
    flexion_limits_deg: _fields.Interval | None = meaning(
        "between which measured poses count", None, alias="flexion_deg")
    set: Values = meaning("parameter -> value of the knee that stays fixed", dict)


#: Names that a study file may hold.
STUDY_FIELDS = tuple(field.alias or name for name, field in StudyFields.model_fields.items())
#: What a balance may be at fault for, and a study may count as a failure.
FAULTS = get_args(Fault)
