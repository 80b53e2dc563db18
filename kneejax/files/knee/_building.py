"""A knee made of a checked document of a right knee."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import numpy as np

from kneejax import geometry, mechanics
from kneejax.files.knee import _parts as parts
from kneejax.files.knee import _surfaces as surfaces
from kneejax.files.knee._document import KneeDocument, Patella
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, PATELLA, TIBIA
from kneejax.mechanics import RANGES, Implausible


class Way(NamedTuple):
    """A part that may have via points and a wrap, the bones that it joins, and known wraps."""

    part: parts.Ligament | parts.Muscle
    bones: geometry.Pair
    wraps: Mapping[str, surfaces.Obstacle]


def knee_of(document: KneeDocument, side: str, file: str) -> mechanics.Knee:
    """The knee of two bones.

    Args:
        document: of a right knee.
        side: of the knee that it was read from.
        file: where it stands, for errors.
    """
    state = geometry.State({TIBIA: pose_of(document.reference_pose)})
    return _built(document, None, side, file, state, None)


def knee_with_patella(
    document: KneeDocument, side: str, file: str, tension_N: Mapping[str, float]
) -> mechanics.Knee:
    """The knee of three bones.

    Lines of constant tension, which stand for the patella where there is none, are left out.

    Args:
        document: as in `knee_of`, with a section `patella`.
        side: likewise.
        file: likewise.
        tension_N: muscle -> its tension; the others have that at rest.
    """
    patella = document.patella
    assert isinstance(patella, Patella)
    poses = {TIBIA: document.reference_pose, PATELLA: patella.reference_pose}
    state = geometry.State({bone: pose_of(pose) for bone, pose in poses.items()})
    muscles = _muscles(patella, state, file, tension_N)
    return _built(document, patella, side, file, state, muscles)


def _built(
    document: KneeDocument, patella: Patella | None, side: str, file: str, state: geometry.State,
    muscles: mechanics.Muscles | None,
) -> mechanics.Knee:  # fmt: skip
    ways, contacts = _ways(document.ligaments, document.wraps), dict[str, surfaces.ContactPart]()
    contacts |= document.contacts
    if patella is not None:
        ways |= _ways(patella.ligaments, patella.wraps)
        contacts |= patella.contacts
    lines = document.lines.items() if patella is None else ()
    names = tuple(ways)

    def members(patterns: Iterable[str]) -> tuple[str, ...]:
        return tuple(n for n in names if any(fnmatch.fnmatchcase(n, p) for p in patterns))

    return mechanics.Knee(
        ligaments=_ligaments(ways, state, file),
        contacts=tuple(part.built() for part in contacts.values()),
        loads=tuple(part.built(name=name) for name, part in document.loads.items()),
        lines=tuple(
            part.built(name=name) for name, part in lines
        ),
        reference_pose=state.tibia,
        contact_names=tuple(contacts),
        groups=tuple((name, members(rows)) for name, rows in document.groups.items()),
        name=document.name,
        side=side,
        other_bones={bone: pose for bone, pose in state.poses.items() if bone != TIBIA},
        muscles=muscles,
    )


def _floats(numbers: Any) -> np.ndarray:
    return np.array(numbers, float)


def pose_of(stated: Any) -> geometry.Pose:
    """A pose of a document."""
    return geometry.Pose.from_table([x for name, x in stated if name != "source"])


def _ways(ligaments: Mapping[str, parts.Ligament], wraps: Mapping[str, Any]) -> dict[str, Way]:
    return {
        name: Way(part, (parts.ENDS[part.ends[0]], parts.ENDS[part.ends[1]]), wraps)
        for name, part in ligaments.items()
    }


def _ligaments(ways: dict[str, Way], state: geometry.State, file: str) -> mechanics.Ligaments:
    """All fibres; those of the patella must not be torn at the reference poses."""
    ligaments: list[Any] = [way.part for way in ways.values()]
    usual = mechanics.usual_failure_strain(tuple(ways))
    tears = [usual[row] if one.failure_strain is None else one.failure_strain
             for row, one in enumerate(ligaments)]  # fmt: skip

    def column(name: str) -> np.ndarray:
        return _floats([getattr(part, name) for part in ligaments])

    def fibres(slack: np.ndarray) -> mechanics.Ligaments:
        return mechanics.Ligaments(
            _floats([getattr(part, part.ends[0]) for part in ligaments]),
            _floats([getattr(part, part.ends[1]) for part in ligaments]),
            column("stiffness_N"),
            slack,
            _floats([_transition_strain(part) for part in ligaments]),
            column("transition_width"),
            tuple(ways),
            _courses([*ways.values()]),
            _floats(tears),
            damping=column("damping_N_s"),
            area=column("area_mm2"),
            laws=tuple(part.law for part in ligaments),
            bodies=tuple(way.bones for way in ways.values()),
        )

    unloaded = fibres(np.ones(len(ligaments)))
    inside, lengths = mechanics.at_reference(unloaded, state, detour_counts(ligaments))
    lengths = np.asarray(lengths)
    slack = [slack_length(*pair) for pair in zip(ligaments, lengths.tolist(), strict=True)]
    found = fibres(np.array(slack))
    try:
        mechanics.check_fibres(found, inside, lengths)
    except Implausible as problem:
        raise _at_its_place(problem, ways[problem.fibre].part, file) from None
    if PATELLA in state.poses:
        strains = lengths / np.asarray(found.slack_length) - 1.0
        for row, (name, part) in enumerate(zip(ways, ligaments, strict=True)):
            if PATELLA in found.bodies[row] and strains[row] > float(found.failure_strain[row]):
                given = part.slack_field
                expected = (
                    f"a ligament that reaches over its {lengths[row]:.1f} mm at the reference "
                    f"poses: strained by {100.0 * strains[row]:.0f} % it would be torn"
                )
                place = f"patella.ligaments.{name}.{given}"
                raise InputProblem(file, place, getattr(part, given), expected)
    return found


def _transition_strain(part: parts.Ligament) -> float:
    """Of the law of Blankevoort; the other has none, and any number will do."""
    return 0.06 if part.transition_strain is None else part.transition_strain


def _at_its_place(problem: Implausible, part: Any, file: str) -> InputProblem:
    """What is wrong with a fibre, said of the field that gave it."""
    section = "ligaments" if part.patellar_attachment_mm is None else "patella.ligaments"
    place, value, expected = f"{section}.{problem.fibre}", problem.value, problem.expected
    if problem.quantity == "wrap":
        place, value = f"{place}.wrap", part.wrap
    elif problem.quantity == "slack_length":
        given = part.slack_field
        place, value = f"{place}.{given}", getattr(part, given)
        expected = f"a value that gives a slack length {expected}"
    return InputProblem(file, place, value, expected)


def _courses(ways: list[Way]) -> list[mechanics.Course]:
    """What is not straight, together where bones and obstacle are the same."""
    kinds: dict[tuple, list[int]] = {}
    for row, way in enumerate(ways):
        bones = tuple(via.bone for via in way.part.via_points)
        if bones or way.part.wrap is not None:
            section = id(way.wraps) if way.part.wrap is not None else 0
            kinds.setdefault((way.bones, bones, way.part.wrap, section), []).append(row)
    courses = []
    for (pair, bones, name, _), rows in kinds.items():
        via = [[ways[row].part.via_points[k].point_mm for row in rows] for k in range(len(bones))]
        points = np.array(via, float) if bones else None
        wrap = ways[rows[0]].wraps[name] if name else None
        bone = wrap.bone if wrap else pair[1]
        obstacle = wrap.built() if wrap else None
        courses.append(mechanics.Course(rows, points, bones, obstacle, bone, pair))
    return courses


def _muscles(
    patella: Patella, state: geometry.State, file: str, tension_N: Mapping[str, float]
) -> mechanics.Muscles:
    """Muscles that pull."""
    known = patella.muscles
    for name, tension in tension_N.items():
        if name not in known:
            expected = f"one of {', '.join(known)}"
            raise InputProblem(file, "patella.muscles", name, expected, tuple(known))
        if not RANGES["tension_N"].holds(tension):
            expected = RANGES["tension_N"].expected(tension)
            raise InputProblem(file, f"tension of {name}", f"{tension:g} N", expected)
    tensions = {name: float(tension_N.get(name, one.tension_N)) for name, one in known.items()}
    names = tuple(name for name, tension in tensions.items() if tension > 0)
    ways = [Way(known[x], (FEMUR, known[x].insertion_bone), patella.wraps) for x in names]
    muscles = mechanics.Muscles(
        [known[name].origin_mm for name in names],
        [known[name].insertion_mm for name in names],
        [tensions[name] for name in names],
        names,
        _courses(ways),
        tuple(way.bones for way in ways),
    )
    for row in np.flatnonzero(np.asarray(muscles.ends_inside(state))):
        expected = f"an origin, via points and an insertion outside {ways[row].part.wrap}"
        place = f"patella.muscles.{names[row]}.wrap"
        raise InputProblem(file, place, "an end inside what the muscle goes around", expected)
    return muscles


def detour_counts(ligaments: Iterable[parts.Ligament]) -> bool:
    """Whether a slack length depends on the way that a fibre takes at the reference pose."""
    return any(
        (part.wrap is not None or part.via_points) and part.slack_length_mm is None
        for part in ligaments
    )


def slack_length(part: parts.Ligament, length: float) -> float:
    """The slack length that a ligament of a document has, mm.

    Args:
        part: a ligament.
        length: at the reference pose, mm.
    """
    if part.slack_length_mm is not None:
        return float(part.slack_length_mm)
    if part.reference_strain is not None:
        return float(mechanics.ligament_law.slack_length_from_strain(length, part.reference_strain))
    values = part.reference_force_N, part.stiffness_N
    if part.law == mechanics.NEO_HOOKEAN:
        law = mechanics.neo_hookean_law
        return float(law.slack_length_from_force(length, *values, part.transition_width))
    corners = part.transition_strain, part.transition_width
    return float(mechanics.ligament_law.slack_length_from_force(length, *values, *corners))
