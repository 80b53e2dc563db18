"""Pressure on the tibial plateaux, seen from above."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import Pose
from kneejax.mechanics import QUADRATURE, Contact, Knee, add_lane_axis
from kneejax.report._style import BLACK, GREY, WIDTH, styled, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colours of pressure, pale where it is small.
PRESSURE_COLOURS = "YlOrRd"
_GROUND = "#ECEEF0"
_MOST_PANELS = 12


@dataclasses.dataclass(frozen=True)
class PlateauPressure:
    """Pressure over one tibial surface, at poses.

    A left knee is given as the left knee that it is: Z points to the person's right.

    Attributes:
        name: of the compartment.
        points_mm: grid on the surface in the tibia's frame, `(m, n, 3)`.
        pressure_MPa: `(poses, m, n)`; zero where the surfaces are apart, NaN where a law has no
            answer (overlap beyond the layer).
        center_mm: centre of pressure in the tibia's frame, `(poses, 3)`; NaN without contact.
    """

    name: str
    points_mm: np.ndarray
    pressure_MPa: np.ndarray
    center_mm: np.ndarray

    @property
    def peak_MPa(self) -> float:
        """Largest pressure of all poses; 0 without contact."""
        return float(np.nanmax(self.pressure_MPa, initial=0.0))


def plateau_pressures(
    knee: Knee, poses: Pose, points: tuple[int, int] = (48, 48)
) -> tuple[PlateauPressure, ...]:
    """Pressure over every tibial surface.

    A contact of the form `elliptical_patch` has no field of pressure of its own: what is shown
    is the pressure law on the depth of the same two surfaces.

    Args:
        knee: any knee.
        poses: fields of shape `(poses,)`.
        points: grid on each surface, along its two parameters (Gauss points).

    Returns:
        One field for each compartment.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> medial, lateral = plateau_pressures(knee, kj.Pose.from_table([[0, 0, 0, 0, 0.5, 0]]))
        >>> medial.pressure_MPa.shape
        (1, 48, 48)
    """
    poses = Pose.from_table(jnp.reshape(poses.to_table(), (-1, 6)))
    fields = []
    for name, contact in zip(knee.contact_names, knee.contacts, strict=True):
        lanes = add_lane_axis(_over_points(contact, points))
        place, pressure, area = (np.asarray(x) for x in _field(lanes, poses, contact.has_patch))
        share = np.where(np.isfinite(pressure), pressure * area, 0.0)
        total = share.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            center = np.einsum("kp,kxp->px", share, place) / total[:, None]
        place = place[:, :, 0].reshape(*points, 3) * _drawn(knee)
        field = np.moveaxis(pressure, -1, 0).reshape(-1, *points)
        fields.append(PlateauPressure(name, place, field, center * _drawn(knee)))
    return tuple(fields)


def _over_points(contact: Contact, points: tuple[int, int]) -> Contact:
    return Contact(
        contact.femoral,
        contact.tibial,
        contact.youngs_modulus,
        contact.poisson_ratio,
        contact.layer_thickness,
        contact.onset_width,
        law=contact.law,
        form=QUADRATURE,
        points=points,
        layer_variation=contact.layer_variation,
    )


@eqx.filter_jit
def _field(contact: Contact, poses: Pose, had_patch: bool) -> tuple[Array, Array, Array]:
    sampled = contact.sample(poses.placement)
    pressed = sampled.depth > 0
    if had_patch:
        # The patch lies in the femoral region; what a sum would add beyond it is no part of it.
        hit = contact.femur_to_plateau(poses.placement).apply_inverse(sampled.hit)
        pressed = pressed & contact.femoral.knows(hit)
    pressure = jnp.where(pressed, contact.point_pressure(sampled), 0.0)
    place = contact.tibial.frame.placement.apply(sampled.points.point)
    shape = sampled.depth.shape
    place = jnp.stack([jnp.broadcast_to(x, shape) for x in place], axis=1)
    return place, pressure, jnp.broadcast_to(sampled.points.area, shape)


def _drawn(knee: Knee) -> np.ndarray:
    """Factors from the stored right twin to the knee as it is."""
    return np.array([1.0, 1.0, lateral_sign(knee)])


def lateral_sign(knee: Knee) -> float:
    """Sign of the lateral direction along Z, which points to the person's right."""
    return -1.0 if knee.side == "left" else 1.0


def spread(count: int, most: int) -> np.ndarray:
    """Rows of at most so many poses, first and last among them, evenly apart.

    Example:
        >>> spread(9, 3).tolist(), spread(2, 3).tolist()
        ([0, 4, 8], [0, 1])
    """
    return np.unique(np.round(np.linspace(0, count - 1, min(count, most))).astype(int))


