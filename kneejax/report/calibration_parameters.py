"""Estimates of a calibration: table, limits in words, figures."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import ArrayLike

from kneejax.inference import Calibration, Estimate, IntervalKind
from kneejax.report.look.colours import BLUE, FITS, GREY, LIGHT, VERMILLION, both_signs
from kneejax.report.look.style import Figure, readable, styled, verbatim
from kneejax.report.look.tables import NONE, Column, Table, grouped, number, trimmed, with_error
from kneejax.report.panels import decades, draw_matrix, figure_legend, grid, hatched, name_rows

#: What a kind of interval says on the line of an estimate.
_KINDS = {IntervalKind.NOT_DETERMINED: "not determined", None: "",
          IntervalKind.NOT_COMPUTED: "limits not computed", IntervalKind.PRIOR: "prior alone"}
#: Columns of parameters.csv.
PARAMETER_COLUMNS = ("name", "value", "unit", "start", "lower", "upper", "standard_error",
                     "at_bound", "low", "high", "interval", "remark")  # fmt: skip


def limits(low: float, high: float, digits: int = 4) -> str:
    """The 95 % limits of an estimate in words; empty if the data give none.

    Example:
        >>> limits(4127.0, 6081.0), limits(4929.0, float("nan"))
        ('4127 to 6081', 'above 4929')
    """
    if math.isfinite(low) and math.isfinite(high):
        return f"{number(low, digits)} to {number(high, digits)}"
    if math.isfinite(low):
        return f"above {number(low, digits)}"
    return f"below {number(high, digits)}" if math.isfinite(high) else ""


def remark(estimate: Estimate) -> str:
    """What a reader must know about an estimate; empty if nothing."""
    kind, untold = estimate.interval, (IntervalKind.NOT_DETERMINED, IntervalKind.NOT_COMPUTED)
    return ": ".join(filter(None, [kind.value if kind in untold else "", reasons(estimate)]))


def reasons(estimate: Estimate) -> str:
    """Why an estimate is where it is, and as sure as it is; empty if nothing is to be said."""
    words = []
    if estimate.at_bound:
        further = "" if estimate.interval is None else ": the data would move it further"
        words.append(f"on its bound{further}")
    if estimate.slack > 0:
        where = "every pose" if estimate.slack == 1.0 else f"{estimate.slack:.0%} of the poses"
        words.append(f"its ligament is slack at {where}")
    if estimate.interval is IntervalKind.PRIOR:
        words.append("known from the prior alone")
    if estimate.reason:
        which = "limits" if estimate.interval is IntervalKind.NOT_COMPUTED else "a limit"
        words.append(f"{which} could not be computed: {estimate.reason}")
    return "; ".join(words)


def estimates_table(calibration: Calibration, note: str = "") -> Table:
    """Estimates as people read them: a row for each parameter, then for each offset of a frame."""
    heads = ("parameter", "value", "std. error", "unit", "95 % limits", "", "truth", "start",
             "lower", "upper")  # fmt: skip
    fit, rows = calibration.fit, []
    for e in (*fit.estimates, *fit.offsets):
        sure = e.interval is not None and math.isfinite(e.standard_error)
        value, error = with_error(e.value, e.standard_error if sure else math.nan)
        known = "" if e.interval is None else limits(e.low, e.high) or NONE
        words = [_KINDS.get(e.interval, ""), "at bound" * e.at_bound]
        name = e.name if e in fit.estimates else f"offset {e.name}"
        rows.append([name, value, f"\u00b1 {error}" if sure else "", e.unit, known,
                     ", ".join(filter(None, words)),
                     trimmed(calibration.truth.get(e.name, math.nan)),
                     *map(trimmed, (e.start, e.lower, e.upper))])  # fmt: skip
    seen = [i for i, head in enumerate(heads) if any(row[i] for row in rows)]
    seen = [i for i in seen if calibration.truth or heads[i] != "truth"]
    words = ("parameter", "unit", "95 % limits", "")
    columns = [Column(heads[i] or "remark", heads[i] or " ", words=heads[i] in words) for i in seen]
    return Table(columns, [[row[i] for i in seen] for row in rows], note=note,
                 spare=("lower upper", "start", "truth"))  # fmt: skip


def parameter_document(e: Estimate) -> dict[str, Any]:
    """The numbers of an estimate for result.json; NaN where there is none."""
    names = ("value", "start", "lower", "upper", "standard_error", "at_bound", "low", "high")
    numbers = {n: (bool if n == "at_bound" else float)(getattr(e, n)) for n in names}
    return numbers | {"interval": None if e.interval is None else e.interval.value}


def parameters_table(calibration: Calibration) -> Table:
    """The table of parameters.csv."""
    fit = calibration.fit
    named = [(e.name, e) for e in fit.estimates]
    named += [(f"frame_offset.{e.name}", e) for e in fit.offsets]
    every = [{**parameter_document(e), "name": name, "unit": e.unit, "remark": remark(e)}
             for name, e in named]  # fmt: skip
    words = ("name", "unit", "interval", "remark")
    columns = [Column(name, words=name in words) for name in PARAMETER_COLUMNS]
    return Table(columns, [[one[name] for name in PARAMETER_COLUMNS] for one in every])


@styled
def parameters_figure(calibration: Calibration) -> Figure:
    """Draw each parameter between its bounds: start, estimate with its error, truth if known.

    Args:
        calibration: what to draw; small rings are the other procedures.

    Returns:
        One panel per quantity (stiffness, reference strain, ...), one row per parameter.
    """
    groups = grouped(((e.name.partition(".")[2] or e.name, e.unit), e)
                     for e in calibration.fit.estimates)  # fmt: skip
    columns, sizes = min(2, len(groups)) or 1, [len(group) for group in groups.values()] or [1]
    depths = [0.42 * max(sizes[i : i + columns]) for i in range(0, len(sizes), columns)]
    rows = len(depths)
    longest = max((len(e.name.partition(".")[0]) for e in calibration.fit.estimates), default=4)
    left = min(max(0.5, 0.064 * longest + 0.12), 2.1)
    figure, panels = grid(rows, columns, sum(depths) + (rows - 1) * 0.55 + 0.75, left=left,
                          right=0.1, top=0.5, bottom=0.25, apart=(left + 0.1, 0.55),
                          shown=len(groups), height_ratios=depths)  # fmt: skip
    handles: dict[str, Any] = {}
    hollow: dict[str, Any] = {"markerfacecolor": "none"}
    for axes, ((quantity, unit), group) in zip(panels.flat, groups.items(), strict=False):
        title = quantity.replace(".", " ").replace("_", " ").capitalize()
        axes.set_title(verbatim(f"{title}, {unit}" if unit else title))
        y = np.arange(len(group), dtype=float)
        values, starts, lower, upper = np.array([(e.value, e.start, e.lower, e.upper)
                                                 for e in group]).T
        truth = np.array([calibration.truth.get(e.name, np.nan) for e in group])
        ends = np.concatenate([values, starts, truth, lower, upper])
        ends = ends[np.isfinite(ends)]
        low, high = (np.min(ends), np.max(ends)) if ends.size else (0.0, 1.0)
        pad = 0.04 * (high - low) or 1.0
        bounded = np.isfinite(lower) & np.isfinite(upper)
        if bounded.any():
            handles["bounds"] = axes.barh(y[bounded], (upper - lower)[bounded], 0.5, lower[bounded],
                                          color=LIGHT)  # fmt: skip
        (handles["start"],) = axes.plot(starts, y, "o", color=BLUE, markersize=4.5)
        for row, e in enumerate(group):
            # A cap at each limit; where there is none the line runs to the bound, with an arrow.
            known = np.isfinite([e.low, e.high])
            ends = np.where(known, [e.low, e.high], [e.lower, e.upper])
            if known.any():
                style = {"color": VERMILLION, "markersize": 5, "markeredgewidth": 1.2}
                axes.plot(ends, [row, row], color=VERMILLION, linewidth=1.3, solid_capstyle="butt")
                for end, closed, arrow in zip(ends, known, "<>", strict=True):
                    axes.plot(end, row, "|" if closed else arrow, **style)
            words = ["at bound"] * e.at_bound
            words += ["not determined"] * (e.interval is IntervalKind.NOT_DETERMINED)
            axes.text(high, row - 0.27, ", ".join(words), fontsize=7, color=VERMILLION, ha="right",
                      va="bottom", style="italic")  # fmt: skip
        (handles["estimate and 95 % limits"],) = axes.plot(values, y, "s", color=VERMILLION,
                                                           markersize=4)  # fmt: skip
        for i, fit in enumerate(calibration.fits[1:], 1):
            others = {e.name: e.value for e in fit.estimates}
            (handles[verbatim(f"procedure {fit.procedure}")],) = axes.plot(
                [others.get(e.name, np.nan) for e in group], y + 0.2, "^" if i % 2 else "v",
                color=FITS[i % len(FITS)], markersize=3.5, **hollow,
            )  # fmt: skip
        if calibration.truth:
            (handles["truth"],) = axes.plot(truth, y, "D", color="black", markersize=6, **hollow)
        axes.set(xlim=(low - pad, high + pad), ylim=(len(group) - 0.5, -0.62))
        name_rows(axes, y, [verbatim(e.name.partition(".")[0]) for e in group])
    figure_legend(figure, handles, loc="upper left", bbox_to_anchor=(0.06, 1.0), columnspacing=1.5,
                  handletextpad=0.5, handlelength=1.4, fontsize=7.5, borderaxespad=0.2)  # fmt: skip
    return figure


@styled
def correlation_matrix_figure(parameters: Sequence[str], correlation: ArrayLike) -> Figure:
    """Draw a matrix of correlations; parameters without any are hatched."""
    matrix, names = np.array(correlation, float), [readable(name) for name in parameters]
    n, longest = len(names), max(map(len, names), default=8)
    side, margin = min(max(0.44 * n, 1.6), 5.0), 0.062 * longest + 0.12
    below = 0.05 * longest + 0.15
    figure, ((axes,),) = grid(1, 1, side + 0.3 + below, width=margin + side + 1.5, left=margin,
                              right=1.5, bottom=below)  # fmt: skip
    axes.set_facecolor(LIGHT)
    colours = both_signs()
    # Black is the more legible on all but dark blue.
    draw_matrix(axes, np.where(np.eye(n, dtype=bool), np.nan, matrix), colours, (-1, 1),
                "{:.2f}".format, lambda value: value < -0.8, names, names, numbers=n <= 16,
                size=7.5 if n <= 20 else 5.5)  # fmt: skip
    for label in axes.get_xticklabels():
        label.set(rotation=45, ha="right", rotation_mode="anchor")
    for i in np.flatnonzero(np.isnan(matrix).all(axis=1)):
        for corner, size in (((0, i), (n, 1)), ((i, 0), (1, n))):
            hatched(axes, corner, *size, "////")
    axes.set_title("Correlation of the estimates")
    keys = [Rectangle((0, 0), 1, 1, facecolor=colours(0.5 + value / 2), edgecolor="#A0A0A0", lw=0.4)
            for value in (1.0, 0.5, 0.0, -0.5, -1.0)] + list(axes.patches[-1:])  # fmt: skip
    words = ["+1", "+0.5", "0", "\u22120.5", "\u22121", "not determined"]
    axes.legend(keys, words[: len(keys)], loc="upper left", bbox_to_anchor=(1.03, 1.0),
                borderaxespad=0, handlelength=1.2, handleheight=1.2, fontsize=7.5)  # fmt: skip
    return figure


@styled
def convergence_figure(calibration: Calibration) -> Figure:
    """Draw the objective against simulated motions, with a marker shape for each stage."""
    figure, ((axes,),) = grid(1, 1, 3.1, left=0.67)
    begun = calibration.start_objective
    objectives = [begun, *(step.objective for fit in calibration.fits for step in fit.history)]
    positive = [value for value in objectives if math.isfinite(value) and value > 0] or [1.0]
    top, bottom = max(positive), min(positive)
    shapes, reached, most = "os^Dv", 1, 0
    (start,) = axes.plot(1, max(begun, bottom), "o", color=BLUE, markersize=4.5, label="start")
    handles = [start]
    for i, fit in enumerate(calibration.fits):
        color = FITS[i % len(FITS)]
        x = [1, *(max(step.evaluations, 1) for step in fit.history)]
        y = [max(value, bottom) for value in (begun, *(step.objective for step in fit.history))]
        reached = max(reached, x[-1])
        axes.plot(x, y, "-", color=color, linewidth=1.1, drawstyle="steps-post")
        stages = list(dict.fromkeys(step.stage for step in fit.history))
        most = max(most, len(stages))
        for k, step in enumerate(fit.history, 1):
            j = stages.index(step.stage)
            axes.plot(x[k], y[k], shapes[j % 5], color=color, markersize=4,
                      markerfacecolor="white" if j else color)  # fmt: skip
        word = verbatim(f"procedure {fit.procedure}") if len(calibration.fits) > 1 else "fit"
        word += "" if fit.success else " (not converged)"
        handles.append(Line2D([], [], color=color, label=word))
    for j in range(most if most > 1 else 0):
        handles.append(Line2D([], [], color=GREY, marker=shapes[j % 5], ls="none", ms=4,
                              mfc="white" if j else GREY, label=f"stage {j + 1}"))  # fmt: skip
    axes.set(yscale="log", ylim=(bottom / 1.6, top * 1.6), xlabel="Simulated motions",
             title="Objective (weighted sum of squares)")  # fmt: skip
    # Between the powers of ten too where there are few decades.
    subs = (1.0, 2.0, 5.0) if math.log10(top / bottom) < 2.1 else (1.0,)
    decades(axes.yaxis, 7, subs)
    if reached > 300:
        axes.set_xscale("log")
        axes.xaxis.set_minor_locator(NullLocator())
        ticks = sorted(t * 10**k for t in (1, 2, 5) for k in range(int(math.log10(reached)) + 1))
        axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
        axes.set_xlim(0.9, reached * 1.25)
    else:
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.legend(handles=handles, loc="best", borderaxespad=0.8, fontsize=7.5, handlelength=1.5)
    return figure
