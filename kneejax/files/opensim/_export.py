"""Changed ligament numbers back into the OpenSim model that a knee came from."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files._bundled import bundled_knees
from kneejax.files._knees import check_kind, load_knee_file
from kneejax.files.knee import KneeFile, check_knee, read_knee
from kneejax.files.opensim._coupled_joint import couple_knee
from kneejax.files.opensim._coupled_motion import CoupledMotion
from kneejax.files.opensim._edits import Edits
from kneejax.files.opensim._fibres import replace_fibres
from kneejax.files.opensim._import import OsimImport, import_osim
from kneejax.files.opensim._knee import SIDES
from kneejax.files.opensim._ligaments import NUMBERS, OsimLigament
from kneejax.files.opensim._numbers import METRES_TO_MM, unshifted
from kneejax.files.opensim._registration import SAME
from kneejax.files.opensim._wraps import WRAP_KINDS, carrier_in_bone
from kneejax.files.reading import InputProblem, load_yaml

#: A slack length that was computed from a strain or force is the model's if it errs by less.
_ROUNDING = 1e-12


@dataclasses.dataclass(frozen=True)
class OsimExport:
    """A model with a knee's numbers.

    Attributes:
        data: content of the new file; the model's own bytes but for the numbers that changed.
        changes: a sentence for each of them.
        notes: what a person should know.
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
    them back. What stands in the file besides stays byte by byte. A number that the model leaves
    to a default is added where it is needed.

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
    knee_file = _opened(knee)
    document = knee_file.document
    origin = document.get("imported_from", {})
    side = origin.get("side") or document["side"][0]
    if SIDES.get(side) != document["side"]:
        expected = f"the side that was imported, {SIDES.get(side, side)}"
        raise InputProblem(knee_file.path, "side", document["side"], expected)
    try:
        base = import_osim(
            model, side=side, femur=origin.get("femur"), tibia=origin.get("tibia"),
            inside="straight",
        )  # fmt: skip
    except InputProblem as problem:
        if problem.field not in ("--femur", "--tibia"):
            raise
        expected = f"the model that the knee came from, {origin['file']}, which has this body"
        raise InputProblem(model, "body", problem.value, expected) from None
    edits = Edits(base.model)
    if replace:
        replace_fibres(edits, base, document, _added(knee_file, base, origin))
    _ligaments(edits, knee_file, base, origin.get("ligaments", {}), replace)
    _wraps(edits, knee_file, base, origin.get("wraps", {}))
    if coupled is not None:
        couple_knee(edits, base.knee, coupled, SAME)
    data = base.model.file.spliced(edits.splices)
    notes = _notes(knee_file, base, origin, replace)
    if edits.splices:
        notes += _read_back(knee_file, base, data)
    return OsimExport(data, tuple(edits.changes), tuple(notes))


@dataclasses.dataclass(frozen=True)
class _Stated:
    """What a knee file states, and the way to what must be computed from it."""

    path: Path
    document: dict[str, Any]
    built: Callable[[], KneeFile]


def _opened(knee: KneeFile | str | os.PathLike[str]) -> _Stated:
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


def _added(knee_file: _Stated, base: OsimImport, origin: dict[str, Any]) -> dict[str, Any]:
    """Fibres that the model has not, with all their numbers."""
    keys, known = origin.get("ligaments", {}), {x.key for x in base.ligaments.values()}
    wraps = origin.get("wraps", {})
    added = {}
    for row, (name, entry) in enumerate(knee_file.document["ligaments"].items()):
        if keys.get(name, name) in known:
            continue
        if name in base.found.outside | base.found.unsupported:
            expected = f"a name that no other force of {base.model.file.path.name} has"
            raise InputProblem(knee_file.path, f"ligaments.{name}", name, expected)
        slack = float(knee_file.built().knee.ligaments.slack_length[row])
        added[name] = {"damping_N_s": 0.0, "slack_length_mm": slack} | entry
        if "wrap" in entry:
            added[name]["wrap"] = wraps.get(entry["wrap"], entry["wrap"])
    return added


def _ligaments(
    edits: Edits, knee_file: _Stated, base: OsimImport, keys: dict[str, str], replace: bool
) -> None:
    document = knee_file.document
    by_key = {ligament.key: name for name, ligament in base.ligaments.items()}
    for row, (name, entry) in enumerate(document["ligaments"].items()):
        key, place = keys.get(name, name), f"ligaments.{name}"
        if key not in by_key and replace:
            continue
        if key not in by_key:
            file = base.model.file.path.name
            expected = f"a fibre of {file} that spans the knee, or --replace to add it"
            raise InputProblem(knee_file.path, place, key, expected, by_key)
        ligament, old = base.ligaments[by_key[key]], base.document["ligaments"][by_key[key]]
        for field, (tag, _) in NUMBERS.items():
            if field in entry:
                new = float(entry[field])
            elif field == "slack_length_mm":
                new = float(knee_file.built().knee.ligaments.slack_length[row])
                if abs(new - old[field]) <= _ROUNDING * old[field]:
                    continue
            else:
                continue
            places = METRES_TO_MM if field == "slack_length_mm" else 0
            words = {0: unshifted(new, places)} if new != old[field] else {}
            edits.numbers(ligament.element, tag, words, [unshifted(new, places)])
            edits.say(f"{name}.{field}", old[field], new)
        _points(edits, knee_file, base, ligament, name, entry, old)
        _same(knee_file, f"{place}.wrap", _linked(entry, knee_file, base), old.get("wrap"))


