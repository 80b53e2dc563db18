"""Fibres and muscles of an OpenSim model that come over the knee, and its patella."""

import collections
import dataclasses
import re
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

import numpy as np

from kneejax.files.knee.parts import ENDS
from kneejax.files.opensim import paths
from kneejax.files.opensim.exact import METRES_TO_MM, poses_of, shifted
from kneejax.files.opensim.knee import OsimKneeJoint
from kneejax.files.opensim.model import Model
from kneejax.files.opensim.xml import Element
from kneejax.files.reading import counted, plain_number
from kneejax.geometry import BODIES, FEMUR, PATELLA
from kneejax.mechanics import FAILURE_SOURCE, RANGES, usual_failure_strain

#: Rounding of the ligament law's corners, which OpenSim's law does not have: small enough for its
#: forces, see `kneejax.mechanics.ligament_law.largest_tension_error`.
TRANSITION_WIDTH = 1e-4
#: A point this little inside an obstacle is a matter of digitising.
SHALLOW_MM = 0.5
KIND = "Blankevoort1991Ligament"
#: Field -> (tag, what OpenSim takes where a file and its <defaults> say nothing, what it must be).
NUMBERS = {
    "stiffness_N": ("linear_stiffness", "1", "a number > 0 N"),
    "slack_length_mm": ("slack_length", "0", "a number > 0 m"),
    "transition_strain": ("transition_strain", "0.06", "a number > 0"),
    "damping_N_s": ("damping_coefficient", "0.003", "a number >= 0"),
}
#: Pull of the whole quadriceps where nothing is said, N: the weight of 2 kg that hangs on it in
#: tests of passive flexion.
AT_REST_N = 19.61


@dataclasses.dataclass(frozen=True)
class OsimLigament(paths.OsimPath):
    """A fibre that spans the knee."""

    # field of a knee file -> number of the model, in SI
    numbers: dict[str, Decimal] = dataclasses.field(default_factory=dict)
    assumed: tuple[str, ...] = ()  # fields that stand neither at the fibre nor in <defaults>

    def document(self, knee: OsimKneeJoint, file: str, wraps: dict[Element, str]) -> dict[str, Any]:
        """The entry of a knee file; `wraps` has the names of obstacles."""
        (first, begin), (last, end), via = self.ends(knee)
        fields = {bone: field for field, bone in ENDS.items()}
        entry: dict[str, Any] = {fields[first]: begin, **via, fields[last]: end}
        if self.wrap is not None:
            entry["wrap"] = wraps[self.wrap.element]
        for field, value in self.numbers.items():
            entry[field] = shifted(value, METRES_TO_MM if field == "slack_length_mm" else 0)
        entry["transition_width"] = TRANSITION_WIDTH
        entry["failure_strain"] = float(usual_failure_strain([self.key])[0])
        source = f"{file}, {self.element.tag} {self.key}; failure_strain: {FAILURE_SOURCE}"
        if self.assumed:
            source += f"; OpenSim's default: {', '.join(self.assumed)}"
        return entry | {"source": source}


class _Outside(Exception):
    """A fibre that does not belong to the knee."""


class _Unsupported(Exception):
    """A fibre of the knee that cannot be read."""


