"""Maps of the objective as an answer: where it is lowest, and how well a pair is determined."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.inference import Condition, ParameterMap
from kneejax.report.look import (
    NONE,
    Answer,
    Column,
    Drawing,
    Section,
    Table,
    Verdict,
    number,
    wrapped,
)
from kneejax.report.sensitivity._maps import map_figure, map_matrix_figure

_COLUMNS = (
    "x", "y", "x_minimum", "y_minimum", "objective_minimum", "x_start", "y_start",
    "objective_start", *(condition.word for condition in Condition),
)  # fmt: skip
_CAPTION = (
    "Objective and the sum of squared errors of each coordinate; dark is low. Hatched regions have "
    "no result that counts. A round valley: the data determine both parameters. A long one: a "
    "change of one is compensated by the other."
)


def map_answer(
    maps: Sequence[ParameterMap],
    about: Mapping[str, str],
    versions: Mapping[str, str],
    begun: str = "start",
) -> Answer:
    """What maps of the objective show.

    Args:
        maps: one for each pair of parameters.
        about: what they are of, in words (`kneejax.studies.about_maps`).
        versions: package -> version.
        begun: what the knee's own values are: `start` of a search, or its `fit`.

    Returns:
        The answer; its table is maps.
    """
    lowest = lowest_table(maps, begun)
    drawings = {}
    for one in maps:
        name = "map" if len(maps) == 1 else f"map-{one.names[0]}-{one.names[1]}"
        drawings[name] = Drawing(functools.partial(map_figure, one, begun), _CAPTION)
    single = list(drawings)
    if len(maps) > 2:
        caption = f"All pairs on one scale of colours. {_CAPTION}"
        drawings["maps"] = Drawing(functools.partial(map_matrix_figure, maps, begun), caption)
    picture = "maps" if len(maps) > 2 else single[0]
    empty = [one for one in maps if not one.drawn.any()]
    found = [(" and ".join(one.names), _doubt(one, begun)) for one in maps]
    doubts = [f"{pair}: {doubt}" for pair, doubt in found if doubt]
    counted = np.concatenate([one.condition.ravel() for one in maps])
    counts = [(one, int((counted == one).sum())) for one in Condition if one]
    notes = [f"{n} grid point{'s' * (n > 1)}: {one.sentence}" for one, n in counts if n]
    if maps[0].left_out:
        doubts.append(
            f"{maps[0].left_out} measured poses count nowhere: the knee itself has no balance there"
        )
    words = [line for one in (lowest.note, *notes, *doubts) for line in wrapped(one)]
    # A terminal is too narrow for all columns; the counts below say what is not drawn.
    wide = (f"at_the_{begun}", "not_drawn")
    narrow = [dataclasses.replace(one, shown=one.name not in wide) for one in lowest.columns]
    return Answer(
        title=f"Objective over {' and '.join(maps[0].names)}" if len(maps) == 1 else
        f"Objective over {len(maps)} pairs of parameters",
        asked=f"{about['study']}, knee {about['knee']}: for which values of the parameters is the "
        f"motion nearest to the measured one? Grid {about['grid']}, {about['ranges']}.",
        verdict=Verdict.FAILED if len(empty) == len(maps) else
        Verdict.DOUBTFUL if doubts else Verdict.GOOD,
        sentence=" ".join(_sentence(one) for one in maps[:3] if one.drawn.any()),
        tables={"maps": Table([Column(name) for name in _COLUMNS], [_row(one) for one in maps])},
        main=[lowest],
        drawings=drawings,
        picture=picture,
        doubts=doubts,
        sections=[
            *([Section("Grid points that do not count", notes)] if notes else []),
            *([Section("Each pair", drawings=[x for x in single if x != picture])]
              if len(maps) > 1 else []),
        ],
        text="\n".join([dataclasses.replace(lowest, columns=narrow).terminal(), *words]),
        document={"about": dict(about), "versions": dict(versions)},
        exit_status=int(bool(empty) or any(one.left_out for one in maps)),
    )  # fmt: skip


def lowest_table(maps: Sequence[ParameterMap], begun: str = "start") -> Table:
    """Where the objective is lowest, and how well the pair is determined there.

    Args:
        maps: one for each pair of parameters.
        begun: what the knee's own values are.
    """
    two, percent = functools.partial(number, digits=2), lambda part: f"{part:.1%}"
    rows = []
    for one in maps:
        x, y, objective = one.minimum or (np.nan, np.nan, np.nan)
        low = one.drawn & (one.objective <= 2.0 * objective)
        near = low.sum() / max(one.drawn.sum(), 1)
        rows.append(
            [*one.names, x, y, objective, one.start_objective, near, correlation(one),
             1.0 - one.drawn.mean()]
        )  # fmt: skip
    return Table(
        [
            Column("x", words=True), Column("y", words=True), Column("lowest_at_x"),
            Column("at_y"), Column("objective"), Column(f"at_the_{begun}"),
            Column("within_twice", "within twice", percent), Column("correlation", show=two),
            Column("not_drawn", show=percent),
        ],
        rows,
        "Lowest grid point of each pair",
        f"Within twice: part of the map whose objective is at most twice the lowest. Correlation: "
        f"of the two estimates, by the curvature at the lowest point ({NONE} where it is on an "
        "edge); near 1 or -1 the data determine one combination of the two only.",
    )  # fmt: skip


def _best(one: ParameterMap) -> tuple[int, int]:
    """Row and column of the lowest grid point that may be coloured."""
    best = np.argmin(np.where(one.drawn, one.objective, np.inf))
    row, column = np.unravel_index(best, one.objective.shape)
    return int(row), int(column)


def correlation(one: ParameterMap) -> float:
    """Correlation of two estimates by the curvature of the objective at its lowest grid point.

    Args:
        one: map of the pair.

    Returns:
        Between -1 and 1; NaN where the point or a neighbour has no result that counts, or where
        the objective does not curve upwards.
    """
    row, column = _best(one)
    values = np.pad(np.where(one.drawn, one.objective, np.nan), 1, constant_values=np.nan)
    near = values[row : row + 3, column : column + 3]
    along = near[1, 2] - 2 * near[1, 1] + near[1, 0], near[2, 1] - 2 * near[1, 1] + near[0, 1]
    across = (near[2, 2] - near[2, 0] - near[0, 2] + near[0, 0]) / 4
    product = along[0] * along[1]
    return float(-across / np.sqrt(product)) if across**2 < product else np.nan


def _doubt(one: ParameterMap, begun: str) -> str:
    """Why the lowest grid point may not be where the data are fitted best; empty where it is."""
    if not one.drawn.any():
        return "no grid point has a result that counts"
    row, column = _best(one)
    if one.start_objective < one.objective[row, column]:
        return (
            f"the {begun} has a lower objective, {number(one.start_objective)}, than any grid "
            "point; a finer grid shows its valley"
        )
    if row in (0, len(one.y) - 1) or column in (0, len(one.x) - 1):
        return "the lowest point lies on the edge of the map; a wider range may hold a lower one"
    condition = Condition(int(one.condition[row, column]))
    return f"at the lowest point, {condition.sentence}" if condition else ""


def _sentence(one: ParameterMap) -> str:
    x, y, objective = one.minimum or (np.nan, np.nan, np.nan)
    triples = zip(one.names, (x, y), one.units, strict=True)
    at = ", ".join(f"{name} {number(value)} {unit}".strip() for name, value, unit in triples)
    sentence = f"Of the grid points the objective is lowest, {number(objective)}, at {at}"
    found = correlation(one)
    if not np.isfinite(found):
        return f"{sentence}."
    kind = "compensate each other" if abs(found) > 0.9 else "are determined apart from each other"
    return f"{sentence}; there the two {kind} (correlation {round(found, 2) + 0.0:.2f})."


def _row(one: ParameterMap) -> list[Any]:
    best = one.minimum or (np.nan, np.nan, np.nan)
    counts = [int((one.condition == condition).sum()) for condition in Condition]
    return [*one.names, *best, *one.start, one.start_objective, *counts]
