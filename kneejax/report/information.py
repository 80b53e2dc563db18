"""What data determine of parameters by curvature: the spectrum in words, and a table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from kneejax.quantities import quantity_of
from kneejax.report.look.page import Section, prose
from kneejax.report.look.tables import (
    NONE,
    Column,
    Table,
    number,
    plain,
    short,
    trimmed,
    unit_after,
)

if TYPE_CHECKING:
    from kneejax.inference import Information

# Components of a direction below this part of the largest are not named, nor is a fourth.
_NAMED, _MOST = 0.3, 3
# What is left out may widen the standard error of the rest this many times, and is else mentioned.
_NEARLY = 5.0
# A column that others reproduce within this part of its length is compensated exactly.
_EXACT = 1e-6
# Sentences on the best and the worst known combinations.
_STIFF, _SLOPPY = 2, 3


def slack_words(flexion_deg: np.ndarray, slack: np.ndarray) -> str:
    """Where a ligament is slack, as ranges of flexion.

    Example:
        >>> slack_words([0, 20, 40, 60, 80], [True, False, False, True, True])
        'below 20 and above 40 degrees'
    """
    angles = np.unique(flexion_deg)
    loose = [bool(np.asarray(slack)[np.asarray(flexion_deg) == angle].all()) for angle in angles]
    if all(loose):
        return "at every pose"
    words, last = [], len(angles) - 1
    starts = [i for i in range(len(angles)) if loose[i] and not (i and loose[i - 1])]
    for first in starts:
        end = next((i for i in range(first, last + 1) if not loose[i]), last + 1) - 1
        if first == 0:
            words.append(f"below {angles[end + 1]:g}")
        elif end == last:
            words.append(f"above {angles[first - 1]:g}")
        else:
            words.append(f"between {angles[first - 1]:g} and {angles[end + 1]:g}")
    return f"{joined(words)} degrees" if words else ""


def joined(words: Sequence[str]) -> str:
    """Words with commas, and `and` before the last."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def stiff_words(found: Information) -> list[str]:
    """Sentences on the combinations of parameters that the data fix best."""
    rows = range(min(_STIFF, len(found.eigenvalues)))
    return [_fixed_combination(found, row) for row in rows if found.eigenvalues[row] > 1.0]


def sloppy_words(found: Information) -> list[str]:
    """Sentences on the combinations that the data leave as they were, the worst first."""
    count = len(found.eigenvalues)
    rows = reversed(range(max(count - _SLOPPY, 0), count))
    return [_loose_combination(found, row) for row in rows if found.eigenvalues[row] < 1.0]


def reason_words(found: Information) -> list[str]:
    """For each parameter that is not determined a sentence why; empty for the others."""
    return ["" if determined else _reason(found, row)
            for row, determined in enumerate(found.determined)]  # fmt: skip


def information_table(found: Information) -> Table:
    """What the data determine of each parameter, by curvature."""
    determined, at_bound = found.determined.tolist(), found.at_bound.tolist()
    hidden = {"determined": determined, "at_bound": at_bound, "reason": reason_words(found)}
    return Table.of({
        Column("name", "parameter", words=True): found.names, Column("value"): found.values,
        Column("standard_error", "std. error",
               lambda error: "unlimited" if np.isinf(error) else number(error, 2)):
            found.standard_error,
        Column("unit", words=True): [quantity_of(name).unit for name in found.names],
        Column("scale", "prior SD", lambda scale: trimmed(scale, 3)): found.scale,
        Column("times_better", "times better", lambda x: number(x, 2) if x else NONE):
            found.scale / found.standard_error,
        **{Column(name, shown=False): cells for name, cells in hidden.items()},
        Column("remark", " ", words=True): [*map(remark, determined, at_bound)],
    })  # fmt: skip


def remark(determined: bool, at_bound: bool) -> str:
    """In few words what a parameter is not."""
    return ", ".join(["not determined"] * (not determined) + ["at bound"] * at_bound)


def information_words(found: Information) -> list[str]:
    """Sentences on the combinations of parameters that are known best and worst."""
    words = [*stiff_words(found), *sloppy_words(found)]
    if np.isfinite(found.condition_number):
        ratio = number(float(np.sqrt(found.condition_number)), 2)
        words.append(
            f"The best-determined combination of parameters is known {ratio} times better than "
            f"the worst (condition number {number(found.condition_number, 2)})."
        )
    return words


