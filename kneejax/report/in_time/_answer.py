"""Motions through time as answers: tests, dampers from a record, a leg that a motor raises."""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from kneejax.experiments import RaisedLeg, Transient
from kneejax.geometry import COLUMNS, FEMORAL, convert_table, coordinate
from kneejax.inference.transients import FittedTransient, Recorded
from kneejax.mechanics import NAMED_LOADS, load_words
from kneejax.report.extensor import extensor_table
from kneejax.report.in_time._figures import motor_raise_figure, transient_figure
from kneejax.report.look import Answer, Column, Drawing, Section, Table, Verdict
from kneejax.report.motion import digits, force_table, peak_table, text_of
from kneejax.statics import Status

#: A coordinate that moves less than this from the unloaded pose is left out, mm or degrees.
_SMALL = 0.05
#: Correlation from which a record does not separate two dampers.
_ALIKE = 0.95
#: Rows of a leg that is raised, for people.
_ROWS = 9


def transient_answer(
    name: str,
    experiment: str,
    found: Transient,
    *,
    recorded: Recorded | None = None,
    fit: FittedTransient | None = None,
    convention: str = FEMORAL,
) -> Answer:
    """A motion through time.

    Args:
        name: of the knee, with what was cut.
        experiment: settle, drop or a test.
        found: the motion.
        recorded: a motion to compare with, where there is one.
        fit: the dampers that were found from it.
        convention: of the poses.

    Returns:
        The answer; its tables are motion, forces, energy and, of a fit, damping.
    """
    last = {load: size[-1] for load, size in found.sizes.items()}
    under = f", {load_words(last)}" if any(last.values()) else ""
    title = f"{name}: {experiment} at {found.trajectory.to_table()[0, 0]:.3g} degrees{under}"
    moved, notes, doubts = _moved(found), [*_loads(found)], [*_wrong(found)]
    if found.rest is not None:
        notes.append(f"from the balance under the last loads: {found.from_rest_mm:.2g} mm")
    tables, main, said = _motion_tables(found, convention), [moved], []
    if fit is not None:
        tables["damping"] = _damping_table(fit)
        main.insert(0, "damping")
        said = [text_of(tables["damping"])]
        doubts += _not_found(fit)
    exact = [*_how_exact(found)]
    return Answer(
        title=title,
        asked=f"How the knee moves in {found.time_s[-1] - found.time_s[0]:g} s, with the mass of "
        "the leg and damping.",
        verdict=_verdict(found) if not doubts else Verdict.DOUBTFUL,
        sentence=_sentence(moved, found) if fit is None else _found(fit),
        tables=tables,
        main=main,
        drawings={
            "motion": Drawing(
                functools.partial(transient_figure, found, title, recorded),
                "Changes from the start; dashed: the balance under the last loads.",
            )
        },
        picture="motion",
        doubts=doubts,
        sections=[*_sections(found), Section("Loads, time steps and energy", [*notes, *exact])],
        text="\n".join([title, text_of(moved), *notes, *exact, *said, *doubts]),
        exit_status=_exit_status(found) or int(fit is not None and not fit.converged),
    )


