"""Knees, measurements, laxities and studies that come with the package."""

__all__ = [
    "LaxityBand", "Measurement", "absent_measurement", "bundled_bands", "bundled_examples",
    "bundled_files", "bundled_knee_descriptions", "bundled_knees", "bundled_laxity_sources",
    "bundled_measurements", "bundled_path", "bundled_studies", "named_document", "named_path",
]

import dataclasses
import math
import os
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from kneejax.files import reading
from kneejax.files.reading import InputProblem, Part, Text, load_yaml, one_of, reads
from kneejax.quantities import nearest_name

if TYPE_CHECKING:
    import numpy as np

_ENDINGS = {"knees": ".yaml", "laxity": ".yaml", "measurements": ".csv", "plans": ".yaml",
            "studies": ".yaml", "templates": ".yaml"}
_COLUMNS = ["flexion_deg", "end", "mean", "sd", "cut"]
#: What a published number is of: the first three as `kneejax.Laxity` has them, the last what the
#: range grows by when the ligaments are cut, a difference of two knees.
ENDS = ("positive", "negative", "range", "range_increase")
_ONE = {"knees": "knee", "plans": "plan", "studies": "study"}


@dataclasses.dataclass(frozen=True)
class Measurement:
    """A bundled table of what was measured."""

    path: Path  # the CSV table
    title: str  # what was measured
    source: str  # where it was published
    description: str = ""  # how it was measured; empty if not said
    # what a study takes it for: `poses`, its measured motion; `test`, one without loads; `nothing`,
    # a table of conditions
    use: str = "poses"
    counted_from: str = ""  # of a test, what its numbers are counted from
    # of a test, column of a pose -> column of the table, a minus where senses differ
    columns: Mapping[str, str] = dataclasses.field(default_factory=dict)


class AboutTest(Part):
    """How a table is one of a test."""

    counted_from: Text
    columns: dict[str, str] = {}  # column of a pose -> column of the table


class AboutTable(Part):
    """The YAML file beside a bundled table."""

    title: Text
    source: Text
    description: Text = ""
    test: AboutTest | None = None
    conditions: Any = None


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
        raise InputProblem("bundled data", "kind", kind, _ENDINGS)
    known, stem = bundled_files(kind), name.removesuffix(_ENDINGS[kind])
    if stem not in known:
        raise InputProblem("bundled data", kind, name, known)
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
    files = bundled_files("knees").items()
    return {name: load_yaml(path, "a knee file")["description"].strip() for name, path in files}


class Example(NamedTuple):
    """A bundled folder of made-up files to begin with."""

    path: Path  # the folder
    title: str  # what it holds: the first line of its README.txt


def bundled_examples() -> dict[str, Example]:
    """Name -> folder of each example that comes with the package, in alphabetical order.

    Example:
        >>> bundled_examples()["specimen"].path.name
        'specimen'
    """
    every = sorted((_data_folder() / "examples").glob("*/README.txt"))
    return {about.parent.name: Example(about.parent, about.read_text("utf-8").split("\n")[0])
            for about in every}


def bundled_studies() -> dict[str, str]:
    """Name -> title of each study that comes with the package.

    Example:
        >>> "paper1" in bundled_studies()
        True
    """
    files = bundled_files("studies").items()
    return {name: load_yaml(path, "a study")["title"].strip() for name, path in files}


def absent_measurement(study: str) -> str | None:
    """Who published the measured motion that a bundled study needs, where it is not at hand.

    Args:
        study: name of a bundled study.

    Returns:
        The source that the study names; None if it has all that it needs.

    Raises:
        InputProblem: there is no such study.

    Example:
        >>> absent_measurement("paper1") is None
        True
    """
    path = bundled_path("studies", study)
    measured = load_yaml(path, "a study").get("measured")
    file = measured.get("file") if isinstance(measured, dict) else None
    if not isinstance(file, str) or file in bundled_files("measurements"):
        return None
    return None if (path.parent / file).is_file() else measured.get("source", file)


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
        document = load_yaml(about, "title and source of a table")
        one = reading.checked(AboutTable, document, os.fspath(about))
        use = "nothing" if one.conditions is not None else "test" if one.test else "poses"
        test = {} if one.test is None else dict(one.test)
        answer[name] = Measurement(path, one.title, one.source, one.description, use, **test)
    return answer


def bundled_laxity_sources() -> dict[str, str]:
    """Name -> source of each published laxity that comes with the package.

    Example:
        >>> "robot_anterior_90N" in bundled_laxity_sources()
        True
    """
    files = bundled_files("laxity").items()
    every = {name: load_yaml(path, "source of a laxity table") for name, path in files}
    return {name: about["source"].strip() + "; load not known" * ("size" not in about)
            for name, about in every.items()}


