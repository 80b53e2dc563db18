"""A folder of results holds one run: it is replaced whole, and nobody else's files are touched.

What a command writes is gathered in a draft, in the folder itself. When the command has ended, the
files of the run before go, those of the draft take their places, and `settings.json`, which lists
them with their checksums, comes last. A process that is killed in between is no harm: the draft
says what is left to do, and the next command does it.
"""

import contextlib
import os
import shutil
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from kneejax import _whole_files
from kneejax._whole_files import DRAFT, checksum, gathering, json_bytes, read_json, sync, undamaged
from kneejax.cli._streams import uninterrupted
from kneejax.files import InputProblem

#: The file of a run's settings, and its field of what was written: file -> checksum.
FILE, WRITTEN = "settings.json", "written"
#: Folder of a cohort's knees; in a knee's folder: which task wrote it, its draws, and their folder.
KNEES, MARK, DRAWS = "knees", "task.json", "bootstrap"
RESULT = "result.json"
#: A draft that nobody has touched for so long is no process's any more.
_ABANDONED_S = 86_400.0
_ASIDE = "set-aside-"


def try_out(out: Path, *, folder: bool) -> None:
    """Refuse a place where nothing can be written; permissions alone do not tell, so that a file is
    made there and taken away again: a full disk, or a folder of the system, refuses everybody."""
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
    """Refuse a disk that is too full for what shall be written."""
    place = next(one for one in (out, *out.parents) if one.exists())  # it may not be there yet
    free_mb = shutil.disk_usage(place).free / 1e6
    if free_mb < needed_mb:
        expected = f"at least {needed_mb:.3g} MB free for {what}; there are {free_mb:.3g} MB"
        raise InputProblem("--out", "folder", str(out), expected)


class ResultsFolder:
    """Where a command writes, from before it computes until its results are in place."""

    def __init__(self, out: Path, imports_s: float = 0.0):
        """See what the folder holds, if there is one; finish what a process has left that was
        killed while it put its results in place. The run could begin after `imports_s` seconds."""
        self.out, self.imports_s = out, imports_s
        self._draft = out / f"{DRAFT}{uuid.uuid4().hex[:8]}"
        self._made = not out.exists()
        for draft in out.glob(f"{DRAFT}*"):
            with contextlib.suppress(OSError):
                if _listed(draft / FILE) is not None:
                    _put_in_place(out, draft)
                elif time.time() - draft.stat().st_mtime > _ABANDONED_S:
                    shutil.rmtree(draft)
        self._before = owned(out)
        self._begun = False
        #: Names of files that are in their places already when the run ends.
        self.holds: list[str] = []

    @contextlib.contextmanager
    def gathered(self, given: Mapping[str, Any], resumes: bool = False) -> Iterator[None]:
        """Gather what is written into the folder meanwhile; it is lost where an error ends it.
        Options that were `given` may be files in it; `resumes` goes on with an earlier run."""
        self._set_aside(given, resumes)
        try:
            with gathering(self.out, self._draft, self._object_to):
                yield
        finally:
            # One that is complete is put in place by the next command, if not by this one.
            if not (self._draft / FILE).exists():
                shutil.rmtree(self._draft, ignore_errors=True)
            made = [*sorted(self.out.rglob("*"), reverse=True), self.out] if self._made else ()
            for path in made:
                with contextlib.suppress(OSError):  # only folders that are empty
                    path.rmdir()

    def check_free(self, *names: str) -> None:
        """Refuse names of files that kneejax did not write, before the work, not after it."""
        for name in names:
            self._object_to(Path(name), writing=True)

    def begin(self, keeps: Callable[[str], bool]) -> None:
        """Let go of the run before, but for files that `keeps` says, by name, to be of this one."""
        with uninterrupted():
            _remove(self.out, [name for name in self._before if not keeps(name)])
        self._before, self._begun, self._made = owned(self.out), True, False

    def commit(self, settings: Mapping[str, Any], **more: Any) -> None:
        """Put what was gathered in its place, instead of the run before, with `more` fields of the
        result.json, if there is one; refuse where a file that kneejax did not write is in the way.
        """
        if more and (file := self._draft / RESULT).is_file():
            _whole_files.write_whole(file, json_bytes({**read_json(file), **more}))
        if not self._draft.exists() and (self._before or self._begun):
            return  # nothing was written, or other parts are still to come
        listed = _checksums(self._draft)
        for name in listed:
            self._object_to(Path(name), writing=True)
        listed |= {name: checksum((self.out / name).read_bytes()) for name in self.holds}
        # A person may edit what was asked for, not the list.
        document = {**settings, WRITTEN: _whole_files.with_checksum(dict(sorted(listed.items())))}
        with uninterrupted():
            # The draft is complete from here on, and is put in its place even after a kill.
            _whole_files.write_whole(self._draft / FILE, json_bytes(document), at_once=True)
            _put_in_place(self.out, self._draft)
            self._before, self._made = owned(self.out), False

    def _object_to(self, name: Path, writing: bool) -> None:
        """Refuse to read what this run replaces, and to replace what kneejax has not written."""
        known = name.as_posix() in self._before
        if writing and not known and (self.out / name).is_file():
            expected = "another place: kneejax did not write this file, and does not replace it"
            raise InputProblem(self.out / name, "file", "exists already", expected)
        if not writing and known and name.parts[0] != KNEES:
            expected = f"another folder than that of {name}, which this run reads and would replace"
            raise InputProblem("--out", "folder", os.fspath(self.out), expected)

    def _set_aside(self, options: Mapping[str, Any], resumes: bool) -> None:
        """Move away what a run left whose list of files is damaged, or that made none."""
        if not (self.out / FILE).is_file() or _listed(self.out / FILE) is not None:
            return
        # Parts that can be gone on with say themselves what they are.
        from kneejax.files.results import CLAIM, PARTS

        stays = (KNEES, PARTS, CLAIM) if resumes else ()
        moved = [path for path in self.out.iterdir()
                 if path.name not in stays and not path.name.startswith((DRAFT, _ASIDE))]
        home, given = Path(os.path.realpath(self.out)), [Path.cwd() / "x"]
        for value in options.values():
            for one in value if isinstance(value, list | tuple) else [value]:
                if isinstance(one, str | Path) and one != self.out and os.path.exists(one):
                    given.append(Path(os.path.realpath(one)))
        if any(home in one.parents for one in given):
            expected = "a list of the files of the run before; choose another folder, or delete it"
            raise InputProblem(self.out / FILE, WRITTEN, "none, or damaged", expected)
        number = 1 + sum(path.name.startswith(_ASIDE) for path in self.out.iterdir())
        aside = self.out / f"{_ASIDE}{number}"
        aside.mkdir()
        for path in moved:
            path.rename(aside / path.name)
        print(f"kneejax: {self.out / FILE} does not list the files of its run, or was damaged: "
              f"what was there is in {aside}", file=sys.stderr)
        self._before = owned(self.out)


