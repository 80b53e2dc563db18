"""Knees side by side in tables, words and figures: scores, and the ramps of each parameter."""

import dataclasses
import itertools
from typing import TYPE_CHECKING

import numpy as np

from kneejax.papers.knee_comparison import CHANGED, HALVES, LIMITS, KneeComparison, KneeStudy
from kneejax.papers.varus_valgus import DIRECTIONS
from kneejax.quantities import AXES
from kneejax.report.look import BLACK, GREEN, GREY, ORANGE, PURPLE, WIDTH, styled, verbatim
from kneejax.report.look.colours import uniform_colours
from kneejax.report.look.page import Answer, Drawing, Section
from kneejax.report.look.tables import Column, Table
from kneejax.report.panels import draw_matrix, figure_legend, grid, hatched

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OUTCOMES = dict(
    zip(LIMITS, ("Convergence", "Rotation", "Peak pressure", "Place of the peak"), strict=True)
)
_MARKERS = {"varus": "^", "valgus": "v"}
#: Compartments, by dashes and fill: colours are for values.
_CONTACT_STYLES = (("-", GREY), ((0, (4, 1.5)), "white"))
_MOST_COLUMNS = 5
_RAMP_LABELS = ("Varus rotation, deg", "Moment held, N m", "Peak pressure, MPa")
_SCORED = (
    "Scores of each parameter, means of varus and valgus; hatched where the knee does not have the "
    "parameter, or nothing could be compared."
)
_RAMPED = (
    "Rotation over the moment, the moment that each value holds, and the peak contact pressures at "
    "the moment at which all are compared."
)


def comparison_answer(found: KneeComparison) -> Answer:
    """Knees side by side: scores of every parameter, ramps, and every number in tables."""
    settings, best = found.settings, []
    for knee in found.knees:
        scores = {(x, o): knee.score(x, o) for x in knee.parameters for o in LIMITS}
        known = {pair: score for pair, score in scores.items() if np.isfinite(score)}
        if known:
            (parameter, outcome), score = max(known.items(), key=lambda item: item[1])
            best.append(f"{knee.name}: {parameter} on {_OUTCOMES[outcome].lower()}, {score:g}")
    drawings = {"scores": Drawing(score_figure, found, more=_SCORED)}
    for name in found.parameters:
        drawings[name.replace(".", "-")] = Drawing(ramp_figure, found, name, more=_RAMPED)
    return Answer(
        title="Knees side by side: " + ", ".join(knee.name for knee in found.knees),
        asked=f"What does a change of one ligament do under {settings.body_weight_N / 2:.1f} N "
        f"along the tibia and {settings.full_Nm:g} N m of varus or valgus at extension? Scores 0 "
        "to 3 of Rooks et al. 2022 (paper 4), Table 5, means of varus and valgus.",
        sentence=f"Highest scores: {'; '.join(best)}." if best else "Nothing could be compared.",
        tables=_tables(found), main=[_scores(knee) for knee in found.knees], drawings=drawings,
        doubts=found.doubts,
        sections=[Section("Ramps of each parameter", drawings=list(drawings)[1:])],
        document={
            "knees": [knee.name for knee in found.knees],
            "settings": dataclasses.asdict(settings),
            "scores": {knee.name: {name: {outcome: knee.score(name, outcome) for outcome in LIMITS}
                                   for name in knee.parameters} for knee in found.knees},
            "unchanged": {
                knee.name: {
                    x: {"moment_reached_Nm": run.moment_reached_Nm[0], "ending": run.ending[0],
                        "tension_N": knee.tension_N[x]} for x, run in knee.runs.items()
                } for knee in found.knees
            },
            "doubts": found.doubts,
            "seconds": {knee.name: knee.seconds for knee in found.knees},
            "versions": found.versions,
        },
    )  # fmt: skip


