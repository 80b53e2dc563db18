"""Changed ligament numbers back into the OpenSim model that a knee came from."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import os
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files._bundled import bundled_knees
from kneejax.files._knees import check_kind, load_knee_file
from kneejax.files.knee import KneeFile, check_knee, read_knee
from kneejax.files.opensim._coupled import CoupledMotion, couple_knee
from kneejax.files.opensim._exact import (
    METRES_TO_MM,
    Offset,
    Point,
    angles_xyz,
    radians,
    shifted,
    turn_xyz,
    unshifted,
    write_decimal,
)
from kneejax.files.opensim._frames import SAME
from kneejax.files.opensim._import import OsimImport, import_osim
from kneejax.files.opensim._knee import SIDES
from kneejax.files.opensim._ligaments import KIND, NUMBERS
from kneejax.files.opensim._model import Model
from kneejax.files.opensim._paths import WRAP_KINDS
from kneejax.files.opensim._xml import Element, etree
from kneejax.files.reading import InputProblem, load_yaml
from kneejax.geometry import FEMUR, TIBIA

#: A slack length that was computed from a strain or force is the model's if it errs by less.
_ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True)
class OsimExport:
    """A model with a knee's numbers.

    Attributes:
        data: content of the new file; the model's own bytes where nothing changed.
        changes: a sentence for each number that changed, and each fibre put in or taken out.
        notes: what a person should know.

    Example:
        >>> OsimExport(b"", ("ACL.stiffness_N: 820 -> 902",), ()).changes
        ('ACL.stiffness_N: 820 -> 902',)
    """

    data: bytes
    changes: tuple[str, ...]
    notes: tuple[str, ...]


def export_osim(
    knee: KneeFile | str | os.PathLike[str],
    model: str | os.PathLike[str],
    *,
    replace: bool = False,
    coupled: CoupledMotion | None = None,
) -> OsimExport:
    """Write a knee's ligaments and obstacles into the model that it came from.

    Numbers that are the same keep the model's own text; others become the shortest text that gives
    them back. Comments, space and whatever else stands in the file stay. A number that the model
    leaves to a default is added where it is needed.

    Args:
        knee: a knee that was imported from the model, with whatever numbers since: the name of a
            bundled one, a file, or what was read of it.
        model: the original model.
        replace: whether the model's fibres over the knee become the knee's: those that it has not
            are added (grafts, or bundles of another source in the same frames), those that the
            knee has not are taken out (a torn ligament).
        coupled: secondary motion that the model's knee is to have, a CustomJoint of one coordinate.

    Returns:
        The new content, and what changed.

    Raises:
        InputProblem: the model cannot be read, or the knee has an obstacle or via point that the
            model has not; likewise a fibre, unless `replace`.

    Example:
        >>> import tempfile
        >>> from kneejax.files import SMALLEST_MODEL, write_knee
        >>> folder = Path(tempfile.mkdtemp())
        >>> model, knee = folder / "smallest.osim", folder / "knee.yaml"
        >>> _ = model.write_text(SMALLEST_MODEL)
        >>> document = import_osim(model, side="r").document
        >>> document["ligaments"]["LCL"]["stiffness_N"] = 2150.5
        >>> write_knee(document, knee)
        >>> export_osim(knee, model).changes
        ('LCL.stiffness_N: 2000 -> 2150.5',)
    """
    stated = _stated(knee)
    document, origin = stated.document, stated.document.get("imported_from", {})
    side = origin.get("side") or document["side"][0]
    if SIDES.get(side) != document["side"]:
        expected = f"the side that was imported, {SIDES.get(side, side)}"
        raise InputProblem(stated.path, "side", document["side"], expected)
    try:
        base = import_osim(model, side=side, femur=origin.get("femur"), tibia=origin.get("tibia"),
                           inside="straight")
    except InputProblem as problem:
        if problem.field not in ("--femur", "--tibia"):
            raise
        expected = f"the model that the knee came from, {origin['file']}, which has this body"
        raise InputProblem(model, "body", problem.value, expected) from None
    edits = _Edits(base.model)
    keys = {name: stated.key("ligaments", name) for name in document["ligaments"]}
    if replace:
        _replace_fibres(edits, stated, base, keys)
    _write_ligaments(edits, stated, base, keys, replace)
    _write_wraps(edits, stated, base)
    if coupled is not None:
        edits.changes += couple_knee(base.model, base.knee, coupled, SAME)
    notes = _notes(stated, base, keys, replace)
    if not edits.changes:
        return OsimExport(base.model.file.original, (), tuple(notes))
    data = base.model.file.written()
    notes += _read_back(stated, base, data)
    return OsimExport(data, tuple(edits.changes), tuple(notes))


@dataclasses.dataclass(frozen=True)
class _Stated:
    """What a knee file states, and the way to what must be computed from it."""

    path: Path
    document: dict[str, Any]
    built: Callable[[], KneeFile]

    def key(self, section: str, name: str) -> str:
        """What the model calls a fibre or wrap object."""
        return self.document.get("imported_from", {}).get(section, {}).get(name, name)

    def slack_length_mm(self, name: str) -> float:
        """Of a fibre, also where a strain or a force gives it."""
        row = [*self.document["ligaments"]].index(name)
        return float(self.built().knee.ligaments.slack_length[row])

    def check_same(self, place: str, value, model_value) -> None:
        """Refuse what is no number and differs from the model's."""
        if value != model_value:
            expected = f"what the model has, {model_value or 'none'}: only numbers are written back"
            raise InputProblem(self.path, place, value or "none", expected)


