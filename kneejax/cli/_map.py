"""`kneejax map [STUDY.yaml] --pair X Y`."""

from __future__ import annotations

import argparse
import importlib.metadata
import itertools
import json

import jax
import numpy as np

from kneejax.cli._given import check_parameter
from kneejax.cli._progress import balances_on_terminal
from kneejax.cli._study_problem import StudyProblem, study_and_knee, with_measurement
from kneejax.files import (
    Checkpoints,
    InputProblem,
    Study,
    write_netcdf,
    write_rows,
    write_text,
)
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import Condition, ParameterMap, check_installed, sensitivity_maps, versions
from kneejax.mechanics import Knee
from kneejax.parameters import select
from kneejax.statics import failures_of

_PACKAGES = ("xarray", "h5netcdf", "h5py")
_MOST_POINTS = 2000  # a side of a map
_COLUMNS = (
    "x", "y", "x_minimum", "y_minimum", "objective_minimum", "x_start", "y_start",
    "objective_start", *(condition.word for condition in Condition),
)  # fmt: skip


def run(arguments: argparse.Namespace) -> int:
    """Compute maps of the objective, write them, draw them."""
    for package in _PACKAGES:
        # Better known before the work than after it.
        check_installed(package, "maps")
    grid = _grid(arguments.grid)
    ranges = dict(_range(word) for word in arguments.ranges)
    study, knee = study_and_knee(arguments.study)
    pairs = _pairs(study, knee, arguments)
    asked = with_measurement(study, knee, calibrated=False)
    bounds = {**asked.study.bounds, **ranges}
    about = {
        "study": asked.study.title,
        "knee": asked.study.knee,
        "pairs": ", ".join(" ".join(pair) for pair in pairs),
        "grid": f"{grid[0]}x{grid[1]}",
        "ranges": ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in bounds.items()),
    }
    store = Checkpoints(arguments.out, about, _fingerprint(asked, about))
    weights = np.array([asked.study.weights[name] for name in FREE_COORDINATES])
    with balances_on_terminal("map") as progress:
        maps = sensitivity_maps(
            asked.knee,
            asked.measured,
            pairs,
            grid=grid,
            bounds=bounds,
            weights=weights,
            offsets=tuple(name for name in asked.study.frame_offset if name != "flexion"),
            store=store,
            progress=progress,
            failures=failures_of(asked.study.failures),
        )
    if store.resumed:
        print(f"{store.resumed} finished parts were found in {arguments.out}, and used")
    files = _write(maps, arguments.out, about)
    store.done()
    print(_table(maps))
    print(f"written: {arguments.out}/{', '.join(files)}")
    return 1 if any(not one.drawn.any() or one.left_out for one in maps) else 0


def _grid(text: str) -> tuple[int, int]:
    words = text.lower().split("x")
    try:
        sides = [int(word) for word in words]
    except ValueError:
        sides = []
    if len(sides) not in (1, 2) or min(sides) < 2 or max(sides) > _MOST_POINTS:
        expected = f"2 to {_MOST_POINTS} points a side, as in 41 or 41x61"
        raise InputProblem("--grid", "points", text, expected)
    return sides[0], sides[-1]


def _range(word: str) -> tuple[str, tuple[float, float]]:
    name, _, limits = word.partition("=")
    try:
        low, high = (float(x) for x in limits.split(":"))
    except ValueError:
        raise InputProblem("--range", "range", word, "NAME=LOW:HIGH") from None
    if not (np.isfinite([low, high]).all() and low < high):
        raise InputProblem("--range", name, limits, "LOW:HIGH with the lower bound first")
    check_parameter("--range", name, (low, high))
    return name, (low, high)


