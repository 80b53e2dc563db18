"""Pressure on the tibial plateaux, seen from above."""

__all__ = ["pressure_figure"]

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.path import Path
from scipy import ndimage

from kneejax.geometry import TIBIA, Pose, State, Surface, Vector
from kneejax.mechanics import QUADRATURE, Contact, Knee, add_lane_axis
from kneejax.report.look.colours import BLACK, GREY
from kneejax.report.look.style import WIDTH, Axes, Figure, styled, verbatim
from kneejax.report.panels import grid
from kneejax.report.scene.surfaces import lots, remembered, state_of, surface_grid

#: Colours of pressure, pale where it is small.
PRESSURE_COLOURS = "YlOrRd"
_GROUND = "#ECEEF0"
_MOST_PANELS = 12
#: Pressures at which contours are drawn, as parts of the largest.
_LINES = np.linspace(0.2, 0.8, 4)


@dataclasses.dataclass(frozen=True)
class PlateauPressure:
    """Pressure over one tibial surface, or over the patella's, at poses, in the bone's frame.

    `points_mm` `(m, n, 3)`; `pressure_MPa` `(poses, m, n)`, NaN where a law has no answer;
    `center_mm` of pressure `(poses, 3)`; where there is cartilage, `(m, n)`, and its border.
    A left knee is given as the left knee that it is: Z points to the person's right.
    """

    name: str
    bone: str
    points_mm: np.ndarray
    pressure_MPa: np.ndarray
    center_mm: np.ndarray
    covered: np.ndarray
    rim_mm: np.ndarray

    @property
    def peak_MPa(self) -> float:
        """Largest pressure of all poses; 0 without contact."""
        return float(np.nanmax(self.pressure_MPa, initial=0.0))