def _stated(knee: KneeFile | str | os.PathLike[str]) -> _Stated:
    if isinstance(knee, KneeFile):
        return _Stated(knee.path, knee.document, lambda: knee)
    path = bundled_knees().get(os.fspath(knee)) or Path(knee)
    if not path.is_file() or path.suffix.lower() == ".json":
        known = load_knee_file(knee)  # a calibration's, or says what is wrong with the name
        return _Stated(known.path, known.document, lambda: known)
    check_kind(path)
    document = load_yaml(path, "a knee file")
    check_knee(document, path)
    return _Stated(path, document, functools.cache(lambda: read_knee(path)))


class _Edits:
    """Numbers put into a model's elements; `changes` has a sentence for each that differs."""

    def __init__(self, model: Model):
        self.model = model
        self.changes: list[str] = []

    def say(self, name: str, old, new) -> None:
        """Note a change, if it is one."""
        if old != new:
            shown = (" ".join(f"{float(x):.10g}" for x in (value if isinstance(value, list)
                                                           else [value])) for value in (old, new))
            self.changes.append(f"{name}: {' -> '.join(shown)}")

    def numbers(self, parent: Element, tag: str, every: Sequence[Decimal], changed) -> None:
        """Write those numbers of a child that changed, by their places; all if it has none yet."""
        leaf, words = parent.child(tag), [write_decimal(value) for value in every]
        if changed and leaf is None:
            parent.add(tag, " ".join(words))
        elif changed and leaf is not None:
            leaf.set_words(words, changed)

    def vector(self, parent: Element, tag: str, carrier: Offset, old, new, turns=False) -> None:
        """Move a point, mm, or turn what has three angles, degrees, which a child states in
        coordinates that `carrier` takes to the bone's."""
        changed = [i for i in range(3) if float(new[i]) != old[i]]
        if not changed:
            return
        given = [radians(float(x)) if turns else unshifted(x, METRES_TO_MM) for x in new]
        if carrier.rotation is None:
            stated = self.model.point(parent, tag)
            inner = given if turns else carrier.point_back((given[0], given[1], given[2]))
            kept = [inner[i] if i in changed else stated[i] for i in range(3)]
            return self.numbers(parent, tag, kept, changed)
        back = carrier.matrix.T
        if turns:
            inner = _decimals(angles_xyz(back @ turn_xyz(np.deg2rad(new))))
            return self.numbers(parent, tag, inner, range(3))
        inner = carrier.point_back((given[0], given[1], given[2]))
        for _ in range(3):  # a rounding of the way there is taken back
            there = [shifted(x, METRES_TO_MM) for x in carrier.point(inner)]
            inner = _decimals(np.array(inner, float) + back @ np.subtract(new, there) / 1e3)
        self.numbers(parent, tag, inner, range(3))


def _decimals(values: np.ndarray) -> Point:
    x, y, z = (Decimal(repr(float(value))) for value in values)
    return x, y, z


