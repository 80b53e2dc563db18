"""Surfaces for an imported knee, fitted to the meshes that the OpenSim model names."""

from __future__ import annotations

import copy
import dataclasses
import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.files.opensim._contact import OsimContact, OsimMesh
from kneejax.files.opensim._import import OsimImport
from kneejax.files.opensim._knee import SIDES
from kneejax.files.reading import InputProblem
from kneejax.geometry import PATELLA, Pose

if TYPE_CHECKING:
    from kneejax.files.meshes import MeshImport

_THICKNESS = ("layer_thickness_mm",)


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
    folder = Path(folder)
    if not folder.is_dir():
        raise InputProblem("--geometry", "folder", str(folder), "a folder of meshes")
    contact = _tibiofemoral(read)
    pair = (contact.femur, contact.other)
    varies = any(mesh.varies for mesh in pair)
    patella = _patellar_mesh(read, contact)
    with tempfile.TemporaryDirectory() as scratch:
        sheets = [_mesh(folder, mesh, Path(scratch)) for mesh in pair]
        backs = [_mesh(folder, mesh, Path(scratch), back=True) for mesh in pair if varies]
        from kneejax.files.meshes import import_meshes  # takes a while, and few need it

        found = import_meshes(
            *sheets,
            side=SIDES[read.knee.side],
            patellar_cartilage=None if patella is None else _mesh(folder, patella, Path(scratch)),
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
    document = _with_contacts(read, contact, found, () if varies else _THICKNESS)
    return OsimGeometry(document, tuple(found.findings), found.doubtful)


def _tibiofemoral(read: OsimImport) -> OsimContact:
    """The only contact of femur and tibia, of a cartilage that can be fitted."""
    path, names = read.model.file.path, ", ".join(contact.name for contact in read.contacts)
    if len(read.contacts) != 1:
        expected = "one contact of femur and tibia; use `kneejax import stl --knee knee.yaml ...`"
        raise InputProblem(path, "contacts", names or "none", expected)
    contact = read.contacts[0]
    if contact.poisson_ratio >= 0.5:
        raise InputProblem(path, contact.name, f"nu {contact.poisson_ratio}", "nu below 0.5")
    return contact


def _with_contacts(
    read: OsimImport, contact: OsimContact, found: MeshImport, thickness: tuple[str, ...]
) -> dict[str, Any]:
    """The knee document with contacts, whose materials are the model's."""
    document = copy.deepcopy(read.document)
    document["contacts"], model = dict(found.contacts), read.model.file.path.name
    for part in document["contacts"].values():
        fields = ("youngs_modulus_MPa", "poisson_ratio", *thickness)
        said = {field: f"{model}, {contact.name}" for field in fields}
        part["source"] = part["source"] | said
    if found.patellofemoral is not None:
        joint = read.patellofemoral[0]
        own = found.patellofemoral | {
            "law": joint.law,
            "youngs_modulus_MPa": joint.youngs_modulus_MPa,
            "poisson_ratio": joint.poisson_ratio,
            "layer_thickness_mm": joint.layer_thickness_mm,
        }
        own["source"] = dict.fromkeys(own["source"], f"{model}, {joint.name}")
        document["patella"]["contacts"] = {"patellofemoral": own}
    return document


def _patellar_mesh(read: OsimImport, contact: OsimContact) -> OsimMesh | None:
    """The patella's mesh, where the model has a patella with one contact on the same femur."""
    if "patella" not in read.document:
        return None
    file, found = read.model.file.path, read.patellofemoral
    names = ", ".join(one.name for one in found) or "none"
    expected = "one contact of femur and patella, or --without-patella"
    if len(found) != 1:
        raise InputProblem(file, "contacts of the patella", names, expected)
    if found[0].femur.file != contact.femur.file:
        expected = f"the femur's mesh of {contact.name}, {contact.femur.file}"
        raise InputProblem(file, found[0].name, found[0].femur.file, expected)
    return found[0].other


def _mesh(folder: Path, mesh: OsimMesh, scratch: Path, back: bool = False) -> Path:
    """The file of a mesh with its vertices in the bone's frame."""
    name = mesh.back_file if back else mesh.file
    by_lower = {path.name.lower(): path for path in sorted(folder.iterdir())}
    path = by_lower.get(name.lower())
    if path is None:
        present = ", ".join(sorted(by_lower)[:6]) or "nothing"
        without = "; --without-patella does without it" if mesh.bone == PATELLA else ""
        expected = f"this file; there is {present}{without}"
        raise InputProblem(
            folder, f"mesh of {mesh.name}", name or "not named", expected,
            sorted(path.name for path in by_lower.values()),
        )  # fmt: skip
    if not mesh.moved:
        return path
    import trimesh

    loaded = trimesh.load_mesh(path)
    scaled = np.asarray(loaded.vertices) * np.asarray(mesh.scale)
    size = float(np.max(np.ptp(scaled, axis=0)))
    unit = 1e3 if size > 1.0 else 1.0  # a knee's cartilage is centimetres wide: mm or m
    shift = np.asarray(mesh.frame.translation, float) * unit
    loaded.vertices = scaled @ mesh.frame.matrix.T + shift
    # What is said about it names the file that a person knows.
    moved = scratch / mesh.bone / ("back" if back else "front") / f"{path.stem}.stl"
    moved.parent.mkdir(parents=True, exist_ok=True)
    loaded.export(moved)
    return moved
