"""Figures of tests to make next: what each candidate would tell, and what the chosen ones do."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.design._text import gain_words
from kneejax.report.look import (
    BLACK,
    BLUE,
    GREY,
    VERMILLION,
    WIDTH,
    draw_matrix,
    number,
    readable,
    styled,
    verbatim,
)
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import Design

#: What is hatched, by status: hatch, and its legend entry.
_HATCHES = {
    Status.OUTSIDE_REGION: ("....", "outside fitted surfaces"),
    Status.OVERSTRETCHED: ("||||", "overstretched"),
    Status.UNSTABLE: ("xxxx", "unstable"),
    Status.DISLOCATED: ("////", "dislocated"),
    **dict.fromkeys(
        (Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE),
        ("----", "wrong way"),
    ),
    **dict.fromkeys([s for s in Status if not s.converged], ("\\\\\\\\", "no balance")),
}
_MOST_COLUMNS = 16


@styled
def candidates_figure(design: Design) -> Figure:
    """Draw what each candidate would tell as the next test, over flexion and load.

    Args:
        design: the candidates and the choice.

    Returns:
        A matrix of gains; candidates that were left out are hatched, chosen ones bear their number.
    """
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    rows, places = _grid(design)
    angles = sorted({test.flexion_deg for test in design.candidates})
    gains = np.full((len(rows), len(angles)), np.nan)
    for place, gain in zip(places, design.gains, strict=True):
        gains[place] = gain
    left = 0.062 * max(len(row) for row in rows) + 0.15
    cell = min((WIDTH - left - 0.75) / len(angles), 0.8)
    tall, above, below = 0.32, 0.32, 0.74
    wide = max(left + cell * len(angles) + 0.75, 4.5)
    height = above + tall * len(rows) + below
    figure = Figure(figsize=(wide, height))
    axes = figure.add_axes(
        (left / wide, below / height, cell * len(angles) / wide, tall * len(rows) / height)
    )
    shades = LinearSegmentedColormap.from_list("gain", ["#FFFFFF", "#A8D0E6", BLUE, "#003A5D"])
    most = float(np.nanmax(gains)) if np.isfinite(gains).any() else 1.0
    every = max(1, -(-len(angles) // 20))
    heads = [f"{angle:g}" if j % every == 0 else "" for j, angle in enumerate(angles)]
    factor, form = (1.0, "{:.1f}") if design.criterion == "D" else (100.0, "{:.0f}")
    filled = draw_matrix(
        axes, gains, shades, (0.0, most), lambda gain: form.format(factor * gain),
        lambda gain: gain > 0.55 * most, [verbatim(row) for row in rows], heads,
        numbers=len(angles) <= _MOST_COLUMNS,
    )  # fmt: skip
    handles = {}
    for place, status in zip(places, design.status, strict=True):
        if Status(status) in _HATCHES:
            hatch, word = _HATCHES[Status(status)]
            handles[word] = _hatched(axes, place, hatch)
    _frame_chosen(axes, design, places)
    axes.set_xlabel("Flexion, deg")
    axes.set_title(f"What one more test would add: {gain_words(design.criterion)}")
    handles["chosen, in this order"] = Rectangle((0, 0), 1, 1, fill=False, ec=VERMILLION, lw=1.8)
    figure.legend(
        list(handles.values()), list(handles), loc="lower left",
        bbox_to_anchor=((left - 0.08) / wide, 0.0), ncols=4, handlelength=1.5, handleheight=1.1,
        columnspacing=1.5,
    )  # fmt: skip
    bar = figure.colorbar(
        filled,
        cax=figure.add_axes(
            (
                (left + cell * len(angles) + 0.12) / wide, below / height,
                0.11 / wide, tall * len(rows) / height,
            )
        ),
    )  # fmt: skip
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    bar.ax.tick_params(length=0, labelsize=7)
    if design.criterion == "A":
        ticks = [tick for tick in bar.get_ticks() if 0 <= tick <= most]
        bar.set_ticks(ticks, labels=[f"{100 * tick:.0f}" for tick in ticks])
    return figure


def _frame_chosen(axes: Axes, design: Design, places: Sequence[tuple[int, int]]) -> None:
    """A frame around each chosen test, with its numbers in the order."""
    from matplotlib.patches import Rectangle

    for row, steps in _steps(design).items():
        i, j = places[row]
        axes.add_patch(Rectangle((j, i), 1, 1, fill=False, ec=VERMILLION, lw=1.8, clip_on=False))
        axes.text(
            j + 0.035, i + 0.06, ", ".join(map(str, steps)), ha="left", va="top", fontsize=6.5,
            color="white", fontweight="bold",
            bbox={"boxstyle": "square,pad=0.18", "fc": VERMILLION, "ec": "none"},
        )  # fmt: skip


@styled
def standard_errors_figure(design: Design) -> Figure:
    """Draw the expected standard error of each parameter before and after the chosen tests.

    Args:
        design: the choice.

    Returns:
        One row per parameter, as a fraction of its prior standard deviation; numbers in its own
        unit.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator

    names = [readable(name) for name in design.names]
    n, last = len(names), len(design.chosen)
    parts = design.standard_errors / design.scale
    left, tall, above, below = 0.062 * max(map(len, names)) + 0.15, 0.27, 0.55, 0.45
    height, right = above + tall * n + below, 1.75
    figure = Figure(figsize=(WIDTH, height))
    axes = figure.add_axes(
        (left / WIDTH, below / height, 1 - (left + right) / WIDTH, tall * n / height)
    )
    y = np.arange(n, dtype=float)
    axes.hlines(y, parts[-1], parts[0], color="#C8CDD2", linewidth=2.2, zorder=1)
    handles = {}
    (handles["before"],) = axes.plot(parts[0], y, "o", ms=5, mfc="white", mec=BLACK, zorder=3)
    for step in range(1, last):
        (handles["after each test"],) = axes.plot(parts[step], y, "|", ms=6, color=GREY, zorder=2)
    word = f"after {'the test' if last == 1 else f'all {last} tests'}"
    (handles[word],) = axes.plot(parts[-1], y, "o", ms=5, color=VERMILLION, zorder=4)
    prior = "prior SD (spread between knees)"
    handles[prior] = axes.axvline(1.0, color=GREY, linewidth=0.8, zorder=1)
    axes.set_xscale("log")
    low, high = parts.min() / 1.3, max(parts.max(), 1.0) * 1.3
    axes.set_xlim(low, high)
    subs = (1.0, 2.0, 5.0) if high / low < 200 else (1.0,)
    axes.xaxis.set_major_locator(LogLocator(base=10, subs=subs, numticks=9))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_yticks(y, names)
    axes.set_ylim(n - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("Expected standard error, as a fraction of the prior SD")
    edge, inch = axes.get_yaxis_transform(), 1.0 / (WIDTH - left - right)
    before, after = 1.0 + 0.62 * inch, 1.0 + 1.27 * inch
    for x, head in ((before, "before"), (after, "after")):
        axes.text(x, -0.62, head, transform=edge, ha="right", va="bottom", fontsize=7.5, color=GREY)
    for i, unit in enumerate(_units(design)):
        for x, row in ((before, 0), (after, -1)):
            axes.text(
                x, i, number(design.standard_errors[row, i], 2), transform=edge,
                ha="right", va="center_baseline", fontsize=7.5,
            )  # fmt: skip
        axes.text(after + 0.07 * inch, i, unit, transform=edge, va="center_baseline", fontsize=7.5)
    figure.legend(
        list(handles.values()), list(handles), loc="upper left",
        bbox_to_anchor=((left - 0.1) / WIDTH, 1.0), ncols=4, handlelength=1.2, columnspacing=1.5,
    )  # fmt: skip
    return figure


def _units(design: Design) -> list[str]:
    from kneejax.parameters import unit_of_quantity

    return [unit_of_quantity(name.split(".", 1)[-1]) for name in design.names]


def _grid(design: Design) -> tuple[list[str], list[tuple[int, int]]]:
    """Names of rows, and row and column of each candidate."""
    angles = sorted({test.flexion_deg for test in design.candidates})
    rows: list[str] = []
    taken: set[tuple[int, int]] = set()
    places = []
    for test in design.candidates:
        column, name, copy = angles.index(test.flexion_deg), test.name, 1
        # Two loads of one name at one flexion get rows of their own.
        while name in rows and (rows.index(name), column) in taken:
            copy += 1
            name = f"{test.name} ({copy})"
        if name not in rows:
            rows.append(name)
        places.append((rows.index(name), column))
        taken.add(places[-1])
    return rows, places


def _steps(design: Design) -> dict[int, list[int]]:
    """Chosen candidate -> its places in the order."""
    steps: dict[int, list[int]] = {}
    for step, row in enumerate(design.chosen, 1):
        steps.setdefault(row, []).append(step)
    return steps


def _hatched(axes: Axes, place: tuple[int, int], hatch: str):
    from matplotlib.patches import Rectangle

    i, j = place
    patch = Rectangle((j, i), 1, 1, hatch=hatch, fc="#F4F4F4", ec="#A0A0A0", lw=0)
    axes.add_patch(patch)
    return patch
