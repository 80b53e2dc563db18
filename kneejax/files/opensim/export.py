"""Changed ligament numbers back into the OpenSim model that a knee came from."""

__all__ = ["export_osim"]

import dataclasses
import os
from collections.abc import Collection
from typing import Any

import numpy as np

from kneejax.files._knees import load_knee_file
from kneejax.files.knee.file import KneeFile
from kneejax.files.opensim import exact
from kneejax.files.opensim.coupled import CoupledMotion, couple_knee
from kneejax.files.opensim.frames import SAME
from kneejax.files.opensim.importing import OsimImport, import_osim
from kneejax.files.opensim.knee import SIDES
from kneejax.files.opensim.ligaments import KIND, NUMBERS, OsimLigament
from kneejax.files.opensim.paths import WRAP_KINDS
from kneejax.files.opensim.xml import Element, etree
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, TIBIA
from kneejax.mechanics import BLANKEVOORT

#: A slack length that was computed from a strain or force is the model's if it errs by less.
_ROUNDING = 1e-12
_STILL = exact.Rigid()


@dataclasses.dataclass(frozen=True)
class OsimExport:
    """A model with a knee's numbers."""

    data: bytes  # content of the new file; the model's own bytes where nothing changed
    changes: tuple[str, ...]  # a sentence for each number, and each fibre put in or taken out
    notes: tuple[str, ...]  # what a person should know


def export_osim(
    knee: KneeFile | str | os.PathLike[str], model: str | os.PathLike[str], *,
    replace: bool = False, coupled: CoupledMotion | None = None,
) -> OsimExport:  # fmt: skip
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
        >>> from pathlib import Path
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
    known = knee if isinstance(knee, KneeFile) else load_knee_file(knee)
    document, origin = known.document, known.document.get("imported_from", {})
    side = origin.get("side") or document["side"][0]
    if SIDES.get(side) != document["side"]:
        expected = f"the side that was imported, {SIDES.get(side, side)}"
        raise InputProblem(known.path, "side", document["side"], expected)
    try:
        base = import_osim(model, side=side, femur=origin.get("femur"), tibia=origin.get("tibia"),
                           inside="straight")
    except InputProblem as problem:
        if problem.field not in ("--femur", "--tibia"):
            raise
        expected = f"the model that the knee came from, {origin['file']}, which has this body"
        raise InputProblem(model, "body", problem.value, expected) from None
    for name, entry in document["ligaments"].items():
        if (law := entry.get("law", BLANKEVOORT)) != BLANKEVOORT:
            expected = f"{BLANKEVOORT}: {KIND}s are all that an OpenSim model has"
            raise InputProblem(known.path, f"ligaments.{name}.law", law, expected)
    export = _Export(known, base, replace)
    if replace:
        export.replace_fibres()
    export.write_ligaments()
    export.write_wraps()
    if coupled is not None:
        export.changes += couple_knee(base.model, base.knee, coupled, SAME)
    notes = export.notes()
    if not export.changes:
        return OsimExport(base.model.file.original, (), tuple(notes))
    data = base.model.file.written()
    return OsimExport(data, tuple(export.changes), (*notes, *export.read_back(data)))


def _points(entry: dict[str, Any]) -> list[tuple[str, str, list[float]]]:
    """Field, bone and place, mm, of each point of a fibre."""
    first, last = "femoral_attachment_mm", "tibial_attachment_mm"
    via = [(f"via_points[{k}].point_mm", one["bone"], one["point_mm"])
           for k, one in enumerate(entry.get("via_points", ()))]
    return [(first, FEMUR, entry[first]), *via, (last, TIBIA, entry[last])]


