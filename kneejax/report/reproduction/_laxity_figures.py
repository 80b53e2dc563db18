"""Laxity of papers 2 and 3, in the layout of their figures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import BLACK, BLUE, GREY, ORANGE, VERMILLION, WIDTH, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.reproduction import Paper2Study, Paper3Study
    from kneejax.reproduction.paper2 import Lachman

#: State of the ACL -> colour and words.
_STATES = {
    "two bundles": (BLUE, "both bundles of the ACL"),
    "one bundle": (ORANGE, "anterior bundle alone"),
    "deficient": (VERMILLION, "without an ACL"),
}


@styled
def lachman_figure(found: Paper2Study) -> Figure:
    """Draw displacement over force in the Lachman test, as Figure 3 of paper 2 does, at rest.

    Args:
        found: the study.

    Returns:
        Two panels, with the printed strains and with the calibrated ones; a square is what the
        paper prints. Where a curve ends early the knee gives way.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 3.4))
    panels = figure.subplots(1, 2, sharey=True)
    figure.subplots_adjust(left=0.08, right=0.985, top=0.91, bottom=0.27, wspace=0.07)
    kinds = (
        (found.printed, "Strains of Table 1"),
        (found.calibrated, f"Collateral strains larger by {found.prestrain:.3f}"),
    )
    for axes, (tests, title) in zip(panels, kinds, strict=True):
        for name, (color, label) in _STATES.items():
            _lachman(axes, found.load_N, tests[name], color, label)
        for size, color in ((8.0, VERMILLION), (2.7, ORANGE)):
            axes.plot(100.0, size, "s", color=color, markerfacecolor="none", zorder=5)
        axes.set_title(title)
        axes.set_xlabel("Anterior force, N")
    panels[0].set_ylabel("Anterior displacement, mm")
    panels[0].set_ylim(bottom=0.0)
    handles, labels = panels[0].get_legend_handles_labels()
    (mark,) = panels[0].plot([], [], "s", color=BLACK, markerfacecolor="none")
    figure.legend(
        [*handles, mark], [*labels, "printed, same colours"], loc="lower center", ncol=4,
        bbox_to_anchor=(0.53, 0.0), fontsize=8,
    )  # fmt: skip
    return figure


def _lachman(axes, load: np.ndarray, test: Lachman, color: str, label: str) -> None:
    axes.plot(load, test.moved, "o-", color=color, markersize=2.5, label=label)
    known = np.flatnonzero(np.isfinite(test.moved))
    if 0 < known.size < load.size:
        axes.plot(load[known[-1]], test.moved[known[-1]], "x", color=color, markersize=7)


@styled
def drawer_figure(found: Paper3Study) -> Figure:
    """Draw force over drawer at each flexion, as Figure 10 of paper 3 does.

    Args:
        found: the study.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, 5.2))
    panels = figure.subplots(2, 2, sharex=True, sharey=True).ravel()
    figure.subplots_adjust(left=0.1, right=0.985, top=0.95, bottom=0.1, wspace=0.07, hspace=0.2)
    for axes, flexion, letter in zip(panels, found.drawer_deg, "abcd", strict=False):
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        axes.axvline(0.0, color=GREY, linewidth=0.5)
        axes.plot(found.moved_mm, found.at(flexion), color=BLACK)
        axes.set_title(f"({letter}) {flexion:g} degrees of flexion")
    for axes in panels[2:]:
        axes.set_xlabel("Anterior drawer from the neutral position, mm")
    for axes in panels[::2]:
        axes.set_ylabel("Anterior force, N")
    return figure


@styled
def torsion_figure(found: Paper3Study) -> Figure:
    """Draw rotation under torque over flexion, as Figure 11 of paper 3 does.

    Args:
        found: the study.

    Returns:
        One panel; a cross stands where the knee does not hold the torque.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH * 0.75, 3.6))
    axes = figure.subplots()
    figure.subplots_adjust(left=0.12, right=0.97, top=0.96, bottom=0.27)
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    x = found.torsion_deg
    ends = (
        (found.internal_deg, BLUE, "internal torque"),
        (found.external_deg, VERMILLION, "external torque"),
    )
    lost = None
    for y, color, label in ends:
        axes.plot(x, y, "o-", color=color, markersize=3, label=f"{label}, {found.torque_Nm:g} N m")
        gone = ~np.isfinite(y)
        if gone.any():
            (lost,) = axes.plot(x[gone], np.zeros(gone.sum()), "x", color=color)
    axes.plot(x, found.total_deg, "s--", color=BLACK, markersize=3, label="total")
    axes.set_xlabel("Flexion, deg")
    axes.set_ylabel("Rotation from the neutral position, deg")
    handles, labels = axes.get_legend_handles_labels()
    if lost is not None:
        handles, labels = [*handles, lost], [*labels, "torque not held"]
    figure.legend(handles, labels, loc="lower center", ncol=len(labels), fontsize=7)
    return figure
