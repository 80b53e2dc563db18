"""A knee that nobody has seen: another person's size, side, names and frames, made of a known one.

Everything in an OpenSim model and its meshes is scaled, mirrored to the other side and renamed; the
meshes stand in frames of their own, their triangles shuffled. What mechanics has to give for it
follows from the known knee by scaling alone:

| quantity | times |
|---|---|
| lengths, points, depths | scale |
| strains, tensions, pressures | 1 |
| areas, contact forces | scale squared |
"""

from __future__ import annotations

import dataclasses
import re
import xml.etree.ElementTree as ET
from decimal import Decimal
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

_POINTS, _TURNS = {"location", "translation"}, {"orientation", "xyz_body_rotation"}
_LENGTHS = {"slack_length", "dimensions", "radius", "length", "thickness"}
_MIRROR = np.diag([1.0, 1.0, -1.0])


@dataclasses.dataclass(frozen=True)
class SecondKnee:
    """Where it was written, and what it is.

    Attributes:
        model: the .osim file.
        side: `r` or `l`.
        scale: its lengths over those of the known knee.
        fibres: name of a fibre -> name in the known knee.
    """

    model: Path
    side: str
    scale: float
    fibres: dict[str, str]


def write_second_knee(
    model: Path, meshes: Path, out: Path, scale: str = "1.07", side: str = "r"
) -> SecondKnee:
    """Write the twin's model and, beside it, its meshes.

    Args:
        model: OpenSim model of schema 4 with one knee joint, whose names end in the side.
        meshes: folder of its contact meshes, m.
        out: folder to write into.
        scale: factor of all lengths, as text: products of decimal numbers keep every digit.
        side: of the known knee, `r` or `l`; the other is written.
    """
    out.mkdir(parents=True, exist_ok=True)
    other = "l" if side == "r" else "r"
    text = _sides_swapped(model.read_text(encoding="utf-8"))
    root = ET.fromstring(text)
    _mirror_and_scale(root, Decimal(scale))
    fibres = _rename(root, other)
    _move_meshes(root, meshes, out, float(scale))
    path = out / "unseen.osim"
    ET.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return SecondKnee(path, other, float(scale), fibres)


def _sides_swapped(text: str) -> str:
    return re.sub(r"_([rl])\b", lambda m: "_l" if m[1] == "r" else "_r", text)


def _mirror_and_scale(root: ET.Element, scale: Decimal) -> None:
    for element in root.iter():
        words = (element.text or "").split()
        if len(words) == 3 and element.tag in _POINTS:
            _set(element, words, (scale, scale, -scale))
        elif len(words) == 3 and element.tag in _TURNS:
            _set(element, words, (Decimal(-1), Decimal(-1), Decimal(1)))
        elif words and element.tag in _LENGTHS:
            _set(element, words, (scale,) * len(words))
        elif element.tag == "TransformAxis":
            turns = element.get("name", "").startswith("rotation")
            axis = element.find("axis")
            if axis is not None and axis.text:
                signs = (-1, -1, 1) if turns else (1, 1, -1)
                _set(axis, axis.text.split(), [Decimal(sign) for sign in signs])


def _set(element: ET.Element, words, factors) -> None:
    numbers = (Decimal(word) * factor for word, factor in zip(words, factors, strict=True))
    element.text = " ".join(str(number + 0) for number in numbers)  # no -0


def _rename(root: ET.Element, side: str) -> dict[str, str]:
    """Other names for the model, the knee's bodies, joint, coordinates, obstacles and fibres."""
    (joint,) = (e for e in root.iter("CustomJoint") if e.get("name") == f"knee_{side}")
    word = {"l": "left", "r": "right"}[side]
    new = {f"knee_{side}": f"TF.{word}", root.find("Model").get("name"): "unseen"}
    for socket, name in (("parent", "distal_thigh"), ("child", "proximal_shank")):
        new[joint.findtext(f"socket_{socket}_frame").rsplit("/", 1)[-1]] = f"{name}.{word}"
    for k, coordinate in enumerate(joint.iter("Coordinate")):
        new[coordinate.get("name")] = f"TF.{word}.q{k}"
    for k, wrap in enumerate(e for e in root.iter() if re.fullmatch("Wrap[A-Z].*", e.tag)):
        new[wrap.get("name")] = f"lump {k}"
    fibres = {e.get("name"): f"strand.{k}" for k, e in enumerate(root.iter(_FIBRE), start=1)}
    for name, mesh in zip("AB", _contact_meshes(root), strict=True):
        new[mesh.get("name")] = f"Gelenk{name}"
    for element in root.iter():
        name = element.get("name", "")
        element.set("name", fibres.get(name, new.get(name, name)))
        held, word = (element.text or "").strip(), (element.text or "").strip().rsplit("/", 1)[-1]
        if word in new:
            element.text = held[: len(held) - len(word)] + new[word]
    return {name: old for old, name in fibres.items()}


_FIBRE = "Blankevoort1991Ligament"


def _contact_meshes(root: ET.Element) -> list[ET.Element]:
    """Of the model's first contact, which is that of femur and tibia."""
    force = next(root.iter("Smith2018ArticularContactForce"))
    names = [force.findtext(f"socket_{role}_mesh") for role in ("target", "casting")]
    known = {e.get("name"): e for e in root.iter("Smith2018ContactMesh")}
    return [known[name.rsplit("/", 1)[-1]] for name in names]


def _move_meshes(root: ET.Element, folder: Path, out: Path, scale: float) -> None:
    """Put the meshes into frames of their own; the first keeps its size, reading scales it."""
    import trimesh

    turns = ([0.3, -0.2, 0.5], [-0.7, 0.1, 1.1])
    shifts = ([0.012, -0.034, 0.021], [-0.05, 0.004, 0.017])
    rng = np.random.default_rng(3)
    for k, element in enumerate(_contact_meshes(root)):
        mesh = trimesh.load_mesh(folder / element.findtext("mesh_file").strip(), process=False)
        turn, own = Rotation.from_euler("XYZ", turns[k]).as_matrix(), scale if k == 0 else 1.0
        points = (scale * np.asarray(mesh.vertices) @ _MIRROR - shifts[k]) @ turn / own
        faces = rng.permutation(np.asarray(mesh.faces)[:, ::-1])  # outward again
        name = f"gristle_{k}.stl"
        trimesh.Trimesh(points, faces, process=False).export(out / name)
        element.find("mesh_file").text = name
        element.find("location").text = " ".join(map(repr, shifts[k]))
        element.find("orientation").text = " ".join(map(repr, turns[k]))
        element.find("scale_factors").text = " ".join([repr(own)] * 3)
