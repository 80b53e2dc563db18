"""What of a model became a knee, what did not, of whatever class, and how that is said."""

__all__ = ["format_import_report"]

import collections
import re
from collections.abc import Collection, Iterable
from typing import TYPE_CHECKING, NamedTuple

from kneejax.files.opensim.contact import FORCE
from kneejax.files.opensim.joints import read_joints
from kneejax.files.opensim.knee import SIDES, OsimKneeJoint, beyond, is_between
from kneejax.files.opensim.ligaments import KIND, TRANSITION_WIDTH
from kneejax.files.opensim.model import GROUND, Model
from kneejax.files.opensim.xml import Element, etree, last_word
from kneejax.geometry import COLUMNS, PATELLA, TIBIA
from kneejax.mechanics import ligament_law

if TYPE_CHECKING:
    from kneejax.files.opensim.importing import OsimImport

ACTS, IN_MOTION, DRIVEN, OFF, ELSEWHERE, ASKED, WITHOUT_PATELLA, IN_RING = (
    "acts on the knee", "acts on the knee in motion only", "acts on the knee when it is driven",
    "would act on the knee, switched off in the model", "does not act on this knee",
    "as asked by --without", "as asked by --without-patella",
    "holds a meniscus, for which a ring stands",
)
#: Of some of these, a shorter title for their numbers; all others were left out.
TITLES = {ASKED: ASKED, WITHOUT_PATELLA: WITHOUT_PATELLA, OFF: "switched off in the model",
          IN_RING: "for which rings stand", ELSEWHERE: "not at this knee"}
#: What a class of OpenSim is called: the first whose words stand in its name.
_KINDS = {
    "contact": "Contact|HuntCrossley|ElasticFoundation|SmoothSphere", "muscle": "Muscle",
    "fibre": "Ligament", "coupler": "Coupler", "constraint": "Constraint", "bushing": "Bushing",
    "spring": "Spring|LimitForce|StopForce", "actuator": "Actuator", "other force": "",
}  # fmt: skip
_LEAVES = etree.XPath("descendant-or-self::*[not(*)]")
_PLURALS = {"meniscus": "menisci", "body": "bodies"}


class Untaken(NamedTuple):
    """A force or a constraint of a model that is no part of the imported knee."""

    element: Element
    how: str  # one of the sentences above
    on: tuple[str, ...]  # the bodies and coordinates of the knee that it is attached to
    muscle_or_patella: bool  # whether it goes with these

    @property
    def name(self) -> str:
        """Its name, its class where it has none, and which coordinate a coupler drives."""
        drives = self.element.word("dependent_coordinate_name")
        return (self.element.name or self.element.tag) + (f" drives {drives}" if drives else "")