def plateau_pressures(
    knee: Knee, poses: Pose | State, points: tuple[int, int] = (48, 48)
) -> tuple[PlateauPressure, ...]:
    """Pressure over every tibial surface, and over the patella's, on a grid on each.

    A contact of the form `elliptical_patch` has no field of pressure of its own: what is shown
    is the pressure law on the depth of the same two surfaces, around the point where they meet.
    """
    state = state_of(poses)
    count, fields = state.shape[0], []
    for name, contact in zip(knee.contact_names, knee.contacts, strict=True):
        place, pressure, area = (
            np.concatenate(part, axis=-1)[..., :count]
            for part in zip(*(_field(contact, points, some) for some in lots(state)), strict=True)
        )
        if contact.has_patch:
            contact_point = [_contact_point(contact, some) for some in lots(state)]
            contact_point = np.concatenate(contact_point, axis=-1)[..., :count]
            pressure = _around(pressure, place, contact_point, points)
        rim = rim_of(contact.tibial, points)
        covered = _inside(contact.tibial, rim, place[:, :, 0])
        pressure = np.where(covered[:, None], pressure, 0.0)
        share = np.where(np.isfinite(pressure), pressure * area, 0.0)
        total = share.sum(axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            center = np.einsum("kp,kxp->px", share, place) / total[:, None]
        drawn = np.array([1.0, 1.0, lateral_sign(knee)])
        shape = len(place) // points[1], points[1]
        fields.append(
            PlateauPressure(name, contact.bodies[1], place[:, :, 0].reshape(*shape, 3) * drawn,
                            np.moveaxis(pressure, -1, 0).reshape(-1, *shape), center * drawn,
                            covered.reshape(shape), rim * drawn)
        )
    return tuple(fields)


@eqx.filter_jit
def _field(
    contact: Contact, points: tuple[int, int], state: State
) -> tuple[Array, Array, Array]:
    own = dataclasses.replace(contact, form=QUADRATURE, points=points, damper=None)
    contact = add_lane_axis(own)
    sampled = contact.foundation.sample(state.between(contact.bodies))
    own, depth = sampled.points, sampled.depth
    pressure = jnp.where(depth > 0, own.pressure(depth), 0.0)
    place = jnp.stack([jnp.broadcast_to(x, depth.shape) for x in own.point], axis=1)
    return place, pressure, jnp.broadcast_to(own.area, depth.shape)


@eqx.filter_jit
def _contact_point(contact: Contact, state: State) -> Array:
    contact = add_lane_axis(contact)
    tibia = state.between(contact.bodies)
    gap = contact.gap(tibia, contact.contact_point(tibia))
    point = contact.tibial.frame.placement.apply(gap.point)
    return jnp.stack([jnp.broadcast_to(x, state.shape) for x in point])


def _around(
    pressure: np.ndarray, place: np.ndarray, contact_point: np.ndarray, points: tuple[int, int]
) -> np.ndarray:
    """Pressure of the patch around a contact point alone: a closed form has one patch."""
    kept, parts = np.zeros_like(pressure), np.empty(points, int)
    for pose in range(pressure.shape[1]):
        pressed = (np.nan_to_num(pressure[:, pose], nan=1.0) > 0).reshape(points)
        away = np.sum((place[:, :, pose] - contact_point[:, pose]) ** 2, axis=1)
        ndimage.label(pressed, output=parts)
        own = (pressed & (parts == parts.flat[int(np.argmin(away))])).ravel()
        kept[own, pose] = pressure[own, pose]
    return kept


@remembered
def rim_of(surface: Surface, points: tuple[int, int] = (48, 48)) -> np.ndarray:
    """Border of a surface in its bone's frame, `(k, 3)`, mm: its outline or its region."""
    outline = getattr(surface, "outline", None)
    if outline is None:
        grid = surface_grid(surface, points)
        return np.concatenate([grid[:, 0], grid[-1, 1:], grid[-2::-1, -1], grid[0, -2:0:-1]])
    corners = np.asarray(outline)
    place = surface.frame.placement.apply(surface.point(corners[:, 0], corners[:, 1]))
    return np.stack([np.broadcast_to(np.asarray(x), len(corners)) for x in place], axis=-1)


@remembered
def _inside(surface: Surface, rim: np.ndarray, points_mm: np.ndarray) -> np.ndarray:
    """Which points lie within a border, seen from where the surface faces."""
    def above(of_bone: np.ndarray) -> np.ndarray:
        x, _, z = surface.frame.placement.apply_inverse(Vector.of(of_bone.T))
        return np.stack([np.asarray(z), np.asarray(x)], axis=-1)

    return Path(above(rim)).contains_points(above(points_mm))


def lateral_sign(knee: Knee) -> float:
    """Sign of the lateral direction along Z, which points to the person's right."""
    return -1.0 if knee.side == "left" else 1.0


def spread(count: int, most: int) -> np.ndarray:
    """Rows of at most so many poses, first and last among them, evenly apart."""
    return np.unique(np.round(np.linspace(0, count - 1, min(count, most))).astype(int))


def degrees(angle_deg: float) -> str:
    """An angle as figures show it: `30°`."""
    return f"{round(angle_deg)}°"


@styled
def pressure_figure(knee: Knee, poses: Pose | State, most: int = 8) -> Figure:
    """Pressure on the tibial plateaux from above, one panel per pose, on one scale of colours.

    Anterior is up, the person's right is right: lateral is right on a right knee, left on a left
    one. A cross marks each compartment's centre of pressure; lines are drawn at 20, 40, 60 and 80 %
    of the largest pressure, which the scale of colours marks.

    Args:
        knee: any knee that has contacts.
        poses: as in `plateau_pressures`.
        most: panels at most; of more poses, evenly spaced ones are shown.

    Returns:
        The figure.

    Raises:
        ValueError: the knee has no contacts.
    """
    if not knee.contacts:
        raise ValueError(f"the knee {knee.name!r} has no contacts: there is no pressure to draw")
    state = state_of(poses)
    rows = spread(state.shape[0], min(most, _MOST_PANELS))
    state = jax.tree.map(lambda x: x[rows], state)
    fields = [one for one in plateau_pressures(knee, state) if one.bone == TIBIA]
    every = np.concatenate([field.rim_mm for field in fields])
    (x0, _, z0), (x1, _, z1) = every.min(axis=0), every.max(axis=0)
    # Left, right, lower and upper end of a panel, mm, with room for its words.
    box = z0 - 2.0, z1 + 2.0, x0 - 7.0, x1 + 2.0
    columns = min(4, len(rows))
    lines, panel = -(-len(rows) // columns), WIDTH / 4 if columns > 2 else 3.2
    height = panel * (box[3] - box[2]) / (box[1] - box[0])
    figure, panels = grid(lines, columns, lines * (height + 0.32) + (0.25 if columns > 2 else 0.6),
                          width=max(columns * panel + 0.9, 4.2), constrained=True)  # fmt: skip
    peak = max(field.peak_MPa for field in fields) or 1.0
    scale = Normalize(0.0, peak)
    for number, axes in enumerate(panels.flat):
        axes.set_axis_off()
        if number < len(rows):
            _draw(axes, fields, number, scale, box)
            flexion = np.rad2deg(float(state.tibia.flexion[number]))
            axes.set_title(f"{degrees(flexion)} flexion", loc="center")
    _compass(panels[0, 0], knee, box)
    bar = figure.colorbar(ScalarMappable(scale, PRESSURE_COLOURS), ax=panels, shrink=0.9, aspect=22,
                          pad=0.02)  # fmt: skip
    bar.set_label("Contact pressure, MPa")
    for level in peak * _LINES:
        bar.ax.axhline(level, color=BLACK, linewidth=0.6)
    bar.outline.set_visible(False)
    between = "    " if columns > 2 else "\n"
    figure.suptitle(f"{verbatim(knee.name)}, {knee.side} knee: tibial plateaux from above{between}"
                    "+ centre of pressure, lines as on the scale", fontsize=9, x=0.01, ha="left")
    return figure


def _draw(axes: Axes, fields: Sequence[PlateauPressure], pose: int, scale, box) -> None:
    for field in fields:
        z, x = field.points_mm[..., 2], field.points_mm[..., 0]
        rim = field.rim_mm[:, 2], field.rim_mm[:, 0]
        axes.fill(*rim, facecolor=_GROUND, edgecolor=GREY, linewidth=0.6, zorder=0)
        pressure = field.pressure_MPa[pose]
        if np.nanmax(pressure, initial=0.0) > 0:
            shades = scale.vmax * np.linspace(0.01, 1.0, 25)
            shown = np.minimum(pressure, scale.vmax)
            axes.contourf(z, x, shown, shades, cmap=PRESSURE_COLOURS, norm=scale, zorder=1)
            axes.contour(z, x, shown, scale.vmax * _LINES, colors=BLACK, linewidths=0.3, zorder=2)
            axes.plot(field.center_mm[pose, 2], field.center_mm[pose, 0], "+", color=BLACK,
                      markersize=6, markeredgewidth=1.1, zorder=3)  # fmt: skip
    axes.set(xlim=box[:2], ylim=box[2:], aspect="equal")


def _compass(axes: Axes, knee: Knee, box: tuple[float, float, float, float]) -> None:
    """Words for the directions, and a length to measure by, on one panel."""
    left, right = ("medial", "lateral") if lateral_sign(knee) > 0 else ("lateral", "medial")
    low, top, middle = box[2] + 1.0, box[3] - 2.0, 0.5 * (box[0] + box[1])
    small = {"fontsize": 7, "color": GREY, "va": "bottom"}
    axes.text(box[0] + 1, low, left, ha="left", **small)
    axes.text(box[1] - 1, low, right, ha="right", **small)
    arrow = {"arrowstyle": "-|>", "color": GREY, "lw": 0.7, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (middle, top), (middle, top - 8.0), arrowprops=arrow)
    axes.text(middle, top - 8.5, "ant", ha="center", va="top", fontsize=7, color=GREY, zorder=4,
              bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 0.6})  # fmt: skip
    axes.plot([middle - 5, middle + 5], [low + 0.4] * 2, color=BLACK, lw=1.2)
    axes.text(middle, low + 1.2, "10 mm", ha="center", va="bottom", fontsize=6.5)
