"""Simple joints drawn: their axes in the femur, and their motion beside the measured one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.joints import CondyleAxes, Joint
from kneejax.report.look import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    MEASURED,
    ORANGE,
    PURPLE,
    SHOWN,
    SKY,
    VERMILLION,
    WIDTH,
    styled,
    verbatim,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from numpy.typing import ArrayLike

_MOST_POINTS = 4000
_MARGIN_MM = 30.0
#: Ends of the moving axis, and the hinge's.
_EXTENSION, _FLEXION, _HINGE = VERMILLION, BLUE, GREEN
_FACETS = {"extension": ORANGE, "flexion": SKY}
_CURVES = (VERMILLION, GREEN, PURPLE, BLUE)
# Coordinates seen along the lateral, the anterior and the superior direction.
_VIEWS = (
    ("from the side", 0, 1, "anterior, mm", "superior, mm"),
    ("from behind", 2, 1, "lateral, mm", "superior, mm"),
    ("from above", 2, 0, "lateral, mm", "anterior, mm"),
)


@styled
def joint_axes_figure(
    moving: Joint,
    hinge: Joint | None = None,
    points: ArrayLike | None = None,
    axes: CondyleAxes | None = None,
) -> Figure:
    """The axes of a joint in the femur, seen from three sides.

    Args:
        moving: a joint with two or more calibration angles.
        hinge: one with a single axis.
        points: of the femur's mesh, shape `(n, 3)`, mm.
        axes: facets that were fitted to them; their circles are drawn in the view from the side.

    Returns:
        The figure.
    """
    from matplotlib.figure import Figure

    cloud = None if points is None else np.asarray(points, float)
    low, high = _window(moving, hinge, cloud)
    span = high - low
    widths = [span[across] for _, across, *_ in _VIEWS]
    tallest = max(span[up] for _, _, up, *_ in _VIEWS)
    height = 1.1 + (WIDTH - 1.5) * tallest / sum(widths)
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    panels = figure.subplots(1, 3, width_ratios=widths)
    handles: dict[str, object] = {}
    for panel, (title, across, up, *labels) in zip(panels, _VIEWS, strict=True):
        panel.set_title(title)
        if cloud is not None:
            _cloud(panel, cloud, axes, across, up, handles)
        if axes is not None and across == 0:
            _circles(panel, axes)
        _axis(panel, moving, across, up, handles)
        if hinge is not None:
            line = np.asarray(hinge.femoral[0])
            style = {"color": _HINGE, "marker": "s", "linestyle": "--", "linewidth": 1.2}
            (handles["hinge"],) = panel.plot(line[:, across], line[:, up], **style, markersize=3.5)
        panel.set(xlabel=labels[0], ylabel=labels[1], aspect="equal", anchor="N")
        panel.set_xlim(low[across], high[across])
        panel.set_ylim(low[up], high[up])
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center",
        ncols=3 if len(handles) in (3, 5, 6) else 4, markerscale=1.0,
    )  # fmt: skip
    return figure


@styled
def joint_motion_figure(
    joints: Mapping[str, Joint],
    measured: ArrayLike,
    rows: ArrayLike,
    flexion_deg: ArrayLike,
    label: str = "measured",
) -> Figure:
    """The five coordinates of joints over flexion, beside measured poses.

    Args:
        joints: name -> joint.
        measured: shape `(n, 6)`, degrees and mm, in the order of `kneejax.geometry.COLUMNS`.
        rows: of the measured poses on which the first joint was calibrated.
        flexion_deg: where the joints are drawn, shape `(m,)`, increasing.
        label: what the poses are called; those of a contact knee were not measured.

    Returns:
        The figure.
    """
    from matplotlib.figure import Figure

    measured, flexion = np.asarray(measured, float), np.asarray(flexion_deg, float)
    label = verbatim(label)
    figure = Figure(figsize=(WIDTH, 4.3), layout="constrained")
    panels = figure.subplots(2, 3).ravel()
    handles: dict[str, object] = {}
    angle = np.deg2rad(flexion)
    tables = {name: np.asarray(joint.pose(angle).to_table()) for name, joint in joints.items()}
    for panel, name in zip(panels, SHOWN, strict=False):
        i = list(COORDINATES).index(name)
        small = {"markersize": 2.6, "markeredgewidth": 0, "alpha": 0.55, "linestyle": "none"}
        (handles[label],) = panel.plot(
            measured[:, 0], measured[:, i], marker="o", color=GREY, **small
        )
        for color, (joint, table) in zip(_CURVES, tables.items(), strict=False):
            dashes = "-" if color == _CURVES[0] else "--"
            (handles[joint],) = panel.plot(flexion, table[:, i], color=color, linestyle=dashes)
        used = measured[np.asarray(rows, int)]
        (handles["calibration poses"],) = panel.plot(
            used[:, 0], used[:, i], "o", markersize=5, markerfacecolor="none", color=MEASURED
        )
        ends = np.rad2deg(np.asarray(next(iter(joints.values())).flexion))[[0, -1]]
        for low, high in ((flexion[0], ends[0]), (ends[1], flexion[-1])):
            if low < high:
                fixed = panel.axvspan(low, high, color=LIGHT, alpha=0.6, linewidth=0, zorder=0)
                handles["outside: the axis stays"] = fixed
        panel.set_title(COORDINATES[name].axis_label)
        panel.set_xlabel("Flexion, deg")
    panels[-1].set_axis_off()
    panels[-1].legend(list(handles.values()), list(handles), loc="center left")
    return figure


def _window(moving: Joint, hinge: Joint | None, cloud: np.ndarray | None):
    """What is shown: all axis points, and of the femur what lies near them."""
    shown = np.asarray(moving.femoral).reshape(-1, 3)
    if hinge is not None:
        shown = np.concatenate([shown, np.asarray(hinge.femoral).reshape(-1, 3)])
    low, high = shown.min(axis=0) - 8.0, shown.max(axis=0) + 8.0
    if cloud is not None:
        near = cloud[(np.abs(cloud - 0.5 * (low + high)) < 0.5 * (high - low) + _MARGIN_MM).all(1)]
        if len(near):
            low = np.minimum(low, near.min(axis=0) - 3.0)
            high = np.maximum(high, near.max(axis=0) + 3.0)
    return low, high


def _cloud(panel: Axes, cloud, axes: CondyleAxes | None, across, up, handles) -> None:
    some = cloud[:: max(1, len(cloud) // _MOST_POINTS)]
    style = {"linestyle": "none", "marker": "o", "markeredgewidth": 0, "rasterized": True}
    panel.plot(some[:, across], some[:, up], color="#C9CDD2", markersize=1.1, **style)
    for facet in axes.facets if axes is not None else ():
        part = cloud[facet.rows]
        panel.plot(
            part[:, across], part[:, up], color=_FACETS[facet.name], markersize=1.6, alpha=0.6,
            **style,
        )  # fmt: skip
        label = f"{facet.name} facets"
        if label not in handles:
            (handles[label],) = panel.plot([], [], "o", color=_FACETS[facet.name], markersize=4)


def _circles(panel: Axes, axes: CondyleAxes) -> None:
    """Cylinders seen along the transverse axis: medial solid, lateral dashed."""
    turn = np.linspace(0.0, 2.0 * np.pi, 181)
    for facet in axes.facets:
        c, r = facet.center, facet.cylinder.radius
        color = _EXTENSION if facet.name == "extension" else _FLEXION
        dashes = "-" if facet.side == "medial" else ":"
        style = {"color": color, "linewidth": 0.6, "linestyle": dashes, "alpha": 0.8}
        panel.plot(c[0] + r * np.cos(turn), c[1] + r * np.sin(turn), **style)


def _axis(panel: Axes, moving: Joint, across: int, up: int, handles: dict) -> None:
    degrees = np.rad2deg(np.asarray(moving.flexion))
    lines = np.asarray(moving.femoral)
    angles = np.deg2rad(np.linspace(degrees[0], degrees[-1], 31))
    between = np.asarray(moving.axis_points(angles)[0])
    for side in range(2):
        panel.plot(between[side, across], between[side, up], color=BLACK, linewidth=0.8)
    for i in range(1, len(lines) - 1):
        panel.plot(lines[i, :, across], lines[i, :, up], color=GREY, linewidth=0.7, marker=".")
    ends = ((0, _EXTENSION), (len(lines) - 1, _FLEXION)) if len(lines) > 1 else ((0, _EXTENSION),)
    for i, color in ends:
        (handles[f"axis at {degrees[i]:.0f} degrees"],) = panel.plot(
            lines[i, :, across], lines[i, :, up], color=color, marker="o", markersize=3.5
        )
