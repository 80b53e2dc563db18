"""Sweeps (paper 1, Figures 3 to 10), derivatives, Sobol and Morris indices as figures."""

__all__ = ["local_curves_figure", "local_heatmap_figure", "sweep_figure"]

from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import LocalSensitivity, MotionIndices, Sweep, Sweeps
from kneejax.report import panels as draw
from kneejax.report.look import colours
from kneejax.report.look.colours import BLUE, GREY, VERMILLION
from kneejax.report.look.style import SHOWN, Axes, Figure, readable, styled
from kneejax.report.look.tables import trimmed
from kneejax.statics import Status, converged

_OF_FIBRES = (Status.OVERSTRETCHED, Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE)
#: Poses that are not drawn as if they were fine: legend entry, dashes of the line, marker.
_DOUBTFUL = {"outside fitted surfaces": ((0, (3, 1.2)), ""),
             "a fibre torn or its way wrong": ((0, (5, 1.2)), "^"),
             "unphysiological": ((0, (1, 1)), "v"), "unstable": ((0, (1, 1)), "+")}  # fmt: skip
_NOWHERE = "no balance"
#: Scale -> what follows the unit on an axis, and what one step of a parameter is.
_PER = {"prior": "per prior SD", "percent": "per %"}
_STEP = {"prior": "one standard deviation of each parameter's prior",
         "percent": "1 % of each value (0.01 of a reference strain)"}  # fmt: skip
#: Dashes and hatches of the quantities, in the order in which they come.
_DASHES = ("-", (0, (4, 1.5)), (0, (1, 1)), (0, (5, 1.2, 1, 1.2)))
_HATCHES = ("", "/////", ".....", "xxxxx")
#: Parameters that one panel can show as curves or bars; rows of a heat map.
_MOST_PARAMETERS, _MOST_ROWS = 12, 40
#: Method -> its two measures and how an axis calls them; what its bars measure.
_MEASURES = {"sobol": {"total_order": "total order", "first_order": "first order"},
             "morris": {"mu_star": "mean size of the effect", "sigma": "its standard deviation"}}
_AXIS = {"sobol": "Share of the variance", "morris": "Change over a parameter's range"}


def faults_of(sweep: Sweep) -> tuple[np.ndarray, ...]:
    """Outside surfaces, of fibres, not those of a knee, unstable, without a balance."""
    strange = sweep.unphysiological | (sweep.status == Status.DISLOCATED)
    return (sweep.status == Status.OUTSIDE_REGION, np.isin(sweep.status, _OF_FIBRES), strange,
            sweep.status == Status.UNSTABLE, ~converged(sweep.status))  # fmt: skip


