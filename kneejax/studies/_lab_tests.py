"""Tests under load of a study: what a file says of one, and what its table holds."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple, get_args

import numpy as np
from pydantic import BeforeValidator, PlainValidator, ValidationInfo, model_validator
from pydantic import Field as described

from kneejax._ranges import RANGES
from kneejax.files import InputProblem, bundled_laxity_sources, bundled_measurements
from kneejax.files.reading import Field
from kneejax.studies._checked import (
    Angles,
    Choice,
    Convention,
    Flag,
    LoadName,
    Part,
    Text,
    by_name,
    entries,
    folder_of,
    reads,
    whole,
    within,
)
from kneejax.studies._poses import MIRROR, UNITS

if TYPE_CHECKING:
    from kneejax.experiments import Frames, MeasuredTest
    from kneejax.files import LabTable, LaxityBand, Measurement

#: Words for the negative sense of a load or a coordinate.
_OTHER_SENSE = re.compile(
    r"posterior|medial|inferior|distal|distraction|valgus|abduction|external", re.IGNORECASE
)
_PATELLA = ("flexion", "rotation", "tilt", "anterior", "superior", "lateral")
_COORDINATES = (*UNITS, *(f"patella_{name}" for name in _PATELLA))
#: Fields of a test that say what stands in a table of one's own.
_OF_OWN_TABLES = ("columns", "ignore", "convention", "mirror", "at_deg")
CountedFrom = Literal[
    "unloaded", "intact", "least_load", "opposite", "offset", "offset_each_flexion", "absolute",
    "extension",
]  # fmt: skip
Axes = Literal["femur", "tibia", "grood_suntay"]
_Loads = by_name(
    lambda field, name: field.number(RANGES[name]),
    f"a mapping with the fields {', '.join(get_args(LoadName))}",
    get_args(LoadName),
)


class InTime(Part):
    """What makes rows of a test the frames of a knee in motion."""

    body_kg: Annotated[float, within("body_kg")] = described(75.0, description="of the person")
    height_m: Annotated[float, within("height_m")] = described(1.75, description="of the person")
    ankle_kg: Annotated[float, within("ankle_kg")] = described(0.0, description="a weight there")
    femur_deg: Annotated[float, within("femur_deg")] | None = described(
        None, description="of the femur to the horizontal; no gravity otherwise"
    )
    critical: Annotated[float, within("critical")] | None = described(
        None, description="damping of each fibre as part of the critical one"
    )
    damping_N_s_per_mm: Annotated[float, within("damping_N_s_per_mm")] | None = described(
        None, description="of every coordinate, rotations at 30 mm"
    )
    period_s: Annotated[float, within("period_s")] | None = described(
        None, description="of a motion that repeats itself"
    )
    error_mm: Annotated[float, within("error_mm")] | None = described(
        None, description="that steps through time may leave of any pose"
    )
    harmonics: Annotated[int, whole(1, 12)] | None = described(
        None, description="with which flexion is led, of a motion that repeats itself"
    )
    cycles_before: Annotated[int, whole(0, 100)] | None = described(
        None, description="that the motion had gone through before the first row"
    )

    def frames(self, time_s: np.ndarray, flexion_deg: np.ndarray) -> Frames:
        """The frames of a motion; raises `WrongValue` where its times are none of such a motion."""
        from kneejax.dynamics import gravity_of
        from kneejax.experiments import Frames, leg_of_person

        own = {"critical", "damping_N_s_per_mm", "period_s", "harmonics", "cycles_before"}
        asked = self.model_dump(include=own, exclude_none=True)
        if self.error_mm is not None:
            asked["most_mm"] = self.error_mm
        if self.femur_deg is not None:
            asked["gravity_m_s2"] = gravity_of(self.femur_deg)
        leg = leg_of_person(self.body_kg, self.height_m, self.ankle_kg)
        return Frames(time_s, flexion_deg, leg, **asked)

    @model_validator(mode="after")
    def _check_period(self) -> InTime:
        for name in ("harmonics", "cycles_before"):
            value = getattr(self, name)
            if value is not None and self.period_s is None:
                expected = "period_s too, of a motion that repeats itself"
                raise InputProblem("", name, value, expected)
        return self


def _test_table(value: Any, info: ValidationInfo) -> str:
    """The whole path of a table, or the name of a published test."""
    field = Field("", "", value)
    path = folder_of(info) / field.text()
    if os.path.isfile(path):
        return os.path.abspath(path)
    known = (*bundled_laxity_sources(), *_published())
    if field.text() not in known:
        raise field.problem(f"a CSV table, or a published test ({', '.join(known)})", known)
    return field.text()


def _published() -> dict[str, Measurement]:
    """Motions that come with the package as tests."""
    return {name: one for name, one in bundled_measurements().items() if one.use == "test"}


def older_name(said: Any) -> Any:
    """What a file says of a test: `constant` is the older name of what a study calls loads too."""
    if isinstance(said, dict) and "constant" in said and "loads" not in said:
        return {"loads" if name == "constant" else name: one for name, one in said.items()}
    return said


class StudyTest(Part):
    """A test under load, as a study names it."""

    name: Text = described(description="what tables and figures call it")
    file: Annotated[str, PlainValidator(_test_table)] = described(
        description="CSV table, relative to the study's folder, or a published test"
    )
    source: Any = described(None, description="who measured it")
    columns: Annotated[
        dict[str, str],
        by_name(lambda f, _: f.text(), "a mapping from a name to a column of the file"),
    ] = described(default_factory=dict, description="name -> column, perhaps with a factor")
    ignore: Annotated[tuple[Text, ...], entries("columns")] = described(
        (), description="columns that are left out on purpose"
    )
    convention: Convention = described("grood-suntay", description="what coordinates mean")
    mirror: Flag = described(False, description="whether a left knee was measured in axes with Z "
                             "to the person's right")  # fmt: skip
    flexion_deg: Angles | None = described(None, description="flexions that count")
    at_deg: Annotated[float, within("flexion_deg")] | None = described(
        None, description="flexion of a table without a column of it"
    )
    coordinates: Annotated[
        tuple[Annotated[str, reads(lambda f: f.choice(_COORDINATES))], ...], entries("coordinates")
    ] = described((), description="that count; all that the table has if empty")
    counted_from: Annotated[CountedFrom, Choice()] | None = described(
        None, description="what numbers are counted from; as a published test says, or `unloaded`"
    )
    loads: Annotated[dict[str, float], _Loads] = described(
        default_factory=dict, description="load -> size, of those that acted throughout"
    )
    load: Any = described(
        None, description="load -> size of a published laxity whose load is not known"
    )
    point_mm: Annotated[
        tuple[float, float, float], reads(lambda f: f.numbers(3, RANGES["point_mm"]))
    ] = described((0.0, 0.0, 0.0), description="where forces act")
    axes: Annotated[Axes, Choice()] = described(
        "grood_suntay", description="axes in which loads are given"
    )
    sd_mm: Annotated[float, within("noise_mm")] | None = described(
        None, description="standard deviation of displacements; as the poses' if not stated"
    )
    sd_deg: Annotated[float, within("noise_deg")] | None = described(
        None, description="of rotations; likewise"
    )
    sd_N: Annotated[float, within("tension_N")] | None = described(
        None, description="of forces that were read of the knee's parts"
    )
    sd_strain: Annotated[float, reads(lambda f: f.number(RANGES["strain"].spread))] | None = (
        described(None, description="of strains that were read")
    )
    cut: Annotated[
        tuple[Text, ...],
        entries("ligaments"),
        BeforeValidator(lambda one: [one] if isinstance(one, str) else one),
    ] = described((), description="ligaments or groups that had been cut")
    weight: Annotated[Literal["by_load"], Choice()] | None = described(
        None, description="`by_load` weighs rows in proportion to their load"
    )
    in_time: InTime | None = described(None, description="of rows that are frames of a motion")

    @model_validator(mode="before")
    @classmethod
    def _named_as_today(cls, said: Any) -> Any:
        return older_name(said)

    def said(self, field: str, expected: str, value: Any = None) -> InputProblem:
        """A mistake in a field of this test."""
        value = getattr(self, field) if value is None else value
        value = os.path.basename(value) if field == "file" else value
        return InputProblem("", f".{field}", value, expected)


def measured_test_of(said: StudyTest, lines: Sequence[str] = ()) -> MeasuredTest:
    """The test that a study names, from its table.

    Args:
        said: of it.
        lines: of constant tension and muscles that the knee has (`Knee.pullable`); a table's column
            of such a tension is added to it.

    Raises:
        InputProblem: a field or a table is not what it should be; likewise `WrongValue`.
    """
    from kneejax.experiments import MeasuredTest, against_load, weights_by_load

    table, counted_from = _table_of(said)
    table = _limited(said, table)
    flexion, loads, observed = table[:3]
    constant = dict(said.loads)
    if said.mirror:
        observed = observed * MIRROR[1:]
        for acting in (loads, constant):
            if "lateral_N" in acting:
                acting["lateral_N"] = -acting["lateral_N"]
        turned = dict(zip((f"patella_{name}" for name in _PATELLA), MIRROR, strict=True))
        readings = {k: x * turned.get(k.rsplit("_", 1)[0], 1.0) for k, x in table.readings.items()}
        table = table._replace(readings=readings)
    if said.coordinates:
        table, observed = _that_count(said, table, observed)
    tensions, readings = _pulls(table, lines)
    if said.weight and table.weight is not None:
        raise said.said("weight", "this field left out: the table has a column weight")
    frames = None
    if said.in_time is not None:
        if table.time_s is None:
            raise said.said("file", "a column time_s too, or columns: {time_s: ...}")
        frames = _in_time(said.in_time, table.time_s, flexion)
    own = {"point_mm", "axes", "sd_mm", "sd_deg", "sd_N", "sd_strain", "cut"}
    counted_from = said.counted_from or counted_from or "unloaded"
    test = MeasuredTest(
        said.name, flexion, loads, observed, counted_from=counted_from, constant=constant,
        tensions=tensions, readings=readings, weight=table.weight, frames=frames,
        **said.model_dump(include=own & said.model_fields_set),
    )  # fmt: skip
    if said.weight:
        import dataclasses

        weight = weights_by_load(test.loads[test.driven_by])
        test = dataclasses.replace(test, weight=weight)
    if (found := against_load(test)) is not None:
        raise _of_the_other_sense(said, found)
    return test


def _in_time(said: InTime, time_s: np.ndarray, flexion_deg: np.ndarray) -> Frames:
    from kneejax.numerics import WrongValue

    try:
        return said.frames(time_s, flexion_deg)
    except WrongValue as problem:
        place = f"in_time.{problem.field}"
        raise InputProblem("", place, problem.found, problem.expected) from None


def _of_the_other_sense(said: StudyTest, found: Any) -> InputProblem:
    """A curve along which the tibia moves against its load, by the column suspected."""
    from kneejax.geometry import COORDINATES
    from kneejax.mechanics import NAMED_LOADS

    moved = COORDINATES[found.coordinate].column
    columns = {name: said.columns.get(name, name) for name in (moved, found.load)}
    # A column whose own name speaks of the other sense, unless it was turned round already.
    other = [
        name for name, column in columns.items()
        if _OTHER_SENSE.search(column) and not column.lstrip().startswith("-")
    ]  # fmt: skip
    name = other[0] if len(other) == 1 else moved
    column = columns[name]
    turned = column.lstrip()[1:].lstrip() if column.lstrip().startswith("-") else f"-{column}"
    (least, most), (low, high) = found.loads, found.values
    unit = NAMED_LOADS[found.load].unit
    return InputProblem(
        said.file,
        column,
        f"{moved} from {low:g} to {high:g} at {found.flexion_deg:g} degrees",
        f"a coordinate that rises with its load, {found.load} from {least:g} to {most:g} {unit}: "
        f'a column of the other sense is suspected; write {name}: "{turned}" under columns, or '
        "turn the other column round",
    )


def _that_count(
    said: StudyTest, table: LabTable, observed: np.ndarray
) -> tuple[LabTable, np.ndarray]:
    """Without the coordinates, of any bone, that shall not count."""
    seen = dict(zip(UNITS, observed.T, strict=True))
    others = {column: column.rsplit("_", 1)[0] for column in table.readings}
    others = {column: name for column, name in others.items() if name in _COORDINATES}
    seen |= {name: table.readings[column] for column, name in others.items()}
    for name in said.coordinates:
        if np.isnan(seen.get(name, np.nan)).all():
            expected = f"coordinates that the table has; not {name}"
            raise said.said("coordinates", expected, [*said.coordinates])
    kept = {
        name: sizes for name, sizes in table.readings.items()
        if others.get(name, name) in said.coordinates or name not in others
    }  # fmt: skip
    observed = np.where([name in said.coordinates for name in UNITS], observed, np.nan)
    return table._replace(readings=kept), observed


def _pulls(table: LabTable, lines: Sequence[str]) -> tuple[dict, dict]:
    """Tensions that act along lines of the knee, and what was read of its parts."""
    acting, read = {}, dict(table.readings)
    for line in lines:
        tension = read.pop(f"{line}.tension_N", None)
        if tension is not None:
            acting[line] = tension
            if np.isnan(tension).any():
                row = int(np.flatnonzero(np.isnan(tension))[0]) + 1
                place, expected = f"file: {line}.tension_N, row {row}", "a tension in every row"
                raise InputProblem("", place, "empty", f"{expected}, since it acts on the knee")
    return acting, read


def _limited(said: StudyTest, table: LabTable) -> LabTable:
    """The rows at flexions that count."""
    if said.flexion_deg is None:
        return table
    wanted = said.flexion_deg
    inside = np.isclose(table.flexion_deg[:, None], wanted, atol=1e-6)
    if not inside.any(axis=0).all():
        absent = wanted[~inside.any(axis=0)][0]
        measured = ", ".join(f"{x:g}" for x in np.unique(table.flexion_deg))
        expected = f"of the flexions that were measured, {measured}; not {absent:g}"
        raise said.said("flexion_deg", expected, wanted.tolist())
    return table.take(inside.any(axis=1))


class _Table(NamedTuple):
    """What a table holds, and what it is counted from where a study says nothing else."""

    table: LabTable
    counted_from: str | None = None


def _table_of(said: StudyTest) -> _Table:
    """A table of one's own, the published laxity or the published motion that a test names."""
    from kneejax.experiments import WITHOUT_LOADS
    from kneejax.files import bundled_bands, read_lab_table

    given, name = said.model_fields_set, said.file
    if os.path.isabs(name):
        if "load" in given:
            expected = "no load of a published table: this one has columns of loads"
            raise said.said("load", expected)
        return _Table(read_lab_table(
            name, said.columns, said.at_deg, said.convention, said.ignore,
            unloaded=said.counted_from in WITHOUT_LOADS,
        ))  # fmt: skip
    published = _published()
    for field in _OF_OWN_TABLES:
        if field in given and not (field == "ignore" and name in published):
            raise said.said(field, f"this field left out: {name} comes with the package")
    if name not in published:
        return published_laxity(said, bundled_bands(name=name))
    for field in ("load", "counted_from"):
        if field in given:
            raise said.said(field, f"this field left out: {name} says it itself")
    own = published[name]
    table = read_lab_table(own.path, own.columns, ignore=said.ignore, unloaded=True)
    return _Table(table, own.counted_from)


