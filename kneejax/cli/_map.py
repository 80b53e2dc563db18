"""`kneejax map [STUDY.yaml] --pair X Y`."""

from __future__ import annotations

import importlib.metadata
import json
from pathlib import Path

from kneejax import studies
from kneejax.cli._deliver import deliver
from kneejax.cli._given import said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Map
from kneejax.files import (
    Checkpoints,
    bundled_studies,
    read_calibrated,
    write_netcdf,
)
from kneejax.files.reading import Field, load_json
from kneejax.files.results import CLAIM
from kneejax.inference import versions
from kneejax.numerics import check_installed

_PACKAGES = ("xarray", "h5netcdf", "h5py")


def run(arguments: Map) -> int:
    """Compute maps of the objective, write them, draw them."""
    for package in _PACKAGES:
        # Better known before the work than after it.
        check_installed(package, "maps")
    with said_of_options(studies.Map):
        question = studies.Map(
            pair=arguments.pair, all_pairs=arguments.all_pairs, grid=arguments.grid,
            range=arguments.ranges,
        )  # fmt: skip
    arguments.results.check_free("maps.csv", "result.json", "map.nc")
    study, begun = _study(arguments.study)
    with said_of_options(studies.Map):
        studies.check(study, question)
    about = studies.about_maps(study, question)
    store = Checkpoints(
        arguments.out, about, studies.fingerprint(study, question),
        begin=lambda: arguments.results.begin(lambda _: False),
    )  # fmt: skip
    with stages_on_terminal() as progress:
        maps = studies.sensitivity_map(study, question, progress=progress, store=store)
    if store.resumed:
        print(f"{store.resumed} finished parts were found in {arguments.out}, and used")
    arguments.results.holds = [CLAIM]
    packages = versions() | {name: importlib.metadata.version(name) for name in _PACKAGES}
    files = []
    for one in maps:
        tail = "" if len(maps) == 1 else f"-{one.names[0]}-{one.names[1]}"
        files.append(f"map{tail}.nc")
        dataset = one.to_dataset({**about, "versions": json.dumps(packages)})
        write_netcdf(arguments.out / files[-1], dataset)
    from kneejax.report.sensitivity import map_answer

    shown = files if len(files) < 4 else [f"{len(files)} files map-*.nc"]
    return deliver(map_answer(maps, about, packages, begun), arguments, shown)


def _study(name_or_path: str) -> tuple[studies.Study, str]:
    """A study and what its knee's own values are; that of a calibration's result begins at its
    fit."""
    path = Path(name_or_path)
    a_result = path.is_dir() or path.suffix.lower() == ".json"
    if not a_result or name_or_path in bundled_studies():
        return studies.read_study(name_or_path), "start"
    file = path / "result.json" if path.is_dir() else path
    found = read_calibrated(file)
    path = Field(str(file), "", load_json(file, "a result"))["settings"]["path"]
    if path.value not in bundled_studies() and not Path(path.text()).is_file():
        raise path.problem("the file of its study, which must be there still")
    study = studies.read_study(path.text())
    fitted = found.of_structures(study.knee).found
    return study.replace(start=fitted), "fit"