@styled
def sweep_figure(
    sweeps: Sweeps, name: str, measured: np.ndarray | None = None, moved: bool = False
) -> Figure:
    """Draw the motion over one parameter.

    Args:
        sweeps: with that parameter among them.
        name: the parameter.
        measured: poses `(n, 6)`, degrees and mm, drawn in black.
        moved: whether constants were added to it because its frames are not known; said so.

    Returns:
        Translations on the left, rotations on the right, a line per value, coloured low to high.
        Poses that are not balanced, not stable or not those of a knee are dashed, dotted or left
        out, marked, and counted in the legend.
    """
    sweep, flexion = sweeps[name], sweeps.flexion_deg
    figure, panels, words = draw.coordinate_panels(flexion)
    scale = ScalarMappable(Normalize(sweep.values[0], sweep.values[-1]), colours.uniform_colours())
    handles: dict[str, Any] = {}
    # Legend entry -> poses, the worst that applies to each.
    outside, of_fibres, strange, unstable, nowhere = faults_of(sweep)
    strange &= ~unstable & ~nowhere
    kinds = (outside & ~strange, of_fibres & ~strange, strange, unstable, nowhere)
    faults = dict(zip((*_DOUBTFUL, _NOWHERE), kinds, strict=True))
    lost, fine = nowhere.any(axis=0), ~np.any(kinds, axis=0)
    given = "measured, moved onto the knee itself" if moved else "measured"
    own = f"the knee itself ({f'{trimmed(sweep.own)} {sweep.unit}'.strip()})"
    for coordinate, axes in panels.items():
        column = FREE_COORDINATES.index(coordinate)
        for i, value in enumerate(sweep.values):
            # Solid where it is sound, otherwise in the dashes of what is wrong.
            y, colour = sweep.table[i, :, column], scale.to_rgba(value)
            axes.plot(flexion, np.where(fine[i], y, np.nan), color=colour, linewidth=0.8)
            for entry, (dashes, marker) in _DOUBTFUL.items():
                rows = faults[entry][i]
                if rows.any():
                    # From a pose at fault to its neighbours, too.
                    beside = rows | np.r_[rows[1:], False] | np.r_[False, rows[:-1]]
                    axes.plot(flexion, np.where(beside, y, np.nan), color=colour, linewidth=1.0,
                              linestyle=dashes)  # fmt: skip
                    axes.plot(flexion[rows], y[rows], marker=marker or "none", color=colour,
                              markersize=3, markeredgewidth=0.8, linestyle="none")  # fmt: skip
        if lost.any():
            draw.mark_edge(axes, flexion[lost], "x", GREY)
        seen = [sweep.table[..., column][sweep.sound], sweeps.table[:, column]]
        (line,) = axes.plot(flexion, seen[1], "--", color=VERMILLION, linewidth=1.8)
        if measured is not None:
            style = {**draw.measured_curve(measured[:, 0]), "markersize": 2.2}
            (handles[given],) = axes.plot(measured[:, 0], measured[:, column + 1], **style)
            seen.append(measured[:, column + 1])
        handles[own] = line
        numbers = np.concatenate(seen)
        if np.isfinite(numbers).any():
            # What a working knee does fills the panel; what flies off may leave it.
            least, most = np.nanmin(numbers), np.nanmax(numbers)
            pad = 0.07 * max(most - least, 1.0)
            axes.set_ylim(least - pad, most + pad)
    for entry, (dashes, marker) in (_DOUBTFUL | {_NOWHERE: ("none", "x")}).items():
        if (rows := faults[entry]).any():
            style = {"color": GREY, "linewidth": 0.8, "linestyle": dashes, "markersize": 3.5}
            label = f"{entry}: {rows.sum()} of {rows.size} poses"
            handles[label] = Line2D([], [], marker=marker or "none", **style)
    draw.part_legend(words, handles, (0.0, 0.86), fontsize=8, handlelength=2.6, labelspacing=0.35)
    bar = draw.colour_bar(figure, words.inset_axes((0.0, 0.06, 0.97, 0.075)), scale,
                          readable(sweep.name, sweep.unit))  # fmt: skip
    if sweep.values[0] <= sweep.own <= sweep.values[-1]:
        place = {"clip_on": False, "transform": bar.ax.get_xaxis_transform()}
        bar.ax.plot([sweep.own], [1.12], "v", color=VERMILLION, markersize=5, **place)
    return figure


def _largest_shares(size: np.ndarray, most: int) -> list[int]:
    """Columns of `(outputs, p)` with the largest share in any output, in their own order."""
    size = np.nan_to_num(np.abs(size))
    share = (size / np.maximum(size.max(axis=1, keepdims=True), 1e-300)).max(axis=0)
    return sorted(np.argsort(-share, kind="stable")[:most].tolist())


@styled
def local_curves_figure(local: LocalSensitivity) -> Figure:
    """Draw the derivative of every coordinate with respect to every parameter over flexion.

    Args:
        local: what to draw; of more than twelve parameters, those that move the knee most.

    Returns:
        Translations on the left, rotations on the right, a line per parameter: the colour is its
        ligament's, the dashes are its quantity's.
    """
    figure, panels, words = draw.coordinate_panels(local.flexion_deg)
    shown = _largest_shares(local.largest()[0], _MOST_PARAMETERS)
    styles = colours.parameter_styles([local.names[i] for i in shown])
    drawn, marks = {}, {}
    for coordinate, axes in panels.items():
        axes.set_title(f"{COORDINATES[coordinate].axis_label} {_PER[local.scale]}")
        axes.axhline(0.0, color=GREY, linewidth=0.7)
        for i, (colour, quantity) in zip(shown, styles, strict=True):
            slope = local.scaled[:, FREE_COORDINATES.index(coordinate), i]
            (drawn[readable(local.names[i])],) = axes.plot(
                local.flexion_deg, slope, color=colour, linestyle=_DASHES[quantity % len(_DASHES)]
            )
        marks |= draw.mark_status(axes, local.flexion_deg, local.status)
    drawn |= marks
    draw.part_legend(words, drawn, (0.0, 0.84), ncols=2 if len(drawn) > 5 else 1, handlelength=2.6,
                     labelspacing=0.5 if len(drawn) <= 10 else 0.22)  # fmt: skip
    left_out = len(local.names) - len(shown)
    note = f"; {left_out} that move it less are not shown" if left_out else ""
    words.text(0.0, 0.02, f"Change of the pose by {_STEP[local.scale]}{note}", fontsize=7.5,
               wrap=True, transform=words.transAxes)  # fmt: skip
    return figure