def _write_ligaments(
    edits: _Edits, stated: _Stated, base: OsimImport, keys: Mapping[str, str], replace: bool
) -> None:
    by_key = {ligament.key: name for name, ligament in base.ligaments.items()}
    for name, entry in stated.document["ligaments"].items():
        key, place = keys[name], f"ligaments.{name}"
        if key not in by_key and replace:
            continue
        if key not in by_key:
            expected = f"a fibre of {base.model.name} that spans the knee, or --replace to add it"
            raise InputProblem(stated.path, place, key, expected, by_key)
        ligament, old = base.ligaments[by_key[key]], base.document["ligaments"][by_key[key]]
        for field, (tag, _) in NUMBERS.items():
            if field in entry:
                new = float(entry[field])
            elif field == "slack_length_mm":
                new = stated.slack_length_mm(name)
                if abs(new - old[field]) <= _ROUNDING * old[field]:
                    continue
            else:
                continue
            places = METRES_TO_MM if field == "slack_length_mm" else 0
            changed = [0] if new != old[field] else []
            edits.numbers(ligament.element, tag, [unshifted(new, places)], changed)
            edits.say(f"{name}.{field}", old[field], new)
        new, was = ([x["femoral_attachment_mm"], *x.get("via_points", ()),
                     x["tibial_attachment_mm"]] for x in (entry, old))
        bones = [[via["bone"] for via in x[1:-1]] or "none" for x in (new, was)]
        stated.check_same(f"{place}.via_points", *bones)
        for i, point in enumerate(ligament.points):
            field = f"via_points[{i - 1}].point_mm"
            one, other = new[i], was[i]
            if isinstance(one, dict):
                one, other = one["point_mm"], other["point_mm"]
            else:
                field = "tibial_attachment_mm" if i else "femoral_attachment_mm"
            edits.vector(point.element, "location", point.carrier_in_bone(base.knee), other, one)
            edits.say(f"{name}.{field}", other, one)
        wrap = entry.get("wrap")
        if wrap is not None:  # by the name that it has when the model is read again
            key = stated.key("wraps", wrap)
            wrap = next((name for name, w in base.wraps.items() if w.key == key), key)
        stated.check_same(f"{place}.wrap", wrap, old.get("wrap"))


def _write_wraps(edits: _Edits, stated: _Stated, base: OsimImport) -> None:
    by_key = {wrap.key: name for name, wrap in base.wraps.items()}
    used = {entry.get("wrap") for entry in stated.document["ligaments"].values()}
    for name, entry in stated.document.get("wraps", {}).items():
        key = stated.key("wraps", name)
        if key not in by_key and name not in used:
            continue
        if key not in by_key:
            expected = f"a wrap object of {base.model.name} on the knee's bones"
            raise InputProblem(stated.path, f"wraps.{name}", key, expected, by_key)
        wrap, old = base.wraps[by_key[key]], base.document["wraps"][by_key[key]]
        for field in ("kind", "bone", "side"):
            stated.check_same(f"wraps.{name}.{field}", entry.get(field), old.get(field))
        carrier, straight = wrap.carrier_in_bone(base.knee), [0.0, 0.0, 0.0]
        for field, tag, turns in (("center_mm", "translation", False),
                                  ("rotation_deg", "xyz_body_rotation", True)):
            was, new = (x.get(field, straight) for x in (old, entry))
            edits.vector(wrap.element, tag, carrier, was, new, turns)
            edits.say(f"{name}.{field}", was, new)
        for field, tag, count in WRAP_KINDS[wrap.element.tag][1]:
            new, was = (x[field] if count > 1 else [x[field]] for x in (entry, old))
            changed = [i for i in range(count) if float(new[i]) != was[i]]
            edits.numbers(wrap.element, tag, [unshifted(x, METRES_TO_MM) for x in new], changed)
            edits.say(f"{name}.{field}", old[field], entry[field])


def _replace_fibres(
    edits: _Edits, stated: _Stated, base: OsimImport, keys: Mapping[str, str]
) -> None:
    """Take out fibres that the knee has not, and put those in that the model has not."""
    known = {x.key for x in base.ligaments.values()}
    new, last = [], [*base.ligaments.values()][-1].element
    for name, entry in stated.document["ligaments"].items():
        if keys[name] in known:
            continue
        if name in base.found.outside | base.found.unsupported:
            expected = f"a name that no other force of {base.model.name} has"
            raise InputProblem(stated.path, f"ligaments.{name}", name, expected)
        entry = {"damping_N_s": 0.0, "slack_length_mm": stated.slack_length_mm(name)} | entry
        new.append(_fibre(name, entry, stated, base))
        edits.changes.append(
            f"{name}: put in, {entry['stiffness_N']:.6g} N per unit strain, "
            f"{entry['slack_length_mm']:.6g} mm without load"
        )
    for element in reversed(new):
        last.add_after(element)
    gone = [fibre for fibre in base.ligaments.values() if fibre.key not in keys.values()]
    for fibre in gone:
        fibre.element.take_out()
    edits.changes[:0] = [f"{fibre.key}: taken out" for fibre in gone]


