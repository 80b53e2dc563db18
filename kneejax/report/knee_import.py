"""Knees made from an OpenSim model or from meshes: what was read and how well surfaces fit."""

__all__ = ["surface_fit_figure"]

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.geometry import Condyle, SurfaceFit
from kneejax.report.look.colours import GREY
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.style import Figure, styled
from kneejax.report.look.tables import Column, Table
from kneejax.report.panels import grid


@styled
def surface_fit_figure(
    fits: Mapping[str, SurfaceFit], regions: Mapping[str, np.ndarray] | None = None
) -> Figure:
    """Residual of surface fits at the points that were fitted.

    Condyles are unrolled: angle from anterior over width. Plateaus are seen from above, a patella
    from the front.

    Args:
        fits: title -> fit; one panel each.
        regions: title -> mask of the fit's points in the contact region. Titles state the
            residual there, points elsewhere are drawn faintly. Everywhere by default.

    Returns:
        The figure, on one scale of colours that ends at the largest 98th percentile of a panel.
        Points beyond it are ringed; the largest residual stands in the title.
    """
    inside = {title: np.ones(len(fit.points), bool) for title, fit in fits.items()}
    inside |= {title: np.asarray(here, bool) for title, here in (regions or {}).items()}
    ends = [np.quantile(np.abs(fit.residual[inside[title]]), 0.98) for title, fit in fits.items()]
    limit = float(max(ends, default=0.0)) or 1.0
    colours = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "linewidths": 0}
    columns = min(len(fits), 2)
    rows = -(-len(fits) // columns)
    figure, panels = grid(rows, columns, 3.2 * rows, width=3.6 * columns, constrained=True)
    for axes in panels.flat[len(fits) :]:
        axes.remove()
    for axes, (title, fit) in zip(panels.flat, fits.items(), strict=False):
        here, placement = inside[title], fit.surface.frame.placement
        residual = fit.residual[here]
        axes.grid(False)
        if isinstance(fit.surface, Condyle):
            local = placement.apply_inverse(tuple(fit.points.T))
            x, y, across = (np.broadcast_to(np.asarray(c), len(fit.points)) for c in local)
            along = np.rad2deg(0.5 * np.pi - np.arctan2(x, -y))
            axes.set(xlabel="along the axis, mm", ylabel="angle from anterior, degrees")
            axes.invert_yaxis()  # anterior is up, as on a plateau
        else:
            # Upwards is the axis of the bone that the surface's own X is nearest to.
            own = placement.turn((1.0, 0.0, 0.0))
            up = int(abs(float(own[1])) > abs(float(own[0])))
            across, along = fit.points[:, 2], fit.points[:, up]
            axes.set(xlabel="lateral, mm", ylabel=("anterior, mm", "superior, mm")[up],
                     aspect="equal")  # fmt: skip
        if not here.all():
            axes.scatter(across[~here], along[~here], c=GREY, s=1.5, alpha=0.35, linewidths=0)
        # Thousands of points are one picture inside the SVG, which keeps the file small.
        dots = axes.scatter(across[here], along[here], c=residual, s=4,
                            rasterized=len(residual) > 2000, **colours)  # fmt: skip
        far = np.abs(residual) > limit
        axes.scatter(across[here][far], along[here][far], c=residual[far], s=14,
                     **{**colours, "linewidths": 0.5}, edgecolors="black")  # fmt: skip
        rms = float(np.sqrt(np.average(residual**2, weights=fit.weights[here])))
        digits, largest = 3 if rms < 0.1 else 2, float(np.abs(residual).max())
        axes.set_title(f"{title}\n{rms:.{digits}f} mm rms, {largest:.2f} mm at most")
    bar = figure.colorbar(dots, ax=figure.axes, shrink=0.6, aspect=30, extend="both")
    bar.set_label("distance outside the fit, mm (ringed: beyond the scale)")
    return figure


#: Columns of fit_report.csv that people read, with heading and digits.
_SHOWN = {"surface": (), "rms_mm": ("rms, mm", ".3f"), "max_mm": ("at most, mm", ".3f"),
          "patch_mean_max_mm": ("worst patch, mm", ".3f"),
          "held_out_rms_mm": ("held out, mm", ".3f")}  # fmt: skip
#: Columns of it -> how well a surface fits.
_QUALITY = {"rms_mm": "rms", "max_mm": "maximum", "mean_mm": "mean",
            "patch_mean_rms_mm": "patch_rms", "patch_mean_max_mm": "patch_maximum",
            "whole_rms_mm": "everywhere_rms", "held_out_rms_mm": "held_out_rms"}  # fmt: skip
_MISSED = "doubtful: a surface misses its target; the report says which"


def mesh_import_answer(fits: Mapping[str, Any], findings: Sequence[str], doubtful: bool) -> Answer:
    """Contacts from meshes of cartilage (`kneejax.files.MeshImport.fits`), and what was found."""
    table = Table.of({
        "surface": [*fits],
        ("cells_along", "cells_across"): [part.fit.cells for part in fits.values()],
        "smoothing_mm": [part.fit.smoothing_mm for part in fits.values()],
        "points_in_region": [int(part.region.sum()) for part in fits.values()],
        **{column: [getattr(part.quality, own) for part in fits.values()]
           for column, own in _QUALITY.items()},
    }, "What the fits leave over, mm", prose("fit_report"), show=_SHOWN)  # fmt: skip
    worst = max(fits, key=lambda name: fits[name].quality.rms)
    return Answer(
        title="Surfaces from meshes",
        asked=f"How closely smooth surfaces follow {len(fits)} surfaces of cartilage.",
        sentence=prose("mesh_import", worst=worst, off=fits[worst].quality),
        tables={"fit_report": table}, main=["fit_report"],
        drawings={"surface_fits": Drawing(surface_fit_figure,
                                          {name: part.fit for name, part in fits.items()},
                                          {name: part.region for name, part in fits.items()})},
        doubts=[_MISSED] if doubtful else [], sections=[Section("What was found", findings)],
        text=findings,
    )


def meniscus_import_answer(found: Any, replaced: bool) -> Answer:
    """A meniscus's mesh, a `kneejax.files.MeshMeniscus`, as a contact with a ring."""
    name, ring, quality = found.name.replace("_", " "), found.contact["ring"], found.fit.quality
    columns = {x: getattr(found, x)
               for x in ("angle_deg", "inner_mm", "outer_mm", "height_mm", "area_mm2")}  # fmt: skip
    answer = mesh_import_answer({name: found.fit}, found.findings, bool(found.doubts))
    return dataclasses.replace(
        answer,
        title=f"{name.capitalize()}, from its mesh",
        asked="Where a meniscus lies on its plateau, and what holds it from horn to horn.",
        sentence=prose("meniscus_import", ring=ring, high=found.height_mm.mean(), quality=quality,
                       replaced="; it replaces the one there was" * replaced),
        tables={**answer.tables, "sections": Table.of(columns, "Sections through the middle")},
        sections=[*answer.sections, Section("Sections", [], ["sections"])],
        doubts=[*found.doubts],
    )


def band_import_answer(
    name: str, band: Any, modulus_MPa: float, fibres: int, replaced: Sequence[str]
) -> Answer:
    """A ligament's mesh, a `kneejax.files.MeshBand`, as a band, in the place of fibres."""
    rows = []
    for bone, area in (("femur", band.femoral), ("tibia", band.tibial)):
        half = np.linalg.svd(np.asarray(area.half_axes), compute_uv=False)
        rows.append([bone, *np.asarray(area.centre), *half[:2], np.pi * half[0] * half[1]])
    lengths = ("anterior_mm", "superior_mm", "lateral_mm", "half_length_mm", "half_width_mm")
    columns = [Column(name, show=".1f") for name in lengths]
    areas = Table(["bone", *columns, Column("area_mm2", show=".0f")], rows,
                  "Where it is attached, in each bone's frame")  # fmt: skip
    sections = Table.of({"along_mm": band.along_mm, "area_mm2": band.areas_mm2},
                        "Cross-sections, from the femur")  # fmt: skip
    place = f", in place of {', '.join(replaced)}"
    return Answer(
        title=f"{name}, from its mesh",
        asked="Where a ligament's mesh touches femur and tibia, and how thick it is.",
        sentence=prose("band_import", band=band, fibres=fibres, place=place if replaced else "",
                       stiffness=modulus_MPa * band.area_mm2, least=band.areas_mm2.min(),
                       most=band.areas_mm2.max()),
        tables={"areas": areas, "cross_sections": sections}, main=["areas"],
        sections=[Section("Cross-sections", [], ["cross_sections"])],
    )  # fmt: skip


def osim_import_answer(
    name: str, said: Sequence[str], sections: Mapping[str, Sequence[str]],
    ligaments: Mapping[str, Mapping[str, Any]], doubts: Sequence[str], *, missed: bool = False,
) -> Answer:
    """A knee from an OpenSim model; `missed`: a surface misses its target."""
    columns = [Column("fibre", words=True), "points", Column("wrap", "wrap object", words=True),
               "stiffness_N", "slack_length_mm", Column("transition_strain", "transition")]
    rows = [
        [fibre, 2 + len(x.get("via_points", ())), x.get("wrap", ""), x["stiffness_N"],
         x["slack_length_mm"], x["transition_strain"]]
        for fibre, x in ligaments.items()
    ]  # fmt: skip
    missing = [_MISSED] * (missed and not doubts)
    return Answer(
        title=f"Import of {name}",
        asked="What of an OpenSim model became a knee, what was left out, and what was not read.",
        sentence=" ".join(f"{x}." for x in said[:2]), main=[Table(columns, rows, "Ligaments read")],
        doubts=[*doubts, *missing],
        sections=[Section(title, [*text] or ["None."]) for title, text in sections.items()
                  if title != "Not supported"],
        text=said,
    )  # fmt: skip
