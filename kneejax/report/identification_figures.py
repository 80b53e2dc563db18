"""Figures of what data determine: profiles, spectrum, draws from the posterior, tests to make."""

import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import Design, Information, Posterior, Profile
from kneejax.quantities import quantity_of
from kneejax.report import panels as draw
from kneejax.report.look.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION, both_signs
from kneejax.report.look.style import SHOWN, WIDTH, Figure, readable, styled, verbatim
from kneejax.report.look.tables import grouped, number
from kneejax.statics import Status

#: Panels beside each other.
_COLUMNS = 4
_BINS = 40
#: Draws and parameters of a pair plot.
_POINTS, _MOST_PAIRED = 1500, 10
#: Of a normal density in two dimensions, 95 % lie within so many standard deviations.
_ELLIPSE_95 = float(np.sqrt(-2.0 * np.log(0.05)))
#: Decades that the axis of the spectrum shows below its longest bar.
_DECADES = 8.0
#: What is hatched, by status: hatch, and its legend entry.
_HATCHES = {
    Status.OUTSIDE_REGION: ("....", "outside fitted surfaces"),
    Status.OVERSTRETCHED: ("||||", "overstretched"), Status.UNSTABLE: ("xxxx", "unstable"),
    Status.DISLOCATED: ("////", "dislocated"),
    **dict.fromkeys((Status.WAY_FLIPPED, Status.PAST_WRAP, Status.WRAP_INSIDE),
                    ("----", "wrong way")),
    **dict.fromkeys([s for s in Status if not s.converged], ("\\\\\\\\", "no balance")),
}
_MOST_COLUMNS = 16
#: Criterion -> what its gains are, with their unit; what they are multiplied by, and their digits.
GAINS = {"D": ("information gained, bits", 1.0, "{:.1f}"),
          "A": ("fall of the mean squared standard error, %", 100.0, "{:.0f}")}  # fmt: skip


@styled
def profiles_figure(profiles: Sequence[Profile], truth: Mapping[str, float]) -> Figure:
    """Draw how the misfit grows as each parameter leaves its estimate."""
    from scipy.interpolate import PchipInterpolator

    rows = -(-len(profiles) // _COLUMNS)
    figure, panels = draw.grid(rows, min(_COLUMNS, len(profiles)), 1.62 * rows + 0.55, right=0.18,
                          bottom=0.7, apart=(0.22, 0.55), shown=len(profiles),
                          sharey=True)  # fmt: skip
    for axes, profile in zip(panels.flat, profiles, strict=False):
        known = truth.get(profile.name)
        axes.set_title(readable(profile.name, profile.unit), fontsize=8)
        top = 1.75 * profile.threshold
        axes.set_ylim(-0.04 * top, top)
        x, rise = profile.values, profile.rise
        if len(x) > 2:
            # Between its points a monotone cubic of the signed root of the rise.
            root = np.sign(x - profile.estimate) * np.sqrt(np.maximum(rise, 0.0))
            x = np.linspace(x[0], x[-1], 200)
            rise = PchipInterpolator(profile.values, root)(x) ** 2
        left, right = float(profile.values[0]), float(profile.values[-1])
        pad = 0.04 * (right - left) or abs(left) * 0.05 or 1.0
        left, right = left - pad, right + pad
        axes.set_xlim(left, right)
        axes.axvspan(profile.low, profile.high, color=BLUE, alpha=0.13, linewidth=0,
                     label="95 % confidence")  # fmt: skip
        if np.isfinite(profile.standard_error) and profile.standard_error > 0:
            line = np.linspace(left, right, 200)
            bowl = ((line - profile.estimate) / profile.standard_error) ** 2
            axes.plot(line, bowl, "--", color=GREY, linewidth=1.4, label="by the standard error")
        axes.plot(x, rise, color=BLUE, label="profile")
        axes.plot(profile.values, profile.rise, ".", color=BLUE, markersize=3.5)
        axes.axhline(profile.threshold, color=GREY, linewidth=1.0, linestyle=":",
                     label=f"95 % limit: {profile.threshold:.2f}")  # fmt: skip
        axes.plot([profile.estimate], [0.0], "o", color=VERMILLION, markersize=4, clip_on=False,
                  zorder=5, label="estimate")  # fmt: skip
        ends = {"left": 0.03, "right": 0.97}
        if known is not None and left <= known <= right:
            axes.axvline(known, color=GREEN, linewidth=1.2, label="truth")
        elif known is not None:
            side = "right" if known > right else "left"
            axes.text(ends[side], 0.9, "truth beyond", ha=side, fontsize=6.5, color=GREEN,
                      transform=axes.transAxes)  # fmt: skip
        opened = (profile.low_open, profile.high_open)
        for why, (side, place) in zip(opened, ends.items(), strict=True):
            if why:
                words = "open: bound" if why == "its bound" else "open: no\nbalance beyond"
                axes.text(place, 0.95, words, ha=side, va="top", fontsize=6.5, color=VERMILLION,
                          transform=axes.transAxes, zorder=6,
                          bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0})
        axes.locator_params(axis="x", nbins=3)
        axes.tick_params(labelsize=7)
    for axes in panels[:, 0]:
        axes.set_ylabel("Rise of $\\chi^2$")
    draw.figure_legend(figure, ncols=6, handlelength=1.6, bbox_to_anchor=(0.5, 0.0),
                       columnspacing=1.0, fontsize=7.5)  # fmt: skip
    return figure


