"""The tests to make next: sentences and tables of a choice of candidates."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COLUMNS, COORDINATES, FREE_COORDINATES
from kneejax.mechanics import NAMED_LOADS
from kneejax.parameters import unit_of_quantity
from kneejax.report.look import Column, Table, number, plain, short, unit_after, wrapped
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.inference import Design

#: Columns of a table of all candidates.
CANDIDATE_COLUMNS = (
    "name", "flexion_deg", *NAMED_LOADS, "status", "gain", "chosen",
)  # fmt: skip
_GOALS = {
    "D": "all parameters together become as certain as possible (D-optimal: the joint confidence "
    "region shrinks most)",
    "A": "the parameters become certain on average (A-optimal: the mean squared standard error, in "
    "units of the prior SD, falls most)",
}
_SHOWN = 8
# Departure from a straight line from which on a promise is rough.
_FAR = 0.5


def gain_words(criterion: str) -> str:
    """What the gains of a design are, with their unit."""
    if criterion == "D":
        return "information gained, bits"
    return "fall of the mean squared standard error, %"


def candidates_table(design: Design) -> Table:
    """What each candidate would add, the table of candidates.csv.

    Args:
        design: the candidates and the choice.

    Returns:
        A row per candidate under the columns `CANDIDATE_COLUMNS`; `gain` in bits (D) or as a
        fraction (A), `chosen` is its place in the order, if any.
    """
    place: dict[int, int] = {}
    for step, row in enumerate(design.chosen, 1):
        place.setdefault(row, step)
    rows = [
        [test.name, test.flexion_deg, *(test.loads[name] for name in NAMED_LOADS)]
        + [Status(status).word, float(gain), place.get(row)]
        for row, (test, status, gain) in enumerate(
            zip(design.candidates, design.status, design.gains, strict=True)
        )
    ]
    return Table([Column(name) for name in CANDIDATE_COLUMNS], rows)


def next_tests_table(design: Design) -> Table:
    """The chosen tests as a table to be filled in and added to a study's `tests`.

    Args:
        design: the choice.

    Returns:
        A row per test in the order in which to make them; what is to be measured is empty.
    """
    tests = [design.candidates[row] for row in design.chosen]
    acting = [name for name in NAMED_LOADS if any(test.loads[name] for test in tests)]
    measured = [c for c in FREE_COORDINATES if any(c in test.measured for test in tests)]
    columns = (COLUMNS[0], *acting, *(COORDINATES[c].column for c in measured))
    rows = [
        [test.flexion_deg, *(test.loads[name] for name in acting), *[None] * len(measured)]
        for test in tests
    ]
    return Table([Column(name) for name in columns], rows)


def design_text(design: Design) -> str:
    """Say on a terminal which tests to make next, and why.

    Args:
        design: the choice.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    lines = [*wrapped(f"What to measure next: {goal_words(design)}"), ""]
    for step, sentence in enumerate(design_words(design), 1):
        lines += wrapped(sentence, f"{step}. ")
    for table in design_tables(design):
        lines += ["", f"{table.title}:", table.terminal()]
    notes = design_notes(design)
    lines += [""] * bool(notes)
    for note in notes:
        lines += wrapped(note, "note: ")
    return "\n".join(lines)


def goal_words(design: Design) -> str:
    """How many tests were chosen, and what they make small."""
    many = len(design.chosen)
    tests = f"{many} of {len(design.candidates)} candidate tests" if many > 1 else "one test"
    return (
        f"{tests}, chosen so that {_GOALS[design.criterion]}. Each is one more pose of this knee, "
        "predicted with the fitted parameters."
    )


def design_words(design: Design) -> list[str]:
    """One sentence per chosen test: what to do, and which parameter profits most."""
    words = ["Next", *["Then"] * (len(design.chosen) - 1)]
    return [
        f"{word}: {test}; it cuts the standard error of {_profit(design, step)}."
        for step, (word, test) in enumerate(zip(words, design.tests, strict=True))
    ]


def _profit(design: Design, step: int) -> str:
    before, after = design.standard_errors[step : step + 2]
    row = int(np.argmax(before / after))
    name = design.names[row]
    return f"{plain(name)} from {short(before[row])} to {short(after[row])}{unit_after(name)}"


def design_notes(design: Design) -> list[str]:
    """What else a reader must know."""
    notes = []
    if design.prior_assumed:
        notes.append(
            "The data alone leave combinations of parameters less certain than the prior. The "
            "prior (each parameter's spread between knees, as a standard deviation) is therefore "
            "part of every number here."
        )
    lost = design.status[np.isnan(design.gains)]
    if len(lost):
        words = sorted({Status(s).word.replace("_", " ") for s in lost})
        verb, them = ("is", "it") if len(lost) == 1 else ("are", "them")
        notes.append(
            f"{len(lost)} of {len(design.candidates)} candidates {verb} left out, since the model "
            f"does not predict {them} well ({', '.join(words)})."
        )
    if design.freed:
        bound = ", ".join(plain(name) for name in design.freed)
        notes.append(f"On a bound at the fit, but counted as free here: {bound}.")
    return notes + [
        f"{test}: the pose is far from a straight line over what the parameters may still be "
        f"({_off(bend)}). Take what it promises as a rough guide, and plan again after it."
        for test, bend in zip(design.tests, design.departures, strict=True)
        if bend > _FAR
    ]


def _off(bend: float) -> str:
    return f"off by {bend:.0%}" if np.isfinite(bend) else "some of it has no balance"


def design_tables(design: Design) -> list[Table]:
    """Expected standard errors, the best tests by themselves, and the best for each parameter."""
    steps, two = len(design.chosen), functools.partial(number, digits=2)
    # Many steps do not fit beside each other: the first three and the last tell the story.
    shown = list(range(steps + 1)) if steps <= 5 else [0, 1, 2, 3, steps]
    heads = ["before" if step == 0 else f"after {step}" for step in shown]
    units = [unit_of_quantity(name.split(".", 1)[-1]) for name in design.names]
    parameter, unit = Column("parameter", words=True), Column("unit", words=True)
    errors = Table(
        [parameter, unit, *(Column(head, show=two) for head in ("prior SD", *heads))],
        [
            [name, units[i], design.scale[i], *(design.standard_errors[step, i] for step in shown)]
            for i, name in enumerate(design.names)
        ],
        "Expected standard errors (the prior SD is the spread between knees)",
    )
    order = np.argsort(-np.nan_to_num(design.gains, nan=-1.0), kind="stable")[:_SHOWN]
    factor, digits = (1.0, 1) if design.criterion == "D" else (100.0, 0)
    best = Table(
        [Column("test", words=True), Column("gain")],
        [
            [str(design.candidates[row]), f"{factor * design.gains[row]:.{digits}f}"]
            for row in order
            if np.isfinite(design.gains[row])
        ],
        f"The best next tests by themselves ({gain_words(design.criterion)})",
    )
    after = np.where(np.isnan(design.standard_errors_next), np.inf, design.standard_errors_next)
    rows = [
        [name, str(design.candidates[row]), design.standard_errors[0, i], after[row, i], units[i]]
        for i, name in enumerate(design.names)
        for row in [int(np.argmin(after[:, i]))]
    ]
    columns = [Column("best next test", words=True), Column("before", show=two)]
    single = Table(
        [parameter, *columns, Column("after", show=two), unit],
        rows,
        "If only one parameter matters, the best next test for it",
    )
    return [errors, best, single]
