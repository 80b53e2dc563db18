"""Tests to make next."""

import numpy as np
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.patches import Rectangle

from kneejax.geometry import COLUMNS, COORDINATES, FREE_COORDINATES
from kneejax.inference import Design
from kneejax.mechanics import NAMED_LOADS
from kneejax.quantities import quantity_of
from kneejax.report.look.colours import BLACK, BLUE, GREY, VERMILLION
from kneejax.report.look.page import Section, paragraphs, prose
from kneejax.report.look.style import WIDTH, Figure, readable, styled, verbatim
from kneejax.report.look.tables import Column, Table, grouped, number, plain, short, unit_after
from kneejax.report.panels import decades, draw_matrix, figure_legend, grid, hatched, name_rows
from kneejax.report.pose_tables import words_of
from kneejax.statics import Status

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
_GAINS = {"D": ("information gained, bits", 1.0, "{:.1f}"),
          "A": ("fall of the mean squared standard error, %", 100.0, "{:.0f}")}  # fmt: skip


@styled
def candidates_figure(design: Design) -> Figure:
    """Draw what each candidate would tell as the next test, over flexion and load."""
    angles = sorted({test.flexion_deg for test in design.candidates})
    rows: list[str] = []
    places: list[tuple[int, int]] = []
    for test in design.candidates:
        column, name, copy = angles.index(test.flexion_deg), test.name, 1
        # Two loads of one name at one flexion get rows of their own.
        while name in rows and (rows.index(name), column) in places:
            copy += 1
            name = f"{test.name} ({copy})"
        if name not in rows:
            rows.append(name)
        places.append((rows.index(name), column))
    gains = np.full((len(rows), len(angles)), np.nan)
    for place, gain in zip(places, design.gains, strict=True):
        gains[place] = gain
    left = 0.062 * max(len(row) for row in rows) + 0.15
    cell = min((WIDTH - left - 0.75) / len(angles), 0.8)
    wide, height = max(left + cell * len(angles) + 0.75, 4.5), 0.32 * len(rows) + 1.06
    right = left + cell * len(angles)
    figure, ((axes,),) = grid(1, 1, height, width=wide, left=left, right=wide - right, top=0.32,
                              bottom=0.74)  # fmt: skip
    shades = LinearSegmentedColormap.from_list("gain", ["#FFFFFF", "#A8D0E6", BLUE, "#003A5D"])
    most = float(np.nanmax(gains)) if np.isfinite(gains).any() else 1.0
    every = max(1, -(-len(angles) // 20))
    heads = [f"{angle:g}" if j % every == 0 else "" for j, angle in enumerate(angles)]
    _, factor, form = _GAINS[design.criterion]
    filled = draw_matrix(axes, gains, shades, (0.0, most), lambda gain: form.format(factor * gain),
                         lambda gain: gain > 0.55 * most, [verbatim(row) for row in rows], heads,
                         numbers=len(angles) <= _MOST_COLUMNS)  # fmt: skip
    handles = {}
    for place, status in zip(places, design.status, strict=True):
        if Status(status) in _HATCHES:
            hatch, word = _HATCHES[Status(status)]
            handles[word] = hatched(axes, place[::-1], 1, 1, hatch)
    for row, own in grouped((row, step) for step, row in enumerate(design.chosen, 1)).items():
        i, j = places[row]
        axes.add_patch(Rectangle((j, i), 1, 1, fill=False, ec=VERMILLION, lw=1.8, clip_on=False))
        axes.text(j + 0.035, i + 0.06, ", ".join(map(str, own)), ha="left", va="top", fontsize=6.5,
                  color="white", fontweight="bold",
                  bbox={"boxstyle": "square,pad=0.18", "fc": VERMILLION, "ec": "none"})  # fmt: skip
    axes.set(xlabel="Flexion, deg",
             title=f"What one more test would add: {_GAINS[design.criterion][0]}")  # fmt: skip
    handles["chosen, in this order"] = Rectangle((0, 0), 1, 1, fill=False, ec=VERMILLION, lw=1.8)
    figure_legend(figure, handles, loc="lower left", bbox_to_anchor=((left - 0.08) / wide, 0.0),
                  ncols=4, handlelength=1.5, handleheight=1.1, columnspacing=1.5)  # fmt: skip
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
    figure, ((axes,),) = grid(1, 1, 1 + 0.27 * n, left=left, right=right, top=0.55, bottom=0.45)
    y = np.arange(n, dtype=float)
    axes.hlines(y, parts[-1], parts[0], color="#C8CDD2", linewidth=2.2, zorder=1)
    axes.plot(parts[0], y, "o", ms=5, mfc="white", mec=BLACK, zorder=3, label="before")
    for step in range(1, last):
        axes.plot(parts[step], y, "|", ms=6, color=GREY, zorder=2, label="after each test")
    word = f"after {'the test' if last == 1 else f'all {last} tests'}"
    axes.plot(parts[-1], y, "o", ms=5, color=VERMILLION, zorder=4, label=word)
    prior = "prior SD (spread between knees)"
    axes.axvline(1.0, color=GREY, linewidth=0.8, zorder=1, label=prior)
    low, high = parts.min() / 1.3, max(parts.max(), 1.0) * 1.3
    name_rows(axes, y, names)
    axes.set(xscale="log", xlim=(low, high), ylim=(n - 0.5, -0.5),
             xlabel="Expected standard error, as a fraction of the prior SD")  # fmt: skip
    decades(axes.xaxis, 9, (1.0, 2.0, 5.0) if high / low < 200 else (1.0,))
    edge, inch = axes.get_yaxis_transform(), 1.0 / (WIDTH - left - right)
    before, after = 1.0 + 0.62 * inch, 1.0 + 1.27 * inch
    for x, head in ((before, "before"), (after, "after")):
        axes.text(x, -0.62, head, transform=edge, ha="right", va="bottom", fontsize=7.5, color=GREY)
    small = {"transform": edge, "va": "center_baseline", "fontsize": 7.5}
    for i, unit in enumerate(quantity_of(name).unit for name in design.names):
        for x, row in ((before, 0), (after, -1)):
            axes.text(x, i, number(design.standard_errors[row, i], 2), ha="right", **small)
        axes.text(after + 0.07 * inch, i, unit, **small)
    figure_legend(figure, loc="upper left", bbox_to_anchor=((left - 0.1) / WIDTH, 1.0), ncols=4,
                  handlelength=1.2, columnspacing=1.5)  # fmt: skip
    return figure


_SHOWN = 8
# Departure from a straight line from which on a promise is rough.
_FAR = 0.5


def candidates_table(design: Design) -> Table:
    """What each candidate would add, the table of candidates.csv."""
    tests = design.candidates
    place = {row: step for step, row in reversed([*enumerate(design.chosen, 1)])}
    return Table.of({"name": [one.name for one in tests],
                     "flexion_deg": [one.flexion_deg for one in tests],
                     **{load: [one.loads[load] for one in tests] for load in NAMED_LOADS},
                     "status": words_of(design.status), "gain": design.gains,
                     "chosen": [place.get(row) for row in range(len(tests))]})  # fmt: skip


def next_tests_table(design: Design) -> Table:
    """The chosen tests as a table to be filled in and added to a study's `tests`."""
    tests = [design.candidates[row] for row in design.chosen]
    acting = [name for name in NAMED_LOADS if any(test.loads[name] for test in tests)]
    measured = [c for c in FREE_COORDINATES if any(c in test.measured for test in tests)]
    rows = [[test.flexion_deg, *(test.loads[name] for name in acting), *[None] * len(measured)]
            for test in tests]  # fmt: skip
    return Table.plain((COLUMNS[0], *acting, *(COORDINATES[c].column for c in measured)), rows)


def design_words(design: Design) -> list[str]:
    """One sentence per chosen test: what to do, and which parameter profits most."""
    return [
        f"{'Then' if int(step) > 1 else 'Next'}: {test}; it cuts the standard error of "
        f"{plain(name)} from {short(before)} to {short(after)}{unit_after(name)}."
        for step, test, name, before, after in profit_table(design).rows
    ]


def design_notes(design: Design) -> list[str]:
    """What else a reader must know."""
    notes = [prose("design.prior")] if design.prior_assumed else []
    lost = design.status[np.isnan(design.gains)]
    if len(lost):
        words = sorted({word.replace("_", " ") for word in words_of(lost)})
        verb, them = ("is", "it") if len(lost) == 1 else ("are", "them")
        notes.append(prose("design.lost", lost=len(lost), count=len(design.candidates), verb=verb,
                           them=them, words=", ".join(words)))  # fmt: skip
    if design.freed:
        bound = ", ".join(plain(name) for name in design.freed)
        notes.append(f"On a bound at the fit, but counted as free here: {bound}.")
    for test, bend in zip(design.tests, design.departures, strict=True):
        if bend > _FAR:
            off = f"off by {bend:.0%}" if np.isfinite(bend) else "some of it has no balance"
            notes.append(prose("design.bent", test=test, off=off))
    return notes


def profit_table(design: Design) -> Table:
    """The chosen tests, and what each does to the parameter that gains most."""
    rows = []
    for step, test in enumerate(design.tests):
        before, after = design.standard_errors[step : step + 2]
        i = int(np.argmax(before / after))
        rows.append([str(step + 1), str(test), design.names[i], before[i], after[i]])
    columns = [Column("step", " ", words=True), Column("test", "test to make next", words=True),
               Column("parameter", "gains most", words=True),
               Column("before", "std. error before", "2"), Column("after", show="2")]  # fmt: skip
    return Table(columns, rows)


def design_section(design: Design) -> Section:
    """Which tests to make next, and why: expected standard errors, the best tests by themselves,
    and the best for each parameter."""
    many = len(design.chosen)
    # Many steps do not fit beside each other: the first three and the last tell the story.
    shown = list(range(many + 1)) if many <= 5 else [0, 1, 2, 3, many]
    heads = ["before" if step == 0 else f"after {step}" for step in shown]
    units = [quantity_of(name).unit for name in design.names]
    parameter, unit = Column("parameter", words=True), Column("unit", words=True)
    errors = Table.of({
        parameter: design.names, unit: units, Column("prior SD", show="2"): design.scale,
        tuple(Column(head, show="2") for head in heads): design.standard_errors[shown].T,
    }, "Expected standard errors (the prior SD is the spread between knees)")  # fmt: skip
    order = np.argsort(-np.nan_to_num(design.gains, nan=-1.0), kind="stable")[:_SHOWN]
    gain, factor, form = _GAINS[design.criterion]
    best = Table(
        [Column("test", words=True), Column("gain")],
        [[str(design.candidates[row]), form.format(factor * design.gains[row])] for row in order
         if np.isfinite(design.gains[row])],
        f"The best next tests by themselves ({gain})",
    )
    after = np.where(np.isnan(design.standard_errors_next), np.inf, design.standard_errors_next)
    nearest = [design.candidates[row] for row in after.argmin(axis=0)]
    single = Table.of({
        parameter: design.names, Column("best next test", words=True): [*map(str, nearest)],
        Column("before", show="2"): design.standard_errors[0],
        Column("after", show="2"): after.min(axis=0), unit: units,
    }, "If only one parameter matters, the best next test for it")  # fmt: skip
    goal = prose("design.goal", goal=prose(f"design.{design.criterion}"), tests=(
        f"{many} of {len(design.candidates)} candidate tests" if many > 1 else "one test"
    ))  # fmt: skip
    text = [f"What to measure next: {goal}", *design_words(design), *design_notes(design),
            *paragraphs("design.file") * bool(design.chosen)]  # fmt: skip
    return Section("Tests to make next", text, [errors, best, single], ["next_tests"],
                   printed=True)  # fmt: skip
