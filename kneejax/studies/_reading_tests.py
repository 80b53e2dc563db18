"""Tests under load of a study, from their tables."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.experiments import COUNTED_FROM, WITHOUT_LOADS, MeasuredTest
from kneejax.files import LabTable, parse_flexion, read_lab_table
from kneejax.files.reading import Field
from kneejax.geometry import CLINICAL, COLUMNS, CONVENTIONS, FREE_COORDINATES
from kneejax.mechanics import NAMED_LOADS, RANGES
from kneejax.studies._published_tests import PublishedTest, published_test

#: Signs of a left knee in axes with Z to the person's right: adduction, internal rotation and
#: lateral shift change.
MIRROR = (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)
_OPTIONAL = (
    "source", "columns", "ignore", "convention", "mirror", "flexion_deg", "at_deg", "coordinates",
    "counted_from", "constant", "load", "point_mm", "sd_mm", "sd_deg",
)  # fmt: skip


def read_tests(field: Field, folder: Path) -> list[tuple[MeasuredTest, dict[str, Any]]]:
    """The tests of a study, each with what the file says of it.

    Args:
        field: the list `tests`.
        folder: to which paths of tables are relative.

    Raises:
        InputProblem: a field or a table is not what it should be.
    """
    return [_read(item, folder) for item in field.items("tests")]


def _read(item: Field, folder: Path) -> tuple[MeasuredTest, dict[str, Any]]:
    item.mapping(("name", "file"), _OPTIONAL)
    mirror = "mirror" in item and item["mirror"].boolean()
    table, counted_from = _table(item, folder)
    flexion, loads, observed = _limited(item, table)
    if mirror:
        observed = observed * MIRROR[1:]
        loads |= {"lateral_N": -loads["lateral_N"]} if "lateral_N" in loads else {}
    if "coordinates" in item:
        names = [one.choice(FREE_COORDINATES) for one in item["coordinates"].items("coordinates")]
        for name in names:
            if np.isnan(observed[:, FREE_COORDINATES.index(name)]).all():
                raise item["coordinates"].problem(f"coordinates that the table has; not {name}")
        observed = np.where([name in names for name in FREE_COORDINATES], observed, np.nan)
    constant = item["constant"].mapping((), tuple(NAMED_LOADS)) if "constant" in item else None
    given: dict[str, Any] = {} if counted_from is None else {"counted_from": counted_from}
    for name in ("sd_mm", "sd_deg"):
        if name in item:
            given[name] = item[name].number(RANGES[f"noise_{name[3:]}"])
    if "counted_from" in item:
        given["counted_from"] = item["counted_from"].choice(COUNTED_FROM)
    if "point_mm" in item:
        given["point_mm"] = tuple(item["point_mm"].numbers(3, RANGES["point_mm"]))
    if constant is not None:
        given["constant"] = {name: constant[name].number(RANGES[name]) for name in constant.value}
    try:
        test = MeasuredTest(item["name"].text(), flexion, loads, observed, **given)
    except ValueError as problem:
        part, found, expected = _parts(str(problem))
        raise Field(item.file, f"{item.path}.{part}", found).problem(expected) from None
    return test, dict(item.value) | {"file": _path(item["file"], folder) or item.value["file"]}


def _parts(sentence: str) -> tuple[str, str, str]:
    """What a test does not take, in the parts of an error: where, what, what was expected."""
    place, rest = sentence.split(": ", 1)
    found, expected = rest.split("; expected ", 1)
    return place, found, expected


def _path(field: Field, folder: Path) -> str:
    """Where the table is; empty for one that comes with the package."""
    path = folder / field.text()
    return os.path.abspath(path) if path.is_file() else ""


def _table(item: Field, folder: Path) -> PublishedTest:
    file = _path(item["file"], folder)
    if not file:
        return published_test(item)
    if "load" in item:
        raise item["load"].problem("no load of a published table: this one has columns of loads")
    columns = {}
    if "columns" in item:
        renamed = item["columns"].mapping((), (*NAMED_LOADS, *COLUMNS))
        columns = {name: renamed[name].text() for name in renamed.value}
    ignore = [one.text() for one in item["ignore"].items("columns")] if "ignore" in item else []
    at = item["at_deg"].number(RANGES["flexion_deg"]) if "at_deg" in item else None
    convention = item["convention"].choice(CONVENTIONS) if "convention" in item else CLINICAL
    unloaded = "counted_from" in item and item["counted_from"].value in WITHOUT_LOADS
    return PublishedTest(
        read_lab_table(file, columns, at, convention, tuple(ignore), unloaded=unloaded)
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
    rows = inside.any(axis=1)
    loads = {name: sizes[rows] for name, sizes in table.loads.items()}
    return LabTable(table.flexion_deg[rows], loads, table.observed[rows])
