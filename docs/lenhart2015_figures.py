"""Figures of docs/validation_lenhart2015.md; `make_lenhart2015_validation.py` draws them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from kneejax.report.look.colours import BLACK, BLUE, GREEN, GREY, LIGHT, VERMILLION
from kneejax.report.look.style import WIDTH, styled

FLEXION = "Flexion, degrees"
_RECORDED = dict(
    color=BLACK, ls="none", marker="o", ms=3.6, mfc="white", mew=0.9, clip_on=False, zorder=4
)


@styled
def fibres(flexion, bundles, at) -> Figure:
    """Force of each bundle over flexion.

    Args:
        flexion: degrees, `(n,)`.
        bundles: name -> ours `(n,)` and recorded `(m,)`, N.
        at: rows of the recorded values.
    """
    figure = Figure(figsize=(WIDTH, 3.4), layout="constrained")
    axes = figure.subplots(2, 5, sharex=True)
    for axis, (name, (ours, recorded)) in zip(axes.flat, bundles.items(), strict=True):
        axis.plot(flexion, ours, color=VERMILLION, label="kneejax")
        axis.plot(flexion[at], recorded, label="recorded by OpenSim JAM", **_RECORDED)
        axis.set_title(name)
        axis.set_ylim(0, max(1.15 * ours.max(), 1.0))
        axis.yaxis.set_major_locator(MaxNLocator(4, integer=True))
        _flexion(axis)
    figure.supxlabel(FLEXION, fontsize=8)
    figure.supylabel("Force of the bundle, N", fontsize=8)
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2)
    return figure


@styled
def contact(flexion, compared, criteria) -> Figure:
    """Contact over flexion, with the criterion as a band around what was recorded.

    Args:
        flexion: degrees, `(n,)`.
        compared: ours and recorded, a `ContactComparison`.
        criteria: quantity -> largest share of the recorded value; mm for `center`.
    """
    figure = Figure(figsize=(WIDTH, 3.9), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True)
    rows = [
        ("Contact force, N", compared.force, compared.recorded_force, criteria["force"]),
        ("Contact area, mm²", compared.area, compared.recorded_area, criteria["area"]),
        (
            "Largest pressure, MPa", compared.max_pressure, compared.recorded_max_pressure,
            criteria["max_pressure"],
        ),
    ]  # fmt: skip
    for axis, (label, ours, recorded, share) in zip(axes[0], rows, strict=True):
        _with_band(axis, flexion, ours, recorded, share * recorded)
        axis.set_ylim(0, 1.2 * recorded.max())
        axis.set_title(label)
    names = ("anterior", "lateral")
    for axis, name, k in zip(axes[1], names, (0, 2), strict=False):
        wide = np.full(len(flexion), criteria["center"])
        _with_band(axis, flexion, compared.center[:, k], compared.recorded_center[:, k], wide)
        axis.set_title(f"Centre of pressure: {name}, mm")
    distance = axes[1, 2]
    distance.plot(flexion, compared.errors["center"], color=VERMILLION)
    distance.axhline(criteria["center"], color=GREY, lw=0.9, ls="--")
    distance.text(88, criteria["center"] - 0.03, "criterion", ha="right", va="top", color=GREY)
    distance.set_ylim(0, 1.15 * criteria["center"])
    distance.set_title("Distance between centres, mm")
    for axis in axes.flat:
        _flexion(axis)
    figure.supxlabel(FLEXION, fontsize=8)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=3)
    return figure


def _with_band(axis, flexion, ours, recorded, width) -> None:
    axis.fill_between(
        flexion, recorded - width, recorded + width, color=LIGHT, lw=0, label="criterion"
    )
    axis.plot(flexion, recorded, color=BLACK, lw=2.2, label="recorded by OpenSim JAM")
    axis.plot(flexion, ours, color=VERMILLION, lw=1.0, label="kneejax")


@styled
def equilibrium(flexion, smallest, loose, returned, limits) -> Figure:
    """How firmly recorded poses are held, and how far from them the searches ended.

    Args:
        flexion: degrees, `(n,)`.
        smallest: of three ways to give the tendon's pull, the smallest eigenvalue, N/mm.
        loose: mask of the poses that are not held under the dead load.
        returned: of the dead load and the tendon: degrees and mm, `(n,)`; NaN where not found.
        limits: degrees and mm within which a pose counts as found again.
    """
    figure = Figure(figsize=(WIDTH, 3.1), layout="constrained")
    left, *others = figure.subplots(1, 3, width_ratios=(1.4, 1, 1))
    for (name, values), colour in zip(smallest.items(), (VERMILLION, BLUE, GREEN), strict=True):
        left.plot(flexion, values, color=colour, label=name)
    for axis in (left, *others):
        for k, (low, high) in enumerate(_ranges(flexion, loose)):
            label = None if k or axis is not left else "not held by the dead load"
            axis.axvspan(low, high, color=LIGHT, lw=0, label=label)
        _flexion(axis)
    left.axhline(0.0, color=BLACK, lw=0.7)
    left.set_title("Smallest stiffness, N/mm")
    handles = left.get_legend_handles_labels()
    figure.legend(*handles, loc="outside upper center", ncols=4, columnspacing=1.2)
    for axis, number, unit, limit in zip(others, (0, 1), ("degrees", "mm"), limits, strict=True):
        for pair, colour in zip(returned, (VERMILLION, GREEN), strict=True):
            axis.plot(flexion, pair[number], ls="none", marker="o", ms=1.7, color=colour)
            lost = flexion[np.isnan(pair[number])]
            axis.plot(lost, 0.0 * lost + 20.0, ls="none", marker="x", ms=2.6, mew=0.7, color=colour)
        axis.axhline(limit, color=GREY, lw=0.9, ls="--")
        axis.set_yscale("log")
        axis.set_ylim(1e-3, 30)
        axis.set_title(f"Search ends off by, {unit}")
    figure.supxlabel(FLEXION, fontsize=8)
    return figure


def _ranges(flexion, mask) -> list[tuple[float, float]]:
    """First and last flexion of each run of neighbours, widened to half the distance to others."""
    edges = np.concatenate([flexion[:1], 0.5 * (flexion[1:] + flexion[:-1]), flexion[-1:]])
    change = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return [(edges[a], edges[b]) for a, b in change.reshape(-1, 2)]


def _flexion(axis) -> None:
    axis.set_xlim(-2, 92)
    axis.set_xticks(range(0, 91, 30))