def find_ligaments(model: Model, knee: OsimKneeJoint) -> list[OsimLigament]:
    """A model's fibres over the knee; the knee's `found` gets the reasons of the others."""
    ligaments, keys, wraps = list[OsimLigament](), paths.Counted(), paths.read_wraps(model)
    elements = [e for e in model.elements if e.tag in (KIND, "Ligament")]
    if not any(element.tag == KIND for element in elements):
        others = collections.Counter(
            e.tag for e in model.forces() if not e.tag.endswith(("Muscle", "Actuator"))
            and ("Ligament" in e.tag or any(child.tag.endswith("Path") for child in e.children)))
        listed = ", ".join(f"{n} of class {tag}" for tag, n in others.items())
        plain = f"none that is supported, but {listed}" if others else "none"
        raise model.root.problem("ligaments", plain, f"at least one {KIND}")
    for element in elements:
        key, numbers = keys(element.name, "ligament"), {}
        try:
            points = _points(model, element, knee)
            if element.tag != KIND:
                what = "resting_length, pcsa_force and a force-length curve"
                raise _Unsupported(f"of class Ligament ({what})")
            wrap = _wrap(element, len(points), wraps, knee, key)
            for field, (tag, own, expected) in NUMBERS.items():
                (numbers[field],) = element.numbers(tag, 1, own)
                if numbers[field] < 0 or (numbers[field] == 0 and field != "damping_N_s"):
                    word = element.word(tag) or f"{own} (OpenSim's default)"
                    raise element.problem(tag, word, expected)
        except _Outside as reason:
            knee.found.outside[key] = str(reason)
        except _Unsupported as reason:
            knee.found.unsupported[key] = str(reason)
            knee.found.answered.append(element)
        else:
            assumed = tuple(x for x, (tag, *_) in NUMBERS.items() if not element.word(tag))
            ligaments.append(OsimLigament(element, key, points, wrap, numbers, assumed))
    return ligaments


def _points(model: Model, element: Element, knee: OsimKneeJoint) -> tuple[paths.OsimPoint, ...]:
    """Points from the first of two bones to the second."""
    if element.child("GeometryPath") is None:
        kinds = ", ".join(c.tag for c in element.children if c.tag.endswith("Path")) or "none"
        raise _Unsupported(f"its path is no GeometryPath ({kinds})")
    points = paths.path_points(model, element)
    if len(points) < 2:
        raise _Unsupported(f"its path has {counted(len(points), 'point')}")
    strange = [*dict.fromkeys(x.body for x in points if x.body not in knee.rigid)]
    ends = [knee.bone_of(point.body) for point in points]
    if strange:
        raise _Outside(f"attached to {', '.join(strange)}")
    if len({*ends}) < 2:
        raise _Outside(f"does not leave the {ends[0]}")
    if len({*ends}) > 2:
        raise _Unsupported("runs over three bones")
    if not element.applied:
        raise _Outside("switched off in the model (appliesForce or isDisabled)")
    for point in points:
        if point.element.tag != "PathPoint":
            raise _Unsupported(f"its point {point.element.name} is a {point.element.tag}")
    if ends[0] == ends[-1]:
        raise _Unsupported(f"begins and ends on the {ends[0]}")
    return tuple(points if paths.in_order(ends[0], ends[-1]) else reversed(points))


def _wrap(
    element: Element, points: int, wraps: list[paths.OsimWrap], knee: OsimKneeJoint, key: str
) -> paths.OsimWrap | None:
    """What a fibre goes around."""
    found, notes = list[paths.OsimWrap](), knee.found.notes
    for path_wrap in paths.path_objects(element, "PathWrapSet"):
        same = [x for x in wraps if x.element.name == path_wrap.last_word("wrap_object")]
        if not same:
            expected = f"a wrap object of the model ({element.tag} {element.name} goes around it)"
            raise path_wrap.problem("wrap_object", path_wrap.word("wrap_object") or "missing",
                                    expected, [wrap.element.name for wrap in wraps])
        # OpenSim takes the first of that name; one on the knee's bones is what is meant here.
        wrap = next((wrap for wrap in same if wrap.body in knee.rigid), same[0])
        if not wrap.active:
            notes.append(f"{key}: its wrap object {wrap.key} is not active and was left out.")
            continue
        if wrap.body not in knee.rigid:
            raise _Unsupported(f"its wrap object {wrap.key} is on {wrap.body}")
        if wrap.unsupported:
            raise _Unsupported(wrap.unsupported)
        span = path_wrap.word("range", default="-1 -1")
        ends = [plain_number(word) for word in span.split()]
        if len(ends) != 2 or ends[0] not in (-1, 1) or ends[1] not in (-1, points):
            raise _Unsupported(
                f"goes around {wrap.key} with only some points ({' '.join(span.split())})")
        found += [wrap] if wrap not in found else []
    if len(found) > 1:
        names = ", ".join(wrap.key for wrap in found)
        raise _Unsupported(f"goes around {len(found)} wrap objects ({names})")
    if found and points > 2:
        notes.append(f"{key} has via points and the wrap object {found[0].key}: here every part of "
                     "the fibre may touch the object, in OpenSim one part does.")
    return found[0] if found else None