def raised_leg_answer(name: str, found: RaisedLeg, convention: str = FEMORAL) -> Answer:
    """A leg that a motor raises, compared with the leg that is held at each flexion.

    Args:
        name: of the knee, with what was cut.
        found: the leg.
        convention: of the poses.

    Returns:
        The answer; its tables are motion, forces, energy and, of the leg that is held, extensor.
    """
    one, motion = found.transient, found.transient.trajectory
    title = f"{name}: leg-raise in {one.time_s[-1]:g} s"
    table, patella = motion.to_table(), motion.names.index("patella_flexion")
    picked = np.unique(np.linspace(0, len(found.rows) - 1, _ROWS).round().astype(int))
    rows = [
        [one.time_s[row], table[row, 0], one.quadriceps["quadriceps_N"][row],
         found.held.quadriceps_N[k], table[row, patella]]
        for k, row in zip(picked, np.asarray(found.rows)[picked], strict=True)
    ]  # fmt: skip
    columns = [
        Column("time_s", "time, s", digits(2)), Column("flexion_deg", "flexion, deg", digits(2)),
        Column("quadriceps_N", "quadriceps, N", digits(1)),
        Column("held_N", "held, N", digits(1)),
        Column("patella_flexion_deg", "patella, deg", digits(2)),
    ]  # fmt: skip
    raised = Table(columns, rows, note="Held: the quadriceps force that holds the leg there.")
    sentence = "The leg was nowhere at a flexion at which it was held."
    if np.isfinite(found.from_held).any():
        k, column = np.unravel_index(np.nanargmax(np.abs(found.from_held)), found.from_held.shape)
        far = coordinate(motion.names[column])
        sentence = (
            f"farthest from a leg that is held: {found.farthest:.2g} {far.unit}, {far.phrase}, "
            f"at {table[found.rows[k], 0]:.1f} degrees"
        )
    exact, doubts = [*_how_exact(one)], [*_wrong(one)]
    held = extensor_table(found.held, np.asarray(found.held.motion.status))
    return Answer(
        title=title,
        asked=f"How a leg moves that a motor raises by shortening the quadriceps in "
        f"{one.time_s[-1]:g} s, and how far it is from one that is held.",
        verdict=_verdict(one),
        sentence=f"{sentence[:1].upper()}{sentence[1:]}.",
        tables=_motion_tables(one, convention) | {"extensor": held},
        main=[raised],
        drawings={
            "raised_leg": Drawing(
                functools.partial(motor_raise_figure, found, title),
                "Lines: the leg that is raised; dots: held at each flexion.",
            )
        },
        picture="raised_leg",
        doubts=doubts,
        sections=[
            Section("The leg that is held", tables=["extensor"]), *_sections(one),
            Section("Time steps and energy", exact),
        ],
        text="\n".join([title, text_of(raised), sentence, *exact, *doubts]),
        exit_status=_exit_status(one),
    )  # fmt: skip


def _exit_status(found: Transient) -> int:
    """1 where a motion ended early or its energies do not add up, otherwise 0."""
    return int(found.trajectory.ended is not Status.BALANCED or not found.account.closes)


def _verdict(found: Transient) -> Verdict:
    return Verdict.DOUBTFUL if _exit_status(found) else Verdict.GOOD


def _sections(found: Transient) -> list[Section]:
    knee = found.trajectory.moving.knee
    peaks = peak_table(knee, found.mechanics, found.time_s, "at time, s")
    return [Section("Largest forces", tables=[peaks])]


def _motion_tables(found: Transient, convention: str) -> dict[str, Table]:
    """Poses, rates and loads; forces; energies: motion.csv, forces.csv and energy.csv."""
    motion, more = found.trajectory, {**found.sizes, **found.quadriceps}
    table = motion.to_table()
    poses = convert_table(table[:, :6], FEMORAL, convention)
    loads = np.stack(list(more.values()), 1) if more else np.zeros((len(poses), 0))
    extra = [] if convention == FEMORAL else ["convention"]
    header = [
        "time_s", *COLUMNS, *motion.columns[6:],
        *(f"{coordinate(name).column}_per_s" for name in motion.names), *more, "status", *extra,
    ]  # fmt: skip
    numbers = np.column_stack(
        [found.time_s, poses, table[:, 6:], motion.rates_to_table(), loads]
    )
    rows = [
        [*row, Status(int(word)).word, *[convention] * len(extra)]
        for row, word in zip(numbers.tolist(), np.asarray(motion.status), strict=True)
    ]
    knee = motion.moving.knee
    damping = np.zeros((len(poses), len(knee.ligaments.names) + len(knee.contact_names)))
    damping[:, : len(knee.ligaments.names)] = found.damping_N
    kinds = ("work", "kinetic", "potential", "dissipated", "missing")
    energies = [np.asarray(getattr(found.account, kind))[motion.rows] for kind in kinds]
    energy_rows = np.column_stack([found.time_s, *energies]).tolist()
    return {
        "motion": Table([Column(name) for name in header], rows),
        "forces": force_table(
            knee, found.mechanics, {"time_s": found.time_s.tolist()}, damping_N=damping
        ),
        "energy": Table([Column("time_s"), *(Column(f"{x}_Nmm") for x in kinds)], energy_rows),
    }


