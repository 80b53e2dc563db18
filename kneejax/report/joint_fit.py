"""A moving axis and a hinge that were fitted to poses, as an answer."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import versions
from kneejax.joints import CondyleAxes, Joint, JointFit
from kneejax.report.look import colours
from kneejax.report.look.colours import BLACK, BLUE, GREEN, GREY, LIGHT, PURPLE, VERMILLION
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.style import WIDTH, Figure, styled, verbatim
from kneejax.report.look.tables import Column, Table
from kneejax.report.panels import coordinate_panels, figure_legend, grid, part_legend
from kneejax.report.pose_tables import along, pose_columns
from kneejax.statics import Status

_MOST_POINTS = 4000
_MARGIN_MM = 30.0
#: Ends of the moving axis, and the hinge's.
_EXTENSION, _FLEXION, _HINGE = VERMILLION, BLUE, GREEN
_SHADES = {"extension": colours.ORANGE, "flexion": colours.SKY}
_CURVES = (VERMILLION, GREEN, PURPLE, BLUE)
# Coordinates seen along the lateral, the anterior and the superior direction.
_VIEWS = (("from the side", 0, 1, "anterior, mm", "superior, mm"),
          ("from behind", 2, 1, "lateral, mm", "superior, mm"),
          ("from above", 2, 0, "lateral, mm", "anterior, mm"))  # fmt: skip


@styled
def joint_axes_figure(
    moving: Joint, hinge: Joint, points: ArrayLike | None, axes: CondyleAxes | None
) -> Figure:
    """The axes of a joint in the femur, seen from three sides."""
    cloud = np.zeros((0, 3)) if points is None else np.asarray(points, float)
    # All axis points, and of the femur what lies near them.
    shown = np.concatenate([np.asarray(one.femoral).reshape(-1, 3) for one in (moving, hinge)])
    low, high = shown.min(axis=0) - 8.0, shown.max(axis=0) + 8.0
    near = cloud[(np.abs(cloud - 0.5 * (low + high)) < 0.5 * (high - low) + _MARGIN_MM).all(axis=1)]
    low = np.minimum(low, near.min(axis=0, initial=np.inf) - 3.0)
    high = np.maximum(high, near.max(axis=0, initial=-np.inf) + 3.0)
    span = high - low
    widths = [span[across] for _, across, *_ in _VIEWS]
    height = 1.1 + (WIDTH - 1.5) * max(span[up] for _, _, up, *_ in _VIEWS) / sum(widths)
    figure, (panels,) = grid(1, 3, height, constrained=True, width_ratios=widths)
    degrees, lines = np.rad2deg(np.asarray(moving.flexion)), np.asarray(moving.femoral)
    angles = np.deg2rad(np.linspace(degrees[0], degrees[-1], 31))
    between = np.asarray(moving.axis_points(angles)[0])
    handles: dict[str, object] = {}
    for panel, (title, across, up, *labels) in zip(panels, _VIEWS, strict=True):
        if len(cloud):
            some = cloud[:: max(1, len(cloud) // _MOST_POINTS)]
            style = {"linestyle": "none", "marker": "o", "markeredgewidth": 0, "rasterized": True}
            panel.plot(some[:, across], some[:, up], color="#C9CDD2", markersize=1.1, **style)
            for facet in axes.facets if axes is not None else ():
                part, color = cloud[facet.rows], _SHADES[facet.name]
                panel.plot(part[:, across], part[:, up], color=color, markersize=1.6, alpha=0.6,
                           **style)  # fmt: skip
                if (label := f"{facet.name} facets") not in handles:
                    (handles[label],) = panel.plot([], [], "o", color=color, markersize=4)
        if axes is not None and across == 0:
            # Cylinders seen along the transverse axis: medial solid, lateral dotted.
            turn = np.linspace(0.0, 2.0 * np.pi, 181)
            for facet in axes.facets:
                c, r = facet.center, facet.cylinder.radius
                color = _EXTENSION if facet.name == "extension" else _FLEXION
                dashes = "-" if facet.side == "medial" else ":"
                style = {"color": color, "linewidth": 0.6, "linestyle": dashes, "alpha": 0.8}
                panel.plot(c[0] + r * np.cos(turn), c[1] + r * np.sin(turn), **style)
        panel.plot(between[:, across].T, between[:, up].T, color=BLACK, linewidth=0.8)
        panel.plot(lines[1:-1, :, across].T, lines[1:-1, :, up].T, color=GREY, linewidth=0.7,
                   marker=".")  # fmt: skip
        for i, color in [(0, _EXTENSION), (len(lines) - 1, _FLEXION)][: len(lines)]:
            (handles[f"axis at {degrees[i]:.0f} degrees"],) = panel.plot(
                lines[i, :, across], lines[i, :, up], color=color, marker="o", markersize=3.5
            )
        line = np.asarray(hinge.femoral[0])
        style = {"color": _HINGE, "marker": "s", "linestyle": "--", "linewidth": 1.2}
        (handles["hinge"],) = panel.plot(line[:, across], line[:, up], **style, markersize=3.5)
        panel.set(xlabel=labels[0], ylabel=labels[1], aspect="equal", anchor="N", title=title,
                  xlim=(low[across], high[across]), ylim=(low[up], high[up]))  # fmt: skip
    figure_legend(figure, handles, loc="outside lower center", markerscale=1.0,
                  ncols=3 if len(handles) in (3, 5, 6) else 4)  # fmt: skip
    return figure


@styled
def joint_motion_figure(
    joints: Mapping[str, Joint], measured: np.ndarray, rows: ArrayLike, flexion: np.ndarray,
    label: str,
) -> Figure:
    """The five coordinates of joints over flexion, beside measured poses."""
    figure, panels, words = coordinate_panels(flexion)
    handles: dict[str, object] = {}
    angle, label = np.deg2rad(flexion), verbatim(label)
    tables = {name: np.asarray(joint.pose(angle).to_table()) for name, joint in joints.items()}
    small = {"markersize": 2.6, "markeredgewidth": 0, "alpha": 0.55, "linestyle": "none"}
    used = measured[np.asarray(rows, int)]
    ends = np.rad2deg(np.asarray(next(iter(joints.values())).flexion))[[0, -1]]
    for name, panel in panels.items():
        i = list(COORDINATES).index(name)
        (handles[label],) = panel.plot(measured[:, 0], measured[:, i], "o", color=GREY, **small)
        for color, (joint, table) in zip(_CURVES, tables.items(), strict=False):
            dashes = "-" if color == _CURVES[0] else "--"
            (handles[joint],) = panel.plot(flexion, table[:, i], color=color, linestyle=dashes)
        (handles["calibration poses"],) = panel.plot(
            used[:, 0], used[:, i], "o", markersize=5, markerfacecolor="none", color=BLACK
        )
        for low, high in ((flexion[0], ends[0]), (ends[1], flexion[-1])):
            if low < high:
                fixed = panel.axvspan(low, high, color=LIGHT, alpha=0.6, linewidth=0, zorder=0)
                handles["outside: the axis stays"] = fixed
    part_legend(words, handles, (0.0, 0.86), fontsize=8)
    return figure


#: Columns of facets.csv that people read, with heading and digits.
_SHOWN = {"side": (), "facet": (), "points": ("", "d"), "radius_mm": ("radius, mm", ".1f"),
          "rms_mm": ("rms, mm", ".2f"), "center_error_mm": ("centre known to, mm", ".2f"),
          "own_direction": ()}  # fmt: skip


def joint_fit_answer(
    fit: JointFit, name: str, table: np.ndarray, flexion: np.ndarray, *,
    status: Sequence[Status] = (), hinge: str = "", facets: CondyleAxes | None = None,
    regions: str = "", surface: np.ndarray | None = None, doubts: Sequence[str] = (),
    document: Mapping[str, Any] | None = None,
) -> Answer:
    """What simple joints keep of poses of a name, `(n, 6)`, degrees and mm, and what they lose."""
    article, kind = "a", "moving axis"
    if len(fit.rows) > 2:
        article, kind = "an", f"axis through {len(fit.rows)} poses"
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    heads, files = tuple(pose_columns()), {"poses": fit.moving, "hinge_poses": fit.hinge}
    tables = {file: Table.of({heads: joint.pose(np.deg2rad(flexion)).to_table()})
              for file, joint in files.items()}  # fmt: skip
    known = table[np.isfinite(table).all(axis=1), 0]
    over = f"{len(known)} measured poses"
    if status:
        tables["knee_poses"] = Table.of({heads: table, "status": [one.word for one in status]})
        over = f"passive flexion of {name}, {len(known)} pose{'s' * (len(known) != 1)} from "
        over += f"{known.min():g} to {known.max():g} degrees"
    columns = tuple(dataclasses.replace(one, show=".3f") for one in pose_columns()[1:])
    errors = Table.of({Column("joint", " "): [kind, "hinge"], columns: fit.rmse},
                      f"RMSE over {over}, degrees and mm")  # fmt: skip
    said = [f"{kind}, {fit.moving.interpolation}: calibrated at {angles} degrees.",
            f"hinge: through {hinge}, exact at {fit.poses[0, 0]:.1f} degrees."]  # fmt: skip
    sections = [Section("Axes in the femur", drawings=["axes"]),
                Section("The joints", said, printed=True)]
    if facets is not None:
        header = ("side", "facet", "points", "radius_mm", "rms_mm", *along("center_{}_mm"),
                  "center_error_mm", *along("direction_{}"), "direction_error_deg",
                  "own_direction")  # fmt: skip
        rows = [[x.side, x.name, len(x.rows), x.cylinder.radius, x.cylinder.rms, *x.center,
                 x.cylinder.center_error, *x.cylinder.direction, x.cylinder.direction_error_deg,
                 x.turned] for x in facets.facets]  # fmt: skip
        tables["facets"] = Table.of(
            dict(zip(header, zip(*rows, strict=True), strict=True)), "", prose("facets"),
            show=_SHOWN,
        )  # fmt: skip
        sections.append(Section("Facets of the condyles", [regions], ["facets"], printed=True))
    dense = np.linspace(flexion.min(), flexion.max(), 241)
    worst = [[np.nanmax(x[:2]), np.nanmax(x[2:])] for x in fit.rmse]
    rmse = {joint: dict(zip(FREE_COORDINATES, row, strict=True))
            for joint, row in zip(("moving", "hinge"), fit.rmse.tolist(), strict=True)}  # fmt: skip
    return Answer(
        title=f"Simple joints of {name if status else 'measured poses'}",
        asked=f"How closely {article} {kind} and a hinge follow {over}.",
        sentence=prose("joints.worst", kind=kind, worst=worst), tables=tables, main=[errors],
        drawings={
            "axes": Drawing(joint_axes_figure, fit.moving, fit.hinge, surface, facets),
            "motion": Drawing(joint_motion_figure, {kind: fit.moving, "hinge": fit.hinge}, table,
                              fit.rows, dense, name),
        },
        picture="motion", doubts=doubts, sections=sections,
        document={**(document or {}), "calibration_flexion_deg": fit.poses[:, 0].tolist(),
                  "interpolation": fit.moving.interpolation, "hinge": hinge, "rmse": rmse,
                  "doubts": [*doubts], "versions": versions()},
    )  # fmt: skip
