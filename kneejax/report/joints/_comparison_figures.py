"""Clinical measures over flexion, measured and modelled: paper 5's Figure 5."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kneejax.joints import MEASURES
from kneejax.report.look import BLACK, GREY, PARTS, VERMILLION, WIDTH, styled, verbatim

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from kneejax.joints import Comparison

_NAMES = {
    "ML": "Medial-lateral", "AP": "Anterior-posterior", "CD": "Distraction", "AA": "Adduction",
    "IE": "Internal rotation",
}  # fmt: skip
_MOST_COLUMNS = 4
_DENSE = 20


@styled
def joint_comparison_figure(
    found: Comparison,
    flexion_deg: np.ndarray,
    curves: Mapping[str, np.ndarray],
    subject_flexion_deg: np.ndarray | None = None,
) -> Figure:
    """Draw measured points and modelled curves: a row per clinical measure, a column per model.

    Args:
        found: the comparison.
        flexion_deg: of the curves, shape `(m,)`.
        curves: model -> measures over them, shape `(subjects or 1, m, 5)`; NaN leaves a gap. At
            most four models are drawn, the first ones.
        subject_flexion_deg: where each subject was flexed, shape `(subjects, n)`, if not all alike.

    Returns:
        The figure; points that models were calibrated on are filled.
    """
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    names = list(curves)[:_MOST_COLUMNS]
    subjects = len(found.measured)
    shown = found.flexion_deg[None].repeat(subjects, axis=0)
    if subject_flexion_deg is not None:
        shown = subject_flexion_deg
    # One column would leave the page half empty, four need all of it.
    width = {1: 0.55, 2: 0.85}.get(len(names), 1.0) * WIDTH
    figure = Figure(figsize=(width, 8.4))
    panels = figure.subplots(
        len(MEASURES), len(names), sharex=True, sharey="row", squeeze=False
    )
    figure.subplots_adjust(
        left=0.78 / width, right=1.0 - 0.08 / width, top=0.925, bottom=0.055, wspace=0.07,
        hspace=0.12,
    )  # fmt: skip
    for row, measure in enumerate(MEASURES):
        for column, name in enumerate(names):
            axes = panels[row, column]
            _draw_subjects(axes, flexion_deg, curves[name][..., row], shown, found, row)
            if row == 0:
                axes.set_title(_wrapped_title(name, len(names)))
            if column == 0:
                axes.set_ylabel(f"{_NAMES[measure.name]}\n{measure.name}, {measure.unit}")
            if row == len(MEASURES) - 1:
                axes.set_xlabel("Flexion, deg")
    figure.align_ylabels(panels[:, 0])
    handles = [
        Line2D([], [], color=VERMILLION if subjects == 1 else GREY, label="model"),
        Line2D([], [], marker="o", linestyle="none", markersize=4, color=BLACK,
               markerfacecolor="none", label="measured"),
    ]  # fmt: skip
    if not found.compared.all():
        handles.append(
            Line2D([], [], marker="o", linestyle="none", markersize=4, color=BLACK,
                   label="measured, calibrated on")
        )  # fmt: skip
    figure.legend(handles=handles, loc="upper left", ncols=3, bbox_to_anchor=(0.0, 1.0),
                  handlelength=1.6, columnspacing=1.2)  # fmt: skip
    return figure


def _draw_subjects(
    axes: Axes, flexion_deg: np.ndarray, curves: np.ndarray, shown: np.ndarray,
    found: Comparison, row: int,
) -> None:  # fmt: skip
    """A measure of each subject: as it was measured, and as a model's curve."""
    subjects, kept = len(found.measured), ~found.compared
    colors = [BLACK] if subjects == 1 else [PARTS[i % len(PARTS)] for i in range(subjects)]
    size = 3.6 if found.flexion_deg.size <= _DENSE else 2.2
    for i, color in enumerate(colors):
        if i < len(curves):
            line = VERMILLION if subjects == 1 else color if len(curves) > 1 else GREY
            axes.plot(flexion_deg, curves[i], color=line, linewidth=1.2)
        dots = {"marker": "o", "linestyle": "none", "markersize": size, "color": color,
                "markeredgewidth": 0.8}  # fmt: skip
        axes.plot(shown[i], found.measured[i, :, row], markerfacecolor="none", **dots)
        axes.plot(shown[i, kept], found.measured[i, kept, row], **dots)


def _wrapped_title(name: str, columns: int) -> str:
    """A model's name in lines as wide as its column."""
    lines = textwrap.wrap(name.replace("_", " "), 20 if columns > 2 else 30)
    return verbatim("\n".join(lines[:2]))
