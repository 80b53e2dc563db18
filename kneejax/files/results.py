"""What earlier work left: a calibration's result.json, finished parts of long work, netCDF."""

__all__ = ["Calibrated", "Checkpoints", "read_calibrated", "write_netcdf"]

import dataclasses
import hashlib
import io
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import ConfigDict, PlainValidator

from kneejax._whole_files import read_json, read_sealed, undamaged, write_checked, write_sealed
from kneejax.files import reading
from kneejax.files.reading import Flag, InputProblem, Mistakes, Part, Text, reads, wrong
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import Knee, range_of_parameter
from kneejax.parameters import MEANING, fibres_summed

if TYPE_CHECKING:
    from xarray import Dataset

#: In a folder of results: of which study its parts are, and the folder of these.
CLAIM, PARTS = "study.json", "parts"
_ENDING = ".part"


@dataclasses.dataclass(frozen=True)
class Calibrated:
    """What a calibration found."""

    knee: str  # name or file of the knee that was calibrated
    # parameter -> value of the study: those that it set, then those where it began
    fixed: dict[str, float]
    found: dict[str, float]  # parameter -> value that the calibration found
    # free coordinate -> what is added to the knee's motion to compare it with the measured one, mm
    # or degrees
    frame_offset: dict[str, float]
    study: str = ""  # its title and its file; empty where the result does not say
    # free coordinate -> standard deviation of its measurement, degrees and mm, stated or estimated
    noise: dict[str, float] = dataclasses.field(default_factory=dict)
    # parameter -> its standard error, where the data determine it
    standard_error: dict[str, float] = dataclasses.field(default_factory=dict)
    # parameters, and the correlation of their estimates as rows
    correlation: tuple[tuple[str, ...], tuple[tuple[float, ...], ...]] = ((), ())
    patella: bool = False  # whether the knee had its patella
    # whether the file is older than stiffnesses that are sums over a structure's fibres: its values
    # are their means, and `of_structures` converts them
    of_fibres: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Parameter -> value; those that the study fixed, then those that it found."""
        return self.fixed | self.found

    def of_structures(self, knee: Knee) -> "Calibrated":
        """The same with a structure's stiffness as the sum over its fibres, of which the knee that
        was calibrated says how many there are."""
        if not self.of_fibres:
            return self
        sums = {of: {name: value * fibres_summed(knee, name)
                     for name, value in getattr(self, of).items()}
                for of in ("fixed", "found", "standard_error")}
        return dataclasses.replace(self, **sums, of_fibres=False)


def _estimate(value: Any, name: str) -> "Estimate":
    """What was found of a parameter, or of a constant between frames."""
    found, mistakes = Estimate.model_validate(value), Mistakes()
    with mistakes.gathered("value"):
        number = reading.number(found.value, range_of_parameter(name))
        return found.model_copy(update={"value": number})
    raise reading.together(mistakes)


def _coordinate(name: str) -> str:
    """The name of a free coordinate, perhaps with its unit, as in older files."""
    if name.removesuffix("_deg").removesuffix("_mm") not in FREE_COORDINATES:
        raise wrong(name, FREE_COORDINATES)
    return name


Real = Annotated[float, reads(reading.number)]


class Written(Part):
    """A part of a file that the package wrote; what else it says is of no concern."""

    model_config = ConfigDict(extra="ignore")


class Estimate(Written):
    """What was found of a number."""

    value: Any
    standard_error: Real | None = None


def _by_name(read: Callable[[Any, str], Any], names: Any = None) -> PlainValidator:
    """A mapping whose values are read with their names."""
    return PlainValidator(reading.mapping_of(read, "a mapping", names))


#: Parameter -> value.
Numbers = Annotated[
    dict[str, float], _by_name(lambda x, name: reading.number(x, range_of_parameter(name)))
]


class StudySettings(Written):
    """What the study said."""

    knee: Text | None = None
    path: Any = None
    patella: Flag = False
    overrides: Numbers | None = None  # what the study set
    start: Numbers | None = None  # where it began


class Correlation(Written):
    """Of the estimates; nothing stands for zero."""

    parameters: Annotated[tuple[Text, ...], reading.entries("names", empty=True)] = ()
    matrix: Any

    @reading.checks
    def _check_square(self, mistakes: Mistakes) -> None:
        if self.matrix:
            count = len(reading.items([*self.parameters], "names"))
            every = [[0.0 if x is None else x for x in reading.items(row, "numbers", count)]
                     for row in reading.items(self.matrix, "rows", count)]  # fmt: skip
            object.__setattr__(self, "matrix", tuple(reading.rows(every, count)))


class ResultFile(Written):
    """What of a result.json is read again."""

    title: Any = None
    knee: Text = ""  # in older files
    parameters: Annotated[dict[str, Estimate], _by_name(_estimate)] | None = None
    settings: StudySettings | None = None
    noise: dict[str, Real | None] | None = None
    # free coordinate -> constant between frames
    frame_offset: Annotated[dict[str, Estimate], _by_name(_estimate, _coordinate)] | None = None
    correlation: Correlation | None = None
    stiffness_of: Annotated[str, reading.one_of(MEANING.values())] | None = None

    @reading.checks
    def _check_knee(self, mistakes: Mistakes) -> None:
        if not self.knee and not (self.settings and self.settings.knee):
            raise wrong("missing", "this field", at="knee")


def read_calibrated(path: str | os.PathLike[str]) -> Calibrated:
    """Read the result.json that `kneejax calibrate` wrote.

    Args:
        path: the file.

    Returns:
        The knee and its numbers; `kneejax.load_knee` of the same file puts them into it. Numbers of
        an older file await `of_structures`.

    Raises:
        InputProblem: the file cannot be read or is no such result.
    """
    file, expected = os.fspath(path), "a result.json of kneejax calibrate"
    document = reading.load_json(path, expected)
    if not isinstance(document, dict) or "parameters" not in document:
        raise InputProblem(file, "parameters", "missing", expected)
    whole = reading.checked(ResultFile, document, file, nulls=True)
    settings, found = whole.settings or StudySettings(), whole.parameters or {}
    words = [word for word in (whole.title, settings.path) if isinstance(word, str) and word]
    named = whole.correlation
    return Calibrated(
        settings.knee or whole.knee,
        {**(settings.overrides or {}), **(settings.start or {})},
        {name: one.value for name, one in found.items()},
        {name.removesuffix("_deg").removesuffix("_mm"): one.value
         for name, one in (whole.frame_offset or {}).items()},
        " ".join([*words[:1], *(f"({word})" for word in words[1:])]),
        {name: sd for name, sd in (whole.noise or {}).items() if sd},
        {name: one.standard_error for name, one in found.items() if one.standard_error is not None},
        (named.parameters, named.matrix) if named and named.matrix else ((), ()),
        settings.patella,
        whole.stiffness_of is None,
    )  # fmt: skip


class Checkpoints:
    """Arrays under names in a folder that belongs to one study.

    The folder is claimed by the fingerprint of everything that the work depends on; work on
    something else must go elsewhere. A part that was damaged counts as missing, and so does a
    damaged claim.

    Attributes:
        folder: of the results.
        resumed: number of parts that were found there.
    """

    def __init__(
        self, folder: str | os.PathLike[str], about: Mapping[str, Any], data: bytes,
        begin: Callable[[], None] | None = None,
    ):  # fmt: skip
        """Check that the folder is free or of the same work; it is claimed by the first part.

        Args:
            folder: of the results; it need not exist yet.
            about: what a person would say the work is; written into the folder.
            data: everything that the work depends on, as bytes.
            begin: called before the folder is claimed.

        Raises:
            InputProblem: the folder belongs to other work.
        """
        self.folder, self.resumed, self._begin = Path(folder), 0, begin
        self._parts = self.folder / PARTS
        self._print = hashlib.sha256(data).hexdigest()
        before = undamaged(read_json(self.folder / CLAIM)) or {}
        self._claimed = before.get("fingerprint") == self._print
        if before and not self._claimed:
            changed = _difference(before.get("about", {}), dict(about))
            expected = f"a folder of the same study: {changed}; choose another, or delete this one"
            raise InputProblem("--out", "folder", os.fspath(folder), expected)
        self._document = {"about": dict(about), "fingerprint": self._print}

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """The arrays kept under a name, or None."""
        data = read_sealed(self._path(name), self._print)
        if data is None:
            return None
        with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
            found = {key: arrays[key] for key in arrays.files}
        self.resumed += 1
        return found

    def save(self, name: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep arrays under a name; the file is complete or absent."""
        if not self._claimed:
            if self._begin is not None:
                self._begin()
            write_checked(self.folder / CLAIM, self._document)
            self._claimed = True
        stream = io.BytesIO()
        np.savez(stream, **arrays)
        write_sealed(self._path(name), stream.getvalue(), self._print)

    def done(self) -> None:
        """Throw the parts away; the folder stays claimed."""
        for path in parts_of(self.folder):
            path.unlink()
        if self._parts.is_dir() and not any(self._parts.iterdir()):
            self._parts.rmdir()

    def _path(self, name: str) -> Path:
        return self._parts / f"{name}{_ENDING}"


def parts_of(folder: Path) -> list[Path]:
    """Files of the parts that a folder of results keeps."""
    return sorted((folder / PARTS).glob(f"*{_ENDING}"))


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In words, what is not as it was."""
    for key in now:
        if key in before and before[key] != json.loads(json.dumps(now[key])):
            return f"its {key} is {before[key]}, not {now[key]}"
    return "it was made from other data"


def write_netcdf(path: str | os.PathLike[str], dataset: "Dataset") -> Path:
    """Write a data set as netCDF 4, completely or not at all.

    Args:
        path: where; folders are made.
        dataset: with coordinates and units (`ParameterMap.to_dataset`).

    Returns:
        The path.

    Raises:
        InputProblem: the file cannot be written.
    """
    # HDF5 that meets a full disk may end the process when it closes its file.
    content = dataset.to_netcdf(engine="h5netcdf", format="NETCDF4")
    reading.write_bytes(path, bytes(content))
    return Path(path)
