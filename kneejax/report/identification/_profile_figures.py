"""Figures of profile likelihoods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look import BLUE, GREEN, GREY, VERMILLION, WIDTH, readable, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.inference import Profile

_COLUMNS = 4


@styled
def profiles_figure(
    profiles: Sequence[Profile], truth: Mapping[str, float] | None = None
) -> Figure:
    """Draw how the misfit grows as each parameter leaves its estimate.

    Args:
        profiles: one per panel.
        truth: parameter -> value that made synthetic data.

    Returns:
        Panels with the profile, the parabola of the standard error, and the confidence interval;
        an end that the data leave open says so.
    """
    from matplotlib.figure import Figure

    rows = -(-len(profiles) // _COLUMNS)
    height = 1.62 * rows + 0.55
    figure = Figure(figsize=(WIDTH, height))
    panels = figure.subplots(rows, min(_COLUMNS, len(profiles)), squeeze=False, sharey=True)
    figure.subplots_adjust(
        left=0.075, right=0.975, top=1 - 0.25 / height, bottom=0.7 / height,
        wspace=0.14, hspace=0.55,
    )  # fmt: skip
    handles: dict[str, Any] = {}
    for axes, profile in zip(panels.flat, profiles, strict=False):
        handles |= _panel(axes, profile, (truth or {}).get(profile.name))
    for axes in panels.flat[len(profiles) :]:
        axes.set_axis_off()
    for axes in panels[:, 0]:
        axes.set_ylabel("Rise of $\\chi^2$")
    figure.legend(
        handles.values(), handles.keys(), loc="lower center", ncols=6, handlelength=1.6,
        bbox_to_anchor=(0.5, 0.0), columnspacing=1.0, fontsize=7.5,
    )  # fmt: skip
    return figure


def _panel(axes: Axes, profile: Profile, truth: float | None) -> dict[str, Any]:
    unit = f", {profile.unit}" if profile.unit else ""
    axes.set_title(readable(profile.name) + unit, fontsize=8)
    top = 1.75 * profile.threshold
    axes.set_ylim(-0.04 * top, top)
    x, rise = _smooth(profile)
    left, right = _limits(profile)
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
    (handles["estimate"],) = axes.plot(
        [profile.estimate], [0.0], "o", color=VERMILLION, markersize=4, clip_on=False, zorder=5
    )
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
            axes.text(
                place, 0.95, words, ha=side, va="top", fontsize=6.5, color=VERMILLION,
                transform=axes.transAxes, zorder=6,
                bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0},
            )  # fmt: skip
    axes.locator_params(axis="x", nbins=3)
    axes.tick_params(labelsize=7)
    return handles


def _limits(profile: Profile) -> tuple[float, float]:
    left, right = float(profile.values[0]), float(profile.values[-1])
    pad = 0.04 * (right - left) or abs(left) * 0.05 or 1.0
    return left - pad, right + pad


def _smooth(profile: Profile) -> tuple[np.ndarray, np.ndarray]:
    """The profile between its points: a monotone cubic of the signed root of the rise."""
    from scipy.interpolate import PchipInterpolator

    if len(profile.values) < 3:
        return profile.values, profile.rise
    side = np.sign(profile.values - profile.estimate)
    root = side * np.sqrt(np.maximum(profile.rise, 0.0))
    x = np.linspace(profile.values[0], profile.values[-1], 200)
    return x, PchipInterpolator(profile.values, root)(x) ** 2
