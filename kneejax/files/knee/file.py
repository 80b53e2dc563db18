"""Knee files: readable YAML in which every number has a unit and a source."""

__all__ = ["KneeFile", "read_knee", "write_knee"]

import dataclasses
import fnmatch
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from kneejax import geometry, mechanics
from kneejax.files.knee import document as documents
from kneejax.files.knee import parts, surfaces
from kneejax.files.knee.document import KneeDocument, Patella, check_knee, mirror_document
from kneejax.files.knee.surfaces import build_surface
from kneejax.files.reading import InputProblem, format_yaml, load_yaml, write_text
from kneejax.geometry import PATELLA, TIBIA, Surface
from kneejax.mechanics import RANGES, Implausible, Knee


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
        left, stated = self.document["side"] == "left", self.document.get("surfaces", {})
        right = documents.mirror_part if left else dict
        return {bone: build_surface(right(part)) for bone, part in stated.items()}

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
        document, side = documents.with_own_patella(self.document), self.document["side"]
        right = check_knee(mirror_document(document) if side == "left" else document, self.path)
        return _built(right, side, str(self.path), tension_N or {})


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
    """As `read_knee`, of a document that stands in a file, or was made of it."""
    read = check_knee(document, path)
    if read.bands:
        document = _drawn(document, read.bands, pose_of(read.reference_pose).placement)
        read = check_knee(document, path)
    right = check_knee(mirror_document(document), path) if read.side == "left" else read
    knee = _built(right, read.side, os.fspath(path))
    sources = dict(documents.sources_of(read))
    return KneeFile(knee, sources, read.description, Path(path), document)


def _drawn(
    document: dict[str, Any], bands: Mapping[str, parts.Band], tibia: geometry.Placement
) -> dict[str, Any]:
    """A knee document whose bands, read, are fibres, each band a group. Half diameters belong to
    each other, first to first; those of an outline twist the band least where the tibia is."""
    fibres, groups = dict(document["ligaments"]), dict(document.get("groups", {}))
    # A left knee's points are its own, and its pose is that of a right one.
    signs = parts.mirror(document["side"])
    for name, band in bands.items():
        areas = band.femoral_area, band.tibial_area
        femoral, tibial = (area.ellipse(document["side"]) for area in areas)
        if any(area.outline_mm is not None for area in areas):
            own = tibial.half_axes * signs
            axes = np.array([[*map(float, tibia.turn(geometry.Vector(*x)))] for x in own]) * signs
            whole = mechanics.AttachmentArea(tibial.centre, axes)
            turned = mechanics.untwisted(femoral, whole).half_axes
            back = [[*map(float, tibia.turn_back(geometry.Vector(*x)))] for x in turned * signs]
            tibial = mechanics.AttachmentArea(tibial.centre, np.array(back) * signs)
        field = mechanics.fibre_field(
            femoral, tibial, band.youngs_modulus_MPa, band.area_mm2, band.prestretch, band.fibres
        )
        same = band.model_dump(exclude_none=True, include={
            "law", "transition_width", "failure_strain", "wrap", "transition_strain"})
        said = band.source if isinstance(band.source, str) else "; ".join(band.source.values())
        groups[name] = [*parts.fibre_names(name, band)]
        for row, fibre in enumerate(groups[name]):
            fibres[fibre] = {
                "femoral_attachment_mm": field.femoral[row].tolist(),
                "tibial_attachment_mm": field.tibial[row].tolist(),
                "stiffness_N": float(field.stiffness[row]),
                "area_mm2": float(field.area[row]),
                "reference_strain": float(field.prestretch[row]) - 1.0,
                "damping_N_s": band.damping_N_s * float(field.area[row]) / band.area_mm2,
                **same,
                "source": f"band {name}: {said}",
            }
    changed = document | {"ligaments": fibres, "groups": groups}
    return {key: value for key, value in changed.items() if key != "bands"}


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
    plain = documents.plain_document(document)
    build_knee(plain, path)
    head = "".join(f"# {line}\n" for line in comment.splitlines())
    write_text(path, head + format_yaml(plain))


