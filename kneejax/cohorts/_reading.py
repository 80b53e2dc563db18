"""A cohort from its files: a folder or a pattern of studies, or a template and a table of knees.

All rows are read before a mistake is reported: a person corrects a table once, not once a row.
"""

__all__ = ["Cohort", "Member", "is_cohort", "read_cohort"]

import copy
import dataclasses
import glob
import os
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import PlainValidator, ValidationInfo

from kneejax import files, studies
from kneejax.files import reading
from kneejax.files.reading import Mistakes, Part, Text, entries, load_yaml, meaning, text, wrong
from kneejax.studies import STUDY_FIELDS, Study, study_of

_COHORT_FILE, _STUDY_FILE = "cohort.yaml", "study.yaml"
_NAME = re.compile(r"[A-Za-z0-9][\w.+-]*")
#: Fields of a study in which a column names an entry, dots and all: `set.ACL.stiffness`.
_WITH_ENTRIES = ("start", "bounds", "prior", "set", "weights", "loads", "measured", "synthetic")
_COLUMNS = ("name, side, about's, or a field of the study: knee, measured.file, TEST.file, "
            "noise_mm, set.ACL.stiffness, ...")  # fmt: skip


def _template(value: Any, info: ValidationInfo) -> Any:
    """The fields of a study as they are, or the file that has them."""
    if isinstance(value, dict):
        return value
    known, name = files.bundled_studies(), text(value)
    if name in known and os.path.isfile(path := files.named_path("studies", name)):
        return path
    kind = "a study file, its fields, or a bundled study"
    return Path(studies.file_named(value, info, kind, known))


def _knees(value: Any, info: ValidationInfo) -> Any:
    """Rows as they are, or the table that has them."""
    if not isinstance(value, list):
        kind = "a CSV table with one row a knee, or a list of knees"
        return Path(studies.file_named(value, info, kind))
    expected = "a mapping with the field name, and what differs"
    mistakes = Mistakes()
    mistakes += [wrong(row, expected, at=f"[{number}]")
                 for number, row in enumerate(reading.items(value, "knees"))
                 if not isinstance(row, dict)]  # fmt: skip
    mistakes.check()
    return value


class CohortFile(Part):
    """All that a cohort file may say."""

    title: Text = meaning("for reports")
    study: Annotated[Any, PlainValidator(_template)] = meaning(
        "the template: a study file, a bundled study, or its fields")
    knees: Annotated[Any, PlainValidator(_knees)] = meaning(
        "CSV table with one row a knee, or a list")
    about: Annotated[tuple[Text, ...], entries("columns")] = meaning(
        "columns that are carried along", ())


@dataclasses.dataclass(frozen=True, eq=False)
class Member:
    """One knee of a cohort.

    Attributes:
        name: of the knee; of its folder of results too.
        study: what is asked of it.
        about: what else is known of it, e.g. `mass_kg`, as the table says; carried along.
        place: file and row where it stands, for errors.
    """

    name: str
    study: Study
    about: Mapping[str, float | str] = dataclasses.field(default_factory=dict)
    place: str = ""


@dataclasses.dataclass(frozen=True, eq=False)
class Cohort:
    """Knees that are calibrated together.

    Attributes:
        title: for reports.
        members: one a knee, in the order of the file or of their names.
        file: where the cohort stands.

    Example:
        >>> Cohort("none yet", (), "cohort.yaml").title
        'none yet'
    """

    title: str
    members: Sequence[Member]
    file: str


def is_cohort(name_or_path: str | os.PathLike[str]) -> bool:
    """Whether a cohort is meant, not a single study: a folder, a pattern, or a file with knees.

    Example:
        >>> is_cohort("paper1"), is_cohort("specimens/*.yaml")
        (False, True)
    """
    path = Path(name_or_path)
    if glob.has_magic(os.fspath(name_or_path)) and not os.path.exists(path):
        return True
    if os.fspath(name_or_path) in files.bundled_studies():
        return False
    if not os.path.isfile(path) or path.suffix.lower() not in (".yaml", ".yml"):
        return os.path.isdir(path)
    document = load_yaml(path, "a study or a cohort file")
    return isinstance(document, dict) and "knees" in document


def read_cohort(name_or_path: str | os.PathLike[str]) -> Cohort:
    """Read a cohort and check every knee of it.

    Args:
        name_or_path: a folder (its `cohort.yaml`, or all studies in it: `*.yaml` and
            `*/study.yaml`), a pattern such as `specimens/*.yaml`, or a file like `cohort.yaml`:
            a `title`, a `study` (the template, as a study file or as its fields), `knees` (a CSV
            table, or a list) and `about` (columns that are only carried along).

    Returns:
        The cohort.

    Raises:
        InputProblems: every mistake of every row, with its file and row.
        InputProblem: there is no cohort at all.
    """
    path, mistakes = Path(name_or_path), Mistakes()
    own = path / _COHORT_FILE if os.path.isdir(path) else path
    title, file, found = path.name, os.fspath(name_or_path), _from_studies(path, mistakes)
    if os.path.isfile(own):
        document = load_yaml(own, "a cohort file")
        whole = reading.checked(CohortFile, document, os.fspath(own), folder=own.parent)
        title, file, found = whole.title, os.fspath(own), _from_rows(whole, own, mistakes)
    seen: dict[str, Member] = {}
    twice = []
    for name, document, place, folder, about in found:
        with mistakes.gathered():
            if not _NAME.fullmatch(name):
                expected = "a name of letters, digits, ., _, + or -, which its folder has too"
                raise files.InputProblem(place, "name", name, expected)
            one = Member(name, study_of(document, place, folder), about, place)
            # Folders of results may not tell capitals from others.
            if (before := seen.setdefault(name.lower(), one)) is not one:
                expected = f"every knee by a name of its own; {before.place} has it too"
                twice.append(files.InputProblem(place, "name", name, expected))
    if mistakes or twice:
        raise files.InputProblems([*mistakes, *twice])
    return Cohort(title, tuple(seen.values()), file)


