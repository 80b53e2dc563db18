"""Knee files: readable YAML in which every number has a unit and a source."""

from __future__ import annotations

import dataclasses
import fnmatch
import os
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.knee import _schema as schema
from kneejax.files.knee._format import plain_document
from kneejax.files.knee._mirror import mirror_document, mirror_part
from kneejax.files.reading import Field, InputProblem, format_yaml, load_yaml, write_text
from kneejax.geometry import (
    COLUMNS,
    POWER,
    TIBIA,
    Condyle,
    Ellipsoid,
    Frame,
    Obstacle,
    Plane,
    Plateau,
    Pose,
    Sphere,
    State,
    Surface,
    WrapCylinder,
    WrapEllipsoid,
    WrapSphere,
)
from kneejax.mechanics import (
    ConstantTensionLine,
    Contact,
    Course,
    Implausible,
    Knee,
    Ligaments,
    Load,
    at_reference,
    check_fibres,
    ligament_law,
    usual_failure_strain,
)


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
    def adaptations(self) -> tuple[dict[str, Any], ...]:
        """Changes of published values: mappings with `field`, `from`, `to` and `reason`."""
        return tuple(self.document.get("adaptations", ()))


def read_knee(path: str | os.PathLike[str]) -> KneeFile:
    """Read a knee file.

    A left knee (`side: left`, Z to the person's right, which is medial there) is mirrored to its
    right twin: points and forces `z -> -z`, rotations and moments about X and Y change sign,
    regions along Z swap and change sign, odd powers of the width or z change sign. The reference
    pose is given by clinical meaning and stays.

    Args:
        path: the file.

    Returns:
        The knee, the sources of its numbers, and the document.

    Raises:
        InputProblem: the file cannot be read or a field is missing, unknown or out of range.

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
    sources = schema.check_knee(Field(os.fspath(path), "", document))
    right = mirror_document(document) if document["side"] == "left" else document
    knee = _build(right, document["side"], os.fspath(path))
    return KneeFile(knee, sources, document["description"].strip(), Path(path), document)


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


def build_surface(surface: dict[str, Any]) -> Surface:
    """Make a surface of a checked part of a knee document.

    Args:
        surface: a mapping with `kind` and that kind's fields, of a right knee.
    """
    kind = surface["kind"]
    if kind == "condyle":
        frame = _frame(surface, "axis_point_mm", "axis_rotation_deg")
        angle = np.deg2rad(surface["angle_deg"])
        basis = surface.get("basis", POWER)
        return Condyle(surface["coefficients_mm"], angle, surface["width_mm"], frame, basis)
    if kind == "plateau":
        frame = _frame(surface, "origin_mm", "rotation_deg")
        region = surface["anterior_mm"], surface["lateral_mm"]
        basis, outline = surface.get("basis", POWER), surface.get("outline_mm")
        return Plateau(surface["coefficients_mm"], *region, frame, basis, outline)
    if kind == "plane":
        return Plane(_frame(surface, "origin_mm", "rotation_deg"), surface["half_extent_mm"])
    frame = _frame(surface, "center_mm", "rotation_deg")
    if kind == "sphere":
        return Sphere(surface["radius_mm"], frame)
    return Ellipsoid(surface["semi_axes_mm"], frame)


def _frame(surface: dict[str, Any], origin: str, rotation: str) -> Frame:
    turn = surface.get(rotation)
    return Frame(surface[origin], None if turn is None else np.deg2rad(turn))


def _build(document: dict[str, Any], side: str, file: str) -> Knee:
    """The knee of a checked document of a right knee."""
    stated = document["reference_pose"]
    pose = Pose.from_table([float(stated[column]) for column in COLUMNS])
    return Knee(
        ligaments=_ligaments(document["ligaments"], document.get("wraps", {}), pose, file),
        contacts=tuple(_contact(part) for part in document["contacts"].values()),
        loads=tuple(_load(part, name) for name, part in document.get("loads", {}).items()),
        lines=tuple(
            ConstantTensionLine(part["tension_N"], part["origin_mm"], part["insertion_mm"], name)
            for name, part in document.get("lines", {}).items()
        ),
        reference_pose=pose,
        contact_names=tuple(document["contacts"]),
        groups=_groups(document),
        name=document["name"].strip(),
        side=side,
    )


def _ligaments(parts: dict[str, Any], wraps: dict[str, Any], pose: Pose, file: str) -> Ligaments:
    courses = _courses(parts, wraps)
    tears = list(zip(parts.values(), usual_failure_strain(tuple(parts)), strict=True))

    def column(name: str) -> np.ndarray:
        return np.array([part[name] for part in parts.values()], float)

    def fibres(slack: np.ndarray) -> Ligaments:
        return Ligaments(
            column("femoral_attachment_mm"),
            column("tibial_attachment_mm"),
            column("stiffness_N"),
            slack,
            column("transition_strain"),
            column("transition_width"),
            tuple(parts),
            courses,
            [part.get("failure_strain", usual) for part, usual in tears],
            damping=[part.get("damping_s", 0.0) for part in parts.values()],
        )

    unloaded = fibres(np.ones(len(parts)))
    inside, lengths = at_reference(unloaded, State({TIBIA: pose}), detour_counts(parts))
    slack = [
        slack_length(part, length)
        for part, length in zip(parts.values(), np.asarray(lengths).tolist(), strict=True)
    ]
    found = fibres(np.array(slack))
    try:
        check_fibres(found, inside, lengths)
    except Implausible as problem:
        raise _at_its_place(problem, parts[problem.fibre], file) from None
    return found


def _at_its_place(problem: Implausible, part: dict[str, Any], file: str) -> InputProblem:
    """What is wrong with a fibre, said of the field that gave it."""
    place, value, expected = f"ligaments.{problem.fibre}", problem.value, problem.expected
    if problem.quantity == "wrap":
        place, value = f"{place}.wrap", part["wrap"]
    elif problem.quantity == "slack_length":
        given = next(name for name in schema.SLACK_FIELDS if name in part)
        place, value = f"{place}.{given}", part[given]
        expected = f"a value that gives a slack length {expected}"
    return InputProblem(file, place, value, expected)


def _courses(parts: dict[str, Any], wraps: dict[str, Any]) -> list[Course]:
    """Fibres that are not straight, together where bones and obstacle are the same."""
    kinds: dict[tuple, list[int]] = {}
    for row, part in enumerate(parts.values()):
        bones = tuple(via["bone"] for via in part.get("via_points", ()))
        if bones or "wrap" in part:
            kinds.setdefault((bones, part.get("wrap")), []).append(row)
    fibres, courses = list(parts.values()), []
    for (bones, name), rows in kinds.items():
        via = [
            [fibres[row]["via_points"][k]["point_mm"] for row in rows] for k in range(len(bones))
        ]
        points = np.array(via, float) if bones else None
        wrap = wraps[name] if name else None
        bone = wrap["bone"] if wrap else "tibia"
        courses.append(Course(rows, points, bones, _obstacle(wrap) if wrap else None, bone))
    return courses


def _obstacle(wrap: dict[str, Any]) -> Obstacle:
    frame = _frame(wrap, "center_mm", "rotation_deg")
    if wrap["kind"] == "sphere":
        return WrapSphere(wrap["radius_mm"], frame)
    if wrap["kind"] == "cylinder":
        return WrapCylinder(wrap["radius_mm"], wrap["length_mm"], frame)
    return WrapEllipsoid(wrap["semi_axes_mm"], frame)


def _groups(document: dict[str, Any]) -> tuple[tuple[str, tuple[str, ...]], ...]:
    names = document["ligaments"]

    def members(patterns: list[str]) -> tuple[str, ...]:
        return tuple(n for n in names if any(fnmatch.fnmatchcase(n, p) for p in patterns))

    return tuple((name, members(rows)) for name, rows in document.get("groups", {}).items())


def detour_counts(parts: dict[str, Any]) -> bool:
    """Whether a slack length depends on the way that a fibre takes at the reference pose."""
    return any(
        ("wrap" in part or "via_points" in part) and "slack_length_mm" not in part
        for part in parts.values()
    )


def slack_length(part: dict[str, Any], length: float) -> float:
    """The slack length that a ligament of a document has, mm.

    Args:
        part: a ligament.
        length: at the reference pose, mm.
    """
    if "slack_length_mm" in part:
        return float(part["slack_length_mm"])
    if "reference_strain" in part:
        return float(ligament_law.slack_length_from_strain(length, part["reference_strain"]))
    names = ("reference_force_N", "stiffness_N", "transition_strain", "transition_width")
    values = (float(part[name]) for name in names)
    return float(ligament_law.slack_length_from_force(length, *values))


def _contact(part: dict[str, Any]) -> Contact:
    return Contact(
        build_surface(part["femoral_surface"]),
        build_surface(part["tibial_surface"]),
        part["youngs_modulus_MPa"],
        part["poisson_ratio"],
        part["layer_thickness_mm"],
        part["onset_width_mm"],
        law=part["law"],
        form=part["form"],
        points=tuple(part.get("points", (24, 24))),
        layer_variation=part.get("layer_variation_mm"),
    )


def _load(part: dict[str, Any], name: str) -> Load:
    still = (0.0, 0.0, 0.0)
    return Load(
        part.get("force_N", still),
        part.get("moment_Nmm", still),
        part.get("point_mm", still),
        axes=part["axes"],
        point_in=part.get("point_in", "tibia"),
        name=name,
    )
