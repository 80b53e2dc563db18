"""`kneejax map [STUDY.yaml] --pair X Y`."""

from __future__ import annotations

import importlib.metadata
import json

import numpy as np

from kneejax import studies
from kneejax.cli._given import said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Map
from kneejax.files import Checkpoints, write_netcdf, write_rows, write_text
from kneejax.files.results import CLAIM
from kneejax.inference import Condition, ParameterMap, versions
from kneejax.numerics import check_installed

_PACKAGES = ("xarray", "h5netcdf", "h5py")
_COLUMNS = (
    "x", "y", "x_minimum", "y_minimum", "objective_minimum", "x_start", "y_start",
    "objective_start", *(condition.word for condition in Condition),
)  # fmt: skip


def run(arguments: Map) -> int:
    """Compute maps of the objective, write them, draw them."""
    for package in _PACKAGES:
        # Better known before the work than after it.
        check_installed(package, "maps")
    question = studies.Map(
        pair=arguments.pair, all_pairs=arguments.all_pairs, grid=arguments.grid,
        range=arguments.ranges,
    )  # fmt: skip
    arguments.results.check_free("maps.csv", "result.json", "map.nc")
    study = studies.read_study(arguments.study)
    with said_of_options(question):
        studies.check(study, question)
    about = studies.about_maps(study, question)
    store = Checkpoints(
        arguments.out, about, studies.fingerprint(study, question),
        begin=lambda: arguments.results.begin(lambda _: False),
    )  # fmt: skip
    with stages_on_terminal() as progress:
        maps = studies.run(study, question, progress=progress, store=store)
    if store.resumed:
        print(f"{store.resumed} finished parts were found in {arguments.out}, and used")
    arguments.results.holds = [CLAIM]
    files = _write(maps, arguments.out, about, arguments.svg)
    print(_table(maps))
    print(f"written: {arguments.out}/{', '.join(files)}")
    return 1 if any(not one.drawn.any() or one.left_out for one in maps) else 0


def _write(maps: tuple[ParameterMap, ...], out, about: dict, svg: bool) -> list[str]:
    from kneejax.report import map_figure, map_matrix_figure, save_figure

    packages = versions() | {name: importlib.metadata.version(name) for name in _PACKAGES}
    made = {**about, "versions": json.dumps(packages)}
    files = []
    for one in maps:
        tail = "" if len(maps) == 1 else f"-{one.names[0]}-{one.names[1]}"
        write_netcdf(out / f"map{tail}.nc", one.to_dataset(made))
        save_figure(map_figure(one), out / "figures", f"map{tail}", svg=svg)
        files.append(f"map{tail}.nc")
    shown = files if len(files) < 4 else [f"{len(files)} files map-*.nc"]
    write_rows(out / "maps.csv", list(_COLUMNS), [_row(one) for one in maps])
    if len(maps) > 2:
        save_figure(map_matrix_figure(maps), out / "figures", "maps", svg=svg)
    write_text(
        out / "result.json", json.dumps({"about": about, "versions": packages}, indent=1) + "\n"
    )
    return [*shown, "maps.csv", "result.json", "settings.json", "figures/"]


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
