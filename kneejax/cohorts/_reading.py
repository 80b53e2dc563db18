"""A cohort from its files: a folder or a pattern of studies, or a template and a table of knees.

Every row is read before anything is said: a person mends a table once, not once for each row.
"""

from __future__ import annotations

import copy
import glob
import os
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from kneejax.cohorts._cohort import Cohort, CohortProblems, Member
from kneejax.cohorts._rows import Row, read_knees
from kneejax.files import (
    InputProblem,
    bundled_knees,
    bundled_measurements,
    bundled_studies,
    study_path,
)
from kneejax.files.reading import Field, load_yaml
from kneejax.mechanics import Implausible
from kneejax.numerics import MissingPackage
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.studies import study_of

#: What a cohort that has a file of its own calls it.
COHORT_FILE = "cohort.yaml"
#: A study in a folder of its own.
_STUDY_FILE = "study.yaml"
_MISTAKES = (InputProblem, UnknownParameter, UnsuitableData, Implausible, MissingPackage)
_NAME = re.compile(r"[A-Za-z0-9][\w.+-]*")


def is_cohort(name_or_path: str | os.PathLike[str]) -> bool:
    """Whether a cohort is meant, not a single study: a folder, a pattern, or a file with knees.

    Example:
        >>> is_cohort("paper1"), is_cohort("specimens/*.yaml")
        (False, True)
    """
    path = Path(name_or_path)
    if glob.has_magic(os.fspath(name_or_path)) and not os.path.exists(path):
        return True
    if os.fspath(name_or_path) in bundled_studies():
        return False
    if os.path.isdir(path):
        return True
    if not os.path.isfile(path) or path.suffix.lower() not in (".yaml", ".yml"):
        return False
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
        CohortProblems: every mistake of every row, with its file and row.
        InputProblem: there is no cohort at all.
    """
    path = Path(name_or_path)
    own = path / COHORT_FILE if os.path.isdir(path) else path
    if os.path.isfile(own):
        title, found = _from_file(own)
    else:
        title, found = path.name, _from_studies(name_or_path)
    members: list[Member] = []
    problems: list[str] = []
    for one in found:
        if isinstance(one, Member):
            members.append(one)
        else:
            problems.append(one)
    problems += _twice(members)
    if problems:
        raise CohortProblems(problems)
    return Cohort(title, tuple(members), os.fspath(own if os.path.isfile(own) else name_or_path))


def _from_studies(pattern: str | os.PathLike[str]) -> Iterator[Member | str]:
    """A member, or what is wrong with it, for every study that a folder or a pattern names."""
    folder = Path(pattern)
    if folder.is_dir():
        files = [*folder.glob("*.yaml"), *folder.glob("*.yml"), *folder.glob(f"*/{_STUDY_FILE}")]
        expected = f"{COHORT_FILE}, or studies as *.yaml or */{_STUDY_FILE} in this folder"
    else:
        files = [Path(one) for one in glob.glob(os.fspath(pattern), recursive=True)]
        expected = "a pattern of at least one study file"
    documents = {}
    for file in sorted(files):
        try:
            document = load_yaml(file, "a study file")
        except InputProblem as problem:
            documents[file] = problem
            continue
        # A knee may lie beside the study that begins with it.
        if not (isinstance(document, dict) and "kneejax" in document):
            documents[file] = document
    if not documents:
        raise InputProblem("cohort", "folder", os.fspath(pattern), expected)
    for file, document in documents.items():
        name = file.parent.name if file.name == _STUDY_FILE else file.stem
        if isinstance(document, InputProblem):
            yield str(document)
        else:
            yield from _member(name, Field(os.fspath(file), "", document), file.parent)


def _from_file(path: Path) -> tuple[str, Iterator[Member | str]]:
    """Title of a cohort file, and its members or what is wrong with them."""
    whole = Field(os.fspath(path), "", load_yaml(path, "a cohort file"))
    whole.mapping(("title", "study", "knees"), ("about",))
    template, folder = _template(whole["study"], path.parent)
    about = [one.text() for one in whole["about"].items("columns")] if "about" in whole else []
    rows = read_knees(whole["knees"], path.parent)
    title = whole["title"].text()
    return title, _from_rows(rows, template, folder, path.parent, about)


def _from_rows(
    rows: list[Row], template: dict[str, Any], folder: Path, beside: Path, about: list[str]
) -> Iterator[Member | str]:
    for row in rows:
        try:
            name, known, document = row.study(template, folder, beside, about)
        except InputProblem as problem:
            yield str(problem)
            continue
        # Paths are those of the template's folder, or whole ones.
        yield from _member(name, Field(row.place, "", document), folder, known)


def _template(field: Field, folder: Path) -> tuple[dict[str, Any], Path]:
    """The fields that knees share, and the folder to which their paths are relative."""
    if isinstance(field.value, dict):
        return copy.deepcopy(field.value), folder
    name = field.text()
    known = bundled_studies()
    path = study_path(name) if name in known else folder / name
    if not os.path.isfile(path):
        expected = f"a study file, its fields, or a bundled study; not at {path}"
        raise field.problem(expected, known)
    document = load_yaml(path, "a study file")
    if not isinstance(document, dict):
        raise InputProblem(path, "file", document, "a study file")
    return document, path.parent


def _member(
    name: str, document: Field, folder: Path, about: Mapping[str, float | str] | None = None
) -> Iterator[Member | str]:
    if not _NAME.fullmatch(name):
        expected = "a name of letters, digits, ., _, + or -, which is that of its folder too"
        yield str(InputProblem(document.file, "name", name, expected))
        return
    missing = [*_missing_files(document, folder)]
    yield from map(str, missing)
    if missing:
        return
    try:
        yield Member(name, study_of(document, folder), dict(about or {}), document.file)
    except _MISTAKES as problem:
        for one in getattr(problem, "problems", (problem,)):
            named = str(one).startswith(f"{document.file}: ")
            yield str(one) if named else f"{document.file}: {one}"


def _missing_files(document: Field, folder: Path) -> Iterator[InputProblem]:
    """Every file that a study names and that is not there, at once."""
    named = {"knee": bundled_knees(), "measured": bundled_measurements()}
    if not isinstance(document.value, dict):
        return
    tests = document.value.get("tests")
    places = [(document, "knee", named["knee"])]
    if isinstance(document.value.get("measured"), dict):
        places.append((document["measured"], "file", named["measured"]))
    for number, test in enumerate(tests if isinstance(tests, list) else []):
        one = Field(document.file, f"tests[{number}]", test)
        if isinstance(test, dict):
            places.append((one, "file", named["measured"]))
    for field, name, known in places:
        value = field.value.get(name)
        if isinstance(value, str) and value not in known and not os.path.isfile(folder / value):
            yield field[name].problem(f"a file; not at {folder / value}", known)


def _twice(members: list[Member]) -> list[str]:
    """Names that two knees have; folders of results may not tell capitals from others."""
    seen: dict[str, Member] = {}
    found = []
    for one in members:
        before = seen.setdefault(one.name.lower(), one)
        if before is not one:
            expected = f"every knee by a name of its own; {before.place} has it too"
            found.append(str(InputProblem(one.place, "name", one.name, expected)))
    return found
