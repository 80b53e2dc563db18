"""Knees, measurements and studies that come with the package."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kneejax.files.reading import Field, InputProblem, load_yaml, nearest_name, neighbour

_ENDINGS = {
    "knees": ".yaml",
    "laxity": ".yaml",
    "measurements": ".csv",
    "plans": ".yaml",
    "studies": ".yaml",
    "templates": ".yaml",
}
_ONE = {"knees": "knee", "plans": "plan", "studies": "study"}


@dataclasses.dataclass(frozen=True)
class Measurement:
    """A bundled table of what was measured.

    Attributes:
        path: the CSV table.
        title: one line on what was measured.
        source: where it was published.
        description: how it was measured; empty if not said.
        use: what a study takes it for: `poses` (its measured motion), `test` (a test without
            loads), or `nothing`, a table of conditions.
        counted_from: of a test, what its numbers are counted from.
        columns: of a test, column of a pose -> column of the table, a minus where senses differ.
    """

    path: Path
    title: str
    source: str
    description: str = ""
    use: str = "poses"
    counted_from: str = ""
    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)


def bundled_path(kind: str, name: str) -> Path:
    """The file of something that comes with the package.

    Args:
        kind: a folder of the bundled data: `knees`, `laxity`, `measurements`, `plans`, `studies` or
            `templates`.
        name: of the file, with or without its ending.

    Returns:
        Its path.

    Raises:
        InputProblem: there is no such file.

    Example:
        >>> bundled_path("knees", "four_ligament").name
        'four_ligament.yaml'
    """
    if kind not in _ENDINGS:
        expected = f"one of {', '.join(_ENDINGS)}"
        raise InputProblem("bundled data", "kind", kind, expected, _ENDINGS)
    known = bundled_files(kind)
    stem = name.removesuffix(_ENDINGS[kind])
    if stem not in known:
        expected = f"one of {', '.join(known) or 'none'}"
        raise InputProblem("bundled data", kind, name, expected, known)
    return known[stem]


def bundled_knees() -> dict[str, Path]:
    """Name -> file of each knee that comes with the package, in alphabetical order.

    Example:
        >>> "four_ligament" in bundled_knees()
        True
    """
    return bundled_files("knees")


def bundled_knee_descriptions() -> dict[str, str]:
    """Name -> description of each knee that comes with the package; none is built for that."""
    answer = {}
    for name, path in bundled_files("knees").items():
        document = Field(os.fspath(path), "", load_yaml(path, "a knee file"))
        answer[name] = document["description"].text()
    return answer


@dataclasses.dataclass(frozen=True)
class Example:
    """A bundled folder of made-up files to begin with.

    Attributes:
        path: the folder.
        title: what it holds: the first line of its README.txt.
    """

    path: Path
    title: str


def bundled_examples() -> dict[str, Example]:
    """Name -> folder of each example that comes with the package, in alphabetical order.

    Example:
        >>> bundled_examples()["specimen"].path.name
        'specimen'
    """
    answer = {}
    for about in sorted((_data_folder() / "examples").glob("*/README.txt")):
        title = about.read_text(encoding="utf-8").partition("\n")[0]
        answer[about.parent.name] = Example(about.parent, title)
    return answer


def bundled_studies() -> dict[str, str]:
    """Name -> title of each study that comes with the package.

    Example:
        >>> "paper1" in bundled_studies()
        True
    """
    answer = {}
    for name, path in bundled_files("studies").items():
        document = load_yaml(path, "a study")
        answer[name] = Field(os.fspath(path), "", document)["title"].text()
    return answer


def absent_measurement(study: str) -> Path | None:
    """Where a bundled study looks for measured motion that is not there.

    Args:
        study: name of a bundled study.

    Returns:
        The path of the missing table; None if the study has all that it needs.

    Raises:
        InputProblem: there is no such study.

    Example:
        >>> absent_measurement("paper1") is None
        True
    """
    path = bundled_path("studies", study)
    document = load_yaml(path, "a study")
    measured = document.get("measured") if isinstance(document, dict) else None
    file = measured.get("file") if isinstance(measured, dict) else None
    if not isinstance(file, str) or file in bundled_files("measurements"):
        return None
    table = Path(os.path.normpath(path.parent / file))
    return None if table.is_file() else table


def bundled_measurements() -> dict[str, Measurement]:
    """Name -> table and source of each measurement that comes with the package.

    Raises:
        InputProblem: a table has no YAML file of the same name with its `title` and `source`.

    Example:
        >>> bundled_measurements()["walker1988"].counted_from
        'extension'
    """
    answer = {}
    for name, path in bundled_files("measurements").items():
        about = path.with_suffix(".yaml")
        field = Field(os.fspath(about), "", load_yaml(about, "title and source of a table"))
        field.mapping(("title", "source"), ("description", "test", "conditions"))
        said = [field[k].text() if k in field else "" for k in ("title", "source", "description")]
        answer[name] = Measurement(path, *said, **_use(field))
    return answer


def _use(field: Field) -> dict[str, Any]:
    """What a study takes a measurement for."""
    if "conditions" in field:
        return {"use": "nothing"}
    if "test" not in field:
        return {}
    test = field["test"].mapping(("counted_from",), ("columns",))
    columns = test["columns"].value if "columns" in test else {}
    return {"use": "test", "counted_from": test["counted_from"].text(), "columns": columns}


def bundled_laxity_sources() -> dict[str, str]:
    """Name -> source of each published laxity that comes with the package.

    Example:
        >>> "robot_anterior_90N" in bundled_laxity_sources()
        True
    """
    answer = {}
    for name, path in bundled_files("laxity").items():
        field = Field(os.fspath(path), "", load_yaml(path, "source of a laxity table"))
        unknown = "" if "size" in field else "; load not known"
        answer[name] = field["source"].text() + unknown
    return answer


def study_path(name_or_path: str | os.PathLike[str]) -> Path:
    """The file of a study.

    Args:
        name_or_path: name of a bundled study, or a study file.

    Returns:
        Its path.

    Raises:
        InputProblem: there is no such study or file.

    Example:
        >>> study_path("paper1").name
        'paper1.yaml'
    """
    return named_path("studies", name_or_path)


def named_path(kind: str, name_or_path: str | os.PathLike[str]) -> Path:
    """The bundled file of this name, or else the file itself.

    Args:
        kind: a folder of the bundled data.
        name_or_path: name of a bundled file, or any file.

    Raises:
        InputProblem: there is neither.
    """
    known, path, one = bundled_files(kind), Path(name_or_path), _ONE[kind]
    if isinstance(name_or_path, str) and name_or_path in known:
        return known[name_or_path]
    if os.path.exists(path):
        return path
    names = ", ".join(known) or "none are installed"
    expected = f"a bundled {one} ({names}) or a {one} file"
    near = nearest_name(path.stem, known)
    if path.suffix or len(path.parts) != 1:
        near = neighbour(path) or near
    raise InputProblem(one, "name", os.fspath(name_or_path), expected, near)


def named_document(kind: str, name_or_path: str | os.PathLike[str]) -> tuple[Field, Path]:
    """What a bundled file of this name says, or else the file itself.

    Args:
        kind: a folder of the bundled data.
        name_or_path: name of a bundled file, or any file.

    Returns:
        The document, and the folder to which paths in it are relative.

    Raises:
        InputProblem: there is neither, or it is no YAML.
    """
    path = named_path(kind, name_or_path)
    return Field(os.fspath(path), "", load_yaml(path, f"a {_ONE[kind]} file")), path.parent


def bundled_files(kind: str) -> dict[str, Path]:
    """Name -> file of all that is bundled of a kind, in alphabetical order."""
    folder = _data_folder() / kind
    return {path.stem: path for path in sorted(folder.glob(f"*{_ENDINGS[kind]}"))}


def _data_folder() -> Path:
    """`kneejax/data` of an installed package, else `data` beside the package of a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "data"
    return installed if installed.is_dir() else package.parent / "data"
