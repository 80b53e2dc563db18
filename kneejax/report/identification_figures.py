"""Figures of what data determine: spectrum of the information, and profile likelihoods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look.colours import BLUE, GREEN, GREY, VERMILLION, both_signs
from kneejax.report.look.style import Axes, Figure, readable, styled
from kneejax.report.panels import draw_matrix, grid, plain_numbers

if TYPE_CHECKING:
    from kneejax.inference import Information, Profile

# Decades that the axis of the spectrum shows below its longest bar.
_DECADES = 8.0
#: Panels beside each other.
_COLUMNS = 4


@styled
def spectrum_figure(found: Information) -> Figure:
    """Draw how well each combination of parameters is known, and what it is made of."""
    free = ~found.at_bound
    names = [readable(name) for name, on in zip(found.names, free, strict=True) if on]
    vectors, better = found.eigenvectors[free], np.sqrt(found.eigenvalues)
    n = len(names)
    if not n:
        figure, panels = grid(1, 1, 0.8, width=5.0, left=0.1, top=0.1, bottom=0.1)
        panels[0, 0].set_axis_off()
        figure.text(0.5, 0.5, "Every parameter is on a bound: nothing is free.", ha="center")
        return figure
    cell = min(0.44, 6.0 / max(n, 1))
    left, right = 0.062 * max(map(len, names), default=8) + 0.15, 1.0
    wide, tall = max(left + cell * n, left + 3.4) + right, cell * n
    figure, ((top,), (table,)) = grid(2, 1, tall + 2.34, width=wide, left=left,
                                      right=wide - left - tall, top=0.32, bottom=0.55,
                                      apart=(0, 0.12), height_ratios=(1.35, tall))  # fmt: skip
    _draw_bars(top, better)
    weights = draw_matrix(
        table, vectors, both_signs(), (-1, 1), lambda x: f"{x:.1f}" if abs(x) >= 0.095 else "",
        lambda x: x < -0.8, names, [str(i + 1) for i in range(n)], numbers=n <= 16,
        size=7.5 if n <= 20 else 5.5,
    )  # fmt: skip
    table.set_xlabel("Combination, from best determined to worst")
    scale = figure.colorbar(weights, cax=table.inset_axes((1 + 0.15 / tall, 0, 0.1 / tall, 1)))
    scale.set_ticks([-1, 0, 1], labels=["\u22121", "0", "+1"], fontsize=7)
    scale.ax.tick_params(length=0)
    scale.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    scale.set_label("Weight", fontsize=7.5)
    return figure


def _draw_bars(top: Axes, better: np.ndarray) -> None:
    """One bar per combination: how many times better it is known than before."""
    from matplotlib.ticker import LogLocator, NullLocator

    n = len(better)
    low = max(better.max(initial=1.0) * 10.0**-_DECADES, 1e-4)
    floor = min(0.5, max(better[better > low].min(initial=1.0) / 2.0, low))
    places = np.arange(n) + 0.5
    colours = [BLUE if size >= 1.0 else VERMILLION for size in better]
    top.bar(places, np.maximum(better, floor) - floor, bottom=floor, width=0.7, color=colours)
    for place, size in zip(places, better, strict=True):
        word = f"{size:.0f}" if size >= 9.95 else f"{size:.2g}" if size > low else "0"
        if n <= 16:
            top.annotate(word, (place, max(size, floor)), (0, 1.5), textcoords="offset points",
                         ha="center", va="bottom", fontsize=6.8)  # fmt: skip
    top.axhline(1.0, color=GREY, linewidth=0.8)
    top.annotate("no better than\nthe prior", (n, 1.0), (4, 0), textcoords="offset points",
                 va="center", fontsize=7, color=GREY)  # fmt: skip
    top.set_yscale("log")
    most = max(better.max(initial=1.0), 2.0)
    # Room for the number above the longest bar.
    top.set_ylim(floor, most * (most / floor) ** 0.16)
    top.yaxis.set_major_locator(LogLocator(base=10, numticks=6))
    top.yaxis.set_minor_locator(NullLocator())
    plain_numbers(top.yaxis)
    top.set_xlim(0, n)
    top.set_xticks([])
    top.grid(axis="x", visible=False)
    top.set_title("Prior SD over standard error, for each combination of parameters")


@styled
def profiles_figure(
    profiles: Sequence[Profile], truth: Mapping[str, float] | None = None
) -> Figure:
    """Draw how the misfit grows as each parameter leaves its estimate."""
    rows = -(-len(profiles) // _COLUMNS)
    figure, panels = grid(rows, min(_COLUMNS, len(profiles)), 1.62 * rows + 0.55, right=0.18,
                          bottom=0.7, apart=(0.22, 0.55), sharey=True)  # fmt: skip
    handles: dict[str, Any] = {}
    for axes, profile in zip(panels.flat, profiles, strict=False):
        handles |= _panel(axes, profile, (truth or {}).get(profile.name))
    for axes in panels.flat[len(profiles) :]:
        axes.set_axis_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("Rise of $\\chi^2$")
    figure.legend(handles.values(), handles.keys(), loc="lower center", ncols=6, handlelength=1.6,
                  bbox_to_anchor=(0.5, 0.0), columnspacing=1.0, fontsize=7.5)  # fmt: skip
    return figure


def _panel(axes: Axes, profile: Profile, truth: float | None) -> dict[str, Any]:
    unit = f", {profile.unit}" if profile.unit else ""
    axes.set_title(readable(profile.name) + unit, fontsize=8)
    top = 1.75 * profile.threshold
    axes.set_ylim(-0.04 * top, top)
    x, rise = _smooth(profile)
    left, right = float(profile.values[0]), float(profile.values[-1])
    pad = 0.04 * (right - left) or abs(left) * 0.05 or 1.0
    left, right = left - pad, right + pad
    axes.set_xlim(left, right)
    handles = {}
    handles["95 % confidence"] = axes.axvspan(
        profile.low, profile.high, color=BLUE, alpha=0.13, linewidth=0
    )
    if np.isfinite(profile.standard_error) and profile.standard_error > 0:
        line = np.linspace(left, right, 200)
        bowl = ((line - profile.estimate) / profile.standard_error) ** 2
        (handles["by the standard error"],) = axes.plot(line, bowl, "--", color=GREY, linewidth=1.4)
    (handles["profile"],) = axes.plot(x, rise, color=BLUE)
    axes.plot(profile.values, profile.rise, ".", color=BLUE, markersize=3.5)
    limit = f"95 % limit: {profile.threshold:.2f}"
    handles[limit] = axes.axhline(profile.threshold, color=GREY, linewidth=1.0, linestyle=":")
    (handles["estimate"],) = axes.plot([profile.estimate], [0.0], "o", color=VERMILLION,
                                       markersize=4, clip_on=False, zorder=5)  # fmt: skip
    if truth is not None:
        if left <= truth <= right:
            handles["truth"] = axes.axvline(truth, color=GREEN, linewidth=1.2)
        else:
            beyond = "right" if truth > right else "left"
            axes.text(
                0.97 if beyond == "right" else 0.03, 0.9, "truth beyond", ha=beyond, fontsize=6.5,
                color=GREEN, transform=axes.transAxes,
            )  # fmt: skip
    for why, side, place in ((profile.low_open, "left", 0.03), (profile.high_open, "right", 0.97)):
        if why:
            words = "open: bound" if why == "its bound" else "open: no\nbalance beyond"
            axes.text(place, 0.95, words, ha=side, va="top", fontsize=6.5, color=VERMILLION,
                      transform=axes.transAxes, zorder=6,
                      bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0})
    axes.locator_params(axis="x", nbins=3)
    axes.tick_params(labelsize=7)
    return handles


def _smooth(profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """The profile between its points: a monotone cubic of the signed root of the rise."""
    from scipy.interpolate import PchipInterpolator

    if len(profile.values) < 3:
        return profile.values, profile.rise
    side = np.sign(profile.values - profile.estimate)
    root = side * np.sqrt(np.maximum(profile.rise, 0.0))
    x = np.linspace(profile.values[0], profile.values[-1], 200)
    return x, PchipInterpolator(profile.values, root)(x) ** 2
