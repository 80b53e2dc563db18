"""A knee made of a checked document of a right knee."""

from __future__ import annotations

import fnmatch
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from kneejax.files.knee import _schema_parts as parts
from kneejax.files.knee._patella_section import merged
from kneejax.files.reading import InputProblem
from kneejax.geometry import (
    FEMUR,
    PATELLA,
    POWER,
    TIBIA,
    Condyle,
    Ellipsoid,
    Frame,
    Obstacle,
    Pair,
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
    RANGES,
    ConstantTensionLine,
    Contact,
    Course,
    Implausible,
    Knee,
    Ligaments,
    Load,
    Muscles,
    at_reference,
    check_fibres,
    ligament_law,
    usual_failure_strain,
)


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
        return Condyle(
            _floats(surface["coefficients_mm"]), angle, _floats(surface["width_mm"]), frame, basis
        )
    if kind == "plateau":
        frame = _frame(surface, "origin_mm", "rotation_deg")
        region = _floats(surface["anterior_mm"]), _floats(surface["lateral_mm"])
        basis, outline = surface.get("basis", POWER), surface.get("outline_mm")
        return Plateau(_floats(surface["coefficients_mm"]), *region, frame, basis, outline)
    if kind == "plane":
        return Plane(_frame(surface, "origin_mm", "rotation_deg"), surface["half_extent_mm"])
    frame = _frame(surface, "center_mm", "rotation_deg")
    if kind == "sphere":
        return Sphere(surface["radius_mm"], frame)
    return Ellipsoid(surface["semi_axes_mm"], frame)


def _floats(numbers: Any) -> np.ndarray:
    """For these JAX compiles no conversion."""
    return np.array(numbers, float)


def _frame(surface: dict[str, Any], origin: str, rotation: str) -> Frame:
    turn = surface.get(rotation)
    return Frame(surface[origin], None if turn is None else np.deg2rad(turn))


def knee_of(document: dict[str, Any], side: str, file: str) -> Knee:
    """The knee of two bones.

    Args:
        document: a checked document of a right knee.
        side: of the knee that it was read from.
        file: where it stands, for errors.
    """
    return _built(document, side, file, State({TIBIA: _pose(document["reference_pose"], TIBIA)}))


def knee_with_patella(
    document: dict[str, Any], side: str, file: str, tension_N: Mapping[str, float]
) -> Knee:
    """The knee of three bones.

    Args:
        document: as in `knee_of`, with a section `patella`.
        side: likewise.
        file: likewise.
        tension_N: muscle -> its tension; the others have that at rest.
    """
    patella, whole = document["patella"], merged(document)
    poses = {bone: _pose(part["reference_pose"], bone)
             for bone, part in ((TIBIA, document), (PATELLA, patella))}  # fmt: skip
    state = State(poses)
    return _built(whole, side, file, state, _muscles(patella, state, file, tension_N))


def _built(
    document: dict[str, Any], side: str, file: str, state: State, muscles: Muscles | None = None
) -> Knee:
    ligaments = document["ligaments"]
    return Knee(
        ligaments=_ligaments(ligaments, document.get("wraps", {}), state, file),
        contacts=tuple(_contact(part) for part in document["contacts"].values()),
        loads=tuple(_load(part, name) for name, part in document.get("loads", {}).items()),
        lines=tuple(
            ConstantTensionLine(part["tension_N"], part["origin_mm"], part["insertion_mm"], name)
            for name, part in document.get("lines", {}).items()
        ),
        reference_pose=state.tibia,
        contact_names=tuple(document["contacts"]),
        groups=_groups(document.get("groups", {}), tuple(ligaments)),
        name=document["name"].strip(),
        side=side,
        other_bones={bone: pose for bone, pose in state.poses.items() if bone != TIBIA},
        muscles=muscles,
    )


def _pose(stated: dict[str, Any], bone: str) -> Pose:
    return Pose.from_table([float(stated[x]) for x in parts.POSE_FIELDS[bone][:-1]])


