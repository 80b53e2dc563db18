"""Fibres put into a model's text, and taken out of it."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Any
from xml.sax.saxutils import escape, quoteattr

from kneejax.files.opensim._edits import Edits
from kneejax.files.opensim._import import OsimImport
from kneejax.files.opensim._ligaments import KIND, NUMBERS, OsimLigament
from kneejax.files.opensim._numbers import METRES_TO_MM, unshifted, write_decimal
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, TIBIA

_SPACE_BEFORE = re.compile(rb"[ \t]*\Z")
_BREAK_BEFORE = re.compile(rb"(?:\r\n|\r|\n)[ \t]*\Z")


def replace_fibres(
    edits: Edits, base: OsimImport, document: dict[str, Any], added: Mapping[str, dict[str, Any]]
) -> None:
    """Take fibres out of a model, and put others in after the last one over the knee.

    Args:
        edits: to which the splices are added.
        base: the model as it was read.
        document: of the knee; fibres of the model that it does not name are taken out.
        added: name -> entry of a knee file with `slack_length_mm` and `damping_N_s`, and the key
            of the model's wrap object where it goes around one.
    """
    keys = document.get("imported_from", {}).get("ligaments", {})
    kept = {keys.get(name, name) for name in document["ligaments"]}
    data = base.model.file.data
    for fibre in base.ligaments.values():
        if fibre.key in kept:
            continue
        space = _BREAK_BEFORE.search(data, 0, fibre.element.start)
        start = space.start() if space else fibre.element.start
        edits.splices.append((start, fibre.element.end, b""))
        edits.changes.append(f"{fibre.key}: taken out")
    if not added:
        return
    last = max(base.ligaments.values(), key=lambda fibre: fibre.element.end).element
    space = _SPACE_BEFORE.search(data, 0, last.start)
    lead = space.group().decode() if space else ""
    ends = b"\r\n" if b"\r\n" in data else b"\r" if b"\n" not in data else b"\n"
    for name, entry in added.items():
        lines = _lines(name, entry, base, last)
        text = "".join(f"\n{lead}{line}" for line in lines).encode()
        edits.splices.append((last.end, last.end, text.replace(b"\n", ends)))
        edits.changes.append(
            f"{name}: put in, {entry['stiffness_N']:.6g} N per unit strain, "
            f"{entry['slack_length_mm']:.6g} mm without load"
        )


def _lines(name: str, entry: dict[str, Any], base: OsimImport, like: Element) -> Iterator[str]:
    """A fibre as the model writes them."""
    path = like.child("GeometryPath")
    assert path is not None  # otherwise it would not have been read
    named = f" name={quoteattr(path.name)}" if path.name else ""
    bodies = {FEMUR: base.knee.femur, TIBIA: base.knee.tibia}
    ends = (FEMUR, entry["femoral_attachment_mm"]), (TIBIA, entry["tibial_attachment_mm"])
    via = [(one["bone"], one["point_mm"]) for one in entry.get("via_points", ())]
    yield f"<{KIND} name={quoteattr(name)}>"
    yield f"\t<GeometryPath{named}>"
    yield "\t\t<PathPointSet>"
    yield "\t\t\t<objects>"
    for number, (bone, point) in enumerate((ends[0], *via, ends[1]), start=1):
        x, y, z = (unshifted(x, METRES_TO_MM) for x in point)
        location = base.knee.rigid[bodies[bone]][1].point_back((x, y, z))
        place = " ".join(write_decimal(x) for x in location)
        yield f"\t\t\t\t<PathPoint name={quoteattr(f'{name}-P{number}')}>"
        yield f"\t\t\t\t\t{_on_body(bodies[bone], base)}"
        yield f"\t\t\t\t\t<location>{place}</location>"
        yield "\t\t\t\t</PathPoint>"
    yield "\t\t\t</objects>"
    yield "\t\t</PathPointSet>"
    if "wrap" in entry:
        yield "\t\t<PathWrapSet><objects>"
        yield f"\t\t\t<PathWrap><wrap_object>{escape(entry['wrap'])}</wrap_object></PathWrap>"
        yield "\t\t</objects></PathWrapSet>"
    yield "\t</GeometryPath>"
    for field, (tag, _) in NUMBERS.items():
        places = METRES_TO_MM if field == "slack_length_mm" else 0
        yield f"\t<{tag}>{write_decimal(unshifted(entry[field], places))}</{tag}>"
    yield f"</{KIND}>"


def _on_body(body: str, base: OsimImport) -> str:
    """How the model says on which body a point is."""
    fibre: OsimLigament = next(iter(base.ligaments.values()))
    if fibre.points[0].element.child("body") is not None:
        return f"<body>{escape(body)}</body>"
    return f"<socket_parent_frame>/bodyset/{escape(body)}</socket_parent_frame>"