def information_section(found: Information) -> Section:
    """What the data determine and what not, with the spectrum and the correlations."""
    text = [prose("curvature"), *information_words(found), *information_notes(found)]
    return Section("What the data determine by curvature", text,
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
    bound = [name for name, on in zip(found.names, found.at_bound, strict=True) if on]
    if bound:
        notes.append(f"On a bound and held there: {', '.join(bound)}.")
    if found.lost:
        poses = "1 pose counts" if found.lost == 1 else f"{found.lost} poses count"
        notes.append(f"{poses} for nothing: no balance was found there.")
    return notes


def _fixed_combination(found: Information, index: int) -> str:
    """Say what a direction of much information means, and to what standard error it is known.

    Parameters of one quantity are added in their own unit. Where quantities differ, those that
    have a unit are counted in parts of their values. Small components are not named where the
    combination of the named ones is known nearly as well.
    """
    names, values, scale = found.names, found.values, found.scale
    vector = found.eigenvectors[:, index]
    rows = _named(vector)
    mixed = len({names[row].split(".", 1)[-1] for row in rows}) > 1
    parts = [mixed and bool(unit_after(names[row])) for row in rows]
    terms = [
        f"({plain(names[row])} / {short(values[row])}{unit_after(names[row])})"
        if part
        else plain(names[row])
        for row, part in zip(rows, parts, strict=True)
    ]
    sizes = [abs(values[row]) if part else 1.0 for row, part in zip(rows, parts, strict=True)]
    weights = np.array([vector[r] / scale[r] * size for r, size in zip(rows, sizes, strict=True)])
    sentence = terms[0]
    for term, weight in zip(terms[1:], weights[1:] / weights[0], strict=True):
        factor = "" if abs(abs(weight) - 1.0) < 0.05 else f"{short(abs(weight))} "
        sentence += f" {'-' if weight < 0 else '+'} {factor}{term}"
    deviation, others = _deviation(index, rows, found.eigenvalues, found.eigenvectors)
    known = deviation / abs(weights[0])
    error = f"{short(known)}{unit_after(names[rows[0]]) or ' strain'}"
    if parts[0]:
        error = f"{short(100 * known)} %"
    return f"Well-determined combination: {sentence}{others}, standard error {error}."


def _deviation(
    index: int, rows: list[int], eigenvalues: np.ndarray, eigenvectors: np.ndarray
) -> tuple[float, str]:
    """Standard deviation of the named part of a direction, or of all of it, which words say."""
    named = np.zeros(len(eigenvectors))
    named[rows] = eigenvectors[rows, index]
    overlap = (eigenvectors.T @ named) ** 2
    whole = float(eigenvalues[index] ** -0.5)
    if (overlap[eigenvalues == 0] < 1e-12).all():
        known = eigenvalues > 0
        alone = float(np.sqrt((overlap[known] / eigenvalues[known]).sum()))
        if alone < _NEARLY * whole:
            return alone, ""
    return whole, ", with small parts of others"


def _loose_combination(found: Information, index: int) -> str:
    """Say what change of parameters leaves hardly a trace in the data.

    The change is as large as the parameters' scales, so that its trace can be compared with noise.
    """
    names, scale, eigenvalues = found.names, found.scale, found.eigenvalues
    vector = found.eigenvectors[:, index] / np.abs(found.eigenvectors[:, index]).max()
    rows = _named(vector)
    changes = [
        f"{plain(names[row])} by {short(vector[row] * scale[row], '+')}{unit_after(names[row])}"
        for row in rows
    ]
    trace = float(np.sqrt(eigenvalues[index]) * np.linalg.norm(vector))
    named = np.zeros(len(vector))
    named[rows] = vector[rows]
    alone = float(np.linalg.norm(np.sqrt(eigenvalues) * (found.eigenvectors.T @ named)))
    others = ", with small changes of others," if alone > 1.5 * trace + 0.01 else ""
    together = " together" if len(rows) > 1 and not others else ""
    return f"Changing {joined(changes)}{together}{others} {noise_words(trace)}."


def noise_words(deviations: float) -> str:
    """What a change does to the data, as a multiple of their noise."""
    size = "less than 0.001" if deviations < 1e-3 else short(deviations)
    seen = "would be invisible" if deviations < 1.0 else "would hardly show"
    return f"{seen} ({size} x noise)"


def _reason(found: Information, row: int) -> str:
    """Say why data do not determine a parameter."""
    names, weighted, held = found.names, found.weighted, found.at_bound
    slack = found.slack.get(names[row].split(".", 1)[0])
    begin = f"{plain(names[row])} is not determined by these data: "
    if held[row]:
        return f"{begin}it is on its bound, and the data would move it further."
    causes = []
    known = slack is not None and found.flexion_deg is not None
    where = slack_words(found.flexion_deg, slack) if known else ""
    if where:
        causes.append(f"its ligament is slack {where}")
    seen = float(np.linalg.norm(weighted[:, row]))
    if seen >= 1.0:
        causes.append(_rivals(row, names, weighted, held))
    elif seen > 1e-3 or not where:
        change = f"{short(found.scale[row])}{unit_after(names[row])}"
        causes.append(f"a change of {change} {noise_words(seen)}")
    return begin + "; ".join(causes) + "."


def _rivals(row: int, names: Sequence[str], weighted: np.ndarray, held: np.ndarray) -> str:
    """Which other parameters compensate a change of one, and how well.

    How well is said by all others together, free to move anywhere. Who, by the least movement that
    does it: in a spectrum over decades, the weakest would else carry the largest numbers.
    """
    others = np.flatnonzero(~held & (np.arange(len(names)) != row))
    column, rest = weighted[:, row], weighted[:, others]
    anywhere = np.linalg.lstsq(rest, column, rcond=None)[0]
    left = np.linalg.norm(column - rest @ anywhere) / np.linalg.norm(column)
    least = np.linalg.solve(rest.T @ rest + np.eye(len(others)), rest.T @ column)
    part = np.abs(least) * np.linalg.norm(rest, axis=0)
    order = [i for i in np.argsort(-part)[:_MOST] if part[i] >= 0.5 * part.max()]
    who = joined([plain(names[int(others[i])]) for i in order])
    verb = "compensate" if len(order) > 1 else "compensates"
    percent = 100.0 * (1.0 - left)
    much = "exactly" if left < _EXACT else f"to {percent:{'.0f' if percent < 99 else '.4g'}} %"
    return f"{who} {verb} it {much}"


def _named(vector: np.ndarray) -> list[int]:
    """The components worth naming, largest first."""
    order = np.argsort(-np.abs(vector), kind="stable")[:_MOST]
    return [int(row) for row in order if abs(vector[row]) >= _NAMED * np.abs(vector).max()]
