"""What data determine of parameters by curvature, and which tests tell more: words and tables."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from kneejax.geometry import COLUMNS, COORDINATES, FREE_COORDINATES
from kneejax.inference import Design, Information
from kneejax.mechanics import NAMED_LOADS
from kneejax.quantities import quantity_of
from kneejax.report.identification_figures import GAINS
from kneejax.report.look import tables
from kneejax.report.look.page import Section, paragraphs, prose
from kneejax.report.look.tables import Column, Table, plain, short, unit_after
from kneejax.report.pose_tables import words_of

# Components of a direction below this part of the largest are not named, nor is a fourth.
_NAMED, _MOST = 0.3, 3
# What is left out may widen the standard error of the rest this many times, and is else mentioned.
_NEARLY = 5.0
# A column that others reproduce within this part of its length is compensated exactly.
_EXACT = 1e-6
# Sentences on the best and the worst known combinations.
_STIFF, _SLOPPY = 2, 3
#: Tests that are listed as the best by themselves.
_SHOWN = 8
# Departure from a straight line from which on a promise is rough.
_FAR = 0.5


def slack_words(flexion_deg: np.ndarray, slack: np.ndarray) -> str:
    """Where a ligament is slack, as ranges of flexion: `below 20 and above 40 degrees`."""
    angles = np.unique(flexion_deg)
    loose = [np.asarray(slack)[np.asarray(flexion_deg) == angle].all() for angle in angles]
    if all(loose):
        return "at every pose"
    words = [
        f"below {angles[last + 1]:g}" if first == 0 else
        f"above {angles[first - 1]:g}" if last == len(angles) - 1 else
        f"between {angles[first - 1]:g} and {angles[last + 1]:g}"
        for first, last in tables.runs(np.flatnonzero(loose))
    ]  # fmt: skip
    return f"{joined(words)} degrees" if words else ""


def joined(words: Sequence[str]) -> str:
    """Words with commas, and `and` before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def stiff_words(found: Information) -> list[str]:
    """The combinations that the data fix best, in parts of values where quantities differ."""
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
    """Changes, as large as their scales, that hardly show in the data; the worst first."""
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
        name, where = found.names[row], ""
        slack = found.slack.get(name.split(".", 1)[0])
        if slack is not None and found.flexion_deg is not None:
            where = slack_words(found.flexion_deg, slack)
        seen = float(np.linalg.norm(found.weighted[:, row]))
        causes = ["it is on its bound, and the data would move it further"]
        if not found.at_bound[row]:
            causes = [f"its ligament is slack {where}"] * bool(where)
            if seen >= 1.0:
                causes.append(_rivals(found, row))
            elif seen > 1e-3 or not where:
                change = f"{short(found.scale[row])}{unit_after(name)}"
                causes.append(f"a change of {change} {noise_words(seen)}")
        said[row] = f"{plain(name)} is not determined by these data: {'; '.join(causes)}."
    return said


def information_table(
    found: Information, determined: Sequence[bool], limits: Mapping[str, Sequence[str]]
) -> Table:
    """What the data determine, by curvature or as `determined` says; columns of other `limits`."""
    marks = zip(determined, found.at_bound, strict=True)
    values = zip(found.values, found.standard_error, strict=True)
    return Table.of({
        Column("name", "parameter"): found.names,
        Column("value", words=False): [tables.with_error(*pair)[0] for pair in values],
        Column("standard_error", "std. error",
               lambda error: "unlimited" if np.isinf(error) else tables.number(error, 2)):
            found.standard_error,
        "unit": [quantity_of(name).unit for name in found.names], **limits,
        Column("scale", "prior SD", lambda scale: tables.trimmed(scale, 3)): found.scale,
        Column("times_better", "times better", lambda x: tables.number(x, 2) if x else tables.NONE):
            found.scale / found.standard_error,
        Column("remark", " "): [
            ", ".join(["not determined"] * (not told) + ["at bound"] * bool(at_bound))
            for told, at_bound in marks
        ],
    }, spare=("times_better", "scale"))  # fmt: skip


