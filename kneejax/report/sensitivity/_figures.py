"""Figures of local sensitivity: slopes over flexion, as curves and as one heatmap."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.report.look import GREY, PARTS, SHOWN, VERMILLION, WIDTH, readable, styled
from kneejax.report.motion import flexion_axis, mark_status, part_legend
from kneejax.report.sensitivity._sweep_figure import FREE_COLUMN, SPOTS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import LocalSensitivity

#: Scale -> what follows the unit on an axis.
_PER = {"prior": "per prior SD", "percent": "per %"}
#: Dashes of the quantities, in the order in which they come.
_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2)))
#: Parameters that one panel can show as curves or bars.
MOST_PARAMETERS = 12
#: Rows of a heatmap.
_MOST_ROWS = 40
_TRANSLATIONS = ("lateral", "anterior", "superior")


def looks(names: tuple[str, ...]) -> list[tuple[str, int]]:
    """Colour of each parameter's ligament, and the number of its quantity, both as they come."""
    ligaments = list(dict.fromkeys(name.split(".", 1)[0] for name in names))
    quantities = list(dict.fromkeys(name.split(".", 1)[1] for name in names))
    return [
        (PARTS[ligaments.index(ligament) % len(PARTS)], quantities.index(quantity))
        for ligament, quantity in (name.split(".", 1) for name in names)
    ]


def scale_words(local: LocalSensitivity) -> str:
    """What one step of each parameter is, for a legend: `1350 N`, `0.02`, ..."""
    if local.scale == "percent":
        return "1 % of each value (0.01 of a reference strain)"
    return "one standard deviation of each parameter's prior"


