"""Draws from the posterior."""

import itertools
import textwrap
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import Posterior
from kneejax.report.look.colours import BLACK, BLUE, GREEN, GREY, ORANGE, VERMILLION
from kneejax.report.look.page import Drawing, Section, prose
from kneejax.report.look.style import SHOWN, Figure, readable, styled
from kneejax.report.look.tables import Column, Table, number
from kneejax.report.panels import figure_legend, flexion_axis, grid

_COLUMNS = 4
_BINS = 40
#: Draws and parameters of a pair plot.
_POINTS, _MOST_PAIRED = 1500, 10
#: Of a normal density in two dimensions, 95 % lie within so many standard deviations.
_ELLIPSE_95 = float(np.sqrt(-2.0 * np.log(0.05)))


@styled
def marginals_figure(found: Posterior) -> Figure:
    """Draw the posterior of each parameter beside its prior and the normal approximation."""
    rows = -(-len(found.names) // _COLUMNS)
    # Name and unit, broken where a panel is too narrow for them.
    pairs = zip(found.names, found.units, strict=True)
    titles = [textwrap.fill(readable(name, unit), 24) for name, unit in pairs]
    two_lines = 0.13 * any("\n" in title for title in titles)
    figure, panels = grid(rows, min(_COLUMNS, len(found.names)), (1.55 + two_lines) * rows + 0.5,
                          left=0.21, right=0.14, top=0.25 + two_lines, bottom=0.65,
                          apart=(0.28, 0.55 + two_lines), shown=len(titles))  # fmt: skip
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
    figure_legend(figure, handlelength=1.8, bbox_to_anchor=(0.5, 0.0), columnspacing=1.4)
    return figure


def _short(value: float, _) -> str:
    """A number without trailing zeros."""
    return f"{value:.6g}".replace("-", "\N{MINUS SIGN}")


def _range(found: Posterior, index: int) -> tuple[float, float]:
    """What a panel shows of a parameter: all draws but one in a thousand, and the truth."""
    low, high = np.quantile(found.draws[..., index], (0.001, 0.999))
    truth = found.truth.get(found.names[index], low)
    low, high = min(low, truth), max(high, truth)
    pad = 0.08 * (high - low)
    return float(low - pad), float(high + pad)


@styled
def pairs_figure(found: Posterior) -> Figure:
    """Draw the posterior of each pair of parameters."""
    strongest = np.abs(found.correlation) - np.eye(len(found.names))
    chosen = np.argsort(-strongest.max(axis=0), kind="stable")[:_MOST_PAIRED]
    chosen, count = sorted(chosen.tolist()), len(chosen)
    figure, panels = grid(count, count, 6.58, left=0.8, right=0.07, bottom=0.69, apart=(0.09, 0.08))
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
                lost = found.draws[found.divergent]
                (handles["divergent"],) = axes.plot(lost[:, column], lost[:, row], "x",
                                                    color=VERMILLION, markersize=3)  # fmt: skip
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
        figure_legend(figure, handles, loc="upper left", handlelength=1.6, columnspacing=1.4,
                      bbox_to_anchor=(0.1, 1.0), borderaxespad=0.2)  # fmt: skip
    return figure


@styled
def predictive_figure(found: Posterior) -> Figure:
    """Draw the motion that the posterior predicts over the measured one."""
    figure, panels = grid(5, 2, 8.2, left=0.53, bottom=0.7, apart=(0.5, 0.45), sharex=True)
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
        flexion_axis(axes, flexion)
    figure_legend(figure, handlelength=1.6, bbox_to_anchor=(0.5, 0.0), columnspacing=1.6)
    return figure


def posterior_drawings(found: Posterior) -> dict[str, Drawing]:
    """All figures of a posterior, with captions; pairs of several parameters."""
    drawn = {"posterior": marginals_figure, "predictive": predictive_figure}
    drawn |= {"posterior_pairs": pairs_figure} if len(found.names) > 1 else {}
    return {name: Drawing(figure, found) for name, figure in drawn.items()}


#: Above this R-hat, below this effective size, chains are not to be trusted (Vehtari et al. 2021).
_R_HAT, _EFFECTIVE_PER_CHAIN = 1.01, 100.0
# Of all trajectories; fewer than that only count (`Posterior.divergences`).
_FEW = 1e-3
# A posterior as wide as this part of its prior says little beyond it.
_LITTLE = 0.9


def posterior_section(found: Posterior) -> Section:
    """What a posterior is: how it was drawn, and a row for each parameter."""
    low, high = found.quantiles((0.025, 0.975)).T
    table = Table.of({
        Column("name", "parameter", words=True): found.names, "unit": found.units,
        Column("mean"): found.mean, Column("sd", show="2"): found.sd,
        Column("quantile_025", "2.5 %"): low, Column("quantile_975", "97.5 %"): high,
        Column("laplace_sd", "Laplace sd", "2"): np.sqrt(np.diag(found.laplace_covariance)),
        Column("r_hat", "R-hat", ".3f"): found.r_hat,
        Column("effective_sample_size", "eff.", ".0f"): found.effective_sample_size,
    })  # fmt: skip
    chains, draws, _ = found.draws.shape
    sampled = (f"Posterior by NUTS: {chains} chains of {draws} draws, noise "
               f"{found.settings['noise_mm']:g} mm and {found.settings['noise_deg']:g} degrees, "
               f"{found.divergences} divergent, {number(found.seconds['total'], 3)} s "
               f"({number(found.seconds['compile'], 3)} s until the first draws).")
    return Section("Posterior", [sampled], [table], [*posterior_drawings(found)], printed=True)


def posterior_doubts(result: Posterior) -> list[str]:
    """Sentences on what a reader must know before the numbers are used."""
    said, count = [], result.divergent.size
    if result.unbalanced:
        said.append(prose("posterior.unbalanced", lost=result.unbalanced, count=count))
    diverged = result.divergences - result.unbalanced
    if diverged > _FEW * count:
        said.append(prose("posterior.diverged", lost=diverged, count=count))
    least = np.fmin(result.effective_sample_size, result.tail_effective_sample_size)
    enough = _EFFECTIVE_PER_CHAIN * len(result.draws)
    spread = np.array([prior.spread for prior in result.priors])
    for kind, where in (("chains", ~(result.r_hat <= _R_HAT)), ("few", ~(least >= enough)),
                        ("prior", result.sd > _LITTLE * spread)):  # fmt: skip
        if names := ", ".join(itertools.compress(result.names, where)):
            limits = {"r_hat": _R_HAT, "enough": f"{enough:.0f}"}
            said.append(prose(f"posterior.{kind}", names=names, **limits))
    if (data := result.measured[:, 1:].size) < len(result.names):
        said.append(prose("posterior.data", data=data, count=len(result.names)))
    return said
