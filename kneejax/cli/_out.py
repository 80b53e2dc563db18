"""Whether results can be written where they are asked for: better known before the work."""

from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from pathlib import Path

from kneejax.files import InputProblem


def try_out(out: Path, *, folder: bool) -> None:
    """Write something there, in the folder or as the file, and take it away again; refuse a place
    where that cannot be done.

    Permissions alone do not tell: a folder of the system, or a full or read-only disk, refuses
    whoever may write.
    """
    if folder and os.path.exists(out) and not out.is_dir():
        raise InputProblem("--out", "folder", str(out), "a folder; this is a file")
    if not folder and out.is_dir():
        raise InputProblem("--out", "file", str(out), "the name of the new file; this is a folder")
    place = out if folder else out.parent
    missing = [one for one in (place, *place.parents) if not os.path.exists(one)]
    above = missing[-1].parent if missing else place
    if os.path.exists(above) and not above.is_dir():
        raise InputProblem("--out", "folder", str(out), f"a place in a folder; {above} is a file")
    made: list[Path] = []
    try:
        for one in reversed(missing):
            one.mkdir()
            made.append(one)
        with tempfile.NamedTemporaryFile(dir=place, prefix=".kneejax"):
            pass
    except OSError as error:
        expected = f"a place to write; {above} takes no new files ({error.strerror})"
        raise InputProblem("--out", "folder", str(out), expected) from None
    finally:
        for one in reversed(made):
            # Whoever else writes there keeps the folder.
            with contextlib.suppress(OSError):
                one.rmdir()


def check_room(out: Path, needed_mb: float, what: str) -> None:
    """Refuse a disk that is too full for what shall be written, whose folder may not be there yet.
    """
    place = next(one for one in (out, *out.parents) if one.exists())
    free_mb = shutil.disk_usage(place).free / 1e6
    if free_mb < needed_mb:
        expected = f"at least {needed_mb:.3g} MB free for {what}; there are {free_mb:.3g} MB"
        raise InputProblem("--out", "folder", str(out), expected)