@styled
def pressure_figure(knee: Knee, poses: Pose, most: int = 8) -> Figure:
    """Pressure on the tibial plateaux from above, one panel a pose, on one scale of colours.

    Anterior is up, the person's right is right: lateral is right on a right knee, left on a left
    one. A cross marks each compartment's centre of pressure.

    Args:
        knee: any knee that has contacts.
        poses: fields of shape `(poses,)`.
        most: panels at most; of more poses, evenly spaced ones are shown.

    Returns:
        The figure.

    Raises:
        ValueError: the knee has no contacts.
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    if not knee.contacts:
        raise ValueError(f"the knee {knee.name!r} has no contacts: there is no pressure to draw")
    table = np.reshape(np.asarray(poses.to_table()), (-1, 6))
    rows = spread(len(table), min(most, _MOST_PANELS))
    fields = plateau_pressures(knee, Pose.from_table(table[rows]))
    box = _outline(fields)
    columns = min(4, len(rows))
    lines = -(-len(rows) // columns)
    panel = WIDTH / 4 if columns > 2 else 3.2
    height = panel * (box[3] - box[2]) / (box[1] - box[0])
    figure = Figure(
        figsize=(max(columns * panel + 0.9, 4.2), lines * (height + 0.32) + 0.45),
        layout="constrained",
    )
    panels = figure.subplots(lines, columns, squeeze=False)
    peak = max(field.peak_MPa for field in fields)
    scale = Normalize(0.0, peak if peak > 0 else 1.0)
    for number, axes in enumerate(panels.flat):
        axes.set_axis_off()
        if number < len(rows):
            _draw(axes, fields, number, scale, box)
            axes.set_title(f"{table[rows[number], 0]:.0f}° flexion", loc="center")
    _compass(panels[0, 0], knee, box)
    bar = figure.colorbar(
        ScalarMappable(scale, PRESSURE_COLOURS), ax=panels, shrink=0.9, aspect=22, pad=0.02
    )
    bar.set_label("Contact pressure, MPa   (+ centre of pressure)")
    bar.outline.set_visible(False)
    figure.suptitle(
        f"{verbatim(knee.name)}, {knee.side} knee: tibial plateaux from above",
        fontsize=9,
        x=0.01,
        ha="left",
    )
    return figure


def _outline(fields: tuple[PlateauPressure, ...]) -> tuple[float, float, float, float]:
    """Left, right, lower and upper end of a panel, mm, with room for its words."""
    every = np.concatenate([field.points_mm.reshape(-1, 3) for field in fields])
    (x0, _, z0), (x1, _, z1) = every.min(axis=0), every.max(axis=0)
    return z0 - 2.0, z1 + 2.0, x0 - 7.0, x1 + 2.0


def _draw(axes: Axes, fields: tuple[PlateauPressure, ...], pose: int, scale, box) -> None:
    for field in fields:
        z, x = field.points_mm[..., 2], field.points_mm[..., 0]
        axes.fill(_rim(z), _rim(x), facecolor=_GROUND, edgecolor=GREY, linewidth=0.6, zorder=0)
        pressure = field.pressure_MPa[pose]
        if np.nanmax(pressure, initial=0.0) > 0:
            shades = scale.vmax * np.linspace(0.01, 1.0, 25)
            shown = np.minimum(pressure, scale.vmax)
            axes.contourf(z, x, shown, shades, cmap=PRESSURE_COLOURS, norm=scale, zorder=1)
            lines = scale.vmax * np.linspace(0.2, 0.8, 4)
            axes.contour(z, x, shown, lines, colors=BLACK, linewidths=0.3, zorder=2)
            axes.plot(
                field.center_mm[pose, 2], field.center_mm[pose, 0], "+",
                color=BLACK, markersize=6, markeredgewidth=1.1, zorder=3,
            )  # fmt: skip
    axes.set_xlim(box[0], box[1])
    axes.set_ylim(box[2], box[3])
    axes.set_aspect("equal")


def _rim(grid: np.ndarray) -> np.ndarray:
    """Values around the edge of a grid."""
    return np.concatenate([grid[:, 0], grid[-1, 1:], grid[-2::-1, -1], grid[0, -2::-1]])


def _compass(axes: Axes, knee: Knee, box: tuple[float, float, float, float]) -> None:
    """Words for the directions, and a length to measure by, on one panel."""
    lateral_right = lateral_sign(knee) > 0
    left, right = ("medial", "lateral") if lateral_right else ("lateral", "medial")
    low = box[2] + 1.0
    small = {"fontsize": 7, "color": GREY, "va": "bottom"}
    axes.text(box[0] + 1, low, left, ha="left", **small)
    axes.text(box[1] - 1, low, right, ha="right", **small)
    middle = 0.5 * (box[0] + box[1])
    top = box[3] - 2.0
    arrow = {"arrowstyle": "-|>", "color": GREY, "lw": 0.7, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (middle, top), (middle, top - 9.0), arrowprops=arrow)
    axes.text(middle, top - 10.0, "anterior", rotation=90, ha="center", va="top", fontsize=7,
              color=GREY)  # fmt: skip
    axes.plot([middle - 5, middle + 5], [low + 0.4] * 2, color=BLACK, lw=1.2)
    axes.text(middle, low + 1.2, "10 mm", ha="center", va="bottom", fontsize=6.5)
