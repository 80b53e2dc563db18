"""What a calibration found: estimates and tests under load in tables, words and figures."""

__all__ = ["parameters_figure", "remark", "tests_figure"]

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, NullLocator
from numpy.typing import ArrayLike

from kneejax.experiments import counts_like_poses, reading_unit
from kneejax.geometry import COORDINATES, OTHER_COLUMNS
from kneejax.inference import Calibration, Estimate, FittedTest, IntervalKind
from kneejax.mechanics import NAMED_LOADS
from kneejax.report import panels as draw
from kneejax.report.look import colours, tables
from kneejax.report.look.colours import BLACK, BLUE, FITS, GREY, LIGHT, VERMILLION
from kneejax.report.look.style import Figure, readable, styled, verbatim
from kneejax.report.look.tables import NONE, Column, Table, number
from kneejax.statics import Status

#: What a kind of interval says on the line of an estimate.
_KINDS = {IntervalKind.NOT_DETERMINED: "not determined", None: "",
          IntervalKind.NOT_COMPUTED: "limits not computed", IntervalKind.PRIOR: "prior alone"}
#: Columns of parameters.csv.
PARAMETER_COLUMNS = ("name", "value", "unit", "start", "lower", "upper", "standard_error",
                     "at_bound", "low", "high", "interval", "remark")  # fmt: skip
_PANEL = 2.9  # inches high
#: Flexions with a curve each that a legend names.
_MOST_NAMED = 8
#: What was compared, by what it is counted from.
_COMPARED = {"unloaded": "Change from the unloaded pose", "intact": "Change from the intact knee",
             "least_load": "Change from the least load", "opposite": "Difference of opposite loads",
             "offset": "Pose in the laboratory's frame",
             "offset_each_flexion": "Pose in the laboratory's frame", "absolute": "Pose",
             "extension": "Change from extension"}  # fmt: skip


def limits(low: float, high: float) -> str:
    """The 95 % limits of an estimate in words, `above 4929`; empty if the data give none."""
    if math.isfinite(low):
        return f"{number(low)} to {number(high)}" if math.isfinite(high) else f"above {number(low)}"
    return f"below {number(high)}" if math.isfinite(high) else ""


def remark(estimate: Estimate) -> str:
    """What a reader must know about an estimate; empty if nothing."""
    kind, untold = estimate.interval, (IntervalKind.NOT_DETERMINED, IntervalKind.NOT_COMPUTED)
    return ": ".join(filter(None, [kind.value if kind in untold else "", reasons(estimate)]))


def reasons(estimate: Estimate) -> str:
    """Why an estimate is where it is, and as sure as it is; empty if nothing is to be said."""
    kind, slack = estimate.interval, estimate.slack
    further = "" if kind is None else ": the data would move it further"
    where = "every pose" if slack == 1.0 else f"{slack:.0%} of the poses"
    which = "limits" if kind is IntervalKind.NOT_COMPUTED else "a limit"
    words = [f"on its bound{further}" if estimate.at_bound else "",
             f"its ligament is slack at {where}" if slack > 0 else "",
             "known from the prior alone" if kind is IntervalKind.PRIOR else "",
             f"{which} could not be computed: {estimate.reason}" if estimate.reason else ""]
    return "; ".join(filter(None, words))


def estimates_table(calibration: Calibration, note: str = "") -> Table:
    """Estimates as people read them: a row for each parameter, then for each offset of a frame."""
    heads = ("parameter", "value", "std. error", "unit", "95 % limits", "remark", "truth", "start",
             "lower", "upper")  # fmt: skip
    fit, rows = calibration.fit, []
    for e in (*fit.estimates, *fit.offsets):
        sure = e.interval is not None and math.isfinite(e.standard_error)
        value, error = tables.with_error(e.value, e.standard_error if sure else math.nan)
        known = "" if e.interval is None else limits(e.low, e.high) or NONE
        words = [_KINDS.get(e.interval, ""), "at bound" * e.at_bound]
        name = e.name if e in fit.estimates else f"offset {e.name}"
        rows.append([name, value, f"\u00b1 {error}" if sure else "", e.unit, known,
                     ", ".join(filter(None, words)),
                     tables.trimmed(calibration.truth.get(e.name, math.nan)),
                     *map(tables.trimmed, (e.start, e.lower, e.upper))])  # fmt: skip
    seen = [i for i, head in enumerate(heads) if any(row[i] for row in rows)]
    seen = [i for i in seen if calibration.truth or heads[i] != "truth"]
    words = ("parameter", "unit", "95 % limits", "remark")
    columns = [Column(head, " " if head == "remark" else head, words=head in words)
               for head in (heads[i] for i in seen)]  # fmt: skip
    return Table(columns, [[row[i] for i in seen] for row in rows], note=note,
                 spare=("lower upper", "start", "truth"))  # fmt: skip