def _pairs(study: Study, knee: Knee, arguments: argparse.Namespace) -> list[tuple[str, str]]:
    """The pairs asked for, checked before anything is computed."""
    pairs = [(first, second) for first, second in arguments.pair]
    if arguments.all_pairs:
        names = select(knee, study.parameters).names
        pairs += [pair for pair in itertools.combinations(names, 2) if pair not in pairs]
    if not pairs:
        raise InputProblem(
            "--pair", "parameters", "none", "--pair X Y, or --all-pairs; "
            f"e.g. --pair {' '.join(select(knee, study.parameters).names[:2])}"
        )  # fmt: skip
    if len(set(map(frozenset, pairs))) < len(pairs):
        twice = next(p for i, p in enumerate(pairs) if frozenset(p) in map(frozenset, pairs[:i]))
        raise InputProblem("--pair", "parameters", " ".join(twice), "every pair once")
    unknown = [word.partition("=")[0] for word in arguments.ranges]
    mapped = sorted({name for pair in pairs for name in pair})
    for pair in pairs:
        if len(select(knee, pair)) < 2:
            raise InputProblem("--pair", "parameters", " ".join(pair), "two different parameters")
    for name in unknown:
        if name not in mapped:
            raise InputProblem("--range", "parameter", name, "a parameter of a pair", mapped)
    return pairs


def _fingerprint(asked: StudyProblem, about: dict) -> bytes:
    """Everything that the numbers of a map depend on."""
    leaves, structure = jax.tree.flatten(asked.knee)
    numbers = b"".join(np.asarray(leaf).tobytes() for leaf in leaves)
    settings = [about, dict(asked.study.weights), list(asked.study.frame_offset)]
    settings.append(list(asked.study.failures))
    words = json.dumps([*settings, str(structure), versions()["kneejax"]], default=str)
    return numbers + asked.measured.tobytes() + words.encode()


def _write(maps: tuple[ParameterMap, ...], out, about: dict) -> list[str]:
    from kneejax.report import map_figure, map_matrix_figure, save_figure

    packages = versions() | {name: importlib.metadata.version(name) for name in _PACKAGES}
    made = {**about, "versions": json.dumps(packages)}
    files = []
    for one in maps:
        tail = "" if len(maps) == 1 else f"-{one.names[0]}-{one.names[1]}"
        write_netcdf(out / f"map{tail}.nc", one.to_dataset(made))
        save_figure(map_figure(one), out / "figures", f"map{tail}")
        files.append(f"map{tail}.nc")
    shown = files if len(files) < 4 else [f"{len(files)} files map-*.nc"]
    write_rows(out / "maps.csv", list(_COLUMNS), [_row(one) for one in maps])
    if len(maps) > 2:
        save_figure(map_matrix_figure(maps), out / "figures", "maps")
    write_text(
        out / "result.json", json.dumps({"about": about, "versions": packages}, indent=1) + "\n"
    )
    return [*shown, "maps.csv", "result.json", "figures/"]


def _row(one: ParameterMap) -> list:
    best = one.minimum or (np.nan, np.nan, np.nan)
    counts = [int((one.condition == condition).sum()) for condition in Condition]
    return [*one.names, *best, *one.start, one.start_objective, *counts]


def _table(maps: tuple[ParameterMap, ...]) -> str:
    head = f"{'x':<24}{'y':<24}{'lowest at x':>12}{'at y':>10}{'objective':>11}{'not drawn':>12}"
    lines = [head]
    for one in maps:
        best = one.minimum or (np.nan, np.nan, np.nan)
        hidden = 1.0 - one.drawn.mean()
        lines.append(
            f"{one.names[0]:<24}{one.names[1]:<24}{best[0]:>12.5g}{best[1]:>10.4g}"
            f"{best[2]:>11.4g}{hidden:>12.1%}"
        )
    found = np.bincount(np.concatenate([m.condition.ravel() for m in maps]), minlength=5)
    for condition in Condition:
        if condition and found[condition]:
            count = int(found[condition])
            lines.append(f"{count} grid point{'s' * (count > 1)}: {condition.sentence}")
    if maps[0].left_out:
        lines.append(
            f"{maps[0].left_out} measured poses count nowhere: the knee itself has no balance there"
        )
    return "\n".join(lines)
