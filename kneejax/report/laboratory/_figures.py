"""Curves of load and displacement, and laxity over flexion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.experiments import Curves, Laxity
from kneejax.geometry import COORDINATES
from kneejax.mechanics import NAMED_LOADS
from kneejax.report.look import BLUE, GREY, VERMILLION, WIDTH, styled, verbatim
from kneejax.report.motion import flexion_axis, mark_status
from kneejax.statics import Status, converged

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_PANEL = 2.7  # inches high
#: Flexions with a curve each; of more, evenly chosen ones are named.
_MOST_NAMED = 8
#: Of a displacement, by what it is counted from.
_FROM = {"unloaded": "from the neutral pose", "intact": "from the intact knee"}


@styled
def load_figure(curves: Sequence[Curves], status: Sequence[np.ndarray]) -> Figure:
    """Draw load against displacement, a panel for each test and a curve for each flexion.

    Args:
        curves: one per test.
        status: of each, `Status` values, `(flexions, loads)`.

    Returns:
        Displacements to the right, loads upwards, as laxity papers draw them. Where a knee gives
        way or is no knee any more, a cross marks the last load that it held.
    """
    figure, panels = _panels(len(curves), 0.8)
    for axes, one, own in zip(panels, curves, status, strict=True):
        _curves_panel(axes, one, own)
    return figure


def _panels(count: int, right: float) -> tuple[Figure, np.ndarray]:
    """Panels one below the other, with room for legends to the right."""
    from matplotlib.figure import Figure

    height = _PANEL * count + 0.35
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(count, 1, squeeze=False)[:, 0]
    figure.subplots_adjust(
        left=0.1, right=right, top=1 - 0.3 / height, bottom=0.5 / height, hspace=0.42
    )
    return figure, panels


def _curves_panel(axes: Axes, one: Curves, status: np.ndarray) -> None:
    from matplotlib import colormaps

    test = one.test
    loads = np.asarray(one.driving_load)
    moved = np.asarray(one.displacement_by_load)
    colors = colormaps["viridis"](np.linspace(0.0, 0.92, len(moved)))
    every = max(1, -(-len(moved) // _MOST_NAMED))
    for k, (x, load, color) in enumerate(zip(moved, loads, colors, strict=True)):
        label = f"{test.flexion_deg[k]:g}" if k % every == 0 else None
        axes.plot(x, load, color=color, label=label)
        ends = _ends(one.part, status[k])
        if ends:
            axes.plot(x[ends], load[ends], "x", color=VERMILLION, markersize=5, zorder=5)
    kind, coordinate = NAMED_LOADS[test.driven_by], COORDINATES[test.observed]
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.axvline(0.0, color=GREY, linewidth=0.5)
    axes.set_title(verbatim(f"{test.name}: {test.words}"))
    axes.set_xlabel(f"Change {_FROM[one.counted_from]}: {coordinate.phrase}, {coordinate.unit}")
    axes.set_ylabel(f"{kind.positive.capitalize()}, {kind.unit}")
    handles, labels = axes.get_legend_handles_labels()
    if any(_ends(one.part, own) for own in status):
        (mark,) = axes.plot([], [], "x", color=VERMILLION, markersize=5)
        handles, labels = [*handles, mark], [*labels, "last load held"]
    axes.legend(
        handles, labels, title="Flexion, deg", title_fontsize=8, loc="upper left",
        bbox_to_anchor=(1.02, 1.02), borderaxespad=0, fontsize=7.5, handlelength=1.6,
    )  # fmt: skip


def _ends(part: np.ndarray, status: np.ndarray) -> list[int]:
    """Last rows, each way from the neutral pose, of a knee that still holds together."""
    zero = int(np.argmin(np.abs(part)))
    good = converged(status) & ~np.isin(status, [int(Status.UNSTABLE), int(Status.DISLOCATED)])
    ends = []
    for rows in (np.arange(zero, len(part)), np.arange(zero, -1, -1)):
        held = good[rows]
        if held[0] and not held.all():
            ends.append(int(rows[np.argmin(held) - 1]))
    return ends


@styled
def laxity_figure(
    curves: Sequence[Curves], found: Sequence[Laxity], bands: Sequence[Any] = ()
) -> Figure:
    """Draw how far the knee gives over flexion, beside published ranges of the same load; of a test
    by displacement, what it takes.

    Args:
        curves: one per test.
        found: their laxities.
        bands: published laxities (`kneejax.files.bundled_bands`); those of another test or load
            are left out, and ranges.

    Returns:
        A panel for each test; published means, with two standard deviations where they are known;
        of cut knees the legend says what they are counted from.
    """
    figure, panels = _panels(len(curves), 0.72)
    for axes, one in zip(panels, curves, strict=True):
        rows = [x for x in found if x.test == one.test.name]
        _laxity_panel(axes, one, rows, bands)
    return figure


def _laxity_panel(axes: Axes, one: Curves, rows: Sequence[Laxity], bands: Sequence[Any]) -> None:
    test = one.test
    flexion = np.array([x.flexion_deg for x in rows])
    kind, coordinate = NAMED_LOADS[test.driven_by], COORDINATES[test.observed]
    drawn: list[Any] = []
    by_load = test.displacement is None
    for band in bands if by_load and not test.held else ():
        one_way = band.end in ("positive", "negative")
        if one_way and band.load == test.driven_by and band.size == abs(test.size):
            spread = np.where(np.isfinite(band.sd), 2 * band.sd, 0.0)
            points = axes.errorbar(
                band.flexion_deg, band.mean, spread, fmt="s", color=GREY, markersize=3,
                elinewidth=0.8, capsize=2, zorder=1,
            )  # fmt: skip
            counted = f",\n{_FROM[band.counted_from]}" if band.cut else ""
            drawn.append((points, f"{band.label}:\nmean, two SD where known{counted}"))
    ends = ("positive", "negative") if by_load else ("held_positive", "held_negative")
    for name, word, color in zip(
        ends, (kind.positive, kind.negative), (BLUE, VERMILLION), strict=True
    ):
        y = np.array([getattr(x, name) for x in rows])
        if np.isfinite(y).any():
            (line,) = axes.plot(flexion, y, "o-", color=color, markersize=3)
            drawn.append((line, word))
    status = np.array([int(x.status) for x in rows])
    marks = mark_status(axes, flexion, status, VERMILLION, 0.03)
    drawn += [(handle, entry) for entry, handle in marks.items()]
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    axes.set_title(verbatim(f"{test.name}: {test.words}"))
    change = f"Change {_FROM[one.counted_from]}:\n{coordinate.phrase}, {coordinate.unit}"
    axes.set_ylabel(change if by_load else f"{kind.positive.capitalize()}, {kind.unit}")
    flexion_axis(axes, flexion)
    handles, labels = zip(*drawn, strict=True) if drawn else ((), ())
    axes.legend(
        handles, [verbatim(x) for x in labels], loc="upper left", bbox_to_anchor=(1.02, 1.02),
        borderaxespad=0, fontsize=7.5, handlelength=1.6,
    )  # fmt: skip