#: A ligament or muscle, and what it goes around.
Way = tuple[Any, surfaces.Obstacle | None]


def _built(
    document: KneeDocument, side: str, file: str, tension_N: Mapping[str, float] | None = None
) -> Knee:
    """The knee of a document of a right one, as which a knee of that side is read; of three bones
    where muscles' tensions are given, then without the lines that stand for a patella."""
    ways = _ways(document.ligaments, document.wraps)
    contacts: dict[str, surfaces.ContactPart] = {**document.contacts}
    poses, patella, muscles = {TIBIA: pose_of(document.reference_pose)}, document.patella, None
    if tension_N is not None:
        assert isinstance(patella, Patella)
        poses[PATELLA] = pose_of(patella.reference_pose)
        ways |= _ways(patella.ligaments, patella.wraps)
        contacts |= patella.contacts
        muscles = _muscles(patella, geometry.State(poses), file, tension_N)
    state, lines = geometry.State(poses), document.lines.items() if tension_N is None else ()

    def members(patterns: Iterable[str]) -> tuple[str, ...]:
        return tuple(n for n in ways if any(fnmatch.fnmatchcase(n, p) for p in patterns))

    return Knee(
        ligaments=_ligaments(ways, state, file),
        contacts=tuple(part.built() for part in contacts.values()),
        loads=tuple(part.built(name=name) for name, part in document.loads.items()),
        lines=tuple(part.built(name=name) for name, part in lines),
        reference_pose=state.tibia,
        contact_names=tuple(contacts),
        groups=tuple((name, members(rows)) for name, rows in document.groups.items()),
        name=document.name,
        side=side,
        other_bones={bone: pose for bone, pose in poses.items() if bone != TIBIA},
        muscles=muscles,
    )


def pose_of(stated: Any) -> geometry.Pose:
    """A pose of a document."""
    return geometry.Pose.from_table([x for name, x in stated if name != "source"])


def _ways(of: Mapping[str, Any], wraps: Mapping[str, surfaces.Obstacle]) -> dict[str, Way]:
    return {name: (part, wraps.get(part.wrap or "")) for name, part in of.items()}


def _ligaments(ways: dict[str, Way], state: geometry.State, file: str) -> mechanics.Ligaments:
    """All fibres; those of the patella must not be torn at the reference poses."""
    ligaments, numbers = [part for part, _ in ways.values()], {}
    # The transition strain is of the law of Blankevoort; the other has none, and any will do.
    usual = {"failure_strain": mechanics.usual_failure_strain(tuple(ways)),
             "transition_strain": [0.06] * len(ways)}
    for field in parts.OF_FIBRE:
        every = [getattr(part, field) for part in ligaments]
        stated = [usual[field][k] if x is None else x for k, x in enumerate(every)]
        numbers[parts.quantity(field)] = np.array(stated, float)
    ends = [[getattr(part, part.ends[k]) for part in ligaments] for k in (0, 1)]
    unloaded = mechanics.Ligaments(
        *np.array(ends, float), slack_length=np.ones(len(ways)), names=tuple(ways),
        courses=_courses([*ways.values()]), laws=tuple(part.law for part in ligaments),
        bodies=tuple(part.bones for part in ligaments), **numbers)
    inside, lengths = mechanics.at_reference(unloaded, state, detour_counts(ligaments))
    lengths = np.asarray(lengths)
    slack = [slack_length(*pair) for pair in zip(ligaments, lengths.tolist(), strict=True)]
    found = eqx.tree_at(lambda x: x.slack_length, unloaded, jnp.asarray(np.array(slack, float)))
    try:
        mechanics.check_fibres(found, inside, lengths)
    except Implausible as problem:  # said of the field that gave it
        part = ways[problem.fibre][0]
        value, expected = problem.value, problem.expected
        section = "ligaments" if part.patellar_attachment_mm is None else "patella.ligaments"
        place = f"{section}.{problem.fibre}"
        if problem.quantity == "wrap":
            place, value = f"{place}.wrap", part.wrap
        elif problem.quantity == "slack_length":
            place, value = f"{place}.{part.slack_field}", getattr(part, part.slack_field)
            expected = f"a value that gives a slack length {expected}"
        raise InputProblem(file, place, value, expected) from None
    strains = lengths / np.asarray(found.slack_length) - 1.0
    for row, (name, part) in enumerate(zip(ways, ligaments, strict=True)):
        if PATELLA in part.bones and strains[row] > float(found.failure_strain[row]):
            place = f"patella.ligaments.{name}.{part.slack_field}"
            expected = (f"a ligament that reaches over its {lengths[row]:.1f} mm at the reference "
                        f"poses: strained by {100.0 * strains[row]:.0f} % it would be torn")
            raise InputProblem(file, place, getattr(part, part.slack_field), expected)
    return found