def _scores(knee: KneeStudy) -> Table:
    """What matters in a knee: a row a parameter, a column an outcome."""
    columns = [Column("parameter", " ", words=True)]
    columns += [Column(name, label.lower(), "g") for name, label in _OUTCOMES.items()]
    rows = [[name, *(knee.score(name, outcome) for outcome in LIMITS)] for name in knee.parameters]
    return Table(columns, rows, f"{knee.name} ({knee.seconds:.0f} s)")


def _tables(found: KneeComparison) -> dict[str, Table]:
    """Every outcome, pressure, score and rotation."""
    changed = ["knee", "parameter", "change", "direction"]
    place = [f"{axis}_mm" for axis in AXES]
    outcomes, pressures, scores, rotations = [], [], [], []
    for knee in found.knees:
        for one in knee.outcomes:
            first = [knee.name, one.change.parameter, one.change.label, one.direction]
            values = [getattr(one, name) for name in LIMITS]
            reached = one.moment_reached_Nm, one.ending
            outcomes.append([*first, *reached, *values, one.compared_at_Nm])
            for i, contact in enumerate(knee.contacts):
                centers = one.center_mm[:, i].ravel()
                pressures.append([*first, contact, *one.peak_MPa[:, i], *centers])
        for name, outcome in itertools.product(knee.parameters, LIMITS):
            both = (x for of in (knee.averages, knee.scores) for x in of(name, outcome).values())
            scores.append([knee.name, name, outcome, *both, knee.score(name, outcome)])
        names = [("", "unchanged"), *((c.parameter, c.label) for c in knee.changes)]
        for direction, run in knee.runs.items():
            loads = np.c_[run.ramp.axial_N, run.ramp.moment_Nm].tolist()
            for name, held, angles in zip(names, run.held, run.adduction_deg, strict=True):
                first = [knee.name, *name, direction]
                rotations += [[*first, *loads[x], angles[x]] for x in np.flatnonzero(held)]
    peaks = ["peak_MPa", "unchanged_peak_MPa", *place, *(f"unchanged_{column}" for column in place)]
    rated = [*DIRECTIONS, *(f"{direction}_score" for direction in DIRECTIONS), "score"]
    result = ["moment_reached_Nm", "ending", *LIMITS, "compared_at_Nm"]
    return {
        "outcomes": Table([*changed, *result], outcomes),
        "pressures": Table([*changed, "contact", *peaks], pressures),
        "scores": Table(["knee", "parameter", "outcome", *rated], scores),
        "rotations": Table([*changed, "axial_N", "moment_Nm", "adduction_deg"], rotations),
    }


def _parameter_words(parameter: str) -> str:
    ligament, quantity = parameter.split(".")
    return f"{verbatim(ligament)} {CHANGED[quantity][0]}"


