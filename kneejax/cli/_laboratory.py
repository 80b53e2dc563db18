"""`kneejax simulate TEST`: a knee under loads that grow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from kneejax.cli._asked_knee import knee_words, whole_knee
from kneejax.cli._command import option_name
from kneejax.cli._displacement import change_column
from kneejax.cli._given import check_within, read_loads, refused
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Simulate
from kneejax.experiments import (
    LAXITY_COLUMNS,
    Curves,
    LabTest,
    Laxity,
    Mechanics,
    lab_tests,
    laxity,
    load_curves,
    load_cycle,
    mechanics_of,
    second_balances,
)
from kneejax.files import InputProblem, bundled_bands, parse_flexion, write_poses, write_rows
from kneejax.geometry import COLUMNS, COORDINATES, FEMORAL, convert_table
from kneejax.mechanics import LIMITS, NAMED_LOADS, Knee, Range, load_called
from kneejax.numerics import WrongValue
from kneejax.parameters import cut
from kneejax.report import curve_words, second_balance
from kneejax.statics import Status, converged

#: Sizes of a test. Farther than a limit a knee is dislocated.
_SIZES = ("force_N", "moment_Nm", "displacement_mm", "rotation_deg")
_FARTHEST = {
    "displacement_mm": Range(0.0, LIMITS["anterior"], "mm"),
    "rotation_deg": Range(0.0, LIMITS["internal_rotation"], "deg"),
}


def run_test(arguments: Simulate) -> int:
    """Load a knee, print its laxity, write curves, laxity, poses, forces and two figures."""
    tests = _tests(arguments)
    from_intact = arguments.counted_from == "intact"
    whole = whole_knee(arguments)
    knee = cut(whole, arguments.cut)
    with stages_on_terminal(knee.name):
        curves = load_curves(knee, tests, whole if from_intact else None)
        mechanics = mechanics_of(curves[0])
        others = [second_balances(one, whole) for one in curves] if arguments.cut else []
    status = [one.status(mechanics) for one in curves]
    said = [curve_words(one, mechanics) for one in curves]
    for one, texts, other in zip(curves, said, others, strict=False):
        _add_second(one, texts, other)
    found = [x for one, own in zip(curves, status, strict=True) for x in laxity(one, own)]
    print(knee_words(arguments, knee))
    print("\n".join(_laxity_lines(curves, found)))
    _write(arguments, knee, curves, mechanics, status, said, found)
    doubtful = [_say(*each) for each in zip(curves, status, said, strict=True)]
    doubtful += [_say_second(*each) for each in zip(curves, others, strict=False)]
    _figures(arguments, curves, status, found)
    files = "curves.csv, laxity.csv, poses.csv, forces.csv, settings.json"
    print(f"written: {arguments.out}/{files}, figures/curves.png, figures/laxity.png")
    return int(any(doubtful))


def _tests(arguments: Simulate) -> tuple[LabTest, ...]:
    """What is asked for; everything wrong with it is said before a knee is read."""
    name, loads = arguments.experiment, read_loads(arguments.load)
    given = {load: size for load, size in loads.items() if size}
    steps = 20 if arguments.steps is None else arguments.steps
    angles = None if arguments.flexion is None else parse_flexion(arguments.flexion)
    sizes = {key: getattr(arguments, key) for key in _SIZES}
    asked = {key: size for key, size in sizes.items() if size is not None}
    for key, size in asked.items():
        check_within(f"--{option_name(key)}", key, [size], _FARTHEST.get(key))
    if name == "load":
        path = load_cycle(steps, arguments.both)
        return (_wrench(given, angles, path, tuple(arguments.hold)),)
    try:
        return lab_tests(
            name, angles, **asked, held=arguments.hold, both=arguments.both, steps=steps,
            constant=given,
        )  # fmt: skip
    except WrongValue as problem:
        raise refused(f"simulate {name}", problem) from None


def _wrench(given, angles, path, held) -> LabTest:
    """The test `load`: what `--load` says grows, observed where its first part works."""
    if not given:
        raise InputProblem("simulate", "--load", "load", "the load that grows, as NAME=SIZE")
    first = next(name for name in NAMED_LOADS if name in given)
    observed = next(x for x in NAMED_LOADS[first].also_called if x in COORDINATES)
    flexion = range(0, 91, 15) if angles is None else angles
    ordered = {first: given[first], **given}
    try:
        angles = tuple(float(x) for x in flexion)
        return LabTest("load", ordered, observed, angles, path, held=held)
    except WrongValue as problem:
        raise refused("simulate load", problem) from None


def _laxity_lines(curves: Sequence[Curves], found: Sequence[Laxity]) -> Iterator[str]:
    for one in curves:
        test = one.test
        rows = [x for x in found if x.test == test.name]
        load, unit = NAMED_LOADS[test.driven_by], rows[0].unit
        slope, by_load = f"{load.unit}/{unit}", test.displacement is None
        yield f"{test.name}: {test.words}"
        if by_load:
            observed = test.observed.replace("_", " ")
            counted = ", from the intact knee" if one.intact is not None else ""
            yield f"change of {observed} along the load's own axes{counted}, {unit}:"
        else:
            yield f"what it takes of {load.positive}, {load.unit}:"
        yield (
            "flexion    range  positive  negative   neutral  stiffness at first, at the end  status"
        )
        ends = unit if by_load else load.unit.replace(" ", "")
        yield f"    deg {ends:>8}{ends:>10}{ends:>10}{unit:>10}{slope:>20}{slope:>12}"
        for x in rows:
            cells = (x.range, x.positive, x.negative, x.neutral)
            if not by_load:
                cells = (_span(x), x.held_positive, x.held_negative, x.neutral)
            numbers = "".join(f"{_number(c):>10}" for c in cells)[1:]
            slopes = f"{_number(x.stiffness_start):>20}{_number(x.stiffness_end):>12}"
            yield f"{x.flexion_deg:7.1f}{numbers}{slopes}  {x.status.word}"
            for word, held, full in _not_held(test, x):
                part = f"{held:.3g} of {full:.3g} {load.unit}"
                yield f"        beyond {part} of {word}: {x.status.word}"


def _span(x: Laxity) -> float:
    """Between the forces at both ends of a displacement, or the one of a test one way."""
    known = [force for force in (x.held_positive, x.held_negative) if np.isfinite(force)]
    return max(known) - min(known) if len(known) == 2 else abs(known[0]) if known else np.nan


def _not_held(test: LabTest, x: Laxity) -> Iterator[tuple[str, float, float]]:
    if test.displacement is not None:
        return
    load, size = NAMED_LOADS[test.driven_by], test.full[test.driven_by]
    ends = sorted((size * max(*test.path, 0.0), size * min(*test.path, 0.0)))
    for held, full, word in (
        (x.held_negative, ends[0], load.negative),
        (x.held_positive, ends[1], load.positive),
    ):
        if np.isfinite(held) and abs(held) < abs(full) * (1 - 1e-9):
            yield word, abs(held), abs(full)


def _number(value: float) -> str:
    return f"{value:.2f}" if np.isfinite(value) else "-"


def _write(arguments, knee: Knee, curves, mechanics: Mechanics, status, said, found) -> None:
    out, convention = arguments.out, arguments.convention
    columns = [
        name
        for name in NAMED_LOADS
        if any(name in {**x.test.full, **x.test.constant, x.test.driven_by: 0} for x in curves)
    ]
    held = {column: name for x in curves for name in x.test.held for column in [_held_column(name)]}
    seen = list(dict.fromkeys(x.test.observed for x in curves))
    header = [
        "test", "flexion_deg", "step", *(_load_column(name) for name in columns), *held,
        *COLUMNS[1:], *map(change_column, seen), "counted_from",
        "converged", "stable", "status", "doubt",
    ]  # fmt: skip
    extra = [] if convention == FEMORAL else ["convention"]
    rows = [
        row + [convention] * len(extra)
        for each in zip(curves, status, said, strict=True)
        for row in _curve_rows(*each, columns, held.values(), seen, convention)
    ]
    write_rows(out / "curves.csv", header + extra, rows)
    write_rows(out / "laxity.csv", LAXITY_COLUMNS, [x.row for x in found])
    nodes = np.concatenate([one.nodes.ravel() for one in curves])
    motion = curves[0].motion
    write_poses(
        out / "poses.csv",
        np.concatenate([_femoral(one).reshape(-1, len(COLUMNS)) for one in curves]),
        status=[Status(int(x)) for own in status for x in own.ravel()],
        converged=np.asarray(motion.equilibrium.converged)[nodes].tolist(),
        stable=np.asarray(motion.stable)[nodes].tolist(),
        doubts=[text for own in said for texts in own for text in texts],
        convention=convention,
    )
    forces = _forces(mechanics)
    parts = [row for one in curves for row in _force_rows(knee, one, forces)]
    write_rows(out / "forces.csv", ["test", "flexion_deg", "step", "part", "force_N"], parts)


def _load_column(name: str) -> str:
    """`anterior_N` -> `anterior_force_N`, `varus_Nm` -> `varus_moment_Nm`."""
    word, unit = name.rsplit("_", 1)
    if word == "compression":
        return name
    return f"{word}_{'moment' if unit == 'Nm' else 'force'}_{unit}"


def _held_column(name: str) -> str:
    """Of the moment with which a machine holds a rotation, its sense that of the load."""
    return f"held_{_load_column(load_called(name) or name)}"


def _femoral(one: Curves) -> np.ndarray:
    """Poses by flexion and load; flexion as it was asked for, not through radians."""
    table = np.asarray(one.motion.to_table())[one.nodes]
    table[..., 0] = np.array(one.test.flexion_deg)[:, None]
    return table


def _curve_rows(one: Curves, status, said, columns, held, seen, convention) -> Iterator[list]:
    poses = convert_table(_femoral(one).reshape(-1, len(COLUMNS)), FEMORAL, convention)
    poses = poses.reshape(*one.nodes.shape, -1)
    good, stable = converged(status), np.asarray(one.motion.stable)[one.nodes]
    loads = np.stack([np.asarray(one.load(name)) for name in columns], axis=-1)
    moved = np.asarray(one.displacement)
    turning = [np.asarray(one.motion.reaction(name))[one.nodes] / 1000.0 for name in held]
    for i, flexion in enumerate(one.test.flexion_deg):
        for step, k in enumerate(one.steps):
            yield [
                one.test.name, flexion, step, *loads[i, step], *(own[i, k] for own in turning),
                *poses[i, k, 1:],
                *(moved[i, step] if name == one.test.observed else np.nan for name in seen),
                one.counted_from, bool(good[i, k]), bool(stable[i, k]),
                Status(int(status[i, k])).word, said[i][k],
            ]  # fmt: skip


def _forces(mechanics: Mechanics) -> np.ndarray:
    """Of ligaments, then of contacts, N, `(poses, parts)`."""
    contact = np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1)
    return np.concatenate([np.asarray(mechanics.tension), contact], axis=1)


def _force_rows(knee: Knee, one: Curves, forces: np.ndarray) -> Iterator[list]:
    parts = [*knee.ligaments.names, *knee.contact_names]
    for i, flexion in enumerate(one.test.flexion_deg):
        for step, k in enumerate(one.steps):
            for part, force in zip(parts, forces[one.nodes[i, k]], strict=True):
                yield [one.test.name, flexion, step, part, force]


def _say(one: Curves, status, said) -> bool:
    """Print each outcome with where it is met, its next step and one of its poses in numbers."""
    for kind in sorted({Status(int(x)) for x in status.ravel()} - {Status.BALANCED}):
        rows = [np.flatnonzero(row == kind) for row in status]
        where = ", ".join(_met(one, i, own) for i, own in enumerate(rows) if len(own))
        print(f"{one.test.name} at {where}: {kind.sentence}")
        told = [(i, k) for i, own in enumerate(rows) for k in own if said[i][k]]
        if told:
            i, k = told[-1]
            print(f"  {_met(one, i, np.array([k]))}: {said[i][k]}")
    return bool((status != Status.BALANCED).any())


def _add_second(one: Curves, texts: list[tuple[str, ...]], other: np.ndarray) -> None:
    """Add to the words of each load where a second balance lies."""
    here = _femoral(one)
    for i, row in enumerate(texts):
        known = np.isfinite(other[i]).all(axis=1)
        more = [second_balance(*pair) if yes else "" for *pair, yes in zip(
            other[i], here[i], known, strict=True)]  # fmt: skip
        texts[i] = tuple("; ".join(filter(None, pair)) for pair in zip(row, more, strict=True))


def _say_second(one: Curves, other: np.ndarray) -> bool:
    """Print from which load to which a second balance exists, and where it lies."""
    known = np.asarray(np.isfinite(other).all(axis=-1))
    for i in np.flatnonzero(known.any(axis=1)):
        rows = np.flatnonzero(known[i])
        k = int(rows[np.argmin(np.abs(one.part[rows]))])
        print(
            f"{one.test.name} at {_met(one, int(i), rows)}: a second stable balance exists, which "
            "an intact knee comes to that is loaded first and cut then; reported is that of the "
            "knee that is cut first"
        )
        where = second_balance(other[i, k], _femoral(one)[i, k])
        print(f"  {_met(one, int(i), np.array([k]))}: {where}")
    return bool(known.any())


def _met(one: Curves, flexion: int, rows: np.ndarray) -> str:
    """One flexion, and the loads from the first to the last of some rows."""
    test = one.test
    sizes = test.size * one.part[rows]
    span = f"{sizes[0]:g}" if len(sizes) == 1 else f"{sizes[0]:g} to {sizes[-1]:g}"
    return f"{test.flexion_deg[flexion]:g} degrees ({span} {test.unit})"


def _figures(arguments, curves, status, found) -> None:
    from kneejax.report import laxity_figure, load_figure, save_figure

    folder = arguments.out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(load_figure(curves, status), folder, "curves", svg=arguments.svg)
    bands = bundled_bands(arguments.cut)
    save_figure(laxity_figure(curves, found, bands), folder, "laxity", svg=arguments.svg)
