"""Tests under load of a study, from their tables."""

from __future__ import annotations

import dataclasses
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.experiments import (
    COUNTED_FROM,
    WITHOUT_LOADS,
    MeasuredTest,
    against_load,
    weights_by_load,
)
from kneejax.files import InputProblem, LabTable, parse_flexion, read_lab_table
from kneejax.files.reading import Field
from kneejax.geometry import (
    BODIES,
    CLINICAL,
    CONVENTIONS,
    COORDINATES,
    FREE_COORDINATES,
    OTHER_COLUMNS,
)
from kneejax.mechanics import AXES, NAMED_LOADS, RANGES
from kneejax.numerics import WrongValue
from kneejax.studies._frames import read_frames, refused
from kneejax.studies._published_tests import PublishedTest, ignored, published_test

#: Signs of a left knee in axes with Z to the person's right: adduction, internal rotation and
#: lateral shift change.
MIRROR = (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)
#: The same of other bones, by column.
_MIRROR_OTHERS = {
    one.column: sign
    for bone in BODIES.values()
    for one, sign in zip(bone.values(), MIRROR, strict=True)
    if one.column in OTHER_COLUMNS
}
#: Coordinates of other bones by name -> column.
_OTHERS = {one.name: column for column, one in OTHER_COLUMNS.items()}
#: Words for the negative sense of a load or a coordinate.
_OTHER_SENSE = re.compile(
    r"posterior|medial|inferior|distal|distraction|valgus|abduction|external", re.IGNORECASE
)
_OPTIONAL = (
    "source", "columns", "ignore", "convention", "mirror", "flexion_deg", "at_deg", "coordinates",
    "counted_from", "loads", "load", "point_mm", "axes", "sd_mm", "sd_deg", "sd_N", "sd_strain",
    "cut", "weight", "in_time",
)  # fmt: skip
#: Option of a test -> what a standard deviation may be.
_SPREADS = {
    "sd_mm": RANGES["noise_mm"],
    "sd_deg": RANGES["noise_deg"],
    "sd_N": RANGES["tension_N"],
    "sd_strain": RANGES["strain"].spread,
}
#: Weights in proportion to the load.
_BY_LOAD = "by_load"


def read_tests(
    field: Field, folder: Path, lines: Sequence[str] = ()
) -> list[tuple[MeasuredTest, dict[str, Any]]]:
    """The tests of a study, each with what the file says of it.

    Args:
        field: the list `tests`.
        folder: to which paths of tables are relative.
        lines: of constant tension and muscles that the knee has (`Knee.pullable`); a table's column
            of such a tension is added to it.

    Raises:
        InputProblem: a field or a table is not what it should be.
    """
    return [_read(item, folder, lines) for item in field.items("tests")]


def _read(item: Field, folder: Path, lines: Sequence[str]) -> tuple[MeasuredTest, dict[str, Any]]:
    if isinstance(item.value, dict) and "constant" in item.value and "loads" not in item.value:
        # The older name of what a study calls loads too.
        names = {"constant": "loads"}
        item = Field(item.file, item.path, {names.get(k, k): v for k, v in item.value.items()})
    item.mapping(("name", "file"), _OPTIONAL)
    mirror = "mirror" in item and item["mirror"].boolean()
    table, counted_from = _table(item, folder)
    table = _limited(item, table)
    flexion, loads, observed = table[:3]
    if mirror:
        observed = observed * MIRROR[1:]
        loads |= {"lateral_N": -loads["lateral_N"]} if "lateral_N" in loads else {}
        turned = {name: x * _MIRROR_OTHERS.get(name, 1.0) for name, x in table.readings.items()}
        table = table._replace(readings=turned)
    if "coordinates" in item:
        table, observed = _that_count(item["coordinates"], table, observed)
    tensions, readings = _pulls(item, table, lines)
    given: dict[str, Any] = {
        "readings": readings, "tensions": tensions, "weight": _weight(item, table),
        "cut": _cut(item),
    }  # fmt: skip
    given["frames"] = read_frames(item, table, flexion)
    given |= {} if counted_from is None else {"counted_from": counted_from}
    for name, allowed in _SPREADS.items():
        if name in item:
            given[name] = item[name].number(allowed)
    if "counted_from" in item:
        given["counted_from"] = item["counted_from"].choice(COUNTED_FROM)
    if "point_mm" in item:
        given["point_mm"] = tuple(item["point_mm"].numbers(3, RANGES["point_mm"]))
    if "axes" in item:
        given["axes"] = item["axes"].choice(AXES)
    if "loads" in item:
        constant = item["loads"].mapping((), tuple(NAMED_LOADS))
        given["constant"] = {name: constant[name].number(RANGES[name]) for name in constant.value}
        if mirror and "lateral_N" in given["constant"]:
            given["constant"]["lateral_N"] *= -1.0
    try:
        test = MeasuredTest(item["name"].text(), flexion, loads, observed, **given)
        if item.value.get("weight") == _BY_LOAD:
            weight = weights_by_load(test.loads[test.driven_by])
            test = dataclasses.replace(test, weight=weight)
    except WrongValue as problem:
        raise refused(item, problem) from None
    _check_sense(item, test, folder)
    return test, dict(item.value) | {"file": _path(item["file"], folder) or item.value["file"]}