def _linked(entry: dict[str, Any], knee_file: _Stated, base: OsimImport) -> str | None:
    """The name that a fibre's obstacle has when the model is read again."""
    if "wrap" not in entry:
        return None
    keys = knee_file.document.get("imported_from", {}).get("wraps", {})
    key = keys.get(entry["wrap"], entry["wrap"])
    return next((name for name, wrap in base.wraps.items() if wrap.key == key), key)


def _points(
    edits: Edits,
    knee_file: _Stated,
    base: OsimImport,
    ligament: OsimLigament,
    name: str,
    entry: dict[str, Any],
    old: dict[str, Any],
) -> None:
    place = f"ligaments.{name}.via_points"
    bones = [[via["bone"] for via in x.get("via_points", ())] for x in (entry, old)]
    _same(knee_file, place, bones[0] or "none", bones[1] or "none")
    fields = ["femoral_attachment_mm", *(["via_points"] * len(bones[0])), "tibial_attachment_mm"]
    for i, (field, point) in enumerate(zip(fields, ligament.points, strict=True)):
        if field == "via_points":
            new, was = (x[field][i - 1]["point_mm"] for x in (entry, old))
            field = f"via_points[{i - 1}].point_mm"
        else:
            new, was = entry[field], old[field]
        carrier = point.carrier_in_bone(base.knee)
        edits.place(point.element, "location", carrier, was, new)
        edits.say(f"{name}.{field}", was, new)


def _wraps(edits: Edits, knee_file: _Stated, base: OsimImport, keys: dict[str, str]) -> None:
    by_key = {wrap.key: name for name, wrap in base.wraps.items()}
    used = {entry.get("wrap") for entry in knee_file.document["ligaments"].values()}
    for name, entry in knee_file.document.get("wraps", {}).items():
        key = keys.get(name, name)
        if key not in by_key and name not in used:
            continue
        if key not in by_key:
            expected = f"a wrap object of {base.model.file.path.name} on the knee's bones"
            raise InputProblem(knee_file.path, f"wraps.{name}", key, expected, by_key)
        wrap, old = base.wraps[by_key[key]], base.document["wraps"][by_key[key]]
        for field in ("kind", "bone", "side"):
            _same(knee_file, f"wraps.{name}.{field}", entry.get(field), old.get(field))
        carrier, straight = carrier_in_bone(wrap, base.knee), [0.0, 0.0, 0.0]
        edits.place(wrap.element, "translation", carrier, old["center_mm"], entry["center_mm"])
        edits.say(f"{name}.center_mm", old["center_mm"], entry["center_mm"])
        was, new = (x.get("rotation_deg", straight) for x in (old, entry))
        edits.turn(wrap.element, "xyz_body_rotation", carrier, was, new)
        edits.say(f"{name}.rotation_deg", was, new)
        for field, tag, count in WRAP_KINDS[wrap.element.tag][1]:
            new, was = (x[field] if count > 1 else [x[field]] for x in (entry, old))
            meters = [unshifted(x, METRES_TO_MM) for x in new]
            changed = {i: meters[i] for i in range(count) if float(new[i]) != was[i]}
            edits.numbers(wrap.element, tag, changed, meters)
            edits.say(f"{name}.{field}", old[field], entry[field])


def _same(knee_file: _Stated, place: str, value, model_value) -> None:
    if value != model_value:
        expected = f"what the model has, {model_value or 'none'}: only numbers are written back"
        raise InputProblem(knee_file.path, place, value or "none", expected)


def _notes(
    knee_file: _Stated, base: OsimImport, origin: dict[str, Any], replace: bool
) -> list[str]:
    notes = []
    digest = hashlib.sha256(base.model.file.original).hexdigest()
    if not origin and replace:
        notes.append("The knee does not say which model it came from: its frames are assumed to be "
                     f"those of {base.knee.femur} and {base.knee.tibia}.")  # fmt: skip
    elif not origin:
        notes.append("The knee does not say which model it came from: parts were matched by name.")
    elif origin["sha256"] != digest:
        notes.append(f"The model differs from the one that was imported ({origin['file']}).")
    keys = origin.get("ligaments", {})
    kept = {keys.get(name, name) for name in knee_file.document["ligaments"]}
    missing = [x.key for x in base.ligaments.values() if x.key not in kept]
    if replace and base.found.unsupported:
        left = ", ".join(base.found.unsupported)
        notes.append(f"Left unchanged, since they could not be read: {left}.")
    if missing and not replace:
        notes.append(f"Left unchanged, since the knee does not have them: {', '.join(missing)}.")
    return notes


def _read_back(knee_file: _Stated, base: OsimImport, data: bytes) -> list[str]:
    """What the new model gives otherwise than the knee says."""
    knee = base.knee
    again = import_osim(
        base.model.file.path, side=knee.side, femur=knee.femur, tibia=knee.tibia,
        inside="straight", data=data,
    )  # fmt: skip
    origin, notes = knee_file.document.get("imported_from", {}), []
    for section, found in (("ligaments", again.ligaments), ("wraps", again.wraps)):
        by_key = {item.key: name for name, item in found.items()}
        for name, entry in knee_file.document.get(section, {}).items():
            key = origin.get(section, {}).get(name, name)
            other = again.document.get(section, {}).get(by_key.get(key, ""), {})
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