@styled
def local_heatmap_figure(local: LocalSensitivity) -> Figure:
    """Draw the same derivatives as colours: parameters down, flexion across, a panel a coordinate.

    Args:
        local: what to draw; of more than forty parameters, those that move the knee most.

    Returns:
        Translations on the left and rotations on the right, each kind on one scale of colours
        centred on zero; poses without a balance are hatched.
    """
    shown, flexion = _largest_shares(local.largest()[0], _MOST_ROWS), local.flexion_deg
    rows, pitch = len(shown), 0.145 if len(local.names) <= 16 else 0.1
    height = 3 * (0.55 + pitch * max(rows, 6)) + 0.3
    figure, panels, words = draw.coordinate_panels(flexion, height, left=1.65, apart=(0.15, 0.42))
    middle = (flexion[1:] + flexion[:-1]) / 2
    edges = flexion[0] + np.array([-0.5, 0.5])
    if len(flexion) > 1:
        edges = np.r_[2 * flexion[0] - middle[0], middle, 2 * flexion[-1] - middle[-1]]
    names = [readable(local.names[i]) for i in shown]
    scales: dict[str, Any] = {}
    for coordinate, axes in panels.items():
        unit = COORDINATES[coordinate].unit
        alike = [FREE_COORDINATES.index(c) for c in SHOWN if COORDINATES[c].unit == unit]
        limit = float(np.nan_to_num(np.abs(local.scaled[:, alike])).max()) or 1.0
        slopes = local.scaled[:, FREE_COORDINATES.index(coordinate), shown].T
        scales[unit] = axes.pcolormesh(edges, np.arange(rows + 1), slopes, cmap="RdBu_r",
                                        vmin=-limit, vmax=limit)  # fmt: skip
        for i in np.flatnonzero(np.isnan(slopes).all(axis=0)):
            axes.fill_between(edges[i : i + 2], 0, rows, facecolor="none", edgecolor=GREY,
                              hatch="////", linewidth=0)  # fmt: skip
        axes.set_yticks(np.arange(rows) + 0.5, names)
        axes.tick_params(axis="y", labelsize=min(8.0, 60 * pitch), length=0, labelleft=unit == "mm")
        axes.set(title=COORDINATES[coordinate].label, ylim=(rows, 0), xlim=edges[[0, -1]])
        axes.grid(False)
    inch = 1 / (height * words.get_position().height)
    for place, unit, kind in ((0.4, "mm", "translations, mm"), (0.95, "deg", "rotations, deg")):
        at = words.inset_axes((0.05, 1 - place * inch, 0.9, 0.13 * inch))
        draw.colour_bar(figure, at, scales[unit], f"{kind} {_PER[local.scale]}")
    if len(local.names) > rows:
        note = f"{len(local.names) - rows} parameters that move\nthe knee less are not shown"
        words.text(0.05, 1 - 1.8 * inch, note, fontsize=7.5, transform=words.transAxes)
    return figure


