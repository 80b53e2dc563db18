"""Surfaces for an imported knee, fitted to the meshes that the OpenSim model names."""

from __future__ import annotations

import copy
import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files._opensim_contact import OsimContact, OsimMesh
from kneejax.files._opensim_import import OsimImport
from kneejax.files._opensim_knee import SIDES
from kneejax.files._problem import InputProblem


def add_osim_contacts(
    read: OsimImport, folder: str | os.PathLike[str]
) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Fit the contacts of an imported knee to the model's meshes.

    Args:
        read: what a model gave.
        folder: where its meshes are.

    Returns:
        The knee document with contacts, and sentences about the fit.

    Raises:
        InputProblem: the model has not exactly one contact of femur and tibia, a mesh is not in
            the folder, or it cannot be fitted.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputProblem("--geometry", "folder", str(folder), "a folder of meshes")
    names = ", ".join(contact.name for contact in read.contacts)
    if len(read.contacts) != 1:
        expected = "one contact of femur and tibia; use `kneejax import stl --knee knee.yaml ...`"
        raise InputProblem(read.model.file.path, "contacts", names or "none", expected)
    contact = read.contacts[0]
    if contact.poisson_ratio >= 0.5:
        raise InputProblem(
            read.model.file.path, contact.name, f"nu {contact.poisson_ratio}", "nu below 0.5"
        )
    with tempfile.TemporaryDirectory() as scratch:
        paths = {mesh.bone: _mesh(folder, mesh, Path(scratch)) for mesh in _pair(contact)}
        backs = {
            f"{mesh.bone}_bone": _mesh(folder, mesh, Path(scratch), back=True)
            for mesh in _pair(contact)
            if mesh.varies and all(m.varies for m in _pair(contact))
        }
        from kneejax.files import import_meshes

        found = import_meshes(
            paths["femur"],
            paths["tibia"],
            side=SIDES[read.knee.side],
            youngs_modulus_MPa=contact.youngs_modulus_MPa,
            poisson_ratio=contact.poisson_ratio,
            layer_thickness_mm=contact.layer_thickness_mm,
            law=contact.law,
            **backs,
        )
    document = copy.deepcopy(read.document)
    document["contacts"] = dict(found.contacts)
    return document, tuple(found.findings)


def _pair(contact: OsimContact) -> tuple[OsimMesh, OsimMesh]:
    return contact.femur, contact.tibia


def _mesh(folder: Path, mesh: OsimMesh, scratch: Path, back: bool = False) -> Path:
    """The file of a mesh with its vertices in the bone's frame."""
    name = mesh.back_file if back else mesh.file
    by_lower = {path.name.lower(): path for path in sorted(folder.iterdir())}
    path = by_lower.get(name.lower())
    if path is None:
        present = ", ".join(sorted(by_lower)[:6]) or "nothing"
        raise InputProblem(
            folder, f"mesh of {mesh.name}", name or "not named", f"this file; there is {present}",
            sorted(path.name for path in by_lower.values()),
        )  # fmt: skip
    if not mesh.moved:
        return path
    import trimesh

    loaded = trimesh.load_mesh(path)
    size = float(np.max(np.ptp(loaded.vertices, axis=0)))
    unit = 1e3 if size > 1.0 else 1.0  # a knee's cartilage is centimetres wide: mm or m
    scaled = np.asarray(loaded.vertices) * np.asarray(mesh.scale)
    shift = np.asarray(mesh.frame.translation, float) * unit
    loaded.vertices = scaled @ mesh.frame.matrix.T + shift
    moved = scratch / f"{'back' if back else 'front'}-{mesh.bone}.stl"
    loaded.export(moved)
    return moved
