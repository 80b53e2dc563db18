"""Rows of a cohort's table: what of a study is this knee's own."""

from __future__ import annotations

import copy
import dataclasses
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from kneejax.files import InputProblem, bundled_knees, bundled_measurements
from kneejax.files.reading import Field, plain_number
from kneejax.files.tables import read_rows

_SIDES = ("right", "left", "r", "l")
#: Fields of a study whose entries are named by a person, dots and all.
_BY_NAME = ("start", "bounds", "prior", "set", "weights", "loads")
_NESTED = ("measured", "synthetic")
#: Columns of the table itself.
_NAME, _SIDE = "name", "side"
_COLUMNS = (
    "name, side, about's, or a field of the study: knee, measured.file, TEST.file, noise_mm, "
    "set.ACL.stiffness, ..."
)


@dataclasses.dataclass(frozen=True)
class Row:
    """A knee as its row says.

    Attributes:
        place: file and row, for errors.
        cells: column -> what stands there, without empty ones.
    """

    place: str
    cells: Mapping[str, Any]

    def study(
        self, template: Mapping[str, Any], folder: Path, beside: Path, about: Sequence[str]
    ) -> tuple[str, dict[str, float | str], dict[str, Any]]:
        """The study of this knee.

        Args:
            template: fields that all knees share.
            folder: to which paths of the template are relative.
            beside: to which paths of the row are.
            about: columns that are no fields.

        Returns:
            Its name, what else is known of it, and the fields of its study.

        Raises:
            InputProblem: a column means nothing in a study.
        """
        if not str(self.cells.get(_NAME, "")).strip():
            raise InputProblem(self.place, _NAME, "missing", "a name for this knee")
        name = str(self.cells[_NAME])
        document = copy.deepcopy(dict(template))
        document["title"] = f"{document.get('title', 'Knee')}: {name}"
        known = {}
        for column, value in self.cells.items():
            if column in about:
                if not isinstance(value, str | int | float):
                    raise InputProblem(self.place, column, value, "a number or a text")
                known[column] = value
            elif column not in (_NAME, _SIDE):
                self._set(document, column, self._path(column, value, folder, beside))
        if _SIDE in self.cells:
            self._turn(document)
        return name, known, document

    def _path(self, column: str, value: Any, folder: Path, beside: Path) -> Any:
        """A file of the row, as the template's folder sees it."""
        is_file = column == "knee" or column.endswith(".file") or column == "prior"
        known = {**bundled_knees(), **bundled_measurements()}
        if not (is_file and isinstance(value, str)) or value in known:
            return value
        return os.path.relpath(beside / value, folder)

    def _set(self, document: dict[str, Any], column: str, value: Any) -> None:
        first, _, rest = column.partition(".")
        tests = {t["name"]: t for t in _listed_in(document, "tests") if _named(t)}
        owner = next((n for n in tests if column.startswith(f"{n}.")), None)
        if owner is not None:
            tests[owner][column[len(owner) + 1 :]] = value
        elif not rest:
            if first not in _FIELDS:
                raise self._unknown(column, [*_FIELDS, *(f"{n}.file" for n in tests)])
            document[first] = value
        elif first in (*_BY_NAME, *_NESTED):
            inner = document.setdefault(first, {})
            if not isinstance(inner, dict):
                raise InputProblem(self.place, column, value, f"{first} of the template as fields")
            inner[rest] = value
        else:
            raise self._unknown(column, [*(f"{n}.file" for n in tests), "measured.file"])

    def _unknown(self, column: str, near: Sequence[str]) -> InputProblem:
        return InputProblem(self.place, "column", column, f"no such column, but {_COLUMNS}", near)

    def _turn(self, document: dict[str, Any]) -> None:
        """A left knee's tables are mirrored; its knee file says itself whose it is."""
        side = Field(self.place, _SIDE, self.cells[_SIDE]).choice(_SIDES)
        places = [document.get("measured"), *_listed_in(document, "tests")]
        for one in places:
            # What comes with the package is of right knees, as it says itself.
            if isinstance(one, dict) and str(one.get("file")) not in bundled_measurements():
                one["mirror"] = side.startswith("l")


def read_knees(field: Field, folder: Path) -> list[Row]:
    """Rows of a cohort's knees.

    Args:
        field: a CSV table, or a list of mappings.
        folder: to which the table's path is relative.

    Raises:
        InputProblem: there is no such table, or it has no column `name`.
    """
    if isinstance(field.value, list):
        return [_listed(item) for item in field.items("knees")]
    path = folder / field.text()
    if not os.path.isfile(path):
        raise field.problem(f"a CSV table with one row a knee, or a list of knees; not at {path}")
    header, rows = read_rows(os.fspath(path), [_NAME])
    found = []
    for number, (_, cells) in enumerate(rows, 1):
        values = dict(zip(header, cells, strict=True))
        named = {column: _value(cell) for column, cell in values.items() if cell.strip()}
        # A name may be a number, or the word no.
        named |= {_NAME: values[_NAME].strip()}
        place = f"{path}: row {number}" + f" ({named[_NAME]})" * bool(named[_NAME])
        found.append(Row(place, named))
    return found


def _listed(item: Field) -> Row:
    if not isinstance(item.value, dict):
        raise item.problem("a mapping with the field name, and what differs")
    name = item.value.get(_NAME, "")
    return Row(f"{item.file}: {item.path}" + f" ({name})" * bool(name), item.value)


def _value(cell: str) -> Any:
    """A cell as a file would give it: a number, a truth value, or a text."""
    text = cell.strip()
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    number = plain_number(text)
    if number is None:
        return text
    return int(text) if text.lstrip("+-").isdigit() else number


def _listed_in(document: Mapping[str, Any], field: str) -> list[Any]:
    """What a field lists; nothing where it is no list, which the study refuses."""
    found = document.get(field)
    return found if isinstance(found, list) else []


def _named(test: Any) -> bool:
    return isinstance(test, dict) and isinstance(test.get("name"), str)


_FIELDS = (
    "knee", "measured", "synthetic", "parameters", "start", "bounds", "weights", "prior",
    "procedures", "starts", "seed", "noise_mm", "noise_deg", "frame_offset", "method", "loads",
    "set", "flexion_deg",
)  # fmt: skip
