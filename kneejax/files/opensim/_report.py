"""What an import read, left out and could not read, for people."""

from __future__ import annotations

import collections

from kneejax.files.opensim._contact import FORCE
from kneejax.files.opensim._import import OsimImport
from kneejax.files.opensim._knee import SIDES
from kneejax.files.opensim._ligaments import KIND, TRANSITION_WIDTH
from kneejax.files.opensim._untaken import ELSEWHERE, listed
from kneejax.geometry import COLUMNS
from kneejax.mechanics import ligament_law


def format_import_report(read: OsimImport, geometry: tuple[str, ...] = ()) -> str:
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
    lines = [
        f"# Import of {model.root.name or model.name}, {SIDES[read.knee.side]} knee",
        "",
        f"File {model.name}, version {model.version} of OpenSim's format.",
    ]
    for title, items in import_sections(read, geometry).items():
        lines += ["", f"## {title}", "", *([f"- {item}" for item in items] or ["None."])]
        if title == "Joint":
            lines += _ligaments(read)
    return "\n".join(lines) + "\n"


def import_sections(read: OsimImport, geometry: tuple[str, ...] = ()) -> dict[str, list[str]]:
    """Sentences of an import report, by the titles of its sections.

    Args:
        read: what a model gave.
        geometry: sentences of the fit of its meshes; without any, how to add contacts is said.
    """
    model, knee = read.model, read.knee
    pose = (f"{c} {value:.6g}" for c, value in zip(COLUMNS, knee.pose, strict=True))
    joints = [
        f"{joint.name} ({joint.kind}): {text}" for joint in knee.joints for text in joint.describe()
    ]
    contacts = [f"{c.name}: {text}" for c in read.contacts for text in c.findings]
    if geometry:
        contacts += geometry
    elif read.contacts:
        contact = read.contacts[0]
        contacts.append(
            "No surfaces: with --geometry FOLDER the importer fits them to the meshes "
            f"{contact.femur.file} and {contact.other.file}, or `kneejax import stl --knee "
            "knee.yaml ...` adds them to this knee."
        )
    else:
        contacts.append(
            f"The model has no {FORCE} between femur and tibia; `kneejax import stl --knee "
            "knee.yaml ...` adds contacts to this knee."
        )
    section = read.document.get("patella", {})
    patella = [f"{name.capitalize()}: {', '.join(section[name])}."
               for name in ("ligaments", "muscles") if section]
    return {
        "What was taken as what": [*knee.findings, *knee.unusual, *model.notes],
        "Joint": [f"Reference pose, from the coordinates' defaults: {', '.join(pose)}", *joints],
        "Patella and muscles read": [*patella, *read.patella.notes],
        "Wrap objects read": [_wrap(read, wrap) for wrap in read.wraps],
        "Contact": contacts,
        "Not supported": list(read.doubts),
        "Left out": _left_out(read),
        "Notes": [*dict.fromkeys(read.found.notes), *_notes(read)],
    }


def _ligaments(read: OsimImport) -> list[str]:
    lines = ["", f"## Ligaments read: {len(read.ligaments)} fibres of class {KIND}", ""]
    lines.append("| fibre | points | wrap object | stiffness N | slack length mm | transition |")
    lines.append("|---|---|---|---|---|---|")
    for name, entry in read.document["ligaments"].items():
        row = (
            name,
            str(2 + len(entry.get("via_points", ()))),
            entry.get("wrap", ""),
            f"{entry['stiffness_N']:g}",
            f"{entry['slack_length_mm']:.6g}",
            f"{entry['transition_strain']:g}",
        )
        lines.append(f"| {' | '.join(row)} |")
    groups = read.document.get("groups", {})
    if groups:
        names = ", ".join(f"{name} ({len(fibres)})" for name, fibres in groups.items())
        lines += ["", f"Groups made from their names: {names}."]
    return lines


def _wrap(read: OsimImport, name: str) -> str:
    entry = read.document["wraps"][name]
    sizes = ", ".join(f"{field} {entry[field]}" for field in (
        "radius_mm", "length_mm", "semi_axes_mm") if field in entry)
    users = [n for n, x in read.document["ligaments"].items() if x.get("wrap") == name]
    return f"{name}: {entry['kind']} on the {entry['bone']}, {sizes}, for {', '.join(users)}"


def _left_out(read: OsimImport) -> list[str]:
    lines = [f"In all, {read.numbers_left_out}."] if read.numbers_left_out else []
    if read.bodies:
        lines.append(f"Bodies, part of neither bone: {', '.join(read.bodies)}.")
    by_reason = collections.defaultdict(list)
    for name, reason in read.found.outside.items():
        by_reason[reason].append(name)
    lines += [f"Ligaments, {reason}: {', '.join(names)}." for reason, names in by_reason.items()]
    lines += [f"{text}." for text in read.left_out]
    elsewhere = [x for x in read.untaken if x.how == ELSEWHERE and x.element.tag != KIND]
    return [*lines, *(f"{line}: {ELSEWHERE}." for line in listed(elsewhere))]


def _notes(read: OsimImport) -> list[str]:
    laws = {(x["stiffness_N"], x["transition_strain"])
            for x in read.document["ligaments"].values()}
    error = max(float(ligament_law.largest_tension_error(*law, TRANSITION_WIDTH)) for law in laws)
    notes = [
        f"The corners of OpenSim's force law are rounded (transition_width {TRANSITION_WIDTH:g}): "
        f"forces differ by at most {error:.2g} N.",
        "damping_N_s was read: it counts in motion, not at rest.",
    ]
    if read.wraps:
        notes.append(
            "Fibres take the shortest path around an obstacle; OpenSim's methods for ellipsoids "
            "(hybrid, midpoint, axial) approximate it."
        )
    return notes