def _fibre(name: str, entry: dict[str, Any], stated: _Stated, base: OsimImport) -> Element:
    """A fibre as the model writes them, indented like its last one."""
    like = [*base.ligaments.values()][-1]
    path_name = like.element.child("GeometryPath").get("name")
    bodies = {FEMUR: base.knee.femur, TIBIA: base.knee.tibia}
    on_body, prefix = "socket_parent_frame", "/bodyset/"
    if like.points[0].element.child("body") is not None:
        on_body, prefix = "body", ""
    fibre = like.element.makeelement(KIND, name=name)
    path = etree.SubElement(fibre, "GeometryPath", {"name": path_name} if path_name else {})
    objects = etree.SubElement(etree.SubElement(path, "PathPointSet"), "objects")
    via = [(one["bone"], one["point_mm"]) for one in entry.get("via_points", ())]
    ends = (FEMUR, entry["femoral_attachment_mm"]), (TIBIA, entry["tibial_attachment_mm"])
    for number, (bone, point) in enumerate((ends[0], *via, ends[1]), start=1):
        x, y, z = (unshifted(x, METRES_TO_MM) for x in point)
        location = base.knee.rigid[bodies[bone]][1].point_back((x, y, z))
        one = etree.SubElement(objects, "PathPoint", name=f"{name}-P{number}")
        etree.SubElement(one, on_body).text = prefix + bodies[bone]
        etree.SubElement(one, "location").text = " ".join(write_decimal(x) for x in location)
    if "wrap" in entry:
        objects = etree.SubElement(etree.SubElement(path, "PathWrapSet"), "objects")
        wrap = etree.SubElement(etree.SubElement(objects, "PathWrap"), "wrap_object")
        wrap.text = stated.key("wraps", entry["wrap"])
    for field, (tag, _) in NUMBERS.items():
        places = METRES_TO_MM if field == "slack_length_mm" else 0
        etree.SubElement(fibre, tag).text = write_decimal(unshifted(entry[field], places))
    etree.indent(fibre, space="\t")
    return fibre


def _notes(
    stated: _Stated, base: OsimImport, keys: Mapping[str, str], replace: bool
) -> list[str]:
    notes, origin = [], stated.document.get("imported_from", {})
    if not origin and replace:
        notes.append("The knee does not say which model it came from: its frames are assumed to be "
                     f"those of {base.knee.femur} and {base.knee.tibia}.")
    elif not origin:
        notes.append("The knee does not say which model it came from: parts were matched by name.")
    elif origin["sha256"] != hashlib.sha256(base.model.file.original).hexdigest():
        notes.append(f"The model differs from the one that was imported ({origin['file']}).")
    missing = [x.key for x in base.ligaments.values() if x.key not in keys.values()]
    if replace and base.found.unsupported:
        left = ", ".join(base.found.unsupported)
        notes.append(f"Left unchanged, since they could not be read: {left}.")
    if missing and not replace:
        notes.append(f"Left unchanged, since the knee does not have them: {', '.join(missing)}.")
    return notes


def _read_back(stated: _Stated, base: OsimImport, data: bytes) -> list[str]:
    """What the new model gives otherwise than the knee says."""
    knee, notes = base.knee, []
    again = import_osim(base.model.file.path, side=knee.side, femur=knee.femur, tibia=knee.tibia,
                        inside="straight", data=data)
    for section, found in (("ligaments", again.ligaments), ("wraps", again.wraps)):
        by_key = {item.key: name for name, item in found.items()}
        for name, entry in stated.document.get(section, {}).items():
            key = by_key.get(stated.key(section, name), "")
            other = again.document.get(section, {}).get(key, {})
            for field, value in entry.items():
                # At which strain a fibre tears is no number of OpenSim's.
                given = field in other and field != "failure_strain"
                if given and field.endswith(("_mm", "_deg", "_N", "_s", "strain")):
                    worst = float(np.max(np.abs(np.subtract(value, other[field]))))
                    if worst > 0:
                        notes.append(f"{name}.{field} differs by {worst:.1g} when read again.")
            if "wrap" in entry and other and "wrap" not in other:
                notes.append(
                    f"{name} now ends inside {entry['wrap']}: OpenSim lets it run straight."
                )
    return notes