#: Name of a knee, what is asked of it, where that stands, its folder, what else is known of it.
_Row = tuple[str, Any, str, Path, dict[str, float | str]]


def _from_studies(pattern: Path, mistakes: Mistakes) -> Iterator[_Row]:
    """Every study that a folder or a pattern names."""
    if pattern.is_dir():
        names = ("*.yaml", "*.yml", f"*/{_STUDY_FILE}")
        found = [file for name in names for file in pattern.glob(name)]
        expected = f"{_COHORT_FILE}, or studies as *.yaml or */{_STUDY_FILE} in this folder"
    else:
        found = [Path(one) for one in glob.glob(os.fspath(pattern), recursive=True)]
        expected = "a pattern of at least one study file"
    count = 0
    for file in sorted(found):
        count += 1
        with mistakes.gathered():
            document = load_yaml(file, "a study file")
            if isinstance(document, dict) and "kneejax" in document:
                count -= 1
                continue  # a knee may lie beside the study that begins with it
            name = file.parent.name if file.name == _STUDY_FILE else file.stem
            yield name, document, os.fspath(file), file.parent, {}
    if not count:
        raise files.InputProblem("cohort", "folder", os.fspath(pattern), expected)


def _from_rows(whole: CohortFile, own: Path, mistakes: Mistakes) -> Iterator[_Row]:
    """Every row of a cohort file's knees."""
    template, folder = whole.study, own.parent
    if isinstance(template, Path):
        path, folder = template, template.parent
        template = load_yaml(path, "a study file")
        if not isinstance(template, dict):
            raise files.InputProblem(path, "file", template, "a study file")
    if isinstance(whole.knees, list):
        rows = {f"{own}: knees[{number}]": row for number, row in enumerate(whole.knees)}
    else:
        from kneejax.files.tables.tables import Table  # imports JAX

        table = Table.read(whole.knees, ["name"])
        # A name may be a number, or the word no.
        rows = {
            f"{whole.knees}: row {number}": {
                column: cell.strip() if column == "name" else _value(cell)
                for column, cell in zip(table.header, cells, strict=True) if cell.strip()}
            for number, (_, cells) in enumerate(table.rows, 1)}  # fmt: skip
    for place, row in rows.items():
        name = str(row.get("name", ""))
        # A name that is too long is refused below; here it only says which row is meant.
        place = f"{place} ({textwrap.shorten(name, 60, placeholder='...')})" if name else place
        with mistakes.gathered():
            known, document = _overlaid(place, row, template, folder, own.parent, whole.about)
            yield name, document, place, folder, known


def _value(cell: str) -> Any:
    """A cell as a YAML file would give it: a number, a truth value, or a text."""
    text = cell.strip()
    if text.lower() in ("true", "false"):
        return text.lower() == "true"
    number = reading.plain_number(text)
    whole = number is not None and text.lstrip("+-").isdigit()
    return int(text) if whole else text if number is None else number


def _overlaid(
    place: str, cells: Mapping[str, Any], template: Mapping[str, Any], folder: Path, beside: Path,
    about: Sequence[str],
) -> tuple[dict[str, float | str], dict[str, Any]]:  # fmt: skip
    """What else is known of a row's knee, and the fields of its study. Files of the row are
    relative to the folder `beside`, those of the template and of the study to `folder`."""
    if not str(cells.get("name", "")).strip():
        raise files.InputProblem(place, "name", "missing", "a name for this knee")
    known, document = {}, copy.deepcopy(dict(template))
    document["title"] = f"{document.get('title', 'Knee')}: {cells['name']}"
    listed = document.get("tests")
    tests = [one for one in listed if isinstance(one, dict)] if isinstance(listed, list) else []
    named = {one["name"]: one for one in tests if isinstance(one.get("name"), str)}
    bundled = {**files.bundled_knees(), **files.bundled_measurements()}
    for column, value in cells.items():
        if column in about:
            if not isinstance(value, str | int | float):
                raise files.InputProblem(place, column, value, "a number or a text")
            known[column] = value
        if column in (*about, "name", "side"):
            continue
        is_file = column in ("knee", "prior") or column.endswith(".file")
        if is_file and isinstance(value, str) and value not in bundled:
            value = os.path.relpath(beside / value, folder)
        first, _, rest = column.partition(".")
        test = next((name for name in named if column.startswith(f"{name}.")), None)
        if test is not None:
            named[test][column[len(test) + 1 :]] = value
        elif column in STUDY_FIELDS:
            document[column] = value
        elif rest and first in _WITH_ENTRIES:
            inner = document.setdefault(first, {})
            if not isinstance(inner, dict):
                raise files.InputProblem(place, column, value, f"{first} of the template as fields")
            inner[rest] = value
        else:
            near = [*STUDY_FIELDS, "measured.file", *(f"{name}.file" for name in named)]
            expected = f"no such column, but {_COLUMNS}"
            raise files.InputProblem(place, "column", column, expected, near)
    if "side" in cells:
        mistakes, side = Mistakes(place), ""
        with mistakes.gathered("side"):
            side = reading.choice(cells["side"], ("right", "left", "r", "l"))
        mistakes.check()
        for one in (document.get("measured"), *tests):
            # A left knee's tables are mirrored; what comes with the package is of right knees.
            if isinstance(one, dict) and str(one.get("file")) not in files.bundled_measurements():
                one["mirror"] = side.startswith("l")
    return known, document