def published_laxity(said: StudyTest, bands: Sequence[LaxityBand]) -> _Table:
    """The rows of a published laxity, of knees with those ligaments cut that the test had cut.

    Args:
        said: of the test; where the load is not known, with it as `load: {internal_Nm: 5}`.
        bands: of the laxity.

    Raises:
        InputProblem: it is no test of one knee, or its load is not known and not stated.
    """
    from kneejax.files import LabTable
    from kneejax.mechanics import load_called

    name = bands[0].name
    if bands[0].end == "range_increase":
        raise said.said("file", f"a test of one knee; not {name}, a difference that cutting makes")
    own = [band for band in bands if {*band.cut} == {*said.cut}]
    if not own:
        known = sorted({" and ".join(band.cut) or "nothing" for band in bands})
        value = said.cut[0] if len(said.cut) == 1 else None
        expected = f"{name} with {' or '.join(known)} cut, as it was measured"
        raise said.said("cut" if said.cut else "file", expected, value)
    load, size = own[0].load, _size(said, own[0])
    (column,) = [k for k, coordinate in enumerate(UNITS) if load_called(coordinate) == load]
    rows = []  # flexion, load, reading
    for band in own:
        sense = -1.0 if band.end == "negative" else 1.0
        rows += [(x, sense * size, y) for x, y in zip(band.flexion_deg, band.mean, strict=True)]
        if band.end == "range":
            rows += [(x, -size, 0.0) for x in band.flexion_deg]
    flexion, sizes, read = np.array(rows).T
    observed = np.full((len(rows), len(UNITS)), np.nan)
    observed[:, column] = read
    ranges = any(band.end == "range" for band in own)
    if ranges and said.counted_from:
        expected = f"this field left out: {name} is of ranges between opposite loads"
        raise said.said("counted_from", expected)
    counted = "opposite" if ranges else own[0].counted_from
    return _Table(LabTable(flexion, {load: sizes}, observed), counted)


def _size(said: StudyTest, band: LaxityBand) -> float:
    """The load of a table, as published or as the study states it."""
    unknown, load = np.isnan(band.size), band.load
    if "load" not in said.model_fields_set:
        if unknown:
            raise said.said(
                "file",
                f"load: {{{load}: ...}} beside it, since the load of {band.name} is not known",
            )
        return band.size
    if not unknown:
        expected = f"this field left out: {band.name} was measured under {load} {band.size:g}"
        raise said.said("load", expected)
    given = Field("", "load", said.load).mapping((load,))[load]
    size = given.number(RANGES[load])
    if not size > 0:
        raise given.problem("the size of the load, above 0")
    return size