def _moved(found: Transient) -> Table:
    """Where each coordinate began, how far it went, and where it ended."""
    motion, table = found.trajectory, found.trajectory.to_table()
    rest = None if found.rest is None else np.asarray(found.rest.to_table())[0]
    two = digits(2)
    columns = [
        Column("coordinate", " ", words=True), Column("start", show=two), Column("peak", show=two),
        Column("peak_s", "at, s", digits(3)), Column("end", show=two),
    ]  # fmt: skip
    if rest is not None:
        columns += [Column("rest", "at rest", two), Column("overshoot", show=two)]
    rows = []
    for k, name in enumerate(motion.names[:6]):
        values, away = table[:, k], np.abs(table[:, k] - table[0, k])
        if not np.nanmax(away) > _SMALL:
            continue
        peak = int(np.nanargmax(away))
        row = [coordinate(name).axis_label, values[0], values[peak], found.time_s[peak],
               values[np.isfinite(values)][-1]]  # fmt: skip
        rows.append(row if rest is None else [*row, rest[k], found.overshoot[name]])
    note = "" if rest is None else "At rest: the balance under the last loads."
    return Table(columns, rows, note=note)


def _sentence(moved: Table, found: Transient) -> str:
    if not moved.rows:
        return "The knee does not move."
    far = max(moved.rows, key=lambda row: abs(row[2] - row[1]))
    words = f"{far[0].rpartition(',')[0]} changes most: from {far[1]:.1f} to {far[2]:.1f}"
    words += f"{far[0].rpartition(',')[2]} at {far[3]:.2g} s"
    if found.rest is not None:
        words += f"; at the end the knee is {found.from_rest_mm:.2g} mm from its balance"
    return f"{words}."


def _loads(found: Transient) -> Iterator[str]:
    for name, values in found.sizes.items():
        load = NAMED_LOADS[name]
        word = load.positive if values[np.argmax(np.abs(values))] >= 0 else load.negative
        yield f"{word}: {np.abs(values).max():g} {load.unit} at most"


def _how_exact(found: Transient) -> Iterator[str]:
    """Time steps and their error; energies and what is missing of them."""
    motion, account = found.trajectory, found.account
    yield (
        f"{len(motion.grid.time_s)} steps, {int(motion.grid.within().max())} at most between two "
        f"times; error of the steps {motion.error_mm:.1g} mm"
    )
    work, kinetic, potential, dissipated = (
        _last(x) for x in (account.work, account.kinetic, account.potential, account.dissipated)
    )
    yield (
        f"energy, N mm: work {work}, kinetic {kinetic}, potential {potential}, dissipated "
        f"{dissipated}; missing at most {float(account.part_missing):.2g} of what changed hands"
    )


def _last(values) -> str:
    known = np.asarray(values)[np.isfinite(values)]
    return f"{known[-1]:.4g}" if len(known) else "-"


def _wrong(found: Transient) -> Iterator[str]:
    if not found.account.closes:
        yield "the account of energy does not close: ask for a smaller --error-mm"
    motion = found.trajectory
    if motion.ended is not Status.BALANCED:
        yield f"the motion ends at {motion.ended_s:.4g} s: {motion.ended.sentence}"


def _damping_table(fit: FittedTransient) -> Table:
    """Dampers with their 95 % limits, six digits, damping.csv."""
    rows = [
        [name, *(f"{x:.6g}" if np.isfinite(x) else "" for x in sizes)]
        for name, *sizes in zip(fit.names, fit.values, fit.lower, fit.upper, strict=True)
    ]
    heads = [Column("name", "damper", words=True), Column("value"),
             Column("lower_95", "95 % from"), Column("upper_95", "to")]  # fmt: skip
    left = "; ".join(f"{coordinate(k).axis_label} {x:.2g}" for k, x in fit.rms.items())
    return Table(heads, rows, "Dampers", f"Left of the record, root of the mean square: {left}.")


def _found(fit: FittedTransient) -> str:
    values = zip(fit.names, fit.values, fit.lower, fit.upper, strict=True)
    return "; ".join(
        f"{name} is {value:.3g} "
        + (f"(95 % {low:.3g} to {high:.3g})" if np.isfinite(low) else "(at its bound)")
        for name, value, low, high in values
    ) + "."  # fmt: skip


def _not_found(fit: FittedTransient) -> Iterator[str]:
    """What the record leaves open."""
    for name, lower in zip(fit.names, fit.lower, strict=True):
        if lower < 0.0:
            yield f"{name}: the limits include zero; the record does not determine it"
    together = np.nan_to_num(fit.uncertainty.correlation)
    for i, first in enumerate(fit.names):
        for j in range(i):
            if abs(together[i, j]) > _ALIKE:
                yield (
                    f"{fit.names[j]} and {first} are collinear (correlation {together[i, j]:.2f}): "
                    "this record does not separate them"
                )
    if not fit.converged:
        yield f"the search was given up after {fit.evaluations} evaluations"