def information_section(found: Information) -> Section:
    """What the data determine and what not, with the spectrum and the correlations."""
    text = [prose("curvature"), *stiff_words(found), *sloppy_words(found)]
    if np.isfinite(found.condition_number):
        ratio = tables.number(float(np.sqrt(found.condition_number)), 2)
        text.append(prose("curvature.condition", ratio=ratio,
                          number=tables.number(found.condition_number, 2)))  # fmt: skip
    return Section("What the data determine by curvature", [*text, *information_notes(found)],
                   drawings=["spectrum", "correlation"], printed=True)  # fmt: skip


def information_notes(found: Information) -> list[str]:
    """What else a reader must know."""
    notes, free = [], int((~found.at_bound).sum())
    if found.data < free:
        notes.append(prose("curvature.data", data=found.data, free=free, least=free - found.data))
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
    """Which others compensate a change of one by the least movement, and how well all can."""
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
    return Table((COLUMNS[0], *acting, *(COORDINATES[c].column for c in measured)), rows)


def design_words(design: Design) -> list[str]:
    """One sentence per chosen test: what to do, and which parameter profits most."""
    return [
        f"{'Then' if int(step) > 1 else 'Next'}: {test}; it cuts the standard error of "
        f"{plain(name)} from {short(before)} to {short(after)}{unit_after(name)}."
        for step, test, name, before, after in profit_table(design).rows
    ]


def design_notes(design: Design) -> list[str]:
    """What else a reader must know."""
    notes = [prose("design.prior")] if design.prior_assumed.any() else []
    prior = np.full(len(design.names), np.inf) if design.prior is None else design.prior
    said = np.isfinite(prior) & ~design.prior_assumed
    if said.any():
        names = joined([plain(name) for name in itertools.compress(design.names, said)])
        notes.append(prose("design.stated", names=names))
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
        off = f"off by {bend:.0%}" if np.isfinite(bend) else "some of it has no balance"
        notes += [prose("design.bent", test=test, off=off)] * bool(bend > _FAR)
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
    """Which tests to make next, and why; the best by themselves, and for each parameter."""
    many = len(design.chosen)
    # Many steps do not fit beside each other: the first three and the last tell the story.
    shown = list(range(many + 1)) if many <= 5 else [0, 1, 2, 3, many]
    heads = ["before" if step == 0 else f"after {step}" for step in shown]
    units = [quantity_of(name).unit for name in design.names]
    errors = Table.of({
        "parameter": design.names, "unit": units, Column("prior SD", show="2"): design.scale,
        tuple(Column(head, show="2") for head in heads): design.standard_errors[shown].T,
    }, "Expected standard errors (prior SD: as stated, else the spread between knees)")  # fmt: skip
    order = np.argsort(-np.nan_to_num(design.gains, nan=-1.0), kind="stable")[:_SHOWN]
    gain, factor, form = GAINS[design.criterion]
    best = Table([Column("test", words=True), Column("gain", words=False)],
                 [[str(design.candidates[row]), form.format(factor * design.gains[row])]
                  for row in order if np.isfinite(design.gains[row])],
                 f"The best next tests by themselves ({gain})")  # fmt: skip
    after = np.where(np.isnan(design.standard_errors_next), np.inf, design.standard_errors_next)
    nearest = [str(design.candidates[row]) for row in after.argmin(axis=0)]
    single = Table.of({
        "parameter": design.names, "best next test": nearest,
        Column("before", show="2"): design.standard_errors[0],
        Column("after", show="2"): after.min(axis=0), "unit": units,
    }, "If only one parameter matters, the best next test for it")  # fmt: skip
    tests = f"{many} of {len(design.candidates)} candidate tests" if many > 1 else "one test"
    goal = prose("design.goal", goal=prose(f"design.{design.criterion}"), tests=tests)
    text = [f"What to measure next: {goal}", *design_words(design), *design_notes(design),
            *paragraphs("design.file") * bool(design.chosen)]  # fmt: skip
    return Section("Tests to make next", text, [errors, best, single], ["next_tests"],
                   printed=True)  # fmt: skip