def untaken(
    model: Model, knee: OsimKneeJoint, taken: Iterable[Element], unwanted: Collection[str],
    patella: bool, rings: Collection[str],
) -> tuple[list[Untaken], list[str]]:
    """Forces and constraints but those taken; bodies at the knee that are part of no bone."""
    joints, known = read_joints(model), {*taken}
    between = [x for x in joints if is_between(x) and {x.parent, x.child} & {*knee.rigid}]
    cut = [*between, *knee.joints]
    inner = dict.fromkeys(body for joint in between for body in beyond(joints, cut, joint.child))
    near = {*knee.rigid, *inner}
    # Body -> the part of the model, that of the first of its bodies, to which it belongs.
    parts: dict[str, str] = {}
    for body in [knee.femur, knee.tibia, *model.bodies]:
        if body not in parts:
            parts = dict.fromkeys(beyond(joints, cut, body), body) | parts
    on_ground = [parts[joint.other(GROUND)] for joint in joints if joint.on_ground]
    parts[GROUND] = joined = on_ground[0] if on_ground else parts[knee.femur]
    # Name of a body, or of a frame or a geometry on one -> the bodies.
    places = collections.defaultdict(set)
    for frame in model.frames.values():
        places[frame.name].add(model.place(frame)[0])
    for element in model.elements:
        around = [outer.tag for outer in element.iterancestors()]
        if around[0] in ("objects", "ContactGeometrySet") and "ContactGeometrySet" in around:
            word = element.word("body_name", "socket_frame", "socket_frame_connectee_name")
            if (frame := model.frame(word, element)) is not None:
                places[element.name].add(model.place(frame)[0])
    bodies = {name: [*one][0] for name, one in places.items() if len(one) == 1}
    bodies |= {body: body for body in model.bodies}
    coordinates = {c.name for joint in cut for c in joint.coordinates
                   if {joint.parent, joint.child} & near}
    of_rings = {c.name for joint in between if joint.child in rings for c in joint.coordinates}
    answer = []
    for element in model.forces():
        if element in known:
            continue
        # Bodies and coordinates that anything within it names.
        on, asked = set(), set()
        for leaf in _LEAVES(element):
            for word in leaf.content.split() if leaf.tag != "wrap_object" else ():
                last, socket = last_word(word), leaf.tag.startswith("socket_")
                frame = model.frame(word, leaf.getparent()) if socket else None
                if last in coordinates:
                    asked.add(last)
                elif frame is not None:
                    on.add(model.place(frame)[0])
                elif last in bodies:
                    on.add(bodies[last])
        sides = {parts[body] for body in on}
        has_path = any(child.tag.endswith("Path") for child in element.children)
        across = len(sides) > 1 or (len(on) == 1 and not has_path and sides != {joined})
        how = _how(element) if asked or (across and on & near) else ELSEWHERE
        goes = any(knee.bone_of(body) == PATELLA for body in on) or element.tag.endswith("Muscle")
        held = on <= {x for x in near if x in rings or knee.bone_of(x) == TIBIA}
        if held and how == ACTS and (on & {*rings} or asked) and asked <= of_rings:
            how = IN_RING
        if element.name in unwanted:
            how = ASKED
        elif goes and not patella and how != ELSEWHERE:
            how = WITHOUT_PATELLA
        said = tuple(sorted(on & near if across else set()) + sorted(asked))
        answer.append(Untaken(element, how, said, goes))
    return answer, [body for body in inner if body not in knee.rigid]


def listed(found: Iterable[Untaken], how: str) -> list[str]:
    """Those of one verdict by class, with their names and what they are attached to."""
    lines, found = [], [one for one in found if one.how == how]
    for tag in sorted({one.element.tag for one in found}):
        many = [one for one in found if one.element.tag == tag]
        names, on = [one.name for one in many], sorted({x for one in many for x in one.on})
        where = f", on {', '.join(on)}" if {*on} - {*names} else ""
        lines.append(f"{tag} ({len(many)}): {', '.join(names)}{where}")
    return lines


def numbers_of_kinds(tags: Iterable[str], bodies: Iterable[str] = ()) -> str:
    """How many of which kind, from the classes of elements and the names of bodies."""
    names = [next(kind for kind, words in _KINDS.items() if re.search(words, x)) for x in tags]
    names += ["meniscus" if "menisc" in body.lower() else "body" for body in bodies]
    counts = collections.Counter(names)
    return ", ".join(f"{n} {name if n == 1 else _PLURALS.get(name, f'{name}s')}"
                     for name in (*_KINDS, *_PLURALS) if (n := counts[name]))


def _how(element: Element) -> str:
    if not element.applied:
        return OFF
    if element.tag.endswith("Actuator"):
        return DRIVEN
    leaves = _LEAVES(element)
    stiff = [e.content for e in leaves if "stiffness" in e.tag]
    expressed = any("expression" in e.tag and e.content not in ("", "0") for e in leaves)
    # Zeros of any form are no stiffness.
    some = any(word.strip("0.+-") for text in stiff for word in text.lower().split("e")[0].split())
    return IN_MOTION if stiff and not expressed and not some else ACTS


def format_import_report(read: "OsimImport", geometry: tuple[str, ...] = ()) -> str:
    """An import report in Markdown.

    Args:
        read: what a model gave.
        geometry: sentences of the fit of its meshes; without any, how to add contacts is said.

    Returns:
        The report, a section for each kind of thing that a model has.

    Example:
        >>> from kneejax.files import SMALLEST_MODEL, import_osim
        >>> read = import_osim("smallest.osim", side="r", data=SMALLEST_MODEL.encode())
        >>> print(format_import_report(read).splitlines()[6])
        - femur_r was taken as the femur.
    """
    model = read.model
    text = (f"# Import of {model.root.name or model.name}, {SIDES[read.knee.side]} knee\n\n"
            f"File {model.name}, version {model.version} of OpenSim's format.\n")
    for title, items in import_sections(read, geometry).items():
        text += f"\n## {title}\n\n" + ("".join(f"- {item}\n" for item in items) or "None.\n")
        if title != "Joint":
            continue
        text += f"\n## Ligaments read: {len(read.ligaments)} fibres of class {KIND}\n\n"
        text += "| fibre | points | wrap object | stiffness N | slack length mm | transition |\n"
        text += "|---|---|---|---|---|---|\n" + "".join(
            f"| {name} | {2 + len(x.get('via_points', ()))} | {x.get('wrap', '')} "
            f"| {x['stiffness_N']:g} | {x['slack_length_mm']:.6g} | {x['transition_strain']:g} |\n"
            for name, x in read.document["ligaments"].items())
        groups = read.document.get("groups", {}).items()
        names = ", ".join(f"{name} ({len(fibres)})" for name, fibres in groups)
        text += f"\nGroups made from their names: {names}.\n" if names else ""
    return text


