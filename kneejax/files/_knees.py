"""A knee by its name, from its file, as a calibration found it, or with numbers set by name."""

__all__ = ["check_new", "load_knee", "load_knee_file", "write_calibrated_knee"]

import os
import warnings
from pathlib import Path

import jax.numpy as jnp

from kneejax.files._bundled import named_path
from kneejax.files.knee.file import KneeFile, build_knee, read_knee, write_knee
from kneejax.files.knee.restated import restated
from kneejax.files.meshes.points import MESH_ENDINGS
from kneejax.files.reading import InputProblem, said_of
from kneejax.files.results import Calibrated, read_calibrated
from kneejax.mechanics import Knee
from kneejax.parameters import DoubtfulValue, select

_NAME = " calibrated"
_COMMENT = """The knee that a calibration found: {study}
Comments of the file that it was made of are lost ({knee}).
Numbers that the calibration found, or its study set, have that as their source."""
_OFFSETS = """
What is added to its motion to compare it with the measured one is no part of a knee: {}"""


def load_knee(name_or_path: str | os.PathLike[str], *, patella: bool = False) -> Knee:
    """Load a knee.

    Args:
        name_or_path: name of a bundled knee, a knee file, or the result.json of a calibration.
        patella: whether with its patella, pulled by the quadriceps: a knee of three bones.

    Returns:
        The knee; a left one as its mirrored right twin.

    Raises:
        InputProblem: there is no such knee or file, the file is faulty or has no patella.

    Example:
        >>> knee = load_knee("four_ligament")
        >>> knee.side, knee.contact_names
        ('right', ('medial', 'lateral'))
    """
    read = load_knee_file(name_or_path)
    return read.with_patella() if patella else read.knee


def load_knee_file(name_or_path: str | os.PathLike[str]) -> KneeFile:
    """Load a knee with the sources of its numbers.

    Args:
        name_or_path: name of a bundled knee, a knee file, or the result.json of a calibration.

    Returns:
        The knee, its sources, and the document as it stands in the file; of a calibration, the
        document of its knee with the numbers that it fixed and found.

    Raises:
        InputProblem: there is no such knee or file, or the file is faulty.

    Example:
        >>> read = load_knee_file("four_ligament")
        >>> sorted(read.document["ligaments"])
        ['ACL', 'LCL', 'MCL', 'PCL']
    """
    return _loaded(name_or_path, ())


def _loaded(name_or_path: str | os.PathLike[str], above: tuple[Path, ...]) -> KneeFile:
    """A knee; `above` are the results that lead to it, each calibrated from the one after it."""
    path = named_path("knees", name_or_path)
    if path.suffix.lower() == ".json" and os.path.isfile(path):
        whole, read = path.resolve(), read_calibrated(path)
        if whole in above:
            expected = "the knee that was calibrated; these results lead back to themselves"
            raise InputProblem(above[0], "knee", os.fspath(path), expected)
        return _calibrated(read, path, (*above, whole))
    # Ending of a file that is no knee's -> what it is, and what to do with it.
    other_kinds = {
        ".osim": ("an OpenSim model", ", which kneejax import osim makes of it"),
        ".csv": ("a table", "; a table of poses is given after the knee"),
        **{e: ("a mesh", ", which kneejax import stl makes of meshes") for e in MESH_ENDINGS},
    }
    found, hint = other_kinds.get(path.suffix.lower(), ("", ""))
    if os.path.isdir(path):
        inside = path / "knee.yaml"
        near = os.fspath(inside) if os.path.isfile(inside) else None
        raise InputProblem(path, "file", "a directory", "a knee file", near)
    if found and os.path.isfile(path):
        raise InputProblem(path, "file", found, f"a knee file{hint}")
    return read_knee(path)


def write_calibrated_knee(result: str | os.PathLike[str], path: str | os.PathLike[str]) -> None:
    """Write the knee that a calibration found as a knee file.

    Its numbers have the calibration, or the study that set them, as their source. Comments of the
    file that the calibration began with are lost.

    Args:
        result: the result.json of the calibration.
        path: the new file.

    Raises:
        InputProblem: the result cannot be read, gives no knee, or the file cannot be written: it
            may not be the one that the calibration began with.
        UnknownParameter: a name that the knee does not have.
    """
    read, found = read_calibrated(result), load_knee_file(result)
    check_new(path, read.knee)
    comment = _COMMENT.format(study=read.study or os.fspath(result), knee=read.knee)
    if read.frame_offset:
        comment += _OFFSETS.format(", ".join(f"{k} {x:g}" for k, x in read.frame_offset.items()))
    write_knee(found.document, path, comment)


def check_new(path: str | os.PathLike[str], knee: str | os.PathLike[str]) -> None:
    """Refuse to write a calibrated knee over the one that the calibration began with.

    Args:
        path: of the new knee file.
        knee: name or file of the knee that is calibrated.

    Raises:
        InputProblem: they are one file.

    Example:
        >>> check_new("new.yaml", "four_ligament")
    """
    if os.path.exists(path) and os.path.exists(knee) and os.path.samefile(path, knee):
        expected = "another file than the knee that is calibrated"
        raise InputProblem(path, "file", os.fspath(knee), expected)


def _calibrated(read: Calibrated, path: Path, above: tuple[Path, ...]) -> KneeFile:
    """The knee of a calibration: what its study set, then what it found."""
    base = _loaded(read.knee, above)
    knee = base.with_patella() if read.patella else base.knee
    document, study = base.document, read.study or os.fspath(path)
    read = read.of_structures(knee)
    if read.fixed:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DoubtfulValue)  # the file says what its values mean
            with said_of(path):
                knee = knee.replace(read.fixed)
        document = restated(document, knee, f"set by the study: {study}")
    if read.found:
        # All at once: a strain holds where attachments have moved to.
        with said_of(path):
            selection = select(knee, tuple(read.found))
        numbers = jnp.array([read.found[name] for name in selection.names])
        document = restated(document, selection.apply(knee, numbers), f"calibration: {study}")
    if read.values:
        name = knee.name.removesuffix(_NAME) + _NAME
        about = f"{base.description}; calibrated: {study}"
        document = document | {"name": name, "description": about}
    return build_knee(document, path)