@styled
def fit_indices_figure(found: MotionIndices) -> Figure:
    """Draw what decides how far the motion is from the measured one."""
    indices, sobol = found.indices, found.indices.method == "sobol"
    main, *_ = pair = _MEASURES[indices.method]
    shown = _largest_shares(indices.measures[main], _MOST_PARAMETERS)
    height = 3 * (0.62 + 0.21 * len(shown)) + 0.7
    # Morris' effects have units: each panel has its own axis then, which takes room.
    figure, panels = draw.grid(3, 2, height, left=1.4, bottom=1.05,
                               apart=(0.21, 0.42 if sobol else 0.58), sharey=True, sharex=sobol)
    places = np.arange(len(shown))
    for k, (axes, name) in enumerate(zip(panels.flat, ("", *SHOWN), strict=True)):
        row, title = found.row(name), "Objective"
        if name:
            unit = "" if sobol else f", {COORDINATES[name].unit}"
            title = f"{COORDINATES[name].label}, RMSE{unit}"
        axes.set_title(title)
        bars = zip(pair.items(), ((BLUE, -0.22), ("#9CC6E0", 0.22)), strict=True)
        for (measure, label), (colour, shift) in bars:
            values = indices.measures[measure][row, shown]
            axes.barh(places + shift, values, 0.44, color=colour, label=label)
            if measure in indices.half_widths:
                half = indices.half_widths[measure][row, shown]
                one = _interval(axes, values, places + shift, 0.8, xerr=half)
                one.set_label(f"{100 * indices.confidence:g} % interval")
        draw.name_rows(axes, places, [readable(indices.names[i]) for i in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.axvline(0.0, color=GREY, linewidth=0.7)
        _say_if_empty(axes, indices.measures[main][row])
        if sobol:
            axes.tick_params(labelbottom=k > 3)
        if k > 3:
            axes.set_xlabel(_AXIS[indices.method])
    draw.figure_legend(figure, bbox_to_anchor=(0.59, 0.36 / height), ncols=3, borderaxespad=0)
    _say_what_is_left_out(figure, found)
    return figure


@styled
def pose_indices_figure(found: MotionIndices) -> Figure:
    """Draw what decides each coordinate at several angles."""
    indices, angles, sobol = found.indices, found.flexion_deg, found.indices.method == "sobol"
    measure, words = next(iter(_MEASURES[indices.method].items()))
    shown = _largest_shares(indices.measures[measure], _MOST_PARAMETERS)
    figure, panels = draw.grid(5, 1, 7.9, bottom=1.4, apart=(0, 0.4), sharex=True, sharey=sobol)
    width = 0.92 / len(shown)
    styles = colours.parameter_styles([indices.names[i] for i in shown])
    for axes, name in zip(panels[:, 0], SHOWN, strict=True):
        rows = [found.row(name, angle) for angle in angles]
        for k, (i, (colour, quantity)) in enumerate(zip(shown, styles, strict=True)):
            places = np.arange(len(angles)) + (k - (len(shown) - 1) / 2) * width
            values = indices.measures[measure][rows, i]
            axes.bar(places, values, 0.96 * width, facecolor=colour, edgecolor="white", linewidth=0,
                     hatch=_HATCHES[quantity % len(_HATCHES)], label=readable(indices.names[i]))
            _interval(axes, places, values, 0.7, yerr=indices.half_widths[measure][rows, i])
        unit = "" if sobol else f", {COORDINATES[name].unit}"
        axes.set(title=f"{COORDINATES[name].label}: {words}{unit}",
                 ylabel="Share" if sobol else "Change")  # fmt: skip
        axes.set_ylim(bottom=0)
        axes.grid(axis="x", visible=False)
        _say_if_empty(axes, indices.measures[measure][rows])
    axes.set_xticks(range(len(angles)), [f"{angle:g}" for angle in angles])
    axes.set_xlabel("Flexion, deg")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.42), ncols=4, borderaxespad=0)
    _say_what_is_left_out(figure, found)
    return figure


def _interval(axes: Axes, x, y, width: float, **half: np.ndarray):
    style = {"elinewidth": width, "capsize": 2 * width, "capthick": width}
    return axes.errorbar(x, y, **half, fmt="none", ecolor=colours.BLACK, **style)


def _say_what_is_left_out(figure: Figure, found: MotionIndices) -> None:
    indices, hidden = found.indices, len(found.indices.names) - _MOST_PARAMETERS
    notes = []
    if indices.left_out:
        kind = "Saltelli blocks" if indices.method == "sobol" else "trajectories"
        notes.append(
            f"{indices.left_out} of {indices.blocks} {kind} left out: they hold a run in which the "
            "knee is not balanced and stable"
        )
    notes += [f"{hidden} parameters with smaller indices not shown"] * (hidden > 0)
    below = 0.07 / figure.get_size_inches()[1]
    figure.text(0.085, below, "\n".join(notes), fontsize=7.5, color=GREY)


def _say_if_empty(axes: Axes, values: np.ndarray) -> None:
    if not np.isfinite(values).any():
        axes.text(0.5, 0.5, "not computed", color=GREY, ha="center", va="center",
                  transform=axes.transAxes)  # fmt: skip