def owned(out: Path) -> set[str]:
    """Names of all files in a folder that kneejax wrote, as its lists say."""
    from kneejax.files.results import CLAIM, parts_of

    found = set(_listed(out / FILE) or ())
    if (out / FILE).is_file():
        found.add(FILE)
    if undamaged(read_json(out / CLAIM)) is not None:
        found |= {CLAIM, *(_name(path, out) for path in parts_of(out))}
    for mark in (out / KNEES).glob(f"*/{MARK}"):
        found |= of_knee(mark.parent, out)
    return found


def of_knee(folder: Path, out: Path) -> set[str]:
    """Names of the files of a cohort's knee, as its mark lists them, relative to `out`."""
    listed = _listed(folder / MARK)
    if listed is None:
        return set()
    every = [folder / MARK, *(folder / name for name in listed), *(folder / DRAWS).glob("*.draws")]
    return {_name(path, out) for path in every}


def replace_knee(folder: Path, write: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Write the files of a cohort's knee, all or none, and its mark: checksums, and what `write`
    returns. Where one cannot be written, what stood there has gone."""
    # Draws say themselves which task they are of.
    _remove(folder, [x for x in of_knee(folder, folder) if Path(x).parts[0] != DRAWS])
    draft = folder / f"{DRAFT}{uuid.uuid4().hex[:8]}"
    try:
        with gathering(folder, draft, lambda name, writing: None):
            about = write()
        listed = _checksums(draft)
        draft.mkdir(parents=True, exist_ok=True)
        sealed = _whole_files.with_checksum({**about, WRITTEN: listed})
        (draft / MARK).write_bytes(json_bytes(sealed))
        sync([draft / MARK])
        with uninterrupted():
            for name in (*listed, MARK):
                _move(draft / name, folder / name)
            sync((), [folder])
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return about


def read_mark(folder: Path) -> dict[str, Any] | None:
    """What a knee's mark says, if all that it lists is there and undamaged; None otherwise."""
    mark, listed = undamaged(read_json(folder / MARK)), _listed(folder / MARK)
    if mark is None or listed is None:
        return None
    try:
        same = all(checksum((folder / x).read_bytes()) == said for x, said in listed.items())
    except OSError:
        return None
    return mark if same else None


def _listed(path: Path) -> dict[str, str] | None:
    """Files that a list names, with checksums; None where it is damaged or missing."""
    document = read_json(path)
    if path.name == FILE:
        found = undamaged(document.get(WRITTEN)) if isinstance(document, dict) else None
    else:
        found = (undamaged(document) or {}).get(WRITTEN)
    if not isinstance(found, dict):
        return None
    # A list that leads out of its folder is none of ours.
    inside = all(not os.path.isabs(x) and ".." not in Path(x).parts for x in found)
    return found if inside else None


def _checksums(draft: Path) -> dict[str, str]:
    """Checksum of each file below a folder, all of them on the disk."""
    files = sorted(path for path in draft.rglob("*") if path.is_file())
    sync(files)
    return {_name(path, draft): checksum(path.read_bytes()) for path in files}


def _put_in_place(out: Path, draft: Path) -> None:
    """Move a complete draft to where its files belong; may be done again after any step."""
    new = set(_listed(draft / FILE) or ())
    knees = (of_knee((out / name).parent, out) for name in new if Path(name).name == MARK)
    _remove(out, owned(out) - new.union({FILE}, *knees))
    for name in sorted(new):
        if (draft / name).exists():
            _move(draft / name, out / name)
    _move(draft / FILE, out / FILE)
    shutil.rmtree(draft, ignore_errors=True)
    sync((), [out, *{(out / name).parent for name in new}])


def _remove(out: Path, names: Iterable[str]) -> None:
    """Delete files and the folders that are empty without them; settings.json last of all."""
    folders = set()
    for name in sorted(names, key=lambda name: (name == FILE, name)):
        path = out / name
        path.unlink(missing_ok=True)
        folders |= {one for one in path.parents if one != out and out in one.parents}
    for folder in sorted(folders, key=lambda one: -len(one.parts)):
        with contextlib.suppress(OSError):  # somebody else's files are in it
            folder.rmdir()


def _move(path: Path, to: Path) -> None:
    to.parent.mkdir(parents=True, exist_ok=True)
    os.replace(path, to)


def _name(path: Path, out: Path) -> str:
    return path.relative_to(out).as_posix()
