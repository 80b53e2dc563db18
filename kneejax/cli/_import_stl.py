"""`kneejax import stl --femur-cartilage F --tibia-cartilage F --side r|l`."""

from __future__ import annotations

import copy
from typing import Any

from kneejax.cli._main import DONE, DOUBTFUL
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import ImportStl
from kneejax.files import (
    InputProblem,
    MeshImport,
    import_meshes,
    load_knee_file,
    write_knee,
    write_rows,
    write_text,
)

_SIDES = {"r": "right", "l": "left"}
_TABLE = (
    "surface", "cells_along", "cells_across", "smoothing_mm", "points_in_region", "rms_mm",
    "max_mm", "mean_mm", "patch_mean_rms_mm", "patch_mean_max_mm", "whole_rms_mm",
    "held_out_rms_mm",
)  # fmt: skip


def run(arguments: ImportStl) -> int:
    """Fit contacts to meshes; write knee.yaml, fit_report.csv, fit_report.md and a figure."""
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
    write_rows(arguments.out / "fit_report.csv", list(_TABLE), _rows(found))
    write_text(arguments.out / "fit_report.md", _report(found))
    _figure(arguments, found)
    for finding in found.findings:
        print(finding)
    print(
        f"written: {arguments.out}/knee.yaml, fit_report.csv, fit_report.md, "
        "settings.json, figures/surface_fits.png"
    )
    if found.doubtful:
        print("doubtful: a surface misses its target; the report says which")
    return DOUBTFUL if found.doubtful else DONE


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


def _rows(found: MeshImport) -> list[list]:
    rows = []
    for name, part in found.fits.items():
        q = part.quality
        rows.append([
            name, *part.fit.cells, part.fit.smoothing_mm, int(part.region.sum()), q.rms, q.maximum,
            q.mean, q.patch_rms, q.patch_maximum, q.everywhere_rms, q.held_out_rms,
        ])  # fmt: skip
    return rows


def _report(found: MeshImport) -> str:
    lines = ["# Surfaces from meshes", "", "## What was found", ""]
    lines += [f"- {finding}" for finding in found.findings]
    lines += ["", "## What the fits leave over, mm", ""]
    lines += [f"| {' | '.join(_TABLE)} |", f"|{'---|' * len(_TABLE)}"]
    for row in _rows(found):
        words = [f"{x:.4f}" if isinstance(x, float) else str(x) for x in row]
        lines.append(f"| {' | '.join(words)} |")
    lines += [
        "",
        "rms, max and mean are normal distances of the mesh's corners in the contact region, "
        "weighted by the area that each stands for; patch means are formed over 5 mm; held-out "
        "distances are of corners that the fit did not see, 4 mm patches at a time.",
        "",
    ]
    return "\n".join(lines)


def _figure(arguments: ImportStl, found: MeshImport) -> None:
    from kneejax.report import save_figure, surface_fit_figure

    fits = {name: part.fit for name, part in found.fits.items()}
    regions = {name: part.region for name, part in found.fits.items()}
    folder = arguments.out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(surface_fit_figure(fits, regions), folder, "surface_fits", svg=arguments.svg)
