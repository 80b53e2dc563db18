"""Tests under load of a study, from their tables: those of a file, and published ones."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax._ranges import RANGES
from kneejax.files import InputProblem
from kneejax.files.reading import Field
from kneejax.studies._checked import MIRROR, UNITS
from kneejax.studies._lab_tests import COORDINATES, PATELLA, InTime, StudyTest, published_motions

if TYPE_CHECKING:
    from kneejax.experiments import Frames, MeasuredTest
    from kneejax.files import LabTable, LaxityBand

#: Words for the negative sense of a load or a coordinate.
_OTHER_SENSE = re.compile(
    r"posterior|medial|inferior|distal|distraction|valgus|abduction|external", re.IGNORECASE
)
#: Fields of a test that say what stands in a table of one's own.
_OF_OWN_TABLES = ("columns", "ignore", "convention", "mirror", "at_deg")


def measured_test_of(test: StudyTest, lines: Sequence[str] = ()) -> MeasuredTest:
    """The test that a study names, from its table.

    Args:
        test: of it.
        lines: of constant tension and muscles that the knee has (`Knee.pullable`); a table's column
            of such a tension is added to it.

    Raises:
        InputProblem: a field or a table is not what it should be; likewise `WrongValue`.
    """
    from kneejax.experiments import MeasuredTest, against_load, weights_by_load

    table, counted_from = _table_of(test)
    table = _limited(test, table)
    flexion, loads, observed = table[:3]
    constant = dict(test.loads)
    if test.mirror:
        observed = observed * MIRROR[1:]
        for acting in (loads, constant):
            if "lateral_N" in acting:
                acting["lateral_N"] = -acting["lateral_N"]
        turned = dict(zip((f"patella_{name}" for name in PATELLA), MIRROR, strict=True))
        readings = {k: x * turned.get(k.rsplit("_", 1)[0], 1.0) for k, x in table.readings.items()}
        table = table._replace(readings=readings)
    if test.coordinates:
        table, observed = _that_count(test, table, observed)
    tensions, readings = _pulls(table, lines)
    if test.weight and table.weight is not None:
        raise test.wrong("weight", "this field left out: the table has a column weight")
    frames = None
    if test.in_time is not None:
        if table.time_s is None:
            raise test.wrong("file", "a column time_s too, or columns: {time_s: ...}")
        frames = _frames(test.in_time, table.time_s, flexion)
    own = {"point_mm", "axes", "sd_mm", "sd_deg", "sd_N", "sd_strain", "cut"}
    counted_from = test.counted_from or counted_from or "unloaded"
    made = MeasuredTest(
        test.name, flexion, loads, observed, counted_from=counted_from, constant=constant,
        tensions=tensions, readings=readings, weight=table.weight, frames=frames,
        **test.model_dump(include=own & test.model_fields_set),
    )  # fmt: skip
    if test.weight:
        made = dataclasses.replace(made, weight=weights_by_load(made.loads[made.driven_by]))
    if (found := against_load(made)) is not None:
        raise _of_the_other_sense(test, found)
    return made


def _frames(said: InTime, time_s: np.ndarray, flexion_deg: np.ndarray) -> Frames:
    """The frames of a knee in motion."""
    from kneejax.dynamics import gravity_of
    from kneejax.experiments import Frames, leg_of_person
    from kneejax.numerics import WrongValue

    own = {"critical", "damping_N_s_per_mm", "period_s", "harmonics", "cycles_before"}
    asked = said.model_dump(include=own, exclude_none=True)
    if said.error_mm is not None:
        asked["most_mm"] = said.error_mm
    if said.femur_deg is not None:
        asked["gravity_m_s2"] = gravity_of(said.femur_deg)
    leg = leg_of_person(said.body_kg, said.height_m, said.ankle_kg)
    try:
        return Frames(time_s, flexion_deg, leg, **asked)
    except WrongValue as problem:
        place = f"in_time.{problem.field}"
        raise InputProblem("", place, problem.found, problem.expected) from None


def _of_the_other_sense(test: StudyTest, found: Any) -> InputProblem:
    """A curve along which the tibia moves against its load, by the column suspected."""
    from kneejax.geometry import COORDINATES
    from kneejax.mechanics import NAMED_LOADS

    moved = COORDINATES[found.coordinate].column
    columns = {name: test.columns.get(name, name) for name in (moved, found.load)}
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
        test.file,
        column,
        f"{moved} from {low:g} to {high:g} at {found.flexion_deg:g} degrees",
        f"a coordinate that rises with its load, {found.load} from {least:g} to {most:g} {unit}: "
        f'a column of the other sense is suspected; write {name}: "{turned}" under columns, or '
        "turn the other column round",
    )


def _that_count(
    test: StudyTest, table: LabTable, observed: np.ndarray
) -> tuple[LabTable, np.ndarray]:
    """Without the coordinates, of any bone, that shall not count."""
    seen = dict(zip(UNITS, observed.T, strict=True))
    others = {column: column.rsplit("_", 1)[0] for column in table.readings}
    others = {column: name for column, name in others.items() if name in COORDINATES}
    seen |= {name: table.readings[column] for column, name in others.items()}
    for name in test.coordinates:
        if np.isnan(seen.get(name, np.nan)).all():
            expected = f"coordinates that the table has; not {name}"
            raise test.wrong("coordinates", expected, [*test.coordinates])
    kept = {
        name: sizes for name, sizes in table.readings.items()
        if others.get(name, name) in test.coordinates or name not in others
    }  # fmt: skip
    observed = np.where([name in test.coordinates for name in UNITS], observed, np.nan)
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


def _limited(test: StudyTest, table: LabTable) -> LabTable:
    """The rows at flexions that count."""
    if test.flexion_deg is None:
        return table
    wanted = test.flexion_deg
    inside = np.isclose(table.flexion_deg[:, None], wanted, atol=1e-6)
    if not inside.any(axis=0).all():
        absent = wanted[~inside.any(axis=0)][0]
        measured = ", ".join(f"{x:g}" for x in np.unique(table.flexion_deg))
        expected = f"of the flexions that were measured, {measured}; not {absent:g}"
        raise test.wrong("flexion_deg", expected, wanted.tolist())
    return table.take(inside.any(axis=1))


def _table_of(test: StudyTest) -> tuple[LabTable, str | None]:
    """The table that a test names, published or not, and what a published one is counted from."""
    from kneejax.experiments import WITHOUT_LOADS
    from kneejax.files import bundled_bands, read_lab_table

    given, name = test.model_fields_set, test.file
    if os.path.isabs(name):
        if "load" in given:
            expected = "no load of a published table: this one has columns of loads"
            raise test.wrong("load", expected)
        unloaded = test.counted_from in WITHOUT_LOADS
        return read_lab_table(
            name, test.columns, test.at_deg, test.convention, test.ignore, unloaded=unloaded
        ), None
    published = published_motions()
    for field in _OF_OWN_TABLES:
        if field in given and not (field == "ignore" and name in published):
            raise test.wrong(field, f"this field left out: {name} comes with the package")
    if name not in published:
        return published_laxity(test, bundled_bands(name=name))
    for field in ("load", "counted_from"):
        if field in given:
            raise test.wrong(field, f"this field left out: {name} says it itself")
    own = published[name]
    table = read_lab_table(own.path, own.columns, ignore=test.ignore, unloaded=True)
    return table, own.counted_from


def published_laxity(test: StudyTest, bands: Sequence[LaxityBand]) -> tuple[LabTable, str | None]:
    """The rows of a published laxity, of knees with those ligaments cut that the test had cut.

    Args:
        test: of the test; where the load is not known, with it as `load: {internal_Nm: 5}`.
        bands: of the laxity.

    Raises:
        InputProblem: it is no test of one knee, or its load is not known and not stated.
    """
    from kneejax.files import LabTable
    from kneejax.mechanics import load_called

    name = bands[0].name
    if bands[0].end == "range_increase":
        raise test.wrong("file", f"a test of one knee; not {name}, a difference that cutting makes")
    own = [band for band in bands if {*band.cut} == {*test.cut}]
    if not own:
        known = sorted({" and ".join(band.cut) or "nothing" for band in bands})
        value = test.cut[0] if len(test.cut) == 1 else None
        expected = f"{name} with {' or '.join(known)} cut, as it was measured"
        raise test.wrong("cut" if test.cut else "file", expected, value)
    load, size = own[0].load, _size(test, own[0])
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
    if ranges and test.counted_from:
        expected = f"this field left out: {name} is of ranges between opposite loads"
        raise test.wrong("counted_from", expected)
    counted = "opposite" if ranges else own[0].counted_from
    return LabTable(flexion, {load: sizes}, observed), counted


def _size(test: StudyTest, band: LaxityBand) -> float:
    """The load of a table, as published or as the study states it."""
    unknown, load = np.isnan(band.size), band.load
    if "load" not in test.model_fields_set:
        if unknown:
            raise test.wrong(
                "file",
                f"load: {{{load}: ...}} beside it, since the load of {band.name} is not known",
            )
        return band.size
    if not unknown:
        expected = f"this field left out: {band.name} was measured under {load} {band.size:g}"
        raise test.wrong("load", expected)
    given = Field("", "load", test.load).mapping((load,))[load]
    size = given.number(RANGES[load])
    if not size > 0:
        raise given.problem("the size of the load, above 0")
    return size