def outside_obstacles(
    knee: OsimKneeJoint, ligaments: list[OsimLigament], inside: str
) -> list[OsimLigament]:
    """The fibres; straight, as in OpenSim, where a point lies inside the obstacle."""
    answer = [*ligaments]
    for row, ligament in enumerate(ligaments):
        wrap = ligament.wrap
        if wrap is None or (deepest := wrap.deepest(knee, ligament.points)) is None:
            continue
        depth, point = deepest
        where = point.element.name or "a path point"
        shape = f"the {wrap.element.tag.removeprefix('Wrap').lower()} {wrap.key}"
        if knee.bone_of(point.body) != knee.bone_of(wrap.body):
            shape += " at the reference pose"
        if inside != "straight" and depth > SHALLOW_MM:
            expected = ("a point outside what the fibre goes around; --inside straight leaves the "
                        f"obstacle out, as OpenSim does, --without {ligament.key} the fibre")
            raise ligament.element.problem(where, f"{depth:.3g} mm inside {shape}", expected)
        knee.found.notes.append(
            f"{ligament.key}: {where} lies {depth:.2g} mm inside {shape}; the fibre runs straight, "
            "as in OpenSim, which leaves out an obstacle that a point is inside of.")
        answer[row] = dataclasses.replace(ligament, wrap=None)
    return answer


def check_lengths(knee: OsimKneeJoint, ligaments: list[OsimLigament]) -> None:
    """Attachments closer or farther than any are in another unit or frame."""
    for ligament in ligaments:
        first, last = (ligament.points[i].in_femur(knee) for i in (0, -1))
        length = 1e3 * float(np.linalg.norm(last - first))
        if not (allowed := RANGES["length_mm"]).holds(length):
            expected = (f"{allowed}: another unit than metres, or a default pose in which the knee "
                        "is apart, are suspected")
            value = f"{length:.4g} mm apart at the reference pose"
            raise ligament.element.problem("attachments", value, expected)


def wrap_names(fibres: Sequence[paths.OsimPath]) -> dict[str, paths.OsimWrap]:
    """What fibres or muscles go around, each once, by its name in a knee file."""
    used = {x.wrap.element: x.wrap for x in fibres if x.wrap is not None}
    return paths.by_file_name(used.values(), "W")