def _ligaments(
    ligaments: dict[str, Any], wraps: dict[str, Any], state: State, file: str
) -> Ligaments:
    """All fibres; those of the patella must not be torn at the reference poses."""
    tears = list(zip(ligaments.values(), usual_failure_strain(tuple(ligaments)), strict=True))
    ends = [ends_of(part) for part in ligaments.values()]

    def column(name: str) -> np.ndarray:
        return np.array([part[name] for part in ligaments.values()], float)

    def attachments(side: int) -> np.ndarray:
        every = zip(ligaments.values(), ends, strict=True)
        return np.array([part[fields[side]] for part, fields in every], float)

    def fibres(slack: np.ndarray) -> Ligaments:
        return Ligaments(
            attachments(0),
            attachments(1),
            column("stiffness_N"),
            slack,
            column("transition_strain"),
            column("transition_width"),
            tuple(ligaments),
            _courses([_Way(x, _bones(e)) for x, e in zip(ligaments.values(), ends, strict=True)],
                     wraps),
            _floats([part.get("failure_strain", usual) for part, usual in tears]),
            damping=_floats([part.get("damping_N_s", 0.0) for part in ligaments.values()]),
            bodies=tuple(_bones(fields) for fields in ends),
        )  # fmt: skip

    unloaded = fibres(np.ones(len(ligaments)))
    inside, lengths = at_reference(unloaded, state, detour_counts(ligaments))
    slack = [
        slack_length(part, length)
        for part, length in zip(ligaments.values(), np.asarray(lengths).tolist(), strict=True)
    ]
    found = fibres(np.array(slack))
    try:
        check_fibres(found, inside, lengths)
    except Implausible as problem:
        raise _at_its_place(problem, ligaments[problem.fibre], file) from None
    if PATELLA in state.poses:
        _check_not_torn(found, np.asarray(lengths), ligaments, file)
    return found


def ends_of(part: dict[str, Any]) -> tuple[str, str]:
    """The fields of a ligament's two attachments."""
    first, second = (field for field in parts.ENDS if field in part)
    return first, second


def _bones(ends: tuple[str, str]) -> Pair:
    return parts.ENDS[ends[0]], parts.ENDS[ends[1]]


def _check_not_torn(
    found: Ligaments, lengths: np.ndarray, ligaments: dict[str, Any], file: str
) -> None:
    strains = lengths / np.asarray(found.slack_length) - 1.0
    for row, (name, part) in enumerate(ligaments.items()):
        if PATELLA in found.bodies[row] and strains[row] > float(found.failure_strain[row]):
            given = next(field for field in parts.SLACK_FIELDS if field in part)
            expected = (
                f"a ligament that reaches over its {lengths[row]:.1f} mm at the reference poses: "
                f"strained by {100.0 * strains[row]:.0f} % it would be torn"
            )
            raise InputProblem(file, f"patella.ligaments.{name}.{given}", part[given], expected)


def _at_its_place(problem: Implausible, part: dict[str, Any], file: str) -> InputProblem:
    """What is wrong with a fibre, said of the field that gave it."""
    section = "patella.ligaments" if "patellar_attachment_mm" in part else "ligaments"
    place, value, expected = f"{section}.{problem.fibre}", problem.value, problem.expected
    if problem.quantity == "wrap":
        place, value = f"{place}.wrap", part["wrap"].removeprefix("patella.")
    elif problem.quantity == "slack_length":
        given = next(name for name in parts.SLACK_FIELDS if name in part)
        place, value = f"{place}.{given}", part[given]
        expected = f"a value that gives a slack length {expected}"
    return InputProblem(file, place, value, expected)


class _Way(NamedTuple):
    """A part of the document that may have via points and a wrap, and the bones that it joins."""

    part: dict[str, Any]
    bones: Pair