@styled
def spectrum_figure(found: Information) -> Figure:
    """Draw how well each combination of parameters is known, and what it is made of."""
    free = ~found.at_bound
    names = [readable(name) for name, on in zip(found.names, free, strict=True) if on]
    vectors, better = found.eigenvectors[free], np.sqrt(found.eigenvalues)
    n = len(names)
    if not n:
        figure, _ = draw.grid(1, 1, 0.8, width=5.0, left=0.1, top=0.1, bottom=0.1, shown=0)
        figure.text(0.5, 0.5, "Every parameter is on a bound: nothing is free.", ha="center")
        return figure
    cell, left, right = min(0.44, 6.0 / n), 0.062 * max(map(len, names)) + 0.15, 1.0
    wide, tall = max(left + cell * n, left + 3.4) + right, cell * n
    figure, ((top,), (table,)) = draw.grid(2, 1, tall + 2.34, width=wide, left=left,
                                      right=wide - left - tall, top=0.32, bottom=0.55,
                                      apart=(0, 0.12), height_ratios=(1.35, tall))  # fmt: skip
    # A bar for each combination: how many times better it is known than before.
    low = max(better.max(initial=1.0) * 10.0**-_DECADES, 1e-4)
    floor = min(0.5, max(better[better > low].min(initial=1.0) / 2.0, low))
    places = np.arange(n) + 0.5
    colours = [BLUE if size >= 1.0 else VERMILLION for size in better]
    top.bar(places, np.maximum(better, floor) - floor, bottom=floor, width=0.7, color=colours)
    for place, size in zip(places, better, strict=True) if n <= 16 else ():
        word = f"{size:.0f}" if size >= 9.95 else f"{size:.2g}" if size > low else "0"
        top.annotate(word, (place, max(size, floor)), (0, 1.5), textcoords="offset points",
                     ha="center", va="bottom", fontsize=6.8)  # fmt: skip
    top.axhline(1.0, color=GREY, linewidth=0.8)
    top.annotate("no better than\nthe prior", (n, 1.0), (4, 0), textcoords="offset points",
                 va="center", fontsize=7, color=GREY)  # fmt: skip
    most = max(better.max(), 2.0)
    # Room for the number above the longest bar.
    top.set(yscale="log", ylim=(floor, most * (most / floor) ** 0.16), xlim=(0, n), xticks=[],
            title="Prior SD over standard error, for each combination of parameters")  # fmt: skip
    draw.decades(top.yaxis, 6)
    top.grid(axis="x", visible=False)
    weights = draw.draw_matrix(table, vectors, both_signs(), (-1, 1),
                          lambda x: f"{x:.1f}" if abs(x) >= 0.095 else "", lambda x: x < -0.8,
                          names, [str(i + 1) for i in range(n)], numbers=n <= 16,
                          size=7.5 if n <= 20 else 5.5)  # fmt: skip
    table.set_xlabel("Combination, from best determined to worst")
    scale = figure.colorbar(weights, cax=table.inset_axes((1 + 0.15 / tall, 0, 0.1 / tall, 1)))
    scale.set_ticks([-1, 0, 1], labels=["\u22121", "0", "+1"], fontsize=7)
    scale.ax.tick_params(length=0)
    scale.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    scale.set_label("Weight", fontsize=7.5)
    return figure


