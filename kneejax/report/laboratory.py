"""Tests under load: laxity, curves, and where a knee gives way."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

import jax
import numpy as np

from kneejax.experiments import LAXITY_COLUMNS, Curves, Laxity, Mechanics, laxity
from kneejax.geometry import COLUMNS, COORDINATES, FEMORAL, coordinate
from kneejax.mechanics import NAMED_LOADS, Knee, load_called
from kneejax.report import pose_tables
from kneejax.report.look.colours import BLUE, GREY, VERMILLION, shades
from kneejax.report.look.page import Answer, Drawing, Section
from kneejax.report.look.style import Figure, styled, verbatim
from kneejax.report.look.tables import Column, Table
from kneejax.report.panels import flexion_axis, grid, mark_status, part_legend
from kneejax.statics import Status, converged

#: Flexions with a curve each; of more, evenly chosen ones are named.
_MOST_NAMED = 8
#: Of a displacement, by what it is counted from.
_FROM = {"unloaded": "from the neutral pose", "intact": "from the intact knee"}


@styled
def load_figure(curves: Sequence[Curves], status: Sequence[np.ndarray]) -> Figure:
    """Draw load against displacement, a panel for each test and a curve for each flexion."""
    count = len(curves)
    figure, panels = grid(count, 1, 2.7 * count + 0.35, left=0.7, right=1.4, apart=(0, 0.8))
    for axes, one, own in zip(panels[:, 0], curves, status, strict=True):
        test, loads = one.test, np.asarray(one.driving_load)
        moved, held = np.asarray(one.displacement_by_load), [_ends(one.part, x) for x in own]
        every, shown = max(1, -(-len(moved) // _MOST_NAMED)), {}
        lines = zip(test.flexion_deg, moved, loads, held, shades(len(moved)), strict=True)
        for k, (flexion, x, load, last, color) in enumerate(lines):
            (line,) = axes.plot(x, load, color=color)
            shown |= {f"{flexion:g}": line} if k % every == 0 else {}
            axes.plot(x[last], load[last], "x", color=VERMILLION, markersize=5, zorder=5)
        if any(held):
            (shown["last load held"],) = axes.plot([], [], "x", color=VERMILLION, markersize=5)
        kind, coordinate = NAMED_LOADS[test.driven_by], COORDINATES[test.observed]
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        axes.axvline(0.0, color=GREY, linewidth=0.5)
        moved = f"Change {_FROM[one.counted_from]}: {coordinate.phrase}, {coordinate.unit}"
        axes.set(title=verbatim(f"{test.name}: {test.words}"), xlabel=moved,
                 ylabel=f"{kind.positive.capitalize()}, {kind.unit}")  # fmt: skip
        part_legend(axes, shown, (1.02, 1.02), title="Flexion, deg", title_fontsize=8,
                    handlelength=1.6)  # fmt: skip
    return figure


def _ends(part: np.ndarray, status: np.ndarray) -> list[int]:
    """Last rows, each way from the neutral pose, of a knee that still holds together."""
    zero = int(np.argmin(np.abs(part)))
    good = converged(status) & ~np.isin(status, [int(Status.UNSTABLE), int(Status.DISLOCATED)])
    ends = []
    for rows in (np.arange(zero, len(part)), np.arange(zero, -1, -1)):
        held = good[rows]
        if held[0] and not held.all():
            ends.append(int(rows[np.argmin(held) - 1]))
    return ends


@styled
def laxity_figure(
    curves: Sequence[Curves], found: Sequence[Laxity], bands: Sequence[Any] = ()
) -> Figure:
    """How far the knee gives over flexion, or what a displacement takes."""
    count = len(curves)
    figure, panels = grid(count, 1, 2.7 * count + 0.35, left=0.7, right=1.96, apart=(0, 0.8))
    for axes, one in zip(panels[:, 0], curves, strict=True):
        rows, test = [x for x in found if x.test == one.test.name], one.test
        flexion = np.array([x.flexion_deg for x in rows])
        kind, coordinate = NAMED_LOADS[test.driven_by], COORDINATES[test.observed]
        drawn: dict[str, Any] = {}
        by_load = test.displacement is None
        for band in bands if by_load and not test.held else ():
            one_way = band.end in ("positive", "negative")
            if one_way and band.load == test.driven_by and band.size == abs(test.size):
                spread = np.where(np.isfinite(band.sd), 2 * band.sd, 0.0)
                points = axes.errorbar(band.flexion_deg, band.mean, spread, fmt="s", color=GREY,
                                       markersize=3, elinewidth=0.8, capsize=2, zorder=1)
                counted = f",\n{_FROM[band.counted_from]}" if band.cut else ""
                drawn[verbatim(f"{band.label}:\nmean, two SD where known{counted}")] = points
        ends = ("positive", "negative") if by_load else ("held_positive", "held_negative")
        words = (kind.positive, kind.negative)
        for name, word, color in zip(ends, words, (BLUE, VERMILLION), strict=True):
            y = np.array([getattr(x, name) for x in rows])
            if np.isfinite(y).any():
                (drawn[word],) = axes.plot(flexion, y, "o-", color=color, markersize=3)
        drawn |= mark_status(axes, flexion, np.array([int(x.status) for x in rows]))
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        change = f"Change {_FROM[one.counted_from]}:\n{coordinate.phrase}, {coordinate.unit}"
        axes.set(title=verbatim(f"{test.name}: {test.words}"),
                 ylabel=change if by_load else f"{kind.positive.capitalize()}, {kind.unit}")
        flexion_axis(axes, flexion)
        part_legend(axes, drawn, (1.02, 1.02), handlelength=1.6)
    return figure


def laboratory_answer(
    name: str, knee: Knee, curves: Sequence[Curves], mechanics: Mechanics, *,
    second: Sequence[np.ndarray] = (), bands: Sequence[Any] = (), convention: str = FEMORAL,
    intact: tuple[Knee, Sequence[Curves], Mechanics] | None = None,
) -> Answer:
    """What tests under load tell of a knee; `intact` is that before a meniscus was removed.

    `second` are, of each test, poses of a second stable balance or NaN, `(flexions, loads, 6)`.
    """
    mechanics = jax.tree.map(np.asarray, mechanics)
    status = [one.status(mechanics) for one in curves]
    wrong = [_curve_words(c, mechanics, o) for c, o in itertools.zip_longest(curves, second)]
    found = [x for one, own in zip(curves, status, strict=True) for x in laxity(one, own)]
    by_test = [(one, [x for x in found if x.test == one.test.name]) for one in curves]
    doubts = [s for each in zip(curves, status, wrong, strict=True) for s in _doubts(*each)]
    # From which load to which a second balance exists, and where it lies.
    for one, other in zip(curves, second, strict=False):
        known = np.asarray(np.isfinite(other).all(axis=-1))
        for i in np.flatnonzero(known.any(axis=1)).tolist():
            rows = np.flatnonzero(known[i])
            k = int(rows[np.argmin(np.abs(one.part[rows]))])
            where = pose_tables.second_balance(other[i, k], _femoral_poses(one)[i, k])
            doubts.append(
                f"{one.test.name} at {_met(one, i, rows)}: a second stable balance exists, which "
                "an intact knee comes to that is loaded first and cut then; reported is that of "
                f"the knee that is cut first\n  at {_met(one, i, np.array([k]))}: {where}"
            )
    # Of poses and forces a row for each load of each flexion, by its size and by its step.
    nodes = np.concatenate([one.nodes.ravel() for one in curves])
    every, motion = np.concatenate([x.ravel() for x in status]), curves[0].motion
    more = {"converged": converged(np.asarray(motion.equilibrium.status))[nodes],
            "stable": np.asarray(motion.stable)[nodes],
            "doubt": [text for of_test in wrong for texts in of_test for text in texts]}
    reached = np.concatenate([_femoral_poses(one).reshape(-1, len(COLUMNS)) for one in curves])
    steps = [(one.test.name, flexion, step, one.nodes[i, k]) for one in curves
             for i, flexion in enumerate(one.test.flexion_deg) for step, k in enumerate(one.steps)]
    *keys, rows = zip(*steps, strict=True)
    keys = dict(zip(("test", "flexion_deg", "step"), keys, strict=True))
    angles = dict.fromkeys(f"{x:g}" for one in curves for x in one.test.flexion_deg)
    heads = [f"{one.test.name}: {one.test.words}" for one in curves]
    knees = [(name, knee, curves, mechanics), *([("intact", *intact)] if intact else [])]
    contact = _contact_tables(knees)
    # Laxity at a single angle is a point; what the load does to the knee is the picture then.
    headings = {"curves": "Load against displacement", "laxity": "Laxity over flexion"}
    above = "curves" if all(len(one.nodes) == 1 for one in curves) else "laxity"
    return Answer(
        title=f"{', '.join(one.test.name for one in curves)} of {name}",
        asked=f"{'; '.join(heads)}; at {', '.join(angles)} degrees of flexion.",
        verdict=pose_tables.verdict_of([x.status for x in found]),
        sentence=" ".join(_headline(*each) for each in by_test),
        tables={"curves": _curves_table(curves, status, wrong, convention),
                "laxity": Table(LAXITY_COLUMNS, [x.row for x in found]),
                "poses": pose_tables.pose_table(reached, every, convention, more=more),
                "forces": pose_tables.force_table(knee, _at(mechanics, rows), keys),
                **({"contact": contact[0]} if contact else {})},
        main=[*(laxity_table(*each) for each in by_test), *contact[1:]],
        drawings={"laxity": Drawing(laxity_figure, curves, found, bands),
                  "curves": Drawing(load_figure, curves, status)},
        picture=above, doubts=doubts, exit_status=int(bool(doubts)),
        sections=[Section(headings[x], drawings=[x]) for x in headings if x != above],
    )  # fmt: skip


def laxity_table(curves: Curves, rows: Sequence[Laxity]) -> Table:
    """Laxity for people: a row for each angle, units in the headings."""
    test, unit = curves.test, rows[0].unit
    load, by_load = NAMED_LOADS[test.driven_by], test.displacement is None
    ends, slope = unit if by_load else load.unit, f"{load.unit}/{unit}"
    to, fro = max(test.path) > 0.0, min(test.path) < 0.0
    columns = [Column("flexion_deg", "flexion, deg", ".1f"),
               Column("range", f"range, {ends}", ".2f", shown=to and fro),
               Column("positive", f"under {load.positive}, {ends}", ".2f", shown=to),
               Column("negative", f"under {load.negative}, {ends}", ".2f", shown=fro),
               Column("neutral", f"neutral, {unit}", ".2f"),
               Column("stiffness_start", f"stiffness at first, {slope}", ".2f"),
               Column("stiffness_end", f"at the end, {slope}", ".2f"), "status"]  # fmt: skip
    cells = [
        [x.flexion_deg, *((x.range, x.positive, x.negative) if by_load else
                          (_span(x), x.held_positive, x.held_negative)), x.neutral,
         x.stiffness_start, x.stiffness_end, "; ".join(_not_held(test, x)) or x.status.word]
        for x in rows
    ]  # fmt: skip
    note = f"For the machine's displacement: what it takes of {load.positive}, {load.unit}."
    if by_load:
        counted = ", from the intact knee" if curves.intact is not None else ""
        observed = COORDINATES[test.observed].phrase
        note = f"Change of {observed} along the load's own axes{counted}, {unit}."
    return Table(columns, cells, f"{test.name}: {test.words}", note)


def _span(x: Laxity) -> float:
    """Between the forces at both ends of a displacement, or the one of a test one way."""
    known = [force for force in (x.held_positive, x.held_negative) if np.isfinite(force)]
    return max(known) - min(known) if len(known) == 2 else abs(known[0]) if known else np.nan


def _not_held(test, x: Laxity) -> Iterator[str]:
    """Each way in which the knee did not hold the full load."""
    if test.displacement is not None:
        return
    load, size = NAMED_LOADS[test.driven_by], test.full[test.driven_by]
    low, high = sorted((size * max(*test.path, 0.0), size * min(*test.path, 0.0)))
    for held, full, word in ((x.held_negative, low, load.negative),
                             (x.held_positive, high, load.positive)):
        if np.isfinite(held) and abs(held) < abs(full) * (1 - 1e-9):
            part = f"{abs(held):.3g} of {abs(full):.3g} {load.unit}"
            yield f"beyond {part} of {word}: {x.status.word}"


def _headline(one: Curves, rows: Sequence[Laxity]) -> str:
    """How far the knee gives, and at how many angles something is doubtful."""
    held = [x for x in rows if x.status == Status.BALANCED]
    if not held:
        return f"{one.test.name.capitalize()}: no angle without a doubt."
    by_load = one.test.displacement is None
    unit = held[0].unit if by_load else NAMED_LOADS[one.test.driven_by].unit
    known = [(x.range if by_load else _span(x), x.flexion_deg) for x in held]
    (low, at_low), (high, at_high) = (f(known, key=lambda pair: pair[0]) for f in (min, max))
    lost = len(rows) - len(held)
    said = f"{one.test.name.capitalize()}: {high:.3g} {unit} at {at_high:g} degrees"
    if len(known) > 1:
        said += f", the most, and {low:.3g} {unit} at {at_low:g}, the least"
    return said + (f"; {lost} of {len(rows)} angles in doubt." if lost else ".")


def _curves_table(curves, status, wrong, convention: str) -> Table:
    """A row for each step of the loads of each test."""
    acting = {load for x in curves for load in (*x.test.full, *x.test.constant, x.test.driven_by)}
    columns = [name for name in NAMED_LOADS if name in acting]
    held = {f"held_{_load_column(load_called(name) or name)}": name
            for x in curves for name in x.test.held}  # fmt: skip
    seen = list(dict.fromkeys(x.test.observed for x in curves))
    header = ["test", "flexion_deg", "step", *map(_load_column, columns), *held, *COLUMNS[1:],
              *(f"{name}_change_{coordinate(name).unit}" for name in seen), "counted_from",
              "converged", "stable", "status", "doubt"]  # fmt: skip
    rows, extra = [], {}
    for one, own, said in zip(curves, status, wrong, strict=True):
        poses, extra = pose_tables.in_convention(_femoral_poses(one), convention)
        poses = poses.reshape(*one.nodes.shape, -1)
        loads = np.stack([np.asarray(one.load(name)) for name in columns], axis=-1)
        turning = [np.asarray(one.motion.reaction(x))[one.nodes] / 1000.0 for x in held.values()]
        stable, moved = np.asarray(one.motion.stable)[one.nodes], np.asarray(one.displacement)
        for i, flexion in enumerate(one.test.flexion_deg):
            for step, k in enumerate(one.steps):
                outcome = Status(int(own[i, k]))
                rows.append([one.test.name, flexion, step, *loads[i, step],
                             *(x[i, k] for x in turning), *poses[i, k, 1:],
                             *(moved[i, step] if x == one.test.observed else np.nan for x in seen),
                             one.counted_from, outcome.converged, bool(stable[i, k]), outcome.word,
                             said[i][k], *extra.values()])
    return Table((*header, *extra), rows)


def _load_column(name: str) -> str:
    """`anterior_N` -> `anterior_force_N`, `varus_Nm` -> `varus_moment_Nm`."""
    if name.startswith("compression_"):
        return name
    return name.replace("_Nm", "_moment_Nm") if name.endswith("m") else name[:-1] + "force_N"


def _at(mechanics: Mechanics, rows: Sequence[int]) -> Mechanics:
    return jax.tree.map(lambda x: np.asarray(x)[list(rows)], mechanics)


def _contact_tables(
    knees: Sequence[tuple[str, Knee, Sequence[Curves], Mechanics]],
) -> list[Table]:
    """Contacts in tests of compression: at each load for the file, at the largest for people."""
    columns: Sequence[Column] = ()
    every: list[Sequence[Any]] = []
    for name, knee, curves, mechanics in knees:
        steps = [(name, flexion, float(one.test.size * part), one.nodes[i, k])
                 for one in curves if one.test.driven_by == "compression_N"
                     and one.test.displacement is None and one.test.size > 0
                 for i, flexion in enumerate(one.test.flexion_deg)
                 for k, part in enumerate(one.part)]  # fmt: skip
        if steps:
            *keys, rows = zip(*steps, strict=True)
            names = "knee", Column("flexion_deg", show=".1f"), Column("compression_N", show=".0f")
            numbers = pose_tables.contact_numbers(knee, _at(mechanics, rows))
            table = pose_tables.part_table(dict(zip(names, keys, strict=True)), "contact",
                                           knee.contact_names, numbers)  # fmt: skip
            columns, every = columns or table.columns, [*every, *table.rows]
    if not columns:
        return []
    most = max((row[2] for row in every), default=0.0)
    full = [row for row in every if row[2] == most]
    return [Table(columns, every), Table(columns, full, "Contact under the full compression")]


def _femoral_poses(one: Curves) -> np.ndarray:
    """By flexion and load, `(flexions, loads, 6)`; flexion as asked for, not through radians."""
    table = np.asarray(one.motion.to_table())[one.nodes]
    table[..., 0] = np.array(one.test.flexion_deg)[:, None]
    return table


def _curve_words(
    curves: Curves, mechanics: Mechanics, second: np.ndarray | None
) -> list[tuple[str, ...]]:
    """What is wrong at each flexion, a text per different load, in order of its size."""
    test, motion, here = curves.test, curves.motion, _femoral_poses(curves)
    part = np.zeros(len(motion.status))
    part[curves.nodes] = curves.part
    full = test.full or {test.observed: test.size}
    found = pose_tables.search_words(motion, {name: size * part for name, size in full.items()})
    answer = []
    others = np.full_like(here, np.nan) if second is None else second
    for rows, *where in zip(curves.nodes, others, here, strict=True):
        also = pose_tables.with_second([found[row] for row in rows], *where)
        answer.append(pose_tables.pose_words(motion.knee, _at(mechanics, rows), also))
    return answer


def _doubts(one: Curves, status: np.ndarray, wrong) -> Iterator[str]:
    """Each outcome with where it is found, its next step and poses in numbers."""
    def where(rows: np.ndarray) -> str:
        flexion, load = np.divmod(rows, status.shape[1])
        spans = [_met(one, i, load[flexion == i]) for i in dict.fromkeys(flexion.tolist())]
        return f"{one.test.name} at {', '.join(spans)}"

    words = [text for texts in wrong for text in texts]
    lost = np.where(status.ravel() == Status.BALANCED, "", words).tolist()
    return pose_tables.status_doubts(status.ravel(), lost, where, lambda i: where(np.array([i])))


def _met(one: Curves, flexion: int, rows: np.ndarray) -> str:
    """One flexion, and the loads from the first to the last of some rows."""
    sizes = one.test.size * one.part[rows]
    span = f"{sizes[0]:g}" + f" to {sizes[-1]:g}" * (len(sizes) > 1)
    return f"{one.test.flexion_deg[flexion]:g} degrees ({span} {one.test.unit})"
