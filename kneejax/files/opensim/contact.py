"""Contact of OpenSim JAM as one layer between two bones, and surfaces fitted to its meshes."""

__all__ = ["add_osim_contacts"]

import copy
import dataclasses
import os
import tempfile
from decimal import Decimal
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from kneejax.files.opensim.exact import METRES_TO_MM, PASCAL_TO_MPA, Rigid, shifted
from kneejax.files.opensim.joints import moved, read_joints
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
_FORMULATION = "elastic_foundation_formulation"


class Layer(NamedTuple):
    """A layer of cartilage."""

    youngs_modulus_MPa: float
    poisson_ratio: float
    layer_thickness_mm: float


class OsimMesh(NamedTuple):
    """A contact mesh."""

    name: str
    bone: str  # `femur`, `tibia` or `patella`
    file: str  # name of the surface's file, without folders
    back_file: str  # likewise of its back; empty if none is named
    frame: Rigid  # from the mesh's coordinates to the bone's
    scale: tuple[float, float, float]  # factors of the vertices along x, y, z
    layer: Layer  # its thickness where it does not vary
    varies: bool  # whether the layer reaches from the surface to its back


class OsimContact(NamedTuple):
    """A contact of the femur with the tibia or the patella."""

    name: str
    femur: OsimMesh  # the femur's mesh
    other: OsimMesh  # the other bone's mesh
    law: str  # of `kneejax.mechanics.cartilage_law`
    layer: Layer  # the one that stands for both
    findings: tuple[str, ...]  # what was taken from where
    doubts: tuple[str, ...]  # where the one layer is not the model's
    element: Element  # the force in the file


class OsimMeniscus(NamedTuple):
    """A meniscus: a body that moves on the tibia, for which a ring stands."""

    name: str  # of its body
    upper: OsimMesh  # that meets the femur, in the tibia's frame
    lower: OsimMesh  # that meets the tibia, likewise
    law: str  # of `kneejax.mechanics.cartilage_law`
    findings: tuple[str, ...]  # what was taken, and what was not
    elements: tuple[Element, ...]  # the forces in the file


def find_contacts(
    model: Model, knee: OsimKneeJoint
) -> tuple[list[OsimContact], list[OsimMeniscus]]:
    """Contacts between the knee's bones, and menisci in contact with both femur and tibia."""
    meshes, contacts = {e.name: e for e in model.elements if e.tag == MESH}, []
    movement, joints = moved(model, {}), read_joints(model)
    menisci = [x for x in model.bodies if "menisc" in x.lower() and not knee.bone_of(x)]
    rigid = knee.rigid | {x: (x, knee.rigid[knee.tibia][1].after(movement.between(knee.tibia, x)))
                          for x in menisci}  # fmt: skip
    touching: dict[str, dict[str, tuple[Element, OsimMesh]]] = {x: {} for x in menisci}
    for force in model.elements:
        if force.tag != FORCE:
            continue
        pair: list[tuple[Element, Element]] = []
        for role in ("target", "casting"):
            tags = f"socket_{role}_mesh", f"socket_{role}_mesh_connectee_name"
            name = force.last_word(*tags)
            if name not in meshes:
                word = force.word(*tags) or "missing"
                raise force.problem(tags[0], word, f"a {MESH} of the model", meshes)
            mesh = settings = meshes[name]
            # Earlier versions of JAM keep the material with the force.
            if mesh.child("elastic_modulus") is None:
                held = force.xpath(f"{role}_mesh_contact_params[1]/"
                                   "descendant-or-self::*[elastic_modulus]")
                settings = next(iter(held), mesh)
            pair.append((mesh, settings))
        places = [model.socket(mesh, "frame") for mesh, _ in pair]
        bones = [rigid[body][0] if body in rigid else "" for body, _ in places]
        if not force.applied or "" in bones or len({*bones}) < 2:
            continue
        found = {
            bone: _mesh_of(mesh, settings, bone, rigid[body][1].after(frame))
            for (mesh, settings), bone, (body, frame) in zip(pair, bones, places, strict=True)}
        if {*found} in ({FEMUR, TIBIA}, {FEMUR, PATELLA}):
            contacts.append(_contact(force, found.pop(FEMUR), *found.values()))
        for body, bone in (bones, bones[::-1]):
            if body in touching and bone in (FEMUR, TIBIA):
                touching[body][bone] = force, found[body]
    rings = []
    for body, found in touching.items():
        if len(found) == 2:
            forces, (upper, lower) = zip(*(found[x] for x in (FEMUR, TIBIA)), strict=True)
            free = sum(not c.locked for j in joints if j.child == body for c in j.coordinates)
            thick = " and ".join(f"{x.layer.layer_thickness_mm:g}" for x in (upper, lower))
            said = (f"A ring stands for it and its {free} coordinates: meshes {upper.file} and "
                    f"{lower.file}, layers {thick} mm. The stiffness of its arc, horns and border "
                    "is not the model's: assumed.")
            rings.append(OsimMeniscus(body, upper, lower, _law(forces[0]), (said,), forces))
    return contacts, rings


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
        Layer(shifted(modulus, PASCAL_TO_MPA), float(ratio), shifted(thickness, METRES_TO_MM)),
        settings.truth("use_variable_thickness", False))


