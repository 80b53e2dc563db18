"""Knee files: readable YAML in which every number has a unit and a source."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from kneejax.files.knee._bands import drawn
from kneejax.files.knee._building import knee_of, knee_with_patella, pose_of
from kneejax.files.knee._document import (
    check_knee,
    mirror_document,
    mirror_part,
    plain_document,
    with_own_patella,
)
from kneejax.files.knee._surfaces import build_surface
from kneejax.files.reading import InputProblem, format_yaml, load_yaml, write_text
from kneejax.geometry import Surface
from kneejax.mechanics import Knee


@dataclasses.dataclass(frozen=True)
class KneeFile:
    """A knee and where its numbers come from.

    Attributes:
        knee: ready for computing; a left knee is its mirrored right twin.
        sources: place of a field, or of a part with all its fields (`ligaments.ACL`) -> source.
        description: what the file says of the knee.
        path: the file.
        document: content of the file as it stands there, not mirrored.
    """

    knee: Knee
    sources: dict[str, str]
    description: str
    path: Path
    document: dict[str, Any]

    @property
    def surfaces(self) -> dict[str, Surface]:
        """Articular surfaces that no contact uses yet, by bone, mirrored if the knee is left."""
        left = self.document["side"] == "left"
        parts = self.document.get("surfaces", {}).items()
        return {bone: build_surface(mirror_part(x) if left else x) for bone, x in parts}

    @property
    def has_patella(self) -> bool:
        """Whether the file tells of a patella and its muscles."""
        return "patella" in self.document

    def with_patella(self, tension_N: Mapping[str, float] | None = None) -> Knee:
        """The knee with its patella: a second bone in balance, pulled by the quadriceps.

        Args:
            tension_N: muscle -> its tension; the others of the file have that at rest. Muscles
                that do not pull at all are left out.

        Returns:
            The knee of three bones; `knee` is the one of two.

        Raises:
            InputProblem: the file has no patella, a muscle is unknown or pushes, a muscle begins
                inside the bone, or a ligament of the patella would be torn at the reference poses.

        Example:
            >>> from kneejax.files import load_knee_file
            >>> read = load_knee_file("lenhart2015")
            >>> read.knee.bodies, read.with_patella().bodies
            (('tibia',), ('tibia', 'patella'))
        """
        if not self.has_patella:
            raise InputProblem(self.path, "patella", "missing", "this section, in a knee file")
        document, side = with_own_patella(self.document), self.document["side"]
        right = check_knee(mirror_document(document) if side == "left" else document, self.path)
        return knee_with_patella(right, side, str(self.path), tension_N or {})

    @property
    def adaptations(self) -> tuple[dict[str, Any], ...]:
        """Changes of published values: mappings with `field`, `from`, `to` and `reason`."""
        return tuple(self.document.get("adaptations", ()))


def read_knee(path: str | os.PathLike[str]) -> KneeFile:
    """Read a knee file.

    A left knee (`side: left`, Z to the person's right, which is medial there) is mirrored to its
    right twin: points and forces `z -> -z`, rotations and moments about X and Y change sign,
    regions along Z swap and change sign, odd powers of the width or z change sign. The reference
    pose is given by clinical meaning and stays.

    Bands become fibres, each band a group: in the document too.

    Args:
        path: the file.

    Returns:
        The knee, the sources of its numbers, and the document.

    Raises:
        InputProblem: the file cannot be read or a field is missing, unknown or out of range;
            `InputProblems` where several are.

    Example:
        >>> from kneejax.files import bundled_path
        >>> read = read_knee(bundled_path("knees", "four_ligament"))
        >>> read.knee.ligaments.names
        ('ACL', 'PCL', 'MCL', 'LCL')
        >>> read.document["side"]
        'right'
    """
    return build_knee(load_yaml(path, "a knee file"), path)


def build_knee(document: dict[str, Any], path: str | os.PathLike[str]) -> KneeFile:
    """Check a knee document and build its knee.

    Args:
        document: content of a knee file.
        path: where it stands, or what it was made of, for errors.

    Returns:
        As `read_knee`.

    Raises:
        InputProblem: likewise.
    """
    read = check_knee(document, path)
    if read.bands:
        document = drawn(document, read.bands, pose_of(read.reference_pose).placement)
        read = check_knee(document, path)
    right = read
    if read.side == "left":
        right = check_knee(mirror_document(document), path)
    knee = knee_of(right, read.side, os.fspath(path))
    return KneeFile(knee, read.sources(), read.description, Path(path), document)


def write_knee(document: dict[str, Any], path: str | os.PathLike[str], comment: str = "") -> None:
    """Check a knee document and write it to a file, completely or not at all.

    Args:
        document: as in `format_knee`.
        path: the file.
        comment: lines for the head of the file.

    Raises:
        InputProblem: a field is missing, unknown or out of range, or the file cannot be written.

    Example:
        >>> import tempfile
        >>> from kneejax.files import load_knee_file
        >>> document = load_knee_file("four_ligament").document
        >>> path = Path(tempfile.mkdtemp()) / "knee.yaml"
        >>> write_knee(document, path)
        >>> load_knee_file(path).document == document
        True
    """
    plain = plain_document(document)
    build_knee(plain, path)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_text(path, head + format_yaml(plain))
