"""Tests of a study that come with the package, by their names."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np

from kneejax.files import (
    LabTable,
    LaxityBand,
    Measurement,
    bundled_bands,
    bundled_laxity_sources,
    bundled_measurements,
    read_lab_table,
)
from kneejax.files.reading import Field
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import RANGES, load_called

#: Fields of a test that say what stands in a table of one's own.
_OF_OWN_TABLES = ("columns", "ignore", "convention", "mirror", "at_deg")


class PublishedTest(NamedTuple):
    """A published test.

    Attributes:
        table: what acted and what was read.
        counted_from: what it is counted from where a study says nothing else; None of a table of
            one's own.
    """

    table: LabTable
    counted_from: str | None = None


def published_test(item: Field, cut: Collection[str] = ()) -> PublishedTest:
    """The published laxity, or the published motion, that a test names.

    Args:
        item: the test; a laxity whose load is not known needs it as `load: {internal_Nm: 5}`.
        cut: ligaments that the test had cut.

    Raises:
        InputProblem: there is no such table, it is no test of one knee, its load is not known and
            not stated, or a field is of tables of one's own.
    """
    name = item["file"].text()
    measured = {k: x for k, x in bundled_measurements().items() if x.use == "test"}
    known = (*bundled_laxity_sources(), *measured)
    if name not in known:
        expected = f"a CSV table, or a published test ({', '.join(known)})"
        raise item["file"].problem(expected, known)
    for field in _OF_OWN_TABLES:
        if field in item and not (field == "ignore" and name in measured):
            raise item[field].problem(f"this field left out: {name} comes with the package")
    if name in measured:
        return _motion(item, measured[name])
    return _laxity(item, bundled_bands(name=name), cut)


def ignored(item: Field) -> tuple[str, ...]:
    """Columns of a test's table that are left out on purpose."""
    return tuple(one.text() for one in item["ignore"].items("columns")) if "ignore" in item else ()


def _motion(item: Field, measured: Measurement) -> PublishedTest:
    for field in ("load", "counted_from"):
        if field in item:
            raise item[field].problem(f"this field left out: {item['file'].value} says it itself")
    table = read_lab_table(
        measured.path, measured.columns, ignore=ignored(item), unloaded=True
    )
    return PublishedTest(table, measured.counted_from)


def _laxity(item: Field, bands: Sequence[LaxityBand], cut: Collection[str]) -> PublishedTest:
    if bands[0].end == "range_increase":
        raise item["file"].problem(
            f"a test of one knee; not {bands[0].name}, a difference that cutting makes"
        )
    own = [band for band in bands if set(band.cut) == set(cut)]
    if not own:
        known = sorted({" and ".join(band.cut) or "nothing" for band in bands})
        raise item["cut" if cut else "file"].problem(
            f"{bands[0].name} with {' or '.join(known)} cut, as it was measured"
        )
    load, size = own[0].load, _size(item, own[0])
    (column,) = [k for k, c in enumerate(FREE_COORDINATES) if load_called(c) == load]
    rows = []  # flexion, load, reading
    for band in own:
        sense = -1.0 if band.end == "negative" else 1.0
        rows += [(x, sense * size, y) for x, y in zip(band.flexion_deg, band.mean, strict=True)]
        if band.end == "range":
            rows += [(x, -size, 0.0) for x in band.flexion_deg]
    flexion, sizes, read = np.array(rows).T
    observed = np.full((len(rows), len(FREE_COORDINATES)), np.nan)
    observed[:, column] = read
    ranges = any(band.end == "range" for band in own)
    if ranges and "counted_from" in item:
        expected = f"this field left out: {own[0].name} is of ranges between opposite loads"
        raise item["counted_from"].problem(expected)
    counted = "opposite" if ranges else own[0].counted_from
    return PublishedTest(LabTable(flexion, {load: sizes}, observed), counted)


def _size(item: Field, band: LaxityBand) -> float:
    """The load of a table, as published or as the study states it."""
    unknown = np.isnan(band.size)
    if "load" not in item:
        if unknown:
            raise item["file"].problem(
                f"load: {{{band.load}: ...}} beside it, since the load of {band.name} is not known"
            )
        return band.size
    if not unknown:
        expected = f"this field left out: {band.name} was measured under {band.load} {band.size:g}"
        raise item["load"].problem(expected)
    size = item["load"].mapping((band.load,))[band.load].number(RANGES[band.load])
    if not size > 0:
        raise item["load"][band.load].problem("the size of the load, above 0")
    return size