def _courses(ways: list[Way]) -> list[mechanics.Course]:
    """What is not straight, together where bones and obstacle are the same."""
    kinds: dict[tuple, list[int]] = {}
    for row, (part, obstacle) in enumerate(ways):
        bones = tuple(via.bone for via in part.via_points)
        if bones or obstacle is not None:
            kinds.setdefault((part.bones, bones, id(obstacle)), []).append(row)
    courses = []
    for (pair, bones, _), rows in kinds.items():
        via = [[ways[row][0].via_points[k].point_mm for row in rows] for k in range(len(bones))]
        points, wrap = np.array(via, float) if bones else None, ways[rows[0]][1]
        obstacle, bone = (None, pair[1]) if wrap is None else (wrap.built(), wrap.bone)
        courses.append(mechanics.Course(rows, points, bones, obstacle, bone, pair))
    return courses


def _muscles(
    patella: Patella, state: geometry.State, file: str, tension_N: Mapping[str, float]
) -> mechanics.Muscles:
    """Muscles that pull."""
    known, allowed = patella.muscles, RANGES["tension_N"]
    for name, tension in tension_N.items():
        if name not in known:
            raise InputProblem(file, "patella.muscles", name, known)
        if not allowed.holds(tension):
            found, expected = f"{tension:g} N", allowed.expected(tension)
            raise InputProblem(file, f"tension of {name}", found, expected)
    tensions = {name: float(tension_N.get(name, one.tension_N)) for name, one in known.items()}
    own = {name: one for name, one in known.items() if tensions[name] > 0}
    names, every = tuple(own), [*own.values()]
    muscles = mechanics.Muscles(
        [x.origin_mm for x in every], [x.insertion_mm for x in every], [tensions[x] for x in names],
        names, _courses([*_ways(own, patella.wraps).values()]), tuple(x.bones for x in every))
    for row in np.flatnonzero(np.asarray(muscles.ends_inside(state))):
        expected = f"an origin, via points and an insertion outside {every[row].wrap}"
        place = f"patella.muscles.{names[row]}.wrap"
        raise InputProblem(file, place, "an end inside what the muscle goes around", expected)
    return muscles


def detour_counts(ligaments: Iterable[parts.Ligament]) -> bool:
    """Whether a slack length depends on the way that a fibre takes at the reference pose."""
    return any((part.wrap is not None or part.via_points) and part.slack_length_mm is None
               for part in ligaments)


def slack_length(part: parts.Ligament, length: float) -> float:
    """The slack length of a ligament that is so long at the reference pose, mm."""
    if part.slack_length_mm is not None:
        return float(part.slack_length_mm)
    if part.reference_strain is not None:
        return float(mechanics.ligament_law.slack_length_from_strain(length, part.reference_strain))
    law, corners = mechanics.ligament_law, [part.transition_strain, part.transition_width]
    if part.law == mechanics.NEO_HOOKEAN:
        law, corners = mechanics.neo_hookean_law, corners[1:]
    force, stiffness = part.reference_force_N, part.stiffness_N
    return float(law.slack_length_from_force(length, force, stiffness, *corners))