def _contact(force: Element, femur: OsimMesh, other: OsimMesh) -> OsimContact:
    law, pair, doubts = _law(force), (femur, other), []
    word = force.word(_FORMULATION, default="linear")
    findings = [f"Formulation {word}: the {law} law of kneejax."]
    for mesh in pair:
        modulus, ratio, thickness = mesh.layer
        reaches = "to its back mesh" if mesh.varies else f"{thickness:g} mm"
        findings.append(f"{mesh.bone}: mesh {mesh.name} ({mesh.file}), E {modulus:g} MPa, "
                        f"nu {ratio:g}, layer {reaches}.")
    layers = [mesh.layer for mesh in pair]
    sums = [sum(Decimal(repr(x)) for x in two) for two in zip(*layers, strict=True)]
    layer = Layer(float(sums[0] / 2), float(sums[1] / 2), float(sums[2]))
    same = femur.layer[:2] == other.layer[:2]
    if not same and force.truth("use_lumped_contact_model", True):
        findings.append("Lumped in the model too: the means of E and nu, the sum of the layers.")
    elif not same:
        if max(one.poisson_ratio for one in layers) < 0.5:
            modulus = _in_a_row(layers, layer.poisson_ratio)
            layer = layer._replace(youngs_modulus_MPa=modulus)
        findings.append("The layers are springs in series: E is that of one layer of both "
                        "thicknesses and the mean nu with the same pressure.")
        if law != "linear":
            doubts.append("The model solves two different materials pairwise; with the nonlinear "
                          "law the one layer agrees only at small depths.")
    if layer.poisson_ratio == 0.5:
        doubts.append("nu is 0.5: a layer that cannot change its volume has no elastic foundation, "
                      "and its contact must be given with a smaller nu.")
    return OsimContact(force.name, femur, other, law, layer, tuple(findings), tuple(doubts), force)


def _law(force: Element) -> str:
    word = force.word(_FORMULATION, default="linear")
    if word not in _LAWS:
        raise force.problem(_FORMULATION, word, f"one of {', '.join(_LAWS)}")
    return _LAWS[word]


def _in_a_row(layers: list[Layer], ratio: float) -> float:
    """Young's modulus of one layer that is as stiff as several together."""
    def confined(nu: float) -> float:  # modulus, over Young's
        return (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))

    soft = sum(h / (e * confined(nu)) for e, nu, h in layers)
    return sum(h for *_, h in layers) / soft / confined(ratio)


@dataclasses.dataclass(frozen=True)
class OsimGeometry:
    """Contacts of an imported knee."""

    document: dict[str, Any]  # the knee document with its contacts
    findings: tuple[str, ...]  # sentences about the fit
    doubtful: bool  # whether a surface misses its target