def read_patella(
    model: Model, whole: OsimKneeJoint, beside: list[OsimLigament], knee: OsimKneeJoint,
    at: Mapping[str, float],
) -> tuple[dict[str, Any], list[paths.OsimPath]]:  # fmt: skip
    """The patella's section of a knee document, and its muscles; empty where parts are missing."""
    where = ", ".join(f"{name}={value:g}" for name, value in at.items())
    file = model.name + (f" at {where}" if at else "")
    notes, doubts = list[str](), list[str]()
    muscles = _muscles(model, whole, notes, doubts)
    every = (*beside, *muscles)
    if any(point.body not in knee.rigid for one in every for point in one.points):
        but = f", but for {where}" if at else ""
        notes.append(f"Pelvis and foot stand where the model's default coordinates have them{but}: "
                     "what comes from there begins or ends at a fixed point of the femur or the "
                     "tibia.")
    wraps = wrap_names(every)
    names = {wrap.element: name for name, wrap in wraps.items()}
    ligaments = {name: one.document(whole, file, names)
                 for name, one in paths.by_file_name(beside, "L").items()}
    strongest = {m.element: m.element.number("max_isometric_force", "1000") for m in muscles
                 if whole.bone_of(m.points[-1].body) == PATELLA}
    held = any("patellar_attachment_mm" in entry for entry in ligaments.values())
    if not whole.patella or not held or not strongest:
        lacks = "a patella" if not whole.patella else "muscles" if held else "its ligaments"
        knee.found.patella.append(f"Read without a patella: the model has not {lacks}.")
        return {}, []
    entries = {}
    for name, muscle in paths.by_file_name(muscles, "M").items():
        bones = [whole.bone_of(point.body) for point in muscle.points]
        # What runs along a bone does not change its length: it begins and ends where it leaves one.
        begin = next(k for k, bone in enumerate(bones) if bone != bones[0]) - 1
        end = -next(k for k, bone in enumerate(bones[::-1]) if bone != bones[-1])
        (_, origin), (bone, insertion), via = muscle.ends(whole, begin, end)
        said = f"; tension_N: {AT_REST_N:g} N shared by greatest isometric force"
        source = f"{file}, {muscle.element.tag} {muscle.key}" + said * (bone == PATELLA)
        entries[name] = entry = {
            "tension_N": 0.0, "origin_mm": origin, **via, "insertion_bone": bone,
            "insertion_mm": insertion, "source": source}
        if muscle.element in strongest:
            share = strongest[muscle.element] / sum(strongest.values())
            entry["tension_N"] = round(AT_REST_N * share, 4)
        wrap = muscle.wrap
        # OpenSim leaves out an obstacle that a point is inside.
        if wrap is not None and (inside := wrap.deepest(whole, muscle.points)) is not None:
            place = f"its point {inside[1].element.name} lies inside"
            notes.append(f"Muscle {muscle.key} runs without {wrap.key}: {place}.")
        elif wrap is not None:
            entry["wrap"] = names[wrap.element]
    pose = poses_of(whole.in_femur[PATELLA], whole.side).tolist()
    source = f"{file}: {whole.patella} in {whole.femur} at the coordinates' default values"
    document: dict[str, Any] = {
        "reference_pose": dict(zip((one.column for one in BODIES[PATELLA].values()), pose,
                                   strict=True)) | {"source": source},
        "ligaments": ligaments,
        "contacts": {},
        "muscles": entries,
    }
    used = {part.get("wrap") for part in (*ligaments.values(), *entries.values())}
    own = {name: wrap.document(whole, file) for name, wrap in wraps.items() if name in used}
    document |= {"wraps": own} if own else {}
    knee.found.patella.extend(notes)
    knee.found.doubts[:0] = doubts
    return document, muscles


def _muscles(
    model: Model, knee: OsimKneeJoint, notes: list[str], doubts: list[str]
) -> list[paths.OsimPath]:
    """Muscles over the knee; `notes` get what is left out, `doubts` what is not the model's."""
    wraps, found = paths.read_wraps(model), []
    for element in model.muscles():
        points = paths.path_points(model, element) if element.applied else []
        bones = [knee.bone_of(point.body) for point in points]
        if not all(bones) or len(set(bones)) < 2:
            continue
        if not paths.in_order(bones[0], bones[-1]):
            points, bones = points[::-1], bones[::-1]
        straight = all(point.element.tag == "PathPoint" for point in points)
        if len(set(bones)) > 2 or bones[0] != FEMUR or not straight:
            why = "a point that moves along the bone" if not straight else "three bones"
            notes.append(f"Muscle {element.name} was left out: its path has {why}.")
            continue
        wrap = wrap_of(element, wraps, knee, (bones[0], bones[-1]), doubts)
        name = re.sub(r"_[rl]$", "", element.name)
        found.append(paths.OsimPath(element, name, tuple(points), wrap))
    return found


def wrap_of(
    element: Element, wraps: list[paths.OsimWrap], knee: OsimKneeJoint, bones: tuple[str, str],
    notes: list[str],
) -> paths.OsimWrap | None:  # fmt: skip
    """A muscle's obstacle on a bone that it joins; `notes` gets what was left out or assumed."""
    names = [one.last_word("wrap_object") for one in paths.path_objects(element, "PathWrapSet")]
    found = [
        wrap for name in names for wrap in wraps if wrap.element.name == name and wrap.active
        and knee.bone_of(wrap.body) in bones and wrap.element.tag in paths.WRAP_KINDS]
    notes += [f"Muscle {element.name} takes the shorter way around {wrap.key}, which the model "
              f"confines to the quadrant {wrap.element.word('quadrant')}."
              for wrap in found[:1] if wrap.unsupported]
    notes += [f"Muscle {element.name} goes around one obstacle: {other.key} was left out."
              for other in found[1:]]
    return found[0] if found else None
