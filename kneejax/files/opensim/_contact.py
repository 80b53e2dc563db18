"""Contact settings of OpenSim JAM, as one layer between femur and tibia."""

from __future__ import annotations

import dataclasses
from decimal import Decimal
from pathlib import PurePosixPath, PureWindowsPath

from kneejax.files.opensim._knee import OsimKneeJoint
from kneejax.files.opensim._model import Model, Offset
from kneejax.files.opensim._numbers import METRES_TO_MM, PASCAL_TO_MPA, shifted
from kneejax.files.opensim._xml import Element
from kneejax.geometry import FEMUR, PATELLA, TIBIA

FORCE = "Smith2018ArticularContactForce"
MESH = "Smith2018ContactMesh"
_LAWS = {"linear": "linear", "nonlinear": "log"}


@dataclasses.dataclass(frozen=True)
class OsimMesh:
    """A contact mesh.

    Attributes:
        name: of the element.
        bone: `femur`, `tibia` or `patella`.
        file: name of the surface's file, without folders.
        back_file: likewise of its back; empty if none is named.
        frame: from the mesh's coordinates to the bone's.
        scale: factors of the vertices along x, y, z.
        youngs_modulus_MPa: of its layer.
        poisson_ratio: of its layer.
        thickness_mm: of its layer, where it does not vary.
        varies: whether the layer reaches from the surface to its back.
    """

    name: str
    bone: str
    file: str
    back_file: str
    frame: Offset
    scale: tuple[float, float, float]
    youngs_modulus_MPa: float
    poisson_ratio: float
    thickness_mm: float
    varies: bool

    @property
    def moved(self) -> bool:
        """Whether the file's vertices are not already in the bone's frame."""
        still = self.frame.rotation is None and not any(self.frame.translation)
        return not still or self.scale != (1.0, 1.0, 1.0)


@dataclasses.dataclass(frozen=True)
class OsimContact:
    """A contact of the femur with the tibia or the patella.

    Attributes:
        name: of the force.
        femur: the femur's mesh.
        other: the other bone's mesh.
        law: of `kneejax.mechanics.cartilage_law`.
        youngs_modulus_MPa: of the one layer that stands for both.
        poisson_ratio: likewise.
        layer_thickness_mm: both together.
        findings: what was taken from where.
        doubts: where the one layer is not the model's.
        element: the force in the file.
    """

    name: str
    femur: OsimMesh
    other: OsimMesh
    law: str
    youngs_modulus_MPa: float
    poisson_ratio: float
    layer_thickness_mm: float
    findings: tuple[str, ...]
    doubts: tuple[str, ...]
    element: Element


def find_contacts(model: Model, knee: OsimKneeJoint) -> list[OsimContact]:
    """Contacts between the knee's bones.

    Args:
        model: the model.
        knee: its bones.

    Raises:
        InputProblem: a contact names a mesh that does not exist, or numbers are none.
    """
    forces = [e for e in model.elements() if e.tag == FORCE]
    meshes = {e.name: e for e in model.elements() if e.tag == MESH}
    contacts = []
    for force in forces:
        pair = [_mesh(model, force, role, meshes) for role in ("target", "casting")]
        bodies = [model.socket(mesh, "frame") for mesh, _ in pair]
        bones = [knee.rigid.get(body, ("", Offset()))[0] for body, _ in bodies]
        if model.applied(force) and set(bones) in ({FEMUR, TIBIA}, {FEMUR, PATELLA}):
            found = {
                bone: _read(model, mesh, settings, knee, bone, place)
                for (mesh, settings), bone, place in zip(pair, bones, bodies, strict=True)
            }
            second = TIBIA if TIBIA in found else PATELLA
            contacts.append(_contact(model, force, found[FEMUR], found[second]))
    return contacts


def _mesh(
    model: Model, force: Element, role: str, meshes: dict[str, Element]
) -> tuple[Element, Element]:
    """The mesh of a role, and the element that holds its material."""
    tag = f"socket_{role}_mesh"
    word = force.word(tag, f"{tag}_connectee_name")
    name = word.rstrip("/").rsplit("/", 1)[-1]
    if name not in meshes:
        raise model.file.problem(force, tag, word or "missing", f"a {MESH} of the model", meshes)
    # Earlier versions of JAM keep the material with the force.
    held = next((c for c in force.children if c.tag == f"{role}_mesh_contact_params"), None)
    if held is not None and meshes[name].child("elastic_modulus") is None:
        inner = next((e for e in held.walk() if e.child("elastic_modulus") is not None), None)
        return meshes[name], meshes[name] if inner is None else inner
    return meshes[name], meshes[name]


