"""A moving axis and a hinge that were fitted to poses, as an answer."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import versions
from kneejax.joints import CondyleAxes, JointFit
from kneejax.report.joints._axes_figure import joint_axes_figure, joint_motion_figure
from kneejax.report.look import Answer, Column, Drawing, Section, Table, Verdict, wrapped
from kneejax.report.motion import digits, pose_columns, text_of
from kneejax.statics import Status

#: Columns of facets.csv; those that people read with heading and digits.
_FACETS = (
    "side", "facet", "points", "radius_mm", "rms_mm", "center_anterior_mm", "center_superior_mm",
    "center_lateral_mm", "center_error_mm", "direction_anterior", "direction_superior",
    "direction_lateral", "direction_error_deg", "own_direction",
)  # fmt: skip
_SHOWN = {"radius_mm": ("radius, mm", 1), "rms_mm": ("rms, mm", 2),
          "center_error_mm": ("centre known to, mm", 2)}  # fmt: skip


def joint_fit_answer(
    fit: JointFit,
    name: str,
    table: np.ndarray,
    flexion: np.ndarray,
    *,
    status: Sequence[Status] = (),
    hinge: str = "",
    facets: CondyleAxes | None = None,
    regions: str = "",
    surface: np.ndarray | None = None,
    doubts: Sequence[str] = (),
    document: Mapping[str, Any] | None = None,
) -> Answer:
    """What simple joints keep of a motion, and what they lose.

    Args:
        fit: the joints.
        name: of the poses.
        table: the poses, degrees and mm, `(n, 6)`; NaN where a contact knee has none.
        flexion: where the joints' motion is written, degrees.
        status: of each pose, where they are those of a contact knee.
        hinge: what the hinge's axis goes through, in words.
        facets: of the femur, if there are any.
        regions: how they were chosen, in words.
        surface: points of the femur, `(n, 3)`, mm.
        doubts: on poses and facets.
        document: what result.json says of the input.

    Returns:
        The answer; its tables are poses, hinge_poses, knee_poses of a contact knee, and facets.
    """
    kind = "moving axis" if len(fit.rows) == 2 else f"axis through {len(fit.rows)} poses"
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    moved = fit.moving, fit.hinge
    tables = {
        file: Table(pose_columns(), np.asarray(joint.pose(np.deg2rad(flexion)).to_table()).tolist())
        for joint, file in zip(moved, ("poses", "hinge_poses"), strict=True)
    }
    known = table[np.isfinite(table).all(axis=1), 0]
    over = f"{len(known)} measured poses"
    if status:
        columns = [*pose_columns(), Column("status", words=True)]
        rows = [[*row, one.word] for row, one in zip(table.tolist(), status, strict=True)]
        tables["knee_poses"] = Table(columns, rows)
        over = f"passive flexion of {name}, {len(known)} pose{'s' * (len(known) != 1)} from "
        over += f"{known.min():g} to {known.max():g} degrees"
    errors = Table(
        [Column("joint", " ", words=True), *_error_columns()],
        [[one, *row] for one, row in zip((kind, "hinge"), fit.rmse.tolist(), strict=True)],
        f"RMSE over {over}, degrees and mm:",
    )
    said = [
        f"{kind}, {fit.moving.interpolation}: calibrated at {angles} degrees",
        f"hinge: through {hinge}, exact at {fit.poses[0, 0]:.1f} degrees",
    ]
    text, sections = list(said), [Section("The joints", [f"{x}." for x in said])]
    if facets is not None:
        tables["facets"] = _facet_table(facets)
        text += [f"facets: {regions}", tables["facets"].terminal()]
        sections.append(Section("Facets of the condyles", [regions], ["facets"]))
    dense = np.linspace(flexion.min(), flexion.max(), 241)
    sections.insert(0, Section("Axes in the femur", drawings=["axes"]))
    text += [text_of(errors), *(line for one in doubts for line in wrapped(one, "! "))]
    worst = np.nanmax(fit.rmse[0, :2]), np.nanmax(fit.rmse[0, 2:])
    rmse = {
        joint: dict(zip(FREE_COORDINATES, row, strict=True))
        for joint, row in zip(("moving", "hinge"), fit.rmse.tolist(), strict=True)
    }
    return Answer(
        title=f"Simple joints of {name}",
        asked=f"How closely a {kind} and a hinge follow {over}.",
        verdict=Verdict.DOUBTFUL if doubts else Verdict.GOOD,
        sentence=f"The {kind} is off by at most {worst[0]:.2g} degrees and {worst[1]:.2g} mm (RMSE "
        f"of the worst coordinate), the hinge by {np.nanmax(fit.rmse[1, :2]):.2g} degrees and "
        f"{np.nanmax(fit.rmse[1, 2:]):.2g} mm.",
        tables=tables,
        main=[errors],
        drawings={
            "axes": Drawing(
                functools.partial(joint_axes_figure, fit.moving, fit.hinge, surface, facets),
                "The axes in the femur, from three sides.",
            ),
            "motion": Drawing(
                functools.partial(
                    joint_motion_figure, {kind: fit.moving, "hinge": fit.hinge}, table, fit.rows,
                    dense, name,
                ),
                "The joints over flexion; circles mark the poses that they were calibrated on.",
            ),
        },
        picture="motion",
        doubts=doubts,
        sections=sections,
        text="\n".join(text),
        document={
            **(document or {}), "calibration_flexion_deg": fit.poses[:, 0].tolist(),
            "interpolation": fit.moving.interpolation, "hinge": hinge, "rmse": rmse,
            "doubts": [*doubts], "versions": versions(),
        },
        exit_status=int(bool(doubts)),
    )  # fmt: skip


def _error_columns() -> list[Column]:
    heads = ("adduction", "int.rot.", "anterior", "superior", "lateral")
    units = (column.rsplit("_", 1)[1] for column in COLUMNS[1:])
    pairs = zip(FREE_COORDINATES, heads, units, strict=True)
    return [Column(name, f"{head}, {unit}", digits(3)) for name, head, unit in pairs]


def _facet_table(axes: CondyleAxes) -> Table:
    rows = [
        [
            f.side, f.name, len(f.rows), f.cylinder.radius, f.cylinder.rms, *f.center,
            f.cylinder.center_error, *f.cylinder.direction, f.cylinder.direction_error_deg,
            f.turned,
        ]
        for f in axes.facets
    ]  # fmt: skip
    columns = []
    for name in _FACETS:
        head, count = _SHOWN.get(name, ("", 0))
        shown = name in (*_SHOWN, "side", "facet", "points", "own_direction")
        show = digits(count) if count else None
        show = str if name == "points" else show
        columns.append(Column(name, head, show, words=name in ("side", "facet"), shown=shown))
    note = "Without a direction of its own a facet has that of the transverse axis."
    return Table(columns, rows, note=note)