def import_sections(read: "OsimImport", geometry: tuple[str, ...] = ()) -> dict[str, list[str]]:
    """Sentences of an import report, by the titles of its sections; see `format_import_report`."""
    model, knee, found = read.model, read.knee, read.knee.found
    pose = (f"{c} {value:.6g}" for c, value in zip(COLUMNS, knee.pose, strict=True))
    joints = [f"{joint.name} ({joint.kind}): {text}"
              for joint in knee.joints for text in joint.describe()]
    contacts = [f"{one.name}: {text}" for one in (*read.contacts, *read.menisci)
                for text in one.findings]
    stl = "`kneejax import stl --knee knee.yaml ...` adds"
    if geometry:
        contacts += geometry
    elif read.contacts:
        pair = f"{read.contacts[0].femur.file} and {read.contacts[0].other.file}"
        contacts.append("No surfaces: with --geometry FOLDER the importer fits them to the meshes "
                        f"{pair}, or {stl} them to this knee.")
    else:
        contacts.append(f"The model has no {FORCE} between femur and tibia; {stl} contacts to this "
                        "knee.")
    fibres, wraps = read.document["ligaments"], []
    for name in read.wraps:
        entry = read.document["wraps"][name]
        sizes = ", ".join(f"{field} {entry[field]}" for field in (
            "radius_mm", "length_mm", "semi_axes_mm") if field in entry)
        users = ", ".join(fibre for fibre, x in fibres.items() if x.get("wrap") == name)
        wraps.append(f"{name}: {entry['kind']} on the {entry['bone']}, {sizes}, for {users}")
    left_out = [f"In all, {read.numbers_left_out}."] if read.numbers_left_out else []
    if read.bodies:
        left_out.append(f"Bodies, part of neither bone: {', '.join(read.bodies)}.")
    by_reason = collections.defaultdict(list)
    for name, reason in found.outside.items():
        by_reason[reason].append(name)
    left_out += [f"Ligaments, {reason}: {', '.join(many)}." for reason, many in by_reason.items()]
    left_out += [f"{text}." for text in read.left_out]
    others = (x for x in read.untaken if x.element.tag != KIND)
    left_out += [f"{line}: {ELSEWHERE}." for line in listed(others, ELSEWHERE)]
    laws = {(x["stiffness_N"], x["transition_strain"]) for x in fibres.values()}
    error = max(float(ligament_law.largest_tension_error(*law, TRANSITION_WIDTH)) for law in laws)
    around = ("Fibres take the shortest path around an obstacle; OpenSim's methods for ellipsoids "
              "(hybrid, midpoint, axial) approximate it.")
    section = read.document.get("patella", {})
    patella = [f"{name.capitalize()}: {', '.join(section[name])}."
               for name in ("ligaments", "muscles") if section]
    return {
        "What was taken as what": [*found.findings, *found.unusual, *model.notes],
        "Joint": [f"Reference pose, from the coordinates' defaults: {', '.join(pose)}", *joints],
        "Patella and muscles read": [*patella, *found.patella],
        "Wrap objects read": wraps,
        "Contact": contacts,
        "Not supported": list(read.doubts),
        "Left out": left_out,
        "Notes": [
            *dict.fromkeys(found.notes),
            "The corners of OpenSim's force law are rounded (transition_width "
            f"{TRANSITION_WIDTH:g}): forces differ by at most {error:.2g} N.",
            "damping_N_s was read: it counts in motion, not at rest.",
            *[around] * bool(wraps),
        ],
    }
