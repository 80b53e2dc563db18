"""Finished parts of long work, kept until the whole is done."""

from __future__ import annotations

import hashlib
import io
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.reading import InputProblem, read_bytes, read_text, write_bytes, write_text

_CLAIM, _PARTS = "study.json", "parts"


class Checkpoints:
    """Arrays under names in a folder that belongs to one study.

    The folder is claimed by the fingerprint of everything that the work depends on; work on
    something else must go elsewhere.

    Attributes:
        folder: of the results.
        resumed: number of parts that were found there.
    """

    def __init__(self, folder: str | os.PathLike[str], about: Mapping[str, Any], data: bytes):
        """Check that the folder is free or of the same work; it is claimed by the first part.

        Args:
            folder: of the results; it need not exist yet.
            about: what a person would say the work is; written into the folder.
            data: everything that the work depends on, as bytes.

        Raises:
            InputProblem: the folder belongs to other work.
        """
        self.folder, self.resumed = Path(folder), 0
        self._parts = self.folder / _PARTS
        print_ = hashlib.sha256(data).hexdigest()
        claim = self.folder / _CLAIM
        if claim.exists():
            before = _claim(claim)
            if before.get("fingerprint") != print_:
                changed = _difference(before.get("about", {}), dict(about))
                raise InputProblem(
                    "--out", "folder", os.fspath(folder),
                    f"a folder of the same study: {changed}; choose another, or delete this one",
                )  # fmt: skip
        self._document = {"about": dict(about), "fingerprint": print_}

    def load(self, name: str) -> dict[str, np.ndarray] | None:
        """The arrays kept under a name, or None."""
        path = self._path(name)
        if not path.exists():
            return None
        with np.load(io.BytesIO(read_bytes(path, "a finished part"))) as arrays:
            found = {key: arrays[key] for key in arrays.files}
        self.resumed += 1
        return found

    def save(self, name: str, arrays: Mapping[str, np.ndarray]) -> None:
        """Keep arrays under a name; the file is complete or absent."""
        claim = self.folder / _CLAIM
        if not claim.exists():
            write_text(claim, json.dumps(self._document, indent=1) + "\n")
        stream = io.BytesIO()
        np.savez(stream, **arrays)
        write_bytes(self._path(name), stream.getvalue())

    def done(self) -> None:
        """Throw the parts away; the folder stays claimed."""
        if self._parts.is_dir():
            for path in self._parts.glob("*.npz"):
                path.unlink()
            self._parts.rmdir()

    def _path(self, name: str) -> Path:
        return self._parts / f"{name}.npz"


def _claim(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(read_text(path, "what a folder of results is of"))
    except json.JSONDecodeError as error:
        raise InputProblem(path, "file", f"line {error.lineno}", "JSON") from None
    return found if isinstance(found, dict) else {}


def _difference(before: Mapping[str, Any], now: Mapping[str, Any]) -> str:
    """In words, what is not as it was."""
    for key in now:
        if key in before and before[key] != json.loads(json.dumps(now[key])):
            return f"its {key} is {before[key]}, not {now[key]}"
    return "it was made from other data"