def _read(
    model: Model, mesh: Element, settings: Element, knee: OsimKneeJoint, bone: str, place
) -> OsimMesh:
    body, frame = place
    own = Offset.of(model.point(mesh, "location"), model.point(mesh, "orientation"))
    scale = tuple(float(x) for x in model.numbers(mesh, "scale_factors", 3, "1 1 1"))
    modulus = model.numbers(settings, "elastic_modulus", 1, "1000000")[0]
    ratio = model.numbers(settings, "poissons_ratio", 1, "0.5")[0]
    thickness = model.numbers(settings, "thickness", 1, "0.005")[0]
    for tag, value in (("elastic_modulus", modulus), ("thickness", thickness)):
        if value <= 0:
            raise model.file.problem(settings, tag, settings.word(tag), "a number above 0")
    if not 0 <= ratio <= Decimal("0.5"):
        word = settings.word("poissons_ratio")
        raise model.file.problem(settings, "poissons_ratio", word, "a ratio from 0 to 0.5")
    return OsimMesh(
        mesh.name,
        bone,
        _file_name(mesh.word("mesh_file", "filename")),
        _file_name(mesh.word("mesh_back_file")),
        knee.rigid[body][1].after(frame).after(own),
        scale,
        shifted(modulus, PASCAL_TO_MPA),
        float(ratio),
        shifted(thickness, METRES_TO_MM),
        model.truth(settings, "use_variable_thickness", False),
    )


def _contact(model: Model, force: Element, femur: OsimMesh, other: OsimMesh) -> OsimContact:
    word = force.word("elastic_foundation_formulation", default="linear")
    if word not in _LAWS:
        tag = "elastic_foundation_formulation"
        raise model.file.problem(force, tag, word, f"one of {', '.join(_LAWS)}")
    law, pair = _LAWS[word], (femur, other)
    findings = [f"Formulation {word}: the {law} law of kneejax."]
    doubts = []
    for mesh in pair:
        layer = "to its back mesh" if mesh.varies else f"{mesh.thickness_mm:g} mm"
        findings.append(
            f"{mesh.bone}: mesh {mesh.name} ({mesh.file}), E {mesh.youngs_modulus_MPa:g} MPa, "
            f"nu {mesh.poisson_ratio:g}, layer {layer}."
        )
    thickness = float(sum(Decimal(repr(mesh.thickness_mm)) for mesh in pair))
    moduli = [mesh.youngs_modulus_MPa for mesh in pair]
    ratio = float(sum(Decimal(repr(mesh.poisson_ratio)) for mesh in pair) / 2)
    same = moduli[0] == moduli[1] and femur.poisson_ratio == other.poisson_ratio
    modulus = float(sum(Decimal(repr(x)) for x in moduli) / 2)
    if not same and model.truth(force, "use_lumped_contact_model", True):
        findings.append("Lumped in the model too: the means of E and nu, the sum of the layers.")
    elif not same:
        if max(m.poisson_ratio for m in pair) < 0.5:
            modulus = _in_series(femur, other, thickness, ratio)
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
    return OsimContact(
        force.name, femur, other, law, modulus, ratio, thickness, tuple(findings), tuple(doubts),
        force,
    )  # fmt: skip


def _in_series(femur: OsimMesh, other: OsimMesh, thickness: float, ratio: float) -> float:
    """Young's modulus of one layer that is as stiff as both in a row."""

    def stiffer(nu: float) -> float:
        return (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))

    soft = sum(
        mesh.thickness_mm / (mesh.youngs_modulus_MPa * stiffer(mesh.poisson_ratio))
        for mesh in (femur, other)
    )
    return thickness / soft / stiffer(ratio)


def _file_name(word: str) -> str:
    return PurePosixPath(PureWindowsPath(word).as_posix()).name