def named_path(kind: str, name_or_path: str | os.PathLike[str]) -> Path:
    """The bundled file of this name, or else the file itself.

    Args:
        kind: a folder of the bundled data.
        name_or_path: name of a bundled file, or any file.

    Raises:
        InputProblem: there is neither.

    Example:
        >>> named_path("knees", "four_ligament").name
        'four_ligament.yaml'
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
        near = reading.neighbour(path) or near
    raise InputProblem(one, "name", os.fspath(name_or_path), expected, near)


def named_document(kind: str, name_or_path: str | os.PathLike[str]) -> tuple[Any, Path]:
    """What a bundled file of this name says, or else the file itself.

    Args:
        kind: a folder of the bundled data.
        name_or_path: name of a bundled file, or any file.

    Returns:
        The document, and its file, to whose folder paths in it are relative.

    Raises:
        InputProblem: there is neither, or it is no YAML.
    """
    path = named_path(kind, name_or_path)
    return load_yaml(path, f"a {_ONE[kind]} file"), path


def bundled_files(kind: str) -> dict[str, Path]:
    """Name -> file of all that is bundled of a kind, in alphabetical order.

    Example:
        >>> sorted(bundled_files("knees"))[:2]
        ['average_knee', 'four_ligament']
    """
    folder = _data_folder() / kind
    return {path.stem: path for path in sorted(folder.glob(f"*{_ENDINGS[kind]}"))}


def _data_folder() -> Path:
    """`kneejax/data` of an installed package, else `data` beside the package of a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "data"
    return installed if installed.is_dir() else package.parent / "data"


@dataclasses.dataclass(frozen=True)
class LaxityBand:
    """A published laxity: rows of one table that are of one end and one state of the knee."""

    name: str  # of its file
    label: str  # for a figure's legend
    source: str  # where it was published, and on whom it was measured
    load: str  # that acted, a name of `kneejax.mechanics.NAMED_LOADS`
    size: float  # of the load, in the unit of its name; NaN where it is not known
    end: str  # one of `ENDS`
    cut: tuple[str, ...]  # ligaments that were cut
    flexion_deg: "np.ndarray"  # `(n,)`
    mean: "np.ndarray"  # displacement under the load, `(n,)`, mm or degrees; negative at that end
    sd: "np.ndarray"  # its standard deviation over knees, `(n,)`; NaN where none was published
    # what a cut knee's displacement is counted from: where it rests itself, or `intact`
    counted_from: str = "unloaded"


class AboutLaxity(Part):
    """The YAML file beside a table of laxities."""

    label: Text
    source: Text
    load: Text
    size: Annotated[float, reads(reading.number)] = math.nan
    notes: Any = None
    counted_from: Annotated[str, one_of(["unloaded", "intact"])] = "unloaded"


def bundled_bands(
    cut: Collection[str] | None = None, name: str | None = None
) -> list[LaxityBand]:
    """The laxities that come with the package.

    Args:
        cut: only those of knees with exactly these ligaments cut; all by default.
        name: only those of this table.

    Example:
        >>> [band.cut for band in bundled_bands(name="robot_anterior_90N")]
        [(), ('ACL',)]
        >>> [(band.end, band.mean.tolist()) for band in bundled_bands(name="komzak2013_torsion")]
        [('positive', [12.1]), ('negative', [-10.1])]
    """
    files = bundled_files("laxity")
    every = [band for path in files.values() for band in _read(path) if name in (None, band.name)]
    return [band for band in every if cut is None or set(band.cut) == set(cut)]


def _read(path: Path) -> list[LaxityBand]:
    from kneejax.files.tables.tables import Table

    about = reading.checked(
        AboutLaxity, load_yaml(path, "source of a laxity table"), os.fspath(path))
    table = Table.read(path.with_suffix(".csv"), _COLUMNS)
    ends, cuts = table.cells("end"), table.cells("cut")
    for place, end in ends:
        if end not in ENDS:
            table.wrong(place, end, ENDS)
    numbers = [table.column(x, empty=x == "sd") for x in ("flexion_deg", "mean", "sd")]
    table.mistakes.check()
    kinds: dict[tuple[str, str], list[int]] = {}
    for row, ((_, end), (_, cut)) in enumerate(zip(ends, cuts, strict=True)):
        kinds.setdefault((end, cut), []).append(row)
    said = about.label, about.source, about.load, about.size
    return [LaxityBand(path.stem, *said, end, tuple(cut.split()), *(x[rows] for x in numbers),
                       counted_from=about.counted_from if cut else "unloaded")
            for (end, cut), rows in kinds.items()]
