"""Knee files: readable YAML in which every number has a unit and a source."""

from __future__ import annotations

import dataclasses
import fnmatch
import os
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files.knee import _schema as schema
from kneejax.files.knee._mirror import mirror_document, mirror_part
from kneejax.files.reading import Field, InputProblem, format_yaml, load_yaml, write_text
from kneejax.geometry import (
    COLUMNS,
    POWER,
    Condyle,
    Ellipsoid,
    Frame,
    Obstacle,
    Plane,
    Plateau,
    Pose,
    Sphere,
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
    document = load_yaml(path, "a knee file")
    sources = schema.check_knee(Field(os.fspath(path), "", document))
    right = mirror_document(document) if document["side"] == "left" else document
    knee = _build(right, document["side"], os.fspath(path))
    return KneeFile(knee, sources, document["description"].strip(), Path(path), document)


def format_knee(document: dict[str, Any]) -> str:
    """Write a knee document as text.

    Args:
        document: content of a knee file; NumPy numbers and arrays may stand in it.

    Returns:
        YAML with fields in the order of the format, names in the order given, every float with
        the digits that it has; the same text for the same document.

    Example:
        >>> print(format_knee({"side": "right", "name": "small", "kneejax": 1}), end="")
        kneejax: 1
        name: small
        side: right
    """
    return format_yaml(_ordered(_plain(document)))


def write_knee(document: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """Check a knee document and write it to a file, completely or not at all.

    Args:
        document: as in `format_knee`.
        path: the file.

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
    plain = _ordered(_plain(document))
    schema.check_knee(Field(os.fspath(path), "", plain))
    right = mirror_document(plain) if plain["side"] == "left" else plain
    _build(right, plain["side"], os.fspath(path))
    write_text(path, format_yaml(plain))


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


def _ligaments(
    parts: dict[str, Any], wraps: dict[str, Any], pose: Pose, file: str
) -> Ligaments:
    courses = _courses(parts, wraps)
    tears = list(zip(parts.values(), usual_failure_strain(tuple(parts)), strict=True))

    def column(name: str) -> np.ndarray:
        return np.array([part[name] for part in parts.values()], float)

    def fibres(slack_length) -> Ligaments:
        return Ligaments(
            column("femoral_attachment_mm"),
            column("tibial_attachment_mm"),
            column("stiffness_N"),
            slack_length,
            column("transition_strain"),
            column("transition_width"),
            tuple(parts),
            courses,
            [part.get("failure_strain", usual) for part, usual in tears],
        )

    unloaded = fibres(np.ones(len(parts)))
    around = any("wrap" in part and "slack_length_mm" not in part for part in parts.values())
    inside, lengths = at_reference(unloaded, pose, around)
    slack = [
        _slack(part, length)
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


def _slack(part: dict[str, Any], length: float) -> float:
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


def _plain(value: Any) -> Any:
    """The same with Python's own numbers, texts and lists."""
    if isinstance(value, dict):
        return {str(name): _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):  # NumPy and JAX arrays and numbers
        return _plain(np.asarray(value).tolist())
    return value


def _ordered(document: dict[str, Any]) -> dict[str, Any]:
    document = _sorted(document, schema.KNEE_FIELDS)
    if isinstance(document.get("reference_pose"), dict):
        document["reference_pose"] = _sorted(document["reference_pose"], schema.POSE_FIELDS)
    for section, fields in (
        ("ligaments", schema.LIGAMENT_FIELDS),
        ("contacts", schema.CONTACT_FIELDS),
        ("wraps", schema.WRAP_FIELDS),
        ("lines", schema.LINE_FIELDS),
        ("loads", schema.LOAD_FIELDS),
    ):
        parts = document.get(section)
        if isinstance(parts, dict):
            document[section] = {name: _sorted(part, fields) for name, part in parts.items()}
    surfaces = document.get("surfaces")
    if isinstance(surfaces, dict):
        document["surfaces"] = {bone: _sorted_surface(x) for bone, x in surfaces.items()}
    return document


def _sorted(part: Any, fields: tuple[str, ...]) -> Any:
    """The same mapping, known fields first and in their order; surfaces within it likewise."""
    if not isinstance(part, dict):
        return part
    names = [name for name in fields if name in part]
    answer = {name: part[name] for name in (*names, *(x for x in part if x not in names))}
    for name in ("femoral_surface", "tibial_surface"):
        if name in answer:
            answer[name] = _sorted_surface(answer[name])
    return answer


def _sorted_surface(surface: Any) -> Any:
    if not isinstance(surface, dict):
        return surface
    required, optional = schema.SURFACES.get(surface.get("kind"), ((), ()))  # pyright: ignore[reportCallIssue]
    order = ("kind", required[0], *optional, *required[1:]) if required else ()
    return _sorted(surface, (*order, *schema.SURFACE_EXTRAS))
