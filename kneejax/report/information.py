"""What data determine of parameters by curvature: the spectrum in words, and a table."""

from collections.abc import Mapping, Sequence

import numpy as np

from kneejax.inference import Information
from kneejax.quantities import quantity_of
from kneejax.report.look import tables
from kneejax.report.look.colours import BLUE, GREY, VERMILLION, both_signs
from kneejax.report.look.page import Section, prose
from kneejax.report.look.style import Figure, readable, styled
from kneejax.report.look.tables import Column, Table, plain, short, unit_after
from kneejax.report.panels import decades, draw_matrix, grid

# Components of a direction below this part of the largest are not named, nor is a fourth.
_NAMED, _MOST = 0.3, 3
# What is left out may widen the standard error of the rest this many times, and is else mentioned.
_NEARLY = 5.0
# A column that others reproduce within this part of its length is compensated exactly.
_EXACT = 1e-6
# Sentences on the best and the worst known combinations.
_STIFF, _SLOPPY = 2, 3
# Decades that the axis of the spectrum shows below its longest bar.
_DECADES = 8.0


def slack_words(flexion_deg: np.ndarray, slack: np.ndarray) -> str:
    """Where a ligament is slack, as ranges of flexion.

    Example:
        >>> slack_words([0, 20, 40, 60, 80], [True, False, False, True, True])
        'below 20 and above 40 degrees'
    """
    angles = np.unique(flexion_deg)
    loose = [np.asarray(slack)[np.asarray(flexion_deg) == angle].all() for angle in angles]
    if all(loose):
        return "at every pose"
    words = []
    for first, last in tables.runs(np.flatnonzero(loose)):
        if first == 0:
            words.append(f"below {angles[last + 1]:g}")
        elif last == len(angles) - 1:
            words.append(f"above {angles[first - 1]:g}")
        else:
            words.append(f"between {angles[first - 1]:g} and {angles[last + 1]:g}")
    return f"{joined(words)} degrees" if words else ""