def _check_sense(item: Field, test: MeasuredTest, folder: Path) -> None:
    """Refuse a curve along which the tibia moves against its load, by the column suspected."""
    found = against_load(test)
    if found is None:
        return
    said = item.value.get("columns", {})
    moved = COORDINATES[found.coordinate].column
    columns = {name: str(said.get(name, name)) for name in (moved, found.load)}
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
    raise InputProblem(
        _path(item["file"], folder) or item["file"].text(),
        column,
        f"{moved} from {low:g} to {high:g} at {found.flexion_deg:g} degrees",
        f"a coordinate that rises with its load, {found.load} from {least:g} to {most:g} {unit}: "
        f'a column of the other sense is suspected; write {name}: "{turned}" under columns, or '
        "turn the other column round",
    )


def _that_count(field: Field, table: LabTable, observed: np.ndarray) -> tuple[LabTable, np.ndarray]:
    """Without the coordinates, of any bone, that shall not count."""
    names = [one.choice((*FREE_COORDINATES, *_OTHERS)) for one in field.items("coordinates")]
    seen = dict(zip(FREE_COORDINATES, observed.T, strict=True))
    for name in names:
        if np.isnan(seen.get(name, table.readings.get(_OTHERS.get(name, ""), np.nan))).all():
            raise field.problem(f"coordinates that the table has; not {name}")
    kept = {
        name: sizes for name, sizes in table.readings.items()
        if name not in OTHER_COLUMNS or OTHER_COLUMNS[name].name in names
    }  # fmt: skip
    observed = np.where([name in names for name in FREE_COORDINATES], observed, np.nan)
    return table._replace(readings=kept), observed


def _pulls(item: Field, table: LabTable, lines: Sequence[str]):
    """Tensions that act along lines of the knee, and what was read of its parts."""
    acting, read = {}, dict(table.readings)
    for line in lines:
        tension = read.pop(f"{line}.tension_N", None)
        if tension is not None:
            acting[line] = tension
            if np.isnan(tension).any():
                row = int(np.flatnonzero(np.isnan(tension))[0]) + 1
                place = Field(item.file, f"{item.path}.file: {line}.tension_N, row {row}", "empty")
                raise place.problem("a tension in every row, since it acts on the knee")
    return acting, read


def _cut(item: Field) -> tuple[str, ...]:
    """Ligaments or groups that had been cut."""
    if "cut" not in item:
        return ()
    one = isinstance(item.value["cut"], str)
    listed = [item["cut"]] if one else item["cut"].items("ligaments")
    return tuple(name.text() for name in listed)


def _weight(item: Field, table: LabTable) -> np.ndarray | None:
    """Of each row, where the table says so; one of the two ways at most."""
    if "weight" in item:
        item["weight"].choice((_BY_LOAD,))
        if table.weight is not None:
            raise item["weight"].problem("this field left out: the table has a column weight")
    return table.weight


def _path(field: Field, folder: Path) -> str:
    """Where the table is; empty for one that comes with the package."""
    path = folder / field.text()
    return os.path.abspath(path) if os.path.isfile(path) else ""


def _table(item: Field, folder: Path) -> PublishedTest:
    file = _path(item["file"], folder)
    if not file:
        return published_test(item, _cut(item))
    if "load" in item:
        raise item["load"].problem("no load of a published table: this one has columns of loads")
    columns = {}
    if "columns" in item:
        renamed = item["columns"]
        if not isinstance(renamed.value, dict):
            raise renamed.problem("a mapping from a name to a column of the file")
        columns = {name: renamed[name].text() for name in renamed.value}
    at = item["at_deg"].number(RANGES["flexion_deg"]) if "at_deg" in item else None
    convention = item["convention"].choice(CONVENTIONS) if "convention" in item else CLINICAL
    unloaded = "counted_from" in item and item["counted_from"].value in WITHOUT_LOADS
    return PublishedTest(
        read_lab_table(file, columns, at, convention, ignored(item), unloaded=unloaded)
    )


def _limited(item: Field, table: LabTable) -> LabTable:
    """The rows at flexions that count."""
    if "flexion_deg" not in item:
        return table
    field = item["flexion_deg"]
    if isinstance(field.value, str):
        wanted = parse_flexion(field.value, field.file, field.path)
    else:
        wanted = np.array(field.numbers(allowed=RANGES["flexion_deg"]))
    inside = np.isclose(table.flexion_deg[:, None], wanted, atol=1e-6)
    if not inside.any(axis=0).all():
        absent = wanted[~inside.any(axis=0)][0]
        measured = ", ".join(f"{x:g}" for x in np.unique(table.flexion_deg))
        raise field.problem(f"of the flexions that were measured, {measured}; not {absent:g}")
    return table.take(inside.any(axis=1))