@styled
def ramp_figure(found: KneeComparison, parameter: str) -> "Figure":
    """Draw what one parameter does in every knee that has it (Figures 4 and 5 of paper 4)."""
    from matplotlib.colors import Normalize

    knees = [knee for knee in found.knees if parameter in knee.parameters]
    blocks, columns = -(-len(knees) // _MOST_COLUMNS), min(len(knees), _MOST_COLUMNS)
    figure, panels = grid(3 * blocks, columns, 6.6 * blocks + 0.75, top=0.48, bottom=1.0,
                          apart=(0.12, 0.55), sharey="row")  # fmt: skip
    values = [change.value for change in knees[0].changes if change.parameter == parameter]
    scale, colours = None, dict(zip(HALVES, (GREEN, ORANGE, PURPLE), strict=True))
    if not parameter.endswith("attachment"):
        scale = Normalize(-max(map(abs, values)), max(map(abs, values)))
        colours = {value: uniform_colours()(float(scale(value))) for value in values}
    for axes in panels.flat:
        axes.set_axis_off()
    for place, knee in enumerate(knees):
        block, column = divmod(place, columns)
        rotation, held, pressure = own = panels[3 * block : 3 * block + 3, column]
        for axes in own:
            axes.set_axis_on()
        rotation.set_title(verbatim(knee.name), fontsize=8)
        _rotation(rotation, knee, parameter, colours)
        _held(held, knee, parameter, colours, found.settings.full_Nm)
        _pressure(pressure, knee, parameter)
        if column == 0:
            for axes, label in zip(own, _RAMP_LABELS, strict=True):
                axes.set_ylabel(label)
    for axes in panels[2::3].flat:
        axes.set_ylim(bottom=0.0)
    figure.suptitle(_parameter_words(parameter), x=0.012, ha="left", fontsize=9)
    _legend(figure, knees[0], parameter, scale)
    return figure


def _rotation(axes: "Axes", knee: KneeStudy, parameter: str, colours: dict) -> None:
    for run in knee.runs.values():
        shown = run.ramp.loaded
        x, angles = run.ramp.moment_Nm[shown], run.adduction_deg[:, shown]
        for y, change in zip(angles[1:], knee.changes, strict=True):
            if change.parameter == parameter:
                axes.plot(x, y, color=colours[change.value], linewidth=0.9)
        axes.plot(x, angles[0], color=BLACK, linewidth=1.4, linestyle="--")
    full = max(run.ramp.full_Nm for run in knee.runs.values())
    axes.set(xlabel="Moment, N m", xlim=(-1.2 * full, 1.2 * full), xticks=[-full, 0.0, full])
    axes.axhline(0, color=GREY, linewidth=0.5, zorder=0)


def _held(axes: "Axes", knee: KneeStudy, parameter: str, colours: dict, full_Nm: float) -> None:
    for direction, run in knee.runs.items():
        own = float(run.moment_reached_Nm[0])
        axes.axhline(own, color=BLACK, linewidth=1.0, linestyle="--", zorder=1)
        for one in knee.outcomes_of(parameter, direction):
            axes.plot(
                one.change.value, one.moment_reached_Nm, _MARKERS[direction],
                color=colours[one.change.value], markersize=4.5, clip_on=False, zorder=3,
            )  # fmt: skip
    axes.set_ylim(-1.1 * full_Nm, 1.1 * full_Nm)
    _value_axis(axes, knee, parameter)


def _pressure(axes: "Axes", knee: KneeStudy, parameter: str) -> None:
    moments, halved = [], parameter.endswith("attachment")
    for direction in knee.runs:
        own = knee.outcomes_of(parameter, direction)
        peaks, unchanged = np.array([one.peak_MPa[0] for one in own]), own[0].peak_MPa[1]
        moments += [one.compared_at_Nm for one in own if np.isfinite(one.compared_at_Nm)][-1:]
        x = np.append([one.change.value for one in own], 0.0)
        order = np.argsort(x)
        style = {"marker": _MARKERS[direction], "markersize": 4}
        for i, (dashes, fill) in zip(range(len(knee.contacts)), _CONTACT_STYLES, strict=False):
            y, line = np.append(peaks[:, i], unchanged[i]), "none" if halved else dashes
            axes.plot(x[order], y[order], color=GREY, linestyle=line, linewidth=0.9,
                      markerfacecolor=fill, **style)  # fmt: skip
            axes.plot(0.0, unchanged[i], color=BLACK, zorder=4,
                      markerfacecolor=BLACK if fill == GREY else fill, **style)  # fmt: skip
    _value_axis(axes, knee, parameter)
    axes.set_xlabel(_value_words(parameter))
    words = " and ".join(f"{m:+g}".replace("-", "\u2212") for m in moments)
    axes.set_title(f"at {words} N m" if words else "not compared", fontsize=7, color=GREY)


def _value_axis(axes: "Axes", knee: KneeStudy, parameter: str) -> None:
    if parameter.endswith("attachment"):
        axes.set_xticks([0.0, *HALVES], ["as is", "femur", "tibia", "both"], fontsize=6.3)
        axes.set_xlim(-0.5, 3.5)
        return
    largest = max(abs(change.value) for change in knee.changes if change.parameter == parameter)
    axes.set(xlim=(-1.25 * largest, 1.25 * largest), xticks=[-largest, 0.0, largest])


def _value_words(parameter: str) -> str:
    quantity = parameter.split(".")[1]
    if quantity == "attachment":
        return "Halved on"
    return ", ".join(filter(None, ["Change", CHANGED[quantity][1]]))


def _legend(figure: "Figure", knee: KneeStudy, parameter: str, scale) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.lines import Line2D

    height = figure.get_figheight()
    drawn = {"unchanged": Line2D([], [], color=BLACK, linestyle="--")}
    drawn |= {name: Line2D([], [], color=GREY, marker=marker, linestyle="none", markersize=4.5)
              for name, marker in _MARKERS.items()}  # fmt: skip
    drawn |= {
        verbatim(name): Line2D([], [], color=GREY, linestyle=dashes, marker="o", markersize=4,
                               linewidth=0.9, markerfacecolor=fill)
        for name, (dashes, fill) in zip(knee.contacts, _CONTACT_STYLES, strict=False)
    }  # fmt: skip
    figure_legend(figure, drawn, loc="lower left", bbox_to_anchor=(0.075, 0.1 / height), ncols=5,
                  handlelength=1.8, columnspacing=1.2, fontsize=7.5, borderaxespad=0)  # fmt: skip
    if scale is not None:
        place = figure.add_axes((0.7, 0.38 / height, 0.27, 0.11 / height))
        shades, ticks = ScalarMappable(scale, uniform_colours()), [scale.vmin, 0.0, scale.vmax]
        bar = figure.colorbar(shades, cax=place, orientation="horizontal", ticks=ticks)
        bar.outline.set_visible(False)
        bar.ax.tick_params(labelsize=7, length=2, pad=1)
        bar.ax.set_title(_value_words(parameter), fontsize=7, loc="left", pad=2)


@styled
def score_figure(found: KneeComparison) -> "Figure":
    """Draw the scores of every parameter and outcome, knees side by side (paper 4, Figs 6 to 8)."""
    import matplotlib

    parameters, names = found.parameters, [verbatim(knee.name) for knee in found.knees]
    below = 0.38 + 0.055 * max(len(knee.name) for knee in found.knees)
    height = 0.235 * len(parameters) + below + 0.37
    apart, unknown = 0.35 * 0.67 * WIDTH / (4 * len(names) + 1.05), None
    figure, panels = grid(1, 4, height, left=0.2 * WIDTH, right=0.13 * WIDTH, bottom=below,
                          apart=(apart, 0.0), sharey=True)  # fmt: skip
    words, shades = [*map(_parameter_words, parameters)], matplotlib.colormaps["YlGnBu"]
    for axes, (outcome, label) in zip(panels[0], _OUTCOMES.items(), strict=True):
        scores = [[knee.score(name, outcome) for knee in found.knees] for name in parameters]
        cells = draw_matrix(axes, scores, shades, (0, 3.4), "{:g}".format, lambda x: x > 1.8, words,
                            names, size=7)  # fmt: skip
        axes.tick_params(axis="x", rotation=90)
        axes.set_title(label, fontsize=8, loc="center")
        for row, column in np.argwhere(np.isnan(scores)):
            unknown = hatched(axes, (column, row), 1, 1, "////")
    place = figure.add_axes((0.885, below / height, 0.015, 1 - (below + 0.3) / height))
    bar = figure.colorbar(cells, cax=place)
    bar.ax.set_ylim(0, 3)
    bar.set_ticks([0, 1, 2, 3], labels=["0 none", "1 small", "2 medium", "3 large"], fontsize=7)
    bar.ax.tick_params(length=2)
    bar.outline.set_visible(False)
    if unknown is not None:
        figure_legend(figure, {"not in this knee, or not compared": unknown}, loc="lower left",
                      bbox_to_anchor=(0.01, 0.02), fontsize=7, borderaxespad=0, handlelength=1.4)
    return figure