class _Export:
    """A knee on its way into a model; `changes` has a sentence for each change."""

    def __init__(self, known: KneeFile, base: OsimImport, replace: bool):
        self.known, self.base, self.replace = known, base, replace
        self.document, self.origin = known.document, known.document.get("imported_from", {})
        # What the model calls a fibre or wrap object -> what was read of it, and its entry.
        self.fibres = {one.key: (one, base.document["ligaments"][name])
                       for name, one in base.ligaments.items()}
        self.wraps = {one.key: (one, base.document["wraps"][name])
                      for name, one in base.wraps.items()}
        self.keys = {name: self.key("ligaments", name) for name in self.document["ligaments"]}
        self.unknown = [key for key in self.fibres if key not in self.keys.values()]
        self.changes: list[str] = []

    def key(self, section: str, name: str) -> str:
        """What the model calls a fibre or wrap object."""
        return self.origin.get(section, {}).get(name, name)

    def slack_length_mm(self, name: str) -> float:
        """Also where a strain or a force gives it."""
        given = self.document["ligaments"][name].get("slack_length_mm")
        row = [*self.document["ligaments"]].index(name)
        return given or float(self.known.knee.ligaments.slack_length[row])

    def check_same(self, place: str, value, model_value) -> None:
        """Refuse what is no number and differs from the model's."""
        if value != model_value:
            expected = f"what the model has, {model_value or 'none'}: only numbers are written back"
            raise InputProblem(self.known.path, place, value or "none", expected)

    def write(
        self, field: str, parent: Element, tag: str, was, new,
        carrier: exact.Rigid = _STILL, kind: str = "length",
    ) -> None:  # fmt: skip
        """Write changed numbers: a `number`, a `length` or `point`, mm, or a `turn`, degrees."""
        was, new = (np.ravel(one).tolist() for one in (was, new))
        changed: Collection[int] = [k for k, (x, y) in enumerate(zip(new, was, strict=True))
                                    if float(x) != y]
        if not changed:
            return
        back = carrier.turn.T
        if kind == "turn" and not carrier.turns:
            every = np.array([exact.radians(x) for x in new])
        elif kind == "turn":
            every = exact.decimals(exact.angles_xyz(back @ exact.turn_xyz(np.deg2rad(new))))
        elif kind == "point":
            every = carrier.point_back(exact.decimals(new, exact.METRES_TO_MM))
            for _ in range(3 * carrier.turns):  # a rounding of the way there is taken back
                there = exact.millimetres(carrier.point(every))
                every = exact.decimals(every.astype(float) + back @ np.subtract(new, there) / 1e3)
        else:
            places = exact.METRES_TO_MM if kind == "length" else 0
            every = exact.decimals(new, places)
        if carrier.turns:
            changed = range(3)
        elif kind in ("point", "turn"):
            every = np.where(np.isin(range(3), changed), every, parent.point(tag))
        leaf, words = parent.child(tag), [exact.write_decimal(value) for value in every]
        if leaf is None:
            parent.add(tag, " ".join(words))
        else:
            leaf.set_words(words, changed)
        shown = (" ".join(f"{float(x):.10g}" for x in one) for one in (was, new))
        self.changes.append(f"{field}: {' -> '.join(shown)}")

    def write_ligaments(self) -> None:
        for name, entry in self.document["ligaments"].items():
            key, place = self.keys[name], f"ligaments.{name}"
            if key not in self.fibres:
                if self.replace:
                    continue
                expected = f"a fibre of {self.base.model.name} that spans the knee"
                expected += ", or --replace to add it"
                raise InputProblem(self.known.path, place, key, expected, self.fibres)
            ligament, old = self.fibres[key]
            for field, (tag, *_) in NUMBERS.items():
                length = field == "slack_length_mm"
                if field not in entry and not length:
                    continue
                new = self.slack_length_mm(name) if length else float(entry[field])
                if field in entry or abs(new - old[field]) > _ROUNDING * old[field]:
                    self.write(f"{name}.{field}", ligament.element, tag, old[field], new,
                               kind="length" if length else "number")
            points, was = _points(entry), _points(old)
            bones = ([bone for _, bone, _ in x[1:-1]] or "none" for x in (points, was))
            self.check_same(f"{place}.via_points", *bones)
            for point, (field, _, new), (*_, other) in zip(
                    ligament.points, points, was, strict=True):
                self.write(f"{name}.{field}", point.element, "location", other, new,
                           point.carrier_in_bone(self.base.knee), "point")
            wrap = entry.get("wrap")
            if wrap is not None:  # by the name that it has when the model is read again
                key = self.key("wraps", wrap)
                wrap = next((name for name, w in self.base.wraps.items() if w.key == key), key)
            self.check_same(f"{place}.wrap", wrap, old.get("wrap"))

    def write_wraps(self) -> None:
        used = {entry.get("wrap") for entry in self.document["ligaments"].values()}
        for name, entry in self.document.get("wraps", {}).items():
            key = self.key("wraps", name)
            if key not in self.wraps:
                if name not in used:
                    continue
                expected = f"a wrap object of {self.base.model.name} on the knee's bones"
                raise InputProblem(self.known.path, f"wraps.{name}", key, expected, self.wraps)
            wrap, old = self.wraps[key]
            for field in ("kind", "bone", "side"):
                self.check_same(f"wraps.{name}.{field}", entry.get(field), old.get(field))
            carrier = wrap.carrier_in_bone(self.base.knee)
            for field, tag, kind in (("center_mm", "translation", "point"),
                                     ("rotation_deg", "xyz_body_rotation", "turn")):
                was, new = (x.get(field, [0.0, 0.0, 0.0]) for x in (old, entry))
                self.write(f"{name}.{field}", wrap.element, tag, was, new, carrier, kind)
            for field, tag, _ in WRAP_KINDS[wrap.element.tag][1]:
                self.write(f"{name}.{field}", wrap.element, tag, old[field], entry[field])

    def replace_fibres(self) -> None:
        """Take out fibres that the knee has not, and put those in that the model has not."""
        new, (last, _) = [], [*self.fibres.values()][-1]
        for name, entry in self.document["ligaments"].items():
            if self.keys[name] in self.fibres:
                continue
            found = self.base.knee.found
            if name in found.outside | found.unsupported:
                expected = f"a name that no other force of {self.base.model.name} has"
                raise InputProblem(self.known.path, f"ligaments.{name}", name, expected)
            entry = {"damping_N_s": 0.0} | entry | {"slack_length_mm": self.slack_length_mm(name)}
            new.append(self.fibre(name, entry, last))
            self.changes.append(f"{name}: put in, {entry['stiffness_N']:.6g} N per unit strain, "
                                f"{entry['slack_length_mm']:.6g} mm without load")
        for element in reversed(new):
            last.element.add_after(element)
        for key in self.unknown:
            self.fibres[key][0].element.take_out()
        self.changes[:0] = [f"{key}: taken out" for key in self.unknown]

    def fibre(self, name: str, entry: dict[str, Any], like: OsimLigament) -> Element:
        """A fibre as the model writes them, indented like another one."""
        path_name = like.element.child("GeometryPath").get("name")
        bodies = {FEMUR: self.base.knee.femur, TIBIA: self.base.knee.tibia}
        on_body, prefix = "socket_parent_frame", "/bodyset/"
        if like.points[0].element.child("body") is not None:
            on_body, prefix = "body", ""
        fibre = like.element.makeelement(KIND, name=name)
        path = etree.SubElement(fibre, "GeometryPath", {"name": path_name} if path_name else {})
        objects = etree.SubElement(etree.SubElement(path, "PathPointSet"), "objects")
        for number, (_, bone, point) in enumerate(_points(entry), start=1):
            there = self.base.knee.rigid[bodies[bone]][1]
            location = there.point_back(exact.decimals(point, exact.METRES_TO_MM))
            one = etree.SubElement(objects, "PathPoint", name=f"{name}-P{number}")
            etree.SubElement(one, on_body).text = prefix + bodies[bone]
            etree.SubElement(one, "location").text = " ".join(map(exact.write_decimal, location))
        if "wrap" in entry:
            objects = etree.SubElement(etree.SubElement(path, "PathWrapSet"), "objects")
            wrap = etree.SubElement(etree.SubElement(objects, "PathWrap"), "wrap_object")
            wrap.text = self.key("wraps", entry["wrap"])
        for field, (tag, *_) in NUMBERS.items():
            places = exact.METRES_TO_MM if field == "slack_length_mm" else 0
            number = exact.decimals(entry[field], places)
            etree.SubElement(fibre, tag).text = exact.write_decimal(number)
        etree.indent(fibre, space="\t")
        return fibre

    def notes(self) -> list[str]:
        """What a person should know of how the knee fits the model."""
        notes, bones = [], self.base.knee
        if not self.origin:
            assumed = "parts were matched by name"
            if self.replace:
                assumed = f"its frames are assumed to be those of {bones.femur} and {bones.tibia}"
            notes.append(f"The knee does not say which model it came from: {assumed}.")
        elif self.origin["sha256"] != self.base.document["imported_from"]["sha256"]:
            file = self.origin["file"]
            notes.append(f"The model differs from the one that was imported ({file}).")
        left, why = self.unknown, "the knee does not have them"
        if self.replace:
            left, why = bones.found.unsupported, "they could not be read"
        if left:
            notes.append(f"Left unchanged, since {why}: {', '.join(left)}.")
        return notes

    def read_back(self, data: bytes) -> list[str]:
        """What the new model gives otherwise than the knee says."""
        knee, notes = self.base.knee, []
        again = import_osim(self.base.model.file.path, side=knee.side, femur=knee.femur,
                            tibia=knee.tibia, inside="straight", data=data)
        for section, found in (("ligaments", again.ligaments), ("wraps", again.wraps)):
            by_key = {item.key: again.document[section][name] for name, item in found.items()}
            for name, entry in self.document.get(section, {}).items():
                other = by_key.get(self.key(section, name), {})
                for field, value in entry.items():
                    # At which strain a fibre tears is no number of OpenSim's.
                    given = field in other and field != "failure_strain"
                    if given and field.endswith(("_mm", "_deg", "_N", "_s", "strain")):
                        worst = float(np.max(np.abs(np.subtract(value, other[field]))))
                        if worst > 0:
                            notes.append(f"{name}.{field} differs by {worst:.1g} when read again.")
                if "wrap" in entry and other and "wrap" not in other:
                    notes.append(
                        f"{name} now ends inside {entry['wrap']}: OpenSim lets it run straight.")
        return notes
