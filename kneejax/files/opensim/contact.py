"""Contact of OpenSim JAM as one layer between two bones, and surfaces fitted to its meshes."""

from __future__ import annotations

import copy
import dataclasses
import os
import tempfile
from decimal import Decimal
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.files.opensim.exact import METRES_TO_MM, PASCAL_TO_MPA, Rigid, shifted
from kneejax.files.opensim.knee import SIDES, OsimKneeJoint
from kneejax.files.opensim.model import Model
from kneejax.files.opensim.xml import Element
from kneejax.files.reading import InputProblem
from kneejax.geometry import FEMUR, PATELLA, TIBIA, Pose

if TYPE_CHECKING:
    from kneejax.files.opensim.importing import OsimImport

FORCE = "Smith2018ArticularContactForce"
MESH = "Smith2018ContactMesh"
_LAWS = {"linear": "linear", "nonlinear": "log"}


@dataclasses.dataclass(frozen=True)
class OsimMesh:
    """A contact mesh."""

    name: str
    bone: str  # `femur`, `tibia` or `patella`
    file: str  # name of the surface's file, without folders
    back_file: str  # likewise of its back; empty if none is named
    frame: Rigid  # from the mesh's coordinates to the bone's
    scale: tuple[float, float, float]  # factors of the vertices along x, y, z
    youngs_modulus_MPa: float  # of its layer
    poisson_ratio: float  # of its layer
    thickness_mm: float  # of its layer, where it does not vary
    varies: bool  # whether the layer reaches from the surface to its back


@dataclasses.dataclass(frozen=True)
class OsimContact:
    """A contact of the femur with the tibia or the patella."""

    name: str
    femur: OsimMesh  # the femur's mesh
    other: OsimMesh  # the other bone's mesh
    law: str  # of `kneejax.mechanics.cartilage_law`
    youngs_modulus_MPa: float  # of the one layer that stands for both
    poisson_ratio: float
    layer_thickness_mm: float  # both together
    findings: tuple[str, ...]  # what was taken from where
    doubts: tuple[str, ...]  # where the one layer is not the model's
    element: Element  # the force in the file


def find_contacts(model: Model, knee: OsimKneeJoint) -> list[OsimContact]:
    """Contacts between the knee's bones; what is wrong in one is an InputProblem."""
    meshes, contacts = {e.name: e for e in model.elements if e.tag == MESH}, []
    for force in model.elements:
        if force.tag != FORCE:
            continue
        found = {}
        for role in ("target", "casting"):
            tags = f"socket_{role}_mesh", f"socket_{role}_mesh_connectee_name"
            name = force.last_word(*tags)
            if name not in meshes:
                word = force.word(*tags) or "missing"
                raise force.problem(tags[0], word, f"a {MESH} of the model", meshes)
            mesh = settings = meshes[name]
            # Earlier versions of JAM keep the material with the force.
            held = force.child(f"{role}_mesh_contact_params")
            if held is not None and mesh.child("elastic_modulus") is None:
                inner = (e for e in held.iter("*") if e.child("elastic_modulus") is not None)
                settings = next(inner, mesh)
            body, frame = model.socket(mesh, "frame")
            found[knee.bone_of(body)] = mesh, settings, body, frame
        if force.applied and {*found} in ({FEMUR, TIBIA}, {FEMUR, PATELLA}):
            both = {bone: _mesh_of(mesh, settings, bone, knee.rigid[body][1].after(frame))
                    for bone, (mesh, settings, body, frame) in found.items()}
            contacts.append(_contact(force, both.pop(FEMUR), *both.values()))
    return contacts


def _mesh_of(mesh: Element, settings: Element, bone: str, carrier: Rigid) -> OsimMesh:
    own = Rigid.of(mesh.point("location"), mesh.point("orientation"))
    x, y, z = (float(x) for x in mesh.numbers("scale_factors", 3, "1 1 1"))
    modulus, ratio, thickness = (settings.numbers(*tag)[0] for tag in (
        ("elastic_modulus", 1, "1000000"), ("poissons_ratio", 1, "0.5"), ("thickness", 1, "0.005")))
    for tag, value in (("elastic_modulus", modulus), ("thickness", thickness)):
        if value <= 0:
            raise settings.problem(tag, settings.word(tag), "a number above 0")
    if not 0 <= ratio <= Decimal("0.5"):
        word = settings.word("poissons_ratio")
        raise settings.problem("poissons_ratio", word, "a ratio from 0 to 0.5")
    file, back_file = (PurePosixPath(PureWindowsPath(word).as_posix()).name for word in (
        mesh.word("mesh_file", "filename"), mesh.word("mesh_back_file")))
    return OsimMesh(
        mesh.name, bone, file, back_file, carrier.after(own), (x, y, z),
        shifted(modulus, PASCAL_TO_MPA), float(ratio), shifted(thickness, METRES_TO_MM),
        settings.truth("use_variable_thickness", False),
    )