def parameter_document(e: Estimate) -> dict[str, Any]:
    """The numbers of an estimate for result.json; NaN where there is none."""
    names = ("value", "start", "lower", "upper", "standard_error", "at_bound", "low", "high")
    numbers = {n: (bool if n == "at_bound" else float)(getattr(e, n)) for n in names}
    return numbers | {"interval": None if e.interval is None else e.interval.value}


def parameters_table(calibration: Calibration) -> Table:
    """The table of parameters.csv."""
    named = [("", e) for e in calibration.fit.estimates]
    named += [("frame_offset.", e) for e in calibration.fit.offsets]
    every = [{**parameter_document(e), "name": of + e.name, "unit": e.unit, "remark": remark(e)}
             for of, e in named]  # fmt: skip
    return Table(PARAMETER_COLUMNS, [[one[name] for name in PARAMETER_COLUMNS] for one in every])


@styled
def parameters_figure(calibration: Calibration) -> Figure:
    """Draw each parameter between its bounds: start, estimate with its error, truth if known.

    Args:
        calibration: what to draw; small rings are the other procedures.

    Returns:
        One panel per quantity (stiffness, reference strain, ...), one row per parameter.
    """
    groups = tables.grouped(((e.name.partition(".")[2] or e.name, e.unit), e)
                     for e in calibration.fit.estimates)  # fmt: skip
    columns, sizes = min(2, len(groups)) or 1, [len(group) for group in groups.values()] or [1]
    depths = [0.42 * max(sizes[i : i + columns]) for i in range(0, len(sizes), columns)]
    rows = len(depths)
    longest = max((len(e.name.partition(".")[0]) for e in calibration.fit.estimates), default=4)
    left = min(max(0.5, 0.064 * longest + 0.12), 2.1)
    figure, panels = draw.grid(rows, columns, sum(depths) + (rows - 1) * 0.55 + 0.75, left=left,
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
        draw.name_rows(axes, y, [verbatim(e.name.partition(".")[0]) for e in group])
    draw.figure_legend(figure, handles, loc="upper left", bbox_to_anchor=(0.06, 1.0),
                       columnspacing=1.5, handletextpad=0.5, handlelength=1.4, fontsize=7.5,
                       borderaxespad=0.2)  # fmt: skip
    return figure


@styled
def correlation_matrix_figure(parameters: Sequence[str], correlation: ArrayLike) -> Figure:
    """Draw a matrix of correlations; parameters without any are hatched."""
    matrix, names = np.array(correlation, float), [readable(name) for name in parameters]
    n, longest = len(names), max(map(len, names), default=8)
    side, margin = min(max(0.44 * n, 1.6), 5.0), 0.062 * longest + 0.12
    below = 0.05 * longest + 0.15
    figure, ((axes,),) = draw.grid(1, 1, side + 0.3 + below, width=margin + side + 1.5, left=margin,
                              right=1.5, bottom=below)  # fmt: skip
    axes.set_facecolor(LIGHT)
    shades = colours.both_signs()
    # Black is the more legible on all but dark blue.
    draw.draw_matrix(axes, np.where(np.eye(n, dtype=bool), np.nan, matrix), shades, (-1, 1),
                "{:.2f}".format, lambda value: value < -0.8, names, names, numbers=n <= 16,
                size=7.5 if n <= 20 else 5.5)  # fmt: skip
    for label in axes.get_xticklabels():
        label.set(rotation=45, ha="right", rotation_mode="anchor")
    for i in np.flatnonzero(np.isnan(matrix).all(axis=1)):
        for corner, size in (((0, i), (n, 1)), ((i, 0), (1, n))):
            draw.hatched(axes, corner, *size, "////")
    axes.set_title("Correlation of the estimates")
    keys = [Rectangle((0, 0), 1, 1, facecolor=shades(0.5 + value / 2), edgecolor="#A0A0A0", lw=0.4)
            for value in (1.0, 0.5, 0.0, -0.5, -1.0)] + list(axes.patches[-1:])  # fmt: skip
    words = ["+1", "+0.5", "0", "\u22120.5", "\u22121", "not determined"]
    axes.legend(keys, words[: len(keys)], loc="upper left", bbox_to_anchor=(1.03, 1.0),
                borderaxespad=0, handlelength=1.2, handleheight=1.2, fontsize=7.5)  # fmt: skip
    return figure


@styled
def convergence_figure(calibration: Calibration) -> Figure:
    """Draw the objective against simulated motions, with a marker shape for each stage."""
    figure, ((axes,),) = draw.grid(1, 1, 3.1, left=0.67)
    begun = calibration.start_objective
    objectives = [begun, *(step.objective for fit in calibration.fits for step in fit.history)]
    positive = [value for value in objectives if math.isfinite(value) and value > 0] or [1.0]
    top, bottom = max(positive), min(positive)
    shapes, reached, most = "os^Dv", 1, 0
    handles = axes.plot(1, max(begun, bottom), "o", color=BLUE, markersize=4.5, label="start")
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
    handles += [Line2D([], [], color=GREY, marker=shapes[j % 5], ls="none", ms=4,
                       mfc="white" if j else GREY, label=f"stage {j + 1}")
                for j in range(most if most > 1 else 0)]  # fmt: skip
    axes.set(yscale="log", ylim=(bottom / 1.6, top * 1.6), xlabel="Simulated motions",
             title="Objective (weighted sum of squares)")  # fmt: skip
    # Between the powers of ten too where there are few decades.
    subs = (1.0, 2.0, 5.0) if math.log10(top / bottom) < 2.1 else (1.0,)
    draw.decades(axes.yaxis, 7, subs)
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


def laxity_errors(calibration: Calibration) -> list[dict[str, Any]]:
    """RMSE of each coordinate of a test: of all readings (`flexion_deg` None), and by flexion."""
    found = []
    for own, before, name in _compared(calibration):
        seen = np.isfinite(own.compared[name][0])
        for flexion in (None, *np.unique(own.test.curve_deg[seen]).tolist()):
            rows = seen if flexion is None else seen & (own.test.curve_deg == flexion)
            found.append({"test": own.test.name, "flexion_deg": flexion, "coordinate": name,
                          "readings": int(rows.sum()), "start": before.rmse(name, flexion),
                          "fitted": own.rmse(name, flexion)})  # fmt: skip
    return found


def _compared(calibration: Calibration) -> list[tuple[FittedTest, FittedTest, str]]:
    """Each test as it is fitted and at the start, with each coordinate that it compares."""
    pairs = zip(calibration.fit.tests, calibration.start_tests, strict=True)
    return [(own, before, name) for own, before in pairs for name in own.compared]


def errors_table(calibration: Calibration) -> Table:
    """`laxity_errors` as people read them; of a single reading tests.csv has the reading itself."""
    columns = [Column("test", "test under load"), "coordinate", Column("flexion", "flexion, deg"),
               "readings", Column("start", "start RMSE", "3"), Column("fitted", show="3"), "change"]
    rows = []
    for one in laxity_errors(calibration):
        test, flexion, name, readings, *errors = one.values()
        label, unit = label_of(name), unit_of(name)
        place = [test, f"{label[:1].upper()}{label[1:]}" + f", {unit}" * bool(unit), "all"]
        place = place if flexion is None else ["", "", f"{flexion:g}"]
        if flexion is None or readings > 1:
            rows.append([*place, readings, *errors, tables.change(*errors)])
    return Table(columns, rows)


def reading_table(calibration: Calibration) -> Table:
    """The table of tests.csv: every reading of every test beside what the knee does."""
    tests = [own.test for own in calibration.fit.tests]
    lines = tuple(dict.fromkeys(line for test in tests for line in test.tensions))
    pulls = (f"{line}.tension_N" for line in lines)
    timed = any(test.frames is not None for test in tests)
    header = ("test", *("time_s",) * timed, "flexion_deg", *NAMED_LOADS, *pulls, "coordinate",
              "unit", "counted_from", "measured", "start", "fitted", "status")  # fmt: skip
    rows = []
    for own, before in zip(calibration.fit.tests, calibration.start_tests, strict=True):
        test, nothing = own.test, np.zeros(len(own.test.flexion_deg))
        acting = [test.loads.get(name, nothing) + test.constant.get(name, 0.0)
                  for name in NAMED_LOADS]  # fmt: skip
        acting += [test.tensions.get(line, nothing) for line in lines]
        rows += [
            [test.name, *["" if test.frames is None else test.frames.time_s[row]] * timed,
             test.flexion_deg[row], *(size[row] for size in acting), name, unit_of(name),
             test.counted_from if name in COORDINATES or counts_like_poses(name) else "absolute",
             measured[row], before.compared[name][1][row], fitted[row],
             Status(int(own.status[row])).word]
            for row in range(len(test.flexion_deg))
            for name, (measured, fitted) in own.compared.items()
            if np.isfinite(measured[row])
        ]  # fmt: skip
    return Table(header, rows)


def unit_of(name: str) -> str:
    """Of a coordinate, or of a reading; a strain has none."""
    return COORDINATES[name].unit if name in COORDINATES else reading_unit(name)


def label_of(name: str) -> str:
    """Of a coordinate, or of what was read of a part, within a sentence."""
    if known := COORDINATES.get(name) or OTHER_COLUMNS.get(name):
        return known.phrase
    part, _, kind = name.rpartition(".")
    words = {"tension_N": "tension", "contact_N": "contact force"}
    return f"{part} {words.get(kind, kind)}"


@styled
def tests_figure(calibration: Calibration) -> Figure:
    """Draw measured tests, and what the knee does in them at the start and fitted.

    Args:
        calibration: with tests.

    Returns:
        A panel for each coordinate of each test. Load over displacement, a colour for each flexion;
        over flexion where there is one reading at each, over time of a knee in motion.
    """
    panels = _compared(calibration)
    figure, every = draw.grid(len(panels), 1, _PANEL * len(panels) + 0.35, left=0.7, right=1.54,
                         apart=(0, 0.9))  # fmt: skip
    for axes, (own, before, name) in zip(every[:, 0], panels, strict=True):
        test, (measured, fitted) = own.test, own.compared[name]
        loaded = any(np.ptp(size) > 0 for size in test.loads.values())
        along = test.curve_deg if loaded else test.flexion_deg
        seen = np.isfinite(measured)
        moved = _COMPARED[test.counted_from]
        if name.endswith(("_N", ".strain")):
            change = test.counts_from_rest and name.endswith(".strain")
            moved = label_of(name) + ", change" * change
        moved += f", {unit_of(name) or '-'}"
        across, label = test.flexion_deg, "Flexion, deg"
        if test.frames is not None:
            across, label = test.frames.time_s, "Time, s"
        if test.frames is not None or len(np.unique(along[seen])) == seen.sum() > 1:
            order = np.flatnonzero(seen)[np.argsort(across[seen])]
            start, curve = before.compared[name][1][order], fitted[order]
            axes.plot(across[order], start, ":", color=BLACK, linewidth=0.9)
            axes.plot(across[order], curve, color=BLACK)
            axes.plot(across[order], measured[order], "o", color=BLACK, markersize=3)
            axes.set(xlabel=label, ylabel=moved)
        else:
            flexions, load = np.unique(test.curve_deg), test.loads[test.driven_by]
            step, shades = max(1, -(-len(flexions) // _MOST_NAMED)), colours.shades(len(flexions))
            for k, (flexion, color) in enumerate(zip(flexions, shades, strict=True)):
                rows = np.flatnonzero(test.curve_deg == flexion)
                rows = rows[np.argsort(load[rows], kind="stable")]
                named = f"{flexion:g}" if k % step == 0 else None
                axes.plot(*_curve(before, rows, name, load), ":", color=color, linewidth=0.9)
                axes.plot(*_curve(own, rows, name, load), color=color, label=named)
                axes.plot(measured[rows], load[rows], "o", color=color, markersize=3)
            kind = NAMED_LOADS[test.driven_by]
            axes.set(xlabel=moved, ylabel=f"{kind.positive.capitalize()}, {kind.unit}")
            axes.axvline(0.0, color=GREY, linewidth=0.5)
            legend = {"title": "Flexion, deg", "title_fontsize": 8, "handlelength": 1.6}
            axes.add_artist(draw.part_legend(axes, draw.labelled(axes), (1.02, 1.02), **legend))
        styles = {"measured": {"marker": "o", "markersize": 3, "linestyle": "none"}, "fitted": {},
                  "start": {"linestyle": ":", "linewidth": 0.9}}  # fmt: skip
        kinds = {name: axes.plot([], [], color=GREY, **style)[0] for name, style in styles.items()}
        draw.part_legend(axes, kinds, (1.02, -0.02), loc="lower left", handlelength=1.6)
        cut = f", {' and '.join(test.cut)} cut" if test.cut else ""
        axes.set_title(verbatim(f"{test.name}: {label_of(name)}{cut}"))
        if test.counted_from != "absolute":
            axes.axhline(0.0, color=GREY, linewidth=0.5)
    return figure


def _curve(one: FittedTest, rows: np.ndarray, name: str, load: np.ndarray):
    """A curve from its readings, and from the unloaded pose that counts as zero."""
    measured, fitted = (each[rows] for each in one.compared[name])
    drawn = np.isfinite(measured)
    x, y = fitted[drawn], load[rows][drawn]
    if one.test.counted_from == "unloaded" and not name.endswith("_N"):
        place = int(np.searchsorted(y, 0.0))
        x, y = np.insert(x, place, 0.0), np.insert(y, place, 0.0)
    return x, y