def joined(words: Sequence[str]) -> str:
    """Words with commas, and `and` before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def stiff_words(found: Information) -> list[str]:
    """Sentences on the combinations of parameters that the data fix best, and how well.

    Parameters of one quantity are added in their own unit. Where quantities differ, those that
    have a unit are counted in parts of their values. Small components are not named where the
    combination of the named ones is known nearly as well.
    """
    names, values, said = found.names, found.values, []
    for index in np.flatnonzero(found.eigenvalues[:_STIFF] > 1.0):
        vector = found.eigenvectors[:, index]
        rows, named = _named(vector)
        mixed = len({names[row].split(".", 1)[-1] for row in rows}) > 1
        terms, weights = [], []
        for row in rows:
            term, weight, unit = plain(names[row]), vector[row] / found.scale[row], ""
            if mixed:
                unit = unit_after(names[row])
            if unit:
                term, weight = f"({term} / {short(values[row])}{unit})", weight * abs(values[row])
            terms.append(term)
            weights.append(weight)
        sentence = terms[0]
        for term, weight in zip(terms[1:], np.array(weights[1:]) / weights[0], strict=True):
            factor = "" if abs(abs(weight) - 1.0) < 0.05 else f"{short(abs(weight))} "
            sentence += f" {'-' if weight < 0 else '+'} {factor}{term}"
        # The standard deviation of the named part of the direction, or of all of it.
        overlap, known = (found.eigenvectors.T @ named) ** 2, found.eigenvalues > 0
        deviation, others = float(found.eigenvalues[index] ** -0.5), ", with small parts of others"
        alone = np.inf
        if (overlap[~known] < 1e-12).all():
            alone = float(np.sqrt((overlap[known] / found.eigenvalues[known]).sum()))
        if alone < _NEARLY * deviation:
            deviation, others = alone, ""
        size = deviation / abs(weights[0])
        error = f"{short(size)}{unit_after(names[rows[0]]) or ' strain'}"
        if mixed and unit_after(names[rows[0]]):
            error = f"{short(100 * size)} %"
        said.append(f"Well-determined combination: {sentence}{others}, standard error {error}.")
    return said


def sloppy_words(found: Information) -> list[str]:
    """Sentences on the changes of parameters that leave hardly a trace in the data, the worst
    first.

    A change is as large as the parameters' scales, so that its trace can be compared with noise.
    """
    said, count = [], len(found.eigenvalues)
    for index in reversed(range(max(count - _SLOPPY, 0), count)):
        if found.eigenvalues[index] >= 1.0:
            continue
        vector = found.eigenvectors[:, index] / np.abs(found.eigenvectors[:, index]).max()
        rows, named = _named(vector)
        changes = [
            f"{plain(found.names[row])} by {short(vector[row] * found.scale[row], '+')}"
            f"{unit_after(found.names[row])}"
            for row in rows
        ]
        trace = float(np.sqrt(found.eigenvalues[index]) * np.linalg.norm(vector))
        alone = np.linalg.norm(np.sqrt(found.eigenvalues) * (found.eigenvectors.T @ named))
        others = ", with small changes of others," if alone > 1.5 * trace + 0.01 else ""
        together = " together" if len(rows) > 1 and not others else ""
        said.append(f"Changing {joined(changes)}{together}{others} {noise_words(trace)}.")
    return said


def reason_words(found: Information) -> list[str]:
    """For each parameter that is not determined a sentence why; empty for the others."""
    said = [""] * len(found.names)
    for row in np.flatnonzero(~np.asarray(found.determined, bool)):
        name, causes, where = found.names[row], [], ""
        slack = found.slack.get(name.split(".", 1)[0])
        if slack is not None and found.flexion_deg is not None:
            where = slack_words(found.flexion_deg, slack)
        seen = float(np.linalg.norm(found.weighted[:, row]))
        if found.at_bound[row]:
            causes = ["it is on its bound, and the data would move it further"]
        else:
            causes += [f"its ligament is slack {where}"] * bool(where)
            if seen >= 1.0:
                causes.append(_rivals(found, row))
            elif seen > 1e-3 or not where:
                change = f"{short(found.scale[row])}{unit_after(name)}"
                causes.append(f"a change of {change} {noise_words(seen)}")
        said[row] = f"{plain(name)} is not determined by these data: {'; '.join(causes)}."
    return said


def information_table(
    found: Information, determined: Sequence[bool] | None = None,
    limits: Mapping[str, Sequence[str]] | None = None,
) -> Table:
    """What the data determine of each parameter, by curvature, or as `determined` says, with
    columns of other `limits`."""
    known = found.determined if determined is None else determined
    marks = zip(known, found.at_bound, strict=True)
    values = zip(found.values, found.standard_error, strict=True)
    return Table.of({
        Column("name", "parameter", words=True): found.names,
        Column("value"): [tables.with_error(*pair)[0] for pair in values],
        Column("standard_error", "std. error",
               lambda error: "unlimited" if np.isinf(error) else tables.number(error, 2)):
            found.standard_error,
        Column("unit", words=True): [quantity_of(name).unit for name in found.names],
        **{Column(head, words=True): cells for head, cells in (limits or {}).items()},
        Column("scale", "prior SD", lambda scale: tables.trimmed(scale, 3)): found.scale,
        Column("times_better", "times better", lambda x: tables.number(x, 2) if x else tables.NONE):
            found.scale / found.standard_error,
        Column("remark", " ", words=True): [
            ", ".join(["not determined"] * (not told) + ["at bound"] * bool(at_bound))
            for told, at_bound in marks
        ],
    }, spare=("times_better", "scale"))  # fmt: skip


def information_section(found: Information) -> Section:
    """What the data determine and what not, with the spectrum and the correlations."""
    text = [prose("curvature"), *stiff_words(found), *sloppy_words(found)]
    if np.isfinite(found.condition_number):
        ratio = tables.number(float(np.sqrt(found.condition_number)), 2)
        text.append(
            f"The best-determined combination of parameters is known {ratio} times better than "
            f"the worst (condition number {tables.number(found.condition_number, 2)})."
        )
    return Section("What the data determine by curvature", [*text, *information_notes(found)],
                   drawings=["spectrum", "correlation"], printed=True)  # fmt: skip


def information_notes(found: Information) -> list[str]:
    """What else a reader must know."""
    notes, free = [], int((~found.at_bound).sum())
    if found.data < free:
        notes.append(
            f"{found.data} measured numbers for {free} free parameters: at least "
            f"{free - found.data} combinations stay unknown whatever was measured. Fix parameters "
            "or measure more."
        )
    if bound := [name for name, on in zip(found.names, found.at_bound, strict=True) if on]:
        notes.append(f"On a bound and held there: {', '.join(bound)}.")
    if found.lost:
        poses = "1 pose counts" if found.lost == 1 else f"{found.lost} poses count"
        notes.append(f"{poses} for nothing: no balance was found there.")
    return notes


def noise_words(deviations: float) -> str:
    """What a change does to the data, as a multiple of their noise."""
    size = "less than 0.001" if deviations < 1e-3 else short(deviations)
    seen = "would be invisible" if deviations < 1.0 else "would hardly show"
    return f"{seen} ({size} x noise)"


def _rivals(found: Information, row: int) -> str:
    """Which other parameters compensate a change of one, and how well.

    How well is said by all others together, free to move anywhere. Who, by the least movement that
    does it: in a spectrum over decades, the weakest would else carry the largest numbers.
    """
    others = np.flatnonzero(~found.at_bound & (np.arange(len(found.names)) != row))
    column, rest = found.weighted[:, row], found.weighted[:, others]
    anywhere = np.linalg.lstsq(rest, column, rcond=None)[0]
    left = np.linalg.norm(column - rest @ anywhere) / np.linalg.norm(column)
    least = np.linalg.solve(rest.T @ rest + np.eye(len(others)), rest.T @ column)
    part = np.abs(least) * np.linalg.norm(rest, axis=0)
    order = [i for i in np.argsort(-part)[:_MOST] if part[i] >= 0.5 * part.max()]
    who = joined([plain(found.names[int(others[i])]) for i in order])
    percent = 100.0 * (1.0 - left)
    much = "exactly" if left < _EXACT else f"to {percent:{'.0f' if percent < 99 else '.4g'}} %"
    return f"{who} compensate{'s' * (len(order) == 1)} it {much}"


def _named(vector: np.ndarray) -> tuple[list[int], np.ndarray]:
    """The components worth naming, largest first, and the vector without all others."""
    order = np.argsort(-np.abs(vector), kind="stable")[:_MOST]
    rows = [int(row) for row in order if abs(vector[row]) >= _NAMED * np.abs(vector).max()]
    return rows, np.where(np.isin(np.arange(len(vector)), rows), vector, 0.0)


@styled
def spectrum_figure(found: Information) -> Figure:
    """Draw how well each combination of parameters is known, and what it is made of."""
    free = ~found.at_bound
    names = [readable(name) for name, on in zip(found.names, free, strict=True) if on]
    vectors, better = found.eigenvectors[free], np.sqrt(found.eigenvalues)
    n = len(names)
    if not n:
        figure, _ = grid(1, 1, 0.8, width=5.0, left=0.1, top=0.1, bottom=0.1, shown=0)
        figure.text(0.5, 0.5, "Every parameter is on a bound: nothing is free.", ha="center")
        return figure
    cell, left, right = min(0.44, 6.0 / n), 0.062 * max(map(len, names)) + 0.15, 1.0
    wide, tall = max(left + cell * n, left + 3.4) + right, cell * n
    figure, ((top,), (table,)) = grid(2, 1, tall + 2.34, width=wide, left=left,
                                      right=wide - left - tall, top=0.32, bottom=0.55,
                                      apart=(0, 0.12), height_ratios=(1.35, tall))  # fmt: skip
    # A bar for each combination: how many times better it is known than before.
    low = max(better.max(initial=1.0) * 10.0**-_DECADES, 1e-4)
    floor = min(0.5, max(better[better > low].min(initial=1.0) / 2.0, low))
    places = np.arange(n) + 0.5
    colours = [BLUE if size >= 1.0 else VERMILLION for size in better]
    top.bar(places, np.maximum(better, floor) - floor, bottom=floor, width=0.7, color=colours)
    for place, size in zip(places, better, strict=True):
        word = f"{size:.0f}" if size >= 9.95 else f"{size:.2g}" if size > low else "0"
        if n <= 16:
            top.annotate(word, (place, max(size, floor)), (0, 1.5), textcoords="offset points",
                         ha="center", va="bottom", fontsize=6.8)  # fmt: skip
    top.axhline(1.0, color=GREY, linewidth=0.8)
    top.annotate("no better than\nthe prior", (n, 1.0), (4, 0), textcoords="offset points",
                 va="center", fontsize=7, color=GREY)  # fmt: skip
    most = max(better.max(), 2.0)
    # Room for the number above the longest bar.
    top.set(yscale="log", ylim=(floor, most * (most / floor) ** 0.16), xlim=(0, n), xticks=[],
            title="Prior SD over standard error, for each combination of parameters")  # fmt: skip
    decades(top.yaxis, 6)
    top.grid(axis="x", visible=False)
    weights = draw_matrix(table, vectors, both_signs(), (-1, 1),
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
