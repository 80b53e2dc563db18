"""Knees made from an OpenSim model or from meshes: what was read and how well surfaces fit."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

from kneejax.report.knee._surface_figure import surface_fit_figure
from kneejax.report.look import Answer, Column, Drawing, Section, Table, Verdict
from kneejax.report.motion import digits

#: Columns of fit_report.csv; headings and digits of those that people read.
_FITS = (
    "surface", "cells_along", "cells_across", "smoothing_mm", "points_in_region", "rms_mm",
    "max_mm", "mean_mm", "patch_mean_rms_mm", "patch_mean_max_mm", "whole_rms_mm",
    "held_out_rms_mm",
)  # fmt: skip
_SHOWN = {
    "rms_mm": "rms, mm", "max_mm": "at most, mm", "patch_mean_max_mm": "worst patch, mm",
    "held_out_rms_mm": "held out, mm",
}  # fmt: skip
_FIT_NOTE = (
    "rms, max and mean are normal distances of the mesh's corners in the contact region, weighted "
    "by the area that each stands for; patch means are formed over 5 mm; held-out distances are of "
    "corners that the fit did not see, 4 mm patches at a time."
)
_MISSED = "doubtful: a surface misses its target; the report says which"


def mesh_import_answer(fits: Mapping[str, Any], findings: Sequence[str], doubtful: bool) -> Answer:
    """Contacts from meshes of cartilage.

    Args:
        fits: surface -> its fit, region and quality (`kneejax.files.MeshImport.fits`).
        findings: sentences on what was found.
        doubtful: whether a surface misses its target.

    Returns:
        The answer; its table is fit_report.
    """
    rows = []
    for name, part in fits.items():
        q = part.quality
        rows.append([
            name, *part.fit.cells, part.fit.smoothing_mm, int(part.region.sum()), q.rms, q.maximum,
            q.mean, q.patch_rms, q.patch_maximum, q.everywhere_rms, q.held_out_rms,
        ])  # fmt: skip
    columns = [
        Column(x, _SHOWN.get(x, ""), digits(3) if x in _SHOWN else None, words=x == "surface",
               shown=x in _SHOWN or x == "surface")
        for x in _FITS
    ]  # fmt: skip
    worst = max(rows, key=lambda row: row[5])
    return Answer(
        title="Surfaces from meshes",
        asked=f"How closely smooth surfaces follow {len(rows)} surfaces of cartilage.",
        verdict=Verdict.DOUBTFUL if doubtful else Verdict.GOOD,
        sentence=f"The worst, {worst[0]}, is {worst[5]:.3f} mm rms off its mesh in the contact "
        f"region and {worst[6]:.2f} mm at most.",
        tables={"fit_report": Table(columns, rows, "What the fits leave over, mm", _FIT_NOTE)},
        main=["fit_report"],
        drawings={
            "surface_fits": Drawing(
                functools.partial(
                    surface_fit_figure,
                    {name: part.fit for name, part in fits.items()},
                    {name: part.region for name, part in fits.items()},
                ),
                "Distance of the mesh from its surface; condyles are unrolled.",
            )
        },
        picture="surface_fits",
        doubts=[_MISSED] if doubtful else [],
        sections=[Section("What was found", findings)],
        text="\n".join([*findings, *[_MISSED] * doubtful]),
        exit_status=int(doubtful),
    )


def osim_import_answer(
    name: str,
    said: Sequence[str],
    sections: Mapping[str, Sequence[str]],
    ligaments: Mapping[str, Mapping[str, Any]],
    doubts: Sequence[str],
    *,
    missed: bool = False,
) -> Answer:
    """A knee from an OpenSim model.

    Args:
        name: of the model.
        said: sentences for the terminal: what was taken as what, how much was read.
        sections: of the import report: title -> sentences.
        ligaments: of the knee file: fibre -> entry.
        doubts: what is not supported or was left out though it acts on the knee.
        missed: whether a surface misses its target.
    """
    columns = [
        Column("fibre", words=True), Column("points", show=str),
        Column("wrap", "wrap object", words=True), Column("stiffness_N", "stiffness, N"),
        Column("slack_length_mm", "slack length, mm"), Column("transition_strain", "transition"),
    ]  # fmt: skip
    rows = [
        [fibre, 2 + len(x.get("via_points", ())), x.get("wrap", ""), x["stiffness_N"],
         x["slack_length_mm"], x["transition_strain"]]
        for fibre, x in ligaments.items()
    ]  # fmt: skip
    missing = [_MISSED] * (missed and not doubts)
    return Answer(
        title=f"Import of {name}",
        asked="What of an OpenSim model became a knee, what was left out, and what was not read.",
        verdict=Verdict.DOUBTFUL if doubts or missed else Verdict.GOOD,
        sentence=" ".join(f"{x}." for x in said[:2]),
        main=[Table(columns, rows, "Ligaments read")],
        doubts=[*doubts, *missing],
        sections=[
            Section(title, [*text] or ["None."])
            for title, text in sections.items() if title != "Not supported"
        ],
        text="\n".join([*said, *(f"doubtful: {x}" for x in doubts), *missing]),
        exit_status=int(bool(doubts) or missed),
    )  # fmt: skip