@styled
def marginals_figure(found: Posterior) -> Figure:
    """Draw the posterior of each parameter beside its prior and the normal approximation."""
    rows = -(-len(found.names) // _COLUMNS)
    # Name and unit, broken where a panel is too narrow for them.
    pairs = zip(found.names, found.units, strict=True)
    titles = [textwrap.fill(readable(name, unit), 24) for name, unit in pairs]
    two_lines = 0.13 * any("\n" in title for title in titles)
    height = (1.55 + two_lines) * rows + 0.5
    figure, panels = draw.grid(rows, min(_COLUMNS, len(found.names)), height, left=0.21, right=0.14,
                               top=0.25 + two_lines, bottom=0.65, apart=(0.28, 0.55 + two_lines),
                               shown=len(titles))  # fmt: skip
    for index, axes in enumerate(panels.flat[: len(titles)]):
        name, prior = found.names[index], found.priors[index]
        axes.set_title(titles[index], fontsize=8)
        draws = found.draws[..., index].ravel()
        deviation = float(np.sqrt(found.laplace_covariance[index, index]))
        low, high = _range(found, index)
        x = np.linspace(low, high, 400)
        scores = (x - found.laplace_mean[index]) / deviation
        bell, known = np.exp(-0.5 * scores**2) / (deviation * np.sqrt(2 * np.pi)), prior.density(x)
        edges = np.linspace(max(low, prior.lower), min(high, prior.upper), _BINS + 1)
        heights, *_ = axes.hist(draws, edges, density=True, color=BLUE, alpha=0.3, linewidth=0)
        axes.patches[0].set_label("posterior")
        if np.isfinite(deviation):
            axes.plot(x, bell, "--", color=GREY, linewidth=1.0, label="normal approximation")
        axes.plot(x, known, color=ORANGE, linewidth=1.1, label="prior")
        if name in found.truth:
            axes.axvline(found.truth[name], color=GREEN, linewidth=1.2, label="truth")
        for bound, side in ((prior.lower, low), (prior.upper, high)):
            if low < bound < high:
                axes.axvspan(bound, side, facecolor="none", edgecolor=GREY, hatch="////",
                             linewidth=0, label="outside the bounds")  # fmt: skip
        top = np.nanmax([np.max(heights), bell.max(), known.max()])
        axes.set(xlim=(low, high), ylim=(0.0, 1.12 * top), yticks=[])
        axes.spines["left"].set_visible(False)
        axes.tick_params(labelsize=7)
        axes.xaxis.set_major_locator(MaxNLocator(3, min_n_ticks=2, steps=[1, 2, 5, 10]))
        axes.xaxis.set_major_formatter(_short)
    draw.figure_legend(figure, handlelength=1.8, bbox_to_anchor=(0.5, 0.0), columnspacing=1.4)
    return figure


def _short(value: float, _) -> str:
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def _range(found: Posterior, index: int) -> tuple[float, float]:
    """What a panel shows of a parameter: all draws but one in a thousand, and the truth."""
    ends = np.quantile(found.draws[..., index], (0.001, 0.999))
    seen = [*ends, found.truth.get(found.names[index], ends[0])]
    pad = 0.08 * np.ptp(seen)
    return float(min(seen) - pad), float(max(seen) + pad)


@styled
def pairs_figure(found: Posterior) -> Figure:
    """Draw the posterior of each pair of parameters."""
    strongest = np.abs(found.correlation) - np.eye(len(found.names))
    chosen = np.argsort(-strongest.max(axis=0), kind="stable")[:_MOST_PAIRED]
    chosen, count = sorted(chosen.tolist()), len(chosen)
    figure, panels = draw.grid(count, count, 6.58, left=0.8, right=0.07, bottom=0.69,
                               apart=(0.09, 0.08))  # fmt: skip
    flat = found.draws.reshape(-1, len(found.names))
    thin = flat[:: max(len(flat) // _POINTS, 1)]
    narrow = [readable(name).replace(" ", "\n", 1).replace("reference ", "ref. ")
              for name in found.names]  # fmt: skip
    handles: dict[str, Any] = {}
    for (i, j), axes in np.ndenumerate(panels):
        row, column = chosen[i], chosen[j]
        axes.grid(False)
        axes.tick_params(labelsize=6, length=2, pad=1.5)
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(MaxNLocator(2, min_n_ticks=2, steps=[1, 2, 5, 10]))
            axis.set_major_formatter(_short)
        if i > j:
            axes.plot(thin[:, column], thin[:, row], ".", color=BLUE, markersize=0.6 + 8.0 / count,
                      markeredgewidth=0, alpha=0.35, rasterized=True)  # fmt: skip
            # One that can be seen in the legend.
            handles["draws"] = Line2D([], [], color=BLUE, marker=".", linestyle="none")
            pair = np.ix_([column, row], [column, row])
            covariance = found.laplace_covariance[pair]
            if np.isfinite(covariance).all():
                angle = np.linspace(0.0, 2.0 * np.pi, 100)
                circle = np.linalg.cholesky(covariance) @ [np.cos(angle), np.sin(angle)]
                centre = found.laplace_mean[[column, row]][:, None]
                (handles["normal approximation, 95 %"],) = axes.plot(
                    *(centre + _ELLIPSE_95 * circle), color=BLACK, linewidth=0.8
                )
            if found.divergences:
                lost = found.draws[found.divergent].T
                handles["divergent"] = axes.plot(lost[column], lost[row], "x", color=VERMILLION,
                                                 markersize=3)[0]  # fmt: skip
            for which, line in ((column, axes.axvline), (row, axes.axhline)):
                if (truth := found.truth.get(found.names[which])) is not None:
                    handles["truth"] = line(truth, color=GREEN, linewidth=0.8)
            axes.set(xlim=_range(found, column), ylim=_range(found, row))
        elif i == j:
            axes.hist(found.draws[..., row].ravel(), np.linspace(*_range(found, row), 31),
                      color=BLUE, alpha=0.3, linewidth=0)  # fmt: skip
            axes.set(xlim=_range(found, row), yticks=[])
            axes.spines["left"].set_visible(False)
        else:
            value = found.correlation[row, column]
            word = f"{round(float(value), 2) + 0.0:.2f}".replace("-", "\N{MINUS SIGN}")
            axes.set(xticks=[], yticks=[])
            axes.spines[:].set_visible(False)
            axes.text(0.5, 0.5, word, ha="center", va="center", transform=axes.transAxes,
                      fontsize=6.0 + 3.5 * abs(value), color=BLACK if abs(value) >= 0.3 else GREY)
        axes.tick_params(labelbottom=i == count - 1, labelleft=j == 0 and i > 0)
        if i == count - 1:
            axes.tick_params(axis="x", rotation=50, labelsize=5.5)
            for text in axes.get_xticklabels():
                text.set(ha="right", rotation_mode="anchor")
            axes.set_xlabel(narrow[column], fontsize=6.5, labelpad=2)
        if j == 0 and i > 0:
            axes.set_ylabel(narrow[row], fontsize=6.5, labelpad=2)
    figure.align_labels()
    if handles:
        draw.figure_legend(figure, handles, loc="upper left", handlelength=1.6, columnspacing=1.4,
                      bbox_to_anchor=(0.1, 1.0), borderaxespad=0.2)  # fmt: skip
    return figure


@styled
def predictive_figure(found: Posterior) -> Figure:
    """Draw the motion that the posterior predicts over the measured one."""
    figure, panels = draw.grid(5, 2, 8.2, left=0.53, bottom=0.7, apart=(0.5, 0.45), sharex=True)
    order = np.argsort(found.measured[:, 0], kind="stable")
    flexion = found.measured[order, 0]
    for (left, right), name in zip(panels, SHOWN, strict=True):
        index = FREE_COORDINATES.index(name)
        measured = found.measured[order, 1 + index]
        bands, wide = (quantiles[index, order]
                       for quantiles in (found.motion_quantiles, found.predictive_quantiles))
        median = bands[:, bands.shape[1] // 2]
        coordinate = COORDINATES[name]
        left.set_title(coordinate.axis_label)
        right.set_title(f"Difference from the median, {coordinate.unit}")
        for axes, base in ((left, 0.0), (right, median)):
            for label, ends, alpha in (("new measurement, 95 %", wide, 0.18),
                                       ("motion, 95 %", bands, 0.55)):  # fmt: skip
                axes.fill_between(flexion, ends[:, 0] - base, ends[:, -1] - base, color=BLUE,
                                  alpha=alpha, linewidth=0, label=label)  # fmt: skip
            axes.plot(flexion, median - base, color=BLUE, linewidth=1.0, label="median")
            axes.plot(flexion, measured - base, "o", color=BLACK, markersize=2.6, mew=0,
                      label="measured")  # fmt: skip
    for axes in panels[-1]:
        draw.flexion_axis(axes, flexion)
    draw.figure_legend(figure, handlelength=1.6, bbox_to_anchor=(0.5, 0.0), columnspacing=1.6)
    return figure


@styled
def candidates_figure(design: Design) -> Figure:
    """Draw what each candidate would tell as the next test, over flexion and load."""
    angles = sorted({test.flexion_deg for test in design.candidates})
    rows: dict[str, int] = {}
    places: list[tuple[int, int]] = []
    for test in design.candidates:
        column, name, copy = angles.index(test.flexion_deg), test.name, 1
        # Two loads of one name at one flexion get rows of their own.
        while (rows.get(name), column) in places:
            copy += 1
            name = f"{test.name} ({copy})"
        places.append((rows.setdefault(name, len(rows)), column))
    gains = np.full((len(rows), len(angles)), np.nan)
    gains[tuple(np.transpose(places))] = design.gains
    left = 0.062 * max(len(row) for row in rows) + 0.15
    cell = min((WIDTH - left - 0.75) / len(angles), 0.8)
    wide, height = max(left + cell * len(angles) + 0.75, 4.5), 0.32 * len(rows) + 1.06
    right = left + cell * len(angles)
    figure, ((axes,),) = draw.grid(1, 1, height, width=wide, left=left, right=wide - right,
                                   top=0.32, bottom=0.74)  # fmt: skip
    shades = LinearSegmentedColormap.from_list("gain", ["#FFFFFF", "#A8D0E6", BLUE, "#003A5D"])
    most = float(np.nanmax(gains)) if np.isfinite(gains).any() else 1.0
    every = max(1, -(-len(angles) // 20))
    heads = [f"{angle:g}" if j % every == 0 else "" for j, angle in enumerate(angles)]
    _, factor, form = GAINS[design.criterion]
    filled = draw.draw_matrix(axes, gains, shades, (0.0, most),
                              lambda gain: form.format(factor * gain),
                              lambda gain: gain > 0.55 * most, [verbatim(row) for row in rows],
                              heads, numbers=len(angles) <= _MOST_COLUMNS)  # fmt: skip
    handles = {}
    for place, status in zip(places, design.status, strict=True):
        if Status(status) in _HATCHES:
            hatch, word = _HATCHES[Status(status)]
            handles[word] = draw.hatched(axes, place[::-1], 1, 1, hatch)
    for row, own in grouped((row, step) for step, row in enumerate(design.chosen, 1)).items():
        i, j = places[row]
        axes.add_patch(Rectangle((j, i), 1, 1, fill=False, ec=VERMILLION, lw=1.8, clip_on=False))
        axes.text(j + 0.035, i + 0.06, ", ".join(map(str, own)), ha="left", va="top", fontsize=6.5,
                  color="white", fontweight="bold",
                  bbox={"boxstyle": "square,pad=0.18", "fc": VERMILLION, "ec": "none"})  # fmt: skip
    axes.set(xlabel="Flexion, deg",
             title=f"What one more test would add: {GAINS[design.criterion][0]}")  # fmt: skip
    handles["chosen, in this order"] = Rectangle((0, 0), 1, 1, fill=False, ec=VERMILLION, lw=1.8)
    draw.figure_legend(figure, handles, loc="lower left", ncols=4, handlelength=1.5,
                       bbox_to_anchor=((left - 0.08) / wide, 0.0), handleheight=1.1,
                       columnspacing=1.5)  # fmt: skip
    place = (right + 0.12) / wide, 0.74 / height, 0.11 / wide, 0.32 * len(rows) / height
    bar = figure.colorbar(filled, cax=figure.add_axes(place))
    bar.outline.set_visible(False)  # pyright: ignore[reportCallIssue]
    bar.ax.tick_params(length=0, labelsize=7)
    if design.criterion == "A":
        ticks = [tick for tick in bar.get_ticks() if 0 <= tick <= most]
        bar.set_ticks(ticks, labels=[f"{100 * tick:.0f}" for tick in ticks])
    return figure


@styled
def standard_errors_figure(design: Design) -> Figure:
    """Draw the expected standard error of each parameter before and after the chosen tests."""
    names = [readable(name) for name in design.names]
    n, last = len(names), len(design.chosen)
    parts = design.standard_errors / design.scale
    left, right = 0.062 * max(map(len, names)) + 0.15, 1.75
    figure, ((axes,),) = draw.grid(1, 1, 1 + 0.27 * n, left=left, right=right, top=0.55,
                                   bottom=0.45)  # fmt: skip
    y = np.arange(n, dtype=float)
    axes.hlines(y, parts[-1], parts[0], color="#C8CDD2", linewidth=2.2, zorder=1)
    axes.plot(parts[0], y, "o", ms=5, mfc="white", mec=BLACK, zorder=3, label="before")
    for step in range(1, last):
        axes.plot(parts[step], y, "|", ms=6, color=GREY, zorder=2, label="after each test")
    word = f"after {'the test' if last == 1 else f'all {last} tests'}"
    axes.plot(parts[-1], y, "o", ms=5, color=VERMILLION, zorder=4, label=word)
    axes.axvline(1.0, color=GREY, linewidth=0.8, zorder=1, label="prior SD")
    low, high = parts.min() / 1.3, max(parts.max(), 1.0) * 1.3
    draw.name_rows(axes, y, names)
    axes.set(xscale="log", xlim=(low, high), ylim=(n - 0.5, -0.5),
             xlabel="Expected standard error, as a fraction of the prior SD")  # fmt: skip
    draw.decades(axes.xaxis, 9, (1.0, 2.0, 5.0) if high / low < 200 else (1.0,))
    edge, inch = axes.get_yaxis_transform(), 1.0 / (WIDTH - left - right)
    before, after = 1.0 + 0.62 * inch, 1.0 + 1.27 * inch
    for x, head in ((before, "before"), (after, "after")):
        axes.text(x, -0.62, head, transform=edge, ha="right", va="bottom", fontsize=7.5, color=GREY)
    small = {"transform": edge, "va": "center_baseline", "fontsize": 7.5}
    for i, unit in enumerate(quantity_of(name).unit for name in design.names):
        for x, row in ((before, 0), (after, -1)):
            axes.text(x, i, number(design.standard_errors[row, i], 2), ha="right", **small)
        axes.text(after + 0.07 * inch, i, unit, **small)
    draw.figure_legend(figure, loc="upper left", bbox_to_anchor=((left - 0.1) / WIDTH, 1.0),
                       ncols=4, handlelength=1.2, columnspacing=1.5)  # fmt: skip
    return figure
