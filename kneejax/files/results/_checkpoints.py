"""Finished parts of long work, kept until the whole is done, and data sets as netCDF files."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax._whole_files import read_json, read_sealed, undamaged, write_checked, write_sealed
from kneejax.files.reading import InputProblem, write_bytes

if TYPE_CHECKING:
    from xarray import Dataset

#: In a folder of results: of which study its parts are, and the folder of these.
CLAIM, PARTS = "study.json", "parts"
_ENDING = ".part"


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
        self,
        folder: str | os.PathLike[str],
        about: Mapping[str, Any],
        data: bytes,
        begin: Callable[[], None] | None = None,
    ):
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
            raise InputProblem(
                "--out", "folder", os.fspath(folder),
                f"a folder of the same study: {changed}; choose another, or delete this one",
            )  # fmt: skip
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
    """Files of the parts that a folder of results keeps.

    Args:
        folder: of the results.
    """
    return sorted((folder / PARTS).glob(f"*{_ENDING}"))


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In words, what is not as it was."""
    for key in now:
        if key in before and before[key] != json.loads(json.dumps(now[key])):
            return f"its {key} is {before[key]}, not {now[key]}"
    return "it was made from other data"


def write_netcdf(path: str | os.PathLike[str], dataset: Dataset) -> Path:
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
    write_bytes(path, bytes(content))
    return Path(path)