@styled
def local_curves_figure(local: LocalSensitivity) -> Figure:
    """Draw the derivative of every coordinate with respect to every parameter over flexion.

    Args:
        local: what to draw; of more than twelve parameters, those that move the knee most.

    Returns:
        Translations on the left, rotations on the right, a line per parameter: the colour is its
        ligament's, the dashes are its quantity's.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 6.3))
    panels = figure.subplots(3, 2, sharex=True)
    figure.subplots_adjust(left=0.085, right=0.985, top=0.96, bottom=0.075, wspace=0.2, hspace=0.24)
    shown = most_moving(local, MOST_PARAMETERS)
    styles = looks(tuple(local.names[i] for i in shown))
    drawn: list = []
    marks: dict = {}
    for coordinate, spot in zip(SHOWN, SPOTS, strict=True):
        axes, slopes = panels[spot], local.scaled[:, FREE_COLUMN[coordinate]]
        axes.set_title(f"{COORDINATES[coordinate].axis_label} {_PER[local.scale]}")
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        lines = []
        for i, (colour, quantity) in zip(shown, styles, strict=True):
            dashes = _DASHES[quantity % len(_DASHES)]
            lines += axes.plot(local.flexion_deg, slopes[:, i], color=colour, linestyle=dashes)
        drawn = [(line, readable(local.names[i])) for line, i in zip(lines, shown, strict=True)]
        marks |= mark_status(axes, local.flexion_deg, local.status, VERMILLION, 0.03)
        last = spot in ((2, 0), (1, 1))
        flexion_axis(axes, local.flexion_deg, last)
        axes.tick_params(labelbottom=last)
    words = panels[2, 1]
    words.set_axis_off()
    drawn += [(handle, entry) for entry, handle in marks.items()]
    few = len(drawn) <= 10
    part_legend(
        words, drawn, (0.0, 0.84), ncols=2 if len(drawn) > 5 else 1, handlelength=2.6,
        labelspacing=0.5 if few else 0.22,
    )  # fmt: skip
    note = f"Change of the pose by {scale_words(local)}"
    left_out = len(local.names) - len(shown)
    note += f"; {left_out} that move it less are not shown" if left_out else ""
    words.text(0.0, 0.02, note, fontsize=7.5, wrap=True, transform=words.transAxes)
    return figure


def most_moving(local: LocalSensitivity, most: int) -> list[int]:
    """Parameters to draw, at most so many, in their own order."""
    size = np.nan_to_num(np.abs(local.scaled)).max(axis=0)
    # mm and degrees are judged each against their own coordinate.
    share = (size / np.maximum(size.max(axis=1, keepdims=True), 1e-300)).max(axis=0)
    return sorted(np.argsort(-share, kind="stable")[:most].tolist())


@styled
def local_heatmap_figure(local: LocalSensitivity) -> Figure:
    """Draw the same slopes as colours: parameters down, flexion across, a panel per coordinate.

    Args:
        local: what to draw; of more than forty parameters, those that move the knee most.

    Returns:
        Translations on the left and rotations on the right, each kind on one scale of colours
        centred on zero; poses without a balance are hatched.
    """
    from matplotlib.figure import Figure

    shown = most_moving(local, _MOST_ROWS)
    rows, pitch = len(shown), 0.145 if len(local.names) <= 16 else 0.1
    height = 3 * (0.55 + pitch * max(rows, 6)) + 0.3
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(3, 2, sharex=True, sharey=True)
    figure.subplots_adjust(
        left=0.235, right=0.985, top=1 - 0.25 / height, bottom=0.45 / height, wspace=0.06,
        hspace=0.3 / (height / 3 - 0.4),
    )  # fmt: skip
    edges = _edges(local.flexion_deg)
    colours: dict[bool, object] = {}
    for coordinate, spot in zip(SHOWN, SPOTS, strict=True):
        axes, shift = panels[spot], coordinate in _TRANSLATIONS
        axes.set_title(COORDINATES[coordinate].label)
        limit = _limit(local, shift)
        slopes = local.scaled[:, FREE_COLUMN[coordinate], shown].T
        colours[shift] = axes.pcolormesh(
            edges, np.arange(rows + 1), slopes, cmap="RdBu_r", vmin=-limit, vmax=limit
        )
        _hatch_failed(axes, edges, rows, np.isnan(slopes).all(axis=0))
        axes.set_yticks(np.arange(rows) + 0.5, [readable(local.names[i]) for i in shown])
        axes.tick_params(axis="y", labelsize=min(8.0, 60 * pitch))
        axes.set_ylim(rows, 0)
        axes.grid(False)
        axes.tick_params(axis="y", length=0)
        last = spot in ((2, 0), (1, 1))
        flexion_axis(axes, local.flexion_deg, last)
        axes.set_xlim(edges[0], edges[-1])
        axes.tick_params(labelbottom=last)
    words = panels[2, 1]
    words.set_axis_off()
    inch = 1 / (height * words.get_position().height)
    for place, shift, kind in ((0.7, True, "translations, mm"), (1.35, False, "rotations, deg")):
        bar = figure.colorbar(
            colours[shift],  # pyright: ignore[reportArgumentType]
            cax=words.inset_axes((0.05, 1 - place * inch, 0.9, 0.13 * inch)),
            orientation="horizontal",
        )
        bar.set_label(f"{kind} {_PER[local.scale]}")
        bar.outline.set_linewidth(0.5)  # pyright: ignore[reportCallIssue, reportAttributeAccessIssue]
    if len(local.names) > rows:
        note = f"{len(local.names) - rows} parameters that move\nthe knee less are not shown"
        words.text(0.05, 1 - 2.2 * inch, note, fontsize=7.5, transform=words.transAxes)
    return figure


def _edges(flexion: np.ndarray) -> np.ndarray:
    """Edges of the cells around angles."""
    if len(flexion) == 1:
        return flexion[0] + np.array([-0.5, 0.5])
    middle = (flexion[1:] + flexion[:-1]) / 2
    return np.r_[2 * flexion[0] - middle[0], middle, 2 * flexion[-1] - middle[-1]]


def _limit(local: LocalSensitivity, translations: bool) -> float:
    """The largest slope of either kind of coordinate."""
    columns = [FREE_COLUMN[c] for c in SHOWN if (c in _TRANSLATIONS) == translations]
    return float(np.nan_to_num(np.abs(local.scaled[:, columns])).max()) or 1.0


def _hatch_failed(axes: Axes, edges: np.ndarray, rows: int, failed: np.ndarray) -> None:
    for i in np.flatnonzero(failed):
        axes.fill_between(
            edges[i : i + 2], 0, rows, facecolor="none", edgecolor=GREY, hatch="////", linewidth=0
        )