def add_osim_contacts(read: "OsimImport", folder: str | os.PathLike[str]) -> OsimGeometry:
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
        kneejax.files.reading._text.InputProblem: --geometry: folder: no-such-folder: expected
        a folder
        of meshes
    """
    folder, file = Path(folder), read.model.file.path
    if not folder.is_dir():
        raise InputProblem("--geometry", "folder", str(folder), "a folder of meshes")
    expected = "one contact of femur and tibia; use `kneejax import stl --knee knee.yaml ...`"
    contact, joint = _only(read.contacts, file, "contacts", expected), None
    if (ratio := contact.layer.poisson_ratio) >= 0.5:
        raise InputProblem(file, contact.name, f"nu {ratio}", "nu below 0.5")
    pair, material = (contact.femur, contact.other), dict[str, Any](contact.layer._asdict())
    if varies := any(mesh.varies for mesh in pair):
        material["layer_thickness_mm"] = None
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
        from kneejax.files.meshes.soft_tissues import meniscus_of_mesh

        options = MeshOptions(
            patellar_cartilage=_mesh(folder, joint.other, Path(scratch)) if joint else None,
            femur_bone=backs[0] if varies else None,
            tibia_bone=backs[1] if varies else None,
            thickness="field" if varies else "constant",
            law=contact.law,
            reference_pose=Pose.from_table(read.knee.pose),
            source=", ".join(mesh.file for mesh in pair),
            **material,
        )
        found = import_meshes(*sheets, side=SIDES[read.knee.side], options=options)
        document = copy.deepcopy(read.document)
        document["contacts"] = dict(found.contacts)
        menisci = [meniscus_of_mesh([*dict.fromkeys(_mesh(folder, mesh, Path(scratch)) for mesh in (
            one.upper, one.lower))], document) for one in read.menisci]  # fmt: skip
    stated = [field for field, value in material.items() if value is not None]
    for part in document["contacts"].values():
        part["source"] |= dict.fromkeys(stated, f"{file.name}, {contact.name}")
    if joint is not None and found.patellofemoral is not None:
        # Its material is the model's own, not that of femur and tibia.
        entry = found.patellofemoral | {"law": joint.law} | joint.layer._asdict()
        entry["source"] = dict.fromkeys(entry["source"], f"{file.name}, {joint.name}")
        document["patella"]["contacts"] = {"patellofemoral": entry}
    findings, name = [*found.findings], file.name
    for meniscus, fit in zip(read.menisci, menisci, strict=True):
        cartilage = found.contacts[fit.name.removesuffix("_meniscus")]["layer_thickness_mm"]
        layers = [contact.layer._replace(layer_thickness_mm=cartilage), meniscus.upper.layer,
                  meniscus.lower.layer]  # fmt: skip
        _, ratios, thick = zip(*layers, strict=True)
        if max(ratios) >= 0.5:
            raise InputProblem(file, meniscus.name, "nu 0.5", "nu below 0.5")
        ratio = float(np.mean(ratios))
        stated = Layer(_in_a_row(layers, ratio), ratio, sum(thick))._asdict()
        source = dict.fromkeys(stated, f"{name}, {meniscus.name} and both cartilages")
        document["contacts"][fit.name] = fit.contact | stated | {
            "law": meniscus.law, "source": fit.contact["source"] | source}
        findings += [*fit.findings, *fit.doubts]
    doubtful = found.doubtful or any(fit.doubts for fit in menisci)
    return OsimGeometry(document, tuple(findings), doubtful)


def _only(contacts: tuple[OsimContact, ...], file: Path, field: str, expected: str) -> OsimContact:
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
        expected = f"this file; there is {', '.join(sorted(by_lower)[:6]) or 'nothing'}"
        expected += "; --without-patella does without it" * (mesh.bone == PATELLA)
        known = sorted(path.name for path in by_lower.values())
        raise InputProblem(folder, f"mesh of {mesh.name}", name or "not named", expected, known)
    if mesh.scale == (1.0, 1.0, 1.0) and not mesh.frame.turns and not any(mesh.frame.shift):
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