def _contact(force: Element, femur: OsimMesh, other: OsimMesh) -> OsimContact:
    tag = "elastic_foundation_formulation"
    word, pair, doubts = force.word(tag, default="linear"), (femur, other), []
    if word not in _LAWS:
        raise force.problem(tag, word, f"one of {', '.join(_LAWS)}")
    law = _LAWS[word]
    findings = [f"Formulation {word}: the {law} law of kneejax."]
    for mesh in pair:
        layer = "to its back mesh" if mesh.varies else f"{mesh.thickness_mm:g} mm"
        findings.append(
            f"{mesh.bone}: mesh {mesh.name} ({mesh.file}), E {mesh.youngs_modulus_MPa:g} MPa, "
            f"nu {mesh.poisson_ratio:g}, layer {layer}."
        )
    thickness, ratio, modulus = (
        float(sum(Decimal(repr(getattr(mesh, name))) for mesh in pair) / count)
        for name, count in (("thickness_mm", 1), ("poisson_ratio", 2), ("youngs_modulus_MPa", 2))
    )
    same = len({(mesh.youngs_modulus_MPa, mesh.poisson_ratio) for mesh in pair}) == 1
    if not same and force.truth("use_lumped_contact_model", True):
        findings.append("Lumped in the model too: the means of E and nu, the sum of the layers.")
    elif not same:
        if max(m.poisson_ratio for m in pair) < 0.5:
            # One layer that is as stiff as both in a row.
            soft = sum(m.thickness_mm / (m.youngs_modulus_MPa * _confined(m.poisson_ratio))
                       for m in pair)
            modulus = thickness / soft / _confined(ratio)
        findings.append(
            "The layers are springs in series: E is that of one layer of both thicknesses and the "
            "mean nu with the same pressure."
        )
        if law != "linear":
            doubts.append(
                "The model solves two different materials pairwise; with the nonlinear law the one "
                "layer agrees only at small depths."
            )
    if ratio == 0.5:
        doubts.append(
            "nu is 0.5: a layer that cannot change its volume has no elastic foundation, and its "
            "contact must be given with a smaller nu."
        )
    return OsimContact(force.name, femur, other, law, modulus, ratio, thickness, tuple(findings),
                       tuple(doubts), force)


