"""`kneejax import stl --femur-cartilage F --tibia-cartilage F --side r|l`."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any

from kneejax.cli._deliver import deliver
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import ImportStl
from kneejax.files import (
    InputProblem,
    MeshImport,
    import_meshes,
    load_knee_file,
    write_knee,
    write_text,
)
from kneejax.report import mesh_import_answer
from kneejax.report.look import Table

_SIDES = {"r": "right", "l": "left"}

def run(arguments: ImportStl) -> int:
    """Fit contacts to meshes, write the knee and how well its surfaces fit."""
    knee, pose = None, None
    if arguments.knee is not None:
        knee = load_knee_file(arguments.knee)
        pose = knee.knee.reference_pose
        if knee.document["side"] != _SIDES[arguments.side]:
            expected = f"{knee.document['side'][0]}, the side of {knee.path}"
            raise InputProblem("--side", "side", arguments.side, expected)
    with stages_on_terminal("surfaces and layers"):
        found = import_meshes(
            arguments.femur_cartilage,
            arguments.tibia_cartilage,
            side=arguments.side,
            patellar_cartilage=arguments.patella_cartilage,
            femur_bone=arguments.femur_bone,
            tibia_bone=arguments.tibia_bone,
            layer_thickness_mm=arguments.layer_thickness,
            thickness=arguments.thickness,
            youngs_modulus_MPa=arguments.modulus,
            poisson_ratio=arguments.poisson_ratio,
            law=arguments.law,
            unit=arguments.unit,
            axis_point_mm=arguments.axis_point,
            axis_rotation_deg=arguments.axis_rotation or (0.0, 0.0, 0.0),
            notch_mm=arguments.notch,
            split_mm=arguments.split,
            angle_deg=arguments.angle,
            reference_pose=pose,
        )
    document = _contacts_only(arguments, found) if knee is None else _replaced(knee, found)
    if found.patellofemoral is not None and "muscles" in document.get("patella", {}):
        document["patella"]["contacts"] = {"patellofemoral": found.patellofemoral}
    elif found.patellofemoral is not None:
        # Without ligaments and muscles there is no patella yet: its surface waits for them.
        document["surfaces"] = {"patella": found.patellofemoral["patellar_surface"]}
    write_knee(document, arguments.out / "knee.yaml")
    answer = mesh_import_answer(found.fits, found.findings, found.doubtful)
    report = _report(found.findings, answer.tables["fit_report"])
    write_text(arguments.out / "fit_report.md", report)
    return deliver(answer, arguments, ["knee.yaml", "fit_report.md"])


def _replaced(knee, found: MeshImport) -> dict[str, Any]:
    document = copy.deepcopy(knee.document)
    document["contacts"] = found.contacts
    return document


def _contacts_only(arguments: ImportStl, found: MeshImport) -> dict[str, Any]:
    files = f"{arguments.femur_cartilage.name} and {arguments.tibia_cartilage.name}"
    pose = {
        "flexion_deg": 0.0, "adduction_deg": 0.0, "internal_rotation_deg": 0.0,
        "anterior_mm": 0.0, "superior_mm": 0.0, "lateral_mm": 0.0,
        "source": "the pose of the meshes: both bones' frames coincide",
    }  # fmt: skip
    return {
        "kneejax": 1,
        "name": arguments.out.name or "imported",
        "side": _SIDES[arguments.side],
        "description": f"Contacts from {files}; no ligaments yet",
        "reference_pose": pose,
        "ligaments": {},
        "contacts": found.contacts,
    }


def _report(findings: Sequence[str], fits: Table) -> str:
    """The same in Markdown."""
    lines = ["# Surfaces from meshes", "", "## What was found", ""]
    lines += [f"- {finding}" for finding in findings]
    lines += ["", f"## {fits.title}", ""]
    lines += [f"| {' | '.join(fits.names)} |", f"|{'---|' * len(fits.names)}"]
    for row in fits.rows:
        words = [f"{x:.4f}" if isinstance(x, float) else str(x) for x in row]
        lines.append(f"| {' | '.join(words)} |")
    return "\n".join([*lines, "", fits.note, ""])