def _courses(ways: list[_Way], wraps: dict[str, Any]) -> list[Course]:
    """What is not straight, together where bones and obstacle are the same."""
    kinds: dict[tuple, list[int]] = {}
    for row, (part, pair) in enumerate(ways):
        bones = tuple(via["bone"] for via in part.get("via_points", ()))
        if bones or "wrap" in part:
            kinds.setdefault((pair, bones, part.get("wrap")), []).append(row)
    courses = []
    for (pair, bones, name), rows in kinds.items():
        via = [
            [ways[row].part["via_points"][k]["point_mm"] for row in rows] for k in range(len(bones))
        ]
        points = np.array(via, float) if bones else None
        wrap = wraps[name] if name else None
        bone = wrap["bone"] if wrap else pair[1]
        obstacle = build_obstacle(wrap) if wrap else None
        courses.append(Course(rows, points, bones, obstacle, bone, pair))
    return courses


def _muscles(
    patella: dict[str, Any], state: State, file: str, tension_N: Mapping[str, float]
) -> Muscles:
    """Muscles that pull."""
    known = patella["muscles"]
    for name, tension in tension_N.items():
        if name not in known:
            expected = f"one of {', '.join(known)}"
            raise InputProblem(file, "patella.muscles", name, expected, tuple(known))
        if not RANGES["tension_N"].holds(tension):
            expected = RANGES["tension_N"].expected(tension)
            raise InputProblem(file, f"tension of {name}", f"{tension:g} N", expected)
    tensions = {name: float(tension_N.get(name, x["tension_N"])) for name, x in known.items()}
    names = tuple(name for name, tension in tensions.items() if tension > 0)
    ways = [_Way(known[name], (FEMUR, known[name]["insertion_bone"])) for name in names]
    muscles = Muscles(
        [way.part["origin_mm"] for way in ways],
        [way.part["insertion_mm"] for way in ways],
        [tensions[name] for name in names],
        names,
        _courses(ways, patella.get("wraps", {})),
        tuple(way.bones for way in ways),
    )
    for row in np.flatnonzero(np.asarray(muscles.ends_inside(state))):
        expected = f"an origin, via points and an insertion outside {ways[row].part['wrap']}"
        place = f"patella.muscles.{names[row]}.wrap"
        raise InputProblem(file, place, "an end inside what the muscle goes around", expected)
    return muscles


def build_obstacle(wrap: dict[str, Any]) -> Obstacle:
    """What fibres go around, by its entry in a knee document."""
    frame = _frame(wrap, "center_mm", "rotation_deg")
    if wrap["kind"] == "sphere":
        return WrapSphere(wrap["radius_mm"], frame)
    if wrap["kind"] == "cylinder":
        return WrapCylinder(wrap["radius_mm"], wrap["length_mm"], frame, wrap.get("side", ""))
    return WrapEllipsoid(wrap["semi_axes_mm"], frame)


def _groups(
    groups: dict[str, list[str]], names: tuple[str, ...]
) -> tuple[tuple[str, tuple[str, ...]], ...]:
    def members(patterns: list[str]) -> tuple[str, ...]:
        return tuple(n for n in names if any(fnmatch.fnmatchcase(n, p) for p in patterns))

    return tuple((name, members(rows)) for name, rows in groups.items())


def detour_counts(ligaments: dict[str, Any]) -> bool:
    """Whether a slack length depends on the way that a fibre takes at the reference pose."""
    return any(
        ("wrap" in part or "via_points" in part) and "slack_length_mm" not in part
        for part in ligaments.values()
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
    faces = [face for face in parts.FACES if face in part]
    bones = FEMUR, PATELLA if "patellar_surface" in faces else TIBIA
    return Contact(
        build_surface(part[faces[0]]),
        build_surface(part[faces[1]]),
        part["youngs_modulus_MPa"],
        part["poisson_ratio"],
        part["layer_thickness_mm"],
        part["onset_width_mm"],
        law=part["law"],
        form=part["form"],
        points=tuple(part.get("points", (24, 24))),
        layer_variation=part.get("layer_variation_mm"),
        bodies=bones,
    )


def _load(part: dict[str, Any], name: str) -> Load:
    still = (0.0, 0.0, 0.0)
    return Load(
        *(_floats(part.get(field, still)) for field in ("force_N", "moment_Nmm", "point_mm")),
        axes=part["axes"],
        point_in=part.get("point_in", "tibia"),
        name=name,
    )