def _confined(nu: float) -> float:
    """Confined modulus over Young's."""
    return (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


@dataclasses.dataclass(frozen=True)
class OsimGeometry:
    """Contacts of an imported knee.

    Attributes:
        document: the knee document with its contacts.
        findings: sentences about the fit.
        doubtful: whether a surface misses its target.
    """

    document: dict[str, Any]
    findings: tuple[str, ...]
    doubtful: bool


def add_osim_contacts(read: OsimImport, folder: str | os.PathLike[str]) -> OsimGeometry:
    """Fit the contacts of an imported knee to the model's meshes.

    Args:
        read: what a model gave.
        folder: where its meshes are.

    Returns:
        The knee document with contacts, and what the fit found.

    Raises:
        InputProblem: the model has not exactly one contact of femur and tibia, a mesh is not in
            the folder, or it cannot be fitted.

    Example:
        >>> from kneejax.files import SMALLEST_MODEL, import_osim
        >>> read = import_osim("smallest.osim", side="r", data=SMALLEST_MODEL.encode())
        >>> add_osim_contacts(read, "no-such-folder")
        Traceback (most recent call last):
        kneejax.files.reading._problem.InputProblem: --geometry: folder: no-such-folder: expected
        a folder
        of meshes
    """
    folder, file = Path(folder), read.model.file.path
    if not folder.is_dir():
        raise InputProblem("--geometry", "folder", str(folder), "a folder of meshes")
    expected = "one contact of femur and tibia; use `kneejax import stl --knee knee.yaml ...`"
    contact, joint = _only(read.contacts, file, "contacts", expected), None
    if contact.poisson_ratio >= 0.5:
        raise InputProblem(file, contact.name, f"nu {contact.poisson_ratio}", "nu below 0.5")
    pair = (contact.femur, contact.other)
    varies = any(mesh.varies for mesh in pair)
    if "patella" in read.document:
        expected = "one contact of femur and patella, or --without-patella"
        joint = _only(read.patellofemoral, file, "contacts of the patella", expected)
        if joint.femur.file != contact.femur.file:
            expected = f"the femur's mesh of {contact.name}, {contact.femur.file}"
            raise InputProblem(file, joint.name, joint.femur.file, expected)
    with tempfile.TemporaryDirectory() as scratch:
        sheets = [_mesh(folder, mesh, Path(scratch)) for mesh in pair]
        backs = [_mesh(folder, mesh, Path(scratch), back=True) for mesh in pair if varies]
        # Takes a while, and few need it.
        from kneejax.files.meshes.importing import MeshOptions, import_meshes

        options = MeshOptions(
            patellar_cartilage=_mesh(folder, joint.other, Path(scratch)) if joint else None,
            femur_bone=backs[0] if varies else None,
            tibia_bone=backs[1] if varies else None,
            youngs_modulus_MPa=contact.youngs_modulus_MPa,
            poisson_ratio=contact.poisson_ratio,
            layer_thickness_mm=None if varies else contact.layer_thickness_mm,
            thickness="field" if varies else "constant",
            law=contact.law,
            reference_pose=Pose.from_table(read.knee.pose),
            source=", ".join(mesh.file for mesh in pair),
        )
        found = import_meshes(*sheets, side=SIDES[read.knee.side], options=options)
    document = copy.deepcopy(read.document)
    document["contacts"] = dict(found.contacts)
    stated = "youngs_modulus_MPa", "poisson_ratio", *(() if varies else ("layer_thickness_mm",))
    for part in document["contacts"].values():
        part["source"] |= dict.fromkeys(stated, f"{file.name}, {contact.name}")
    if joint is not None and found.patellofemoral is not None:
        # Its material is the model's own, not that of femur and tibia.
        own = ("law", "youngs_modulus_MPa", "poisson_ratio", "layer_thickness_mm")
        entry = found.patellofemoral | {field: getattr(joint, field) for field in own}
        entry["source"] = dict.fromkeys(entry["source"], f"{file.name}, {joint.name}")
        document["patella"]["contacts"] = {"patellofemoral": entry}
    return OsimGeometry(document, tuple(found.findings), found.doubtful)


def _only(
    contacts: tuple[OsimContact, ...], file: Path, field: str, expected: str
) -> OsimContact:
    if len(contacts) != 1:
        names = ", ".join(contact.name for contact in contacts) or "none"
        raise InputProblem(file, field, names, expected)
    return contacts[0]


def _mesh(folder: Path, mesh: OsimMesh, scratch: Path, back: bool = False) -> Path:
    """The file of a mesh with its vertices in the bone's frame."""
    name = mesh.back_file if back else mesh.file
    by_lower = {path.name.lower(): path for path in sorted(folder.iterdir())}
    path = by_lower.get(name.lower())
    if path is None:
        present = ", ".join(sorted(by_lower)[:6]) or "nothing"
        without = "; --without-patella does without it" if mesh.bone == PATELLA else ""
        expected = f"this file; there is {present}{without}"
        known = sorted(path.name for path in by_lower.values())
        raise InputProblem(folder, f"mesh of {mesh.name}", name or "not named", expected, known)
    still = not mesh.frame.turns and not any(mesh.frame.shift)
    if still and mesh.scale == (1.0, 1.0, 1.0):
        return path
    import trimesh

    loaded = trimesh.load_mesh(path)
    scaled = np.asarray(loaded.vertices) * np.asarray(mesh.scale)
    size = float(np.max(np.ptp(scaled, axis=0)))
    unit = 1e3 if size > 1.0 else 1.0  # a knee's cartilage is centimetres wide: mm or m
    shift = np.asarray(mesh.frame.shift, float) * unit
    loaded.vertices = scaled @ mesh.frame.turn.T + shift
    # What is said about it names the file that a person knows.
    moved = scratch / mesh.bone / ("back" if back else "front") / f"{path.stem}.stl"
    moved.parent.mkdir(parents=True, exist_ok=True)
    loaded.export(moved)
    return moved
