"""What the data of a study determine: maps of the objective, sensitivity, and limits."""

from __future__ import annotations

import functools
import importlib.metadata
import json
from pathlib import Path

from kneejax import files, studies
from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.files.reading import load_json
from kneejax.files.results import CLAIM
from kneejax.inference import Candidate, versions
from kneejax.mechanics import Knee, load_words
from kneejax.numerics import check_installed
from kneejax.studies import stages_on_terminal

_PACKAGES = ("xarray", "h5netcdf", "h5py")


def objective_maps(arguments: options.Map) -> int:
    """Compute maps of the objective, write them, draw them."""
    for package in _PACKAGES:
        # Better known before the work than after it.
        check_installed(package, "maps")
    question = arguments.question()
    arguments.results.check_free("maps.csv", "result.json", "map.nc")
    study, begun = _study(arguments.study)
    studies.check(study, question)
    about = studies.about_maps(study, question)
    store = files.Checkpoints(
        arguments.out, about, studies.fingerprint(study, question),
        begin=lambda: arguments.results.begin(lambda _: False),
    )  # fmt: skip
    with stages_on_terminal() as progress:
        maps = studies.sensitivity_map(study, question, progress=progress, store=store)
    if store.resumed:
        print(f"{store.resumed} finished parts were found in {arguments.out}, and used")
    arguments.results.holds = [CLAIM]
    packages = versions() | {name: importlib.metadata.version(name) for name in _PACKAGES}
    written = []
    for one in maps:
        tail = "" if len(maps) == 1 else f"-{one.names[0]}-{one.names[1]}"
        written.append(f"map{tail}.nc")
        dataset = one.to_dataset({**about, "versions": json.dumps(packages)})
        files.write_netcdf(arguments.out / written[-1], dataset)
    from kneejax.report.maps import map_answer

    shown = written if len(written) < 4 else [f"{len(written)} files map-*.nc"]
    return deliver(map_answer(maps, about, packages, begun), arguments, shown)


def _study(name_or_path: str) -> tuple[studies.Study, str]:
    """A study and what its knee's own values are; that of a calibration's result begins at its
    fit."""
    path = Path(name_or_path)
    a_result = path.is_dir() or path.suffix.lower() == ".json"
    if not a_result or name_or_path in files.bundled_studies():
        return studies.read_study(name_or_path), "start"
    file = path / "result.json" if path.is_dir() else path
    found = files.read_calibrated(file)
    path = load_json(file, "a result")["settings"]["path"]
    if path not in files.bundled_studies() and not Path(path).is_file():
        expected = "the file of its study, which must be there still"
        raise files.InputProblem(file, "settings.path", path, expected)
    study = studies.read_study(path)
    fitted = found.of_structures(study.knee).found
    return study.replace(start=fitted), "fit"


def what_data_tell(arguments: options.Identify) -> int:
    """Say what the data of a study determine; write the answer."""
    table = vars(arguments)["candidates"]
    candidates = None if table is None else [
        Candidate(row.name or load_words(row.loads), row.flexion_deg, **row.loads)
        for row in files.read_candidates(table)
    ]  # fmt: skip
    question = arguments.question(candidates=candidates)
    study = studies.read_study(arguments.study)
    with stages_on_terminal("fit and limits") as show:
        found = studies.identify(study, question, progress=show)
    from kneejax.report import identification_answer

    asked = {"command": arguments.command, "out": arguments.out, **arguments.options()}
    answer = identification_answer(found, {name: str(value) for name, value in asked.items()})
    return deliver(answer, arguments, seconds={"total": found.seconds})


def sensitivity(arguments: options.Sensitivity) -> int:
    """Sweep parameters, differentiate the motion by them, and if asked compute global indices."""
    if arguments.knees:
        return _knees_side_by_side(arguments)
    # A count is a whole number; what is none is refused as it was given.
    lines = {
        name: ends and (*ends[:2], *(int(n) if n.is_integer() else n for n in ends[2:]))
        for name, ends in vars(arguments)["sweep"].items()
    }
    question = arguments.question(sweep=lines)
    study = studies.read_study(arguments.study)
    with stages_on_terminal() as progress:
        found = studies.sensitivity(study, question, progress=progress)
    from kneejax.report.sensitivity import sensitivity_answer

    asked = {field.alias: getattr(arguments, name)
             for name, field in options.Sensitivity.model_fields.items()
             if name in studies.Sensitivity.model_fields}  # fmt: skip
    return deliver(sensitivity_answer(found, asked), arguments, seconds=found.seconds)


def _knees_side_by_side(arguments: options.Sensitivity) -> int:
    """Change one ligament at a time in each knee, print scores, write tables and figures."""
    knees: dict[str, Knee] = {}
    for name in arguments.knees:
        knee = files.load_knee(name)
        if knee.name in knees:
            expected = f"every knee once; {knee.name} is twice"
            raise files.InputProblem("--knees", "knee", name, expected)
        knees[knee.name] = knee
    from kneejax.papers import knee_comparison, knee_comparison_report

    with stages_on_terminal("knees") as show:
        progress = functools.partial(show, "knees")
        found = knee_comparison.compare_knees(knees, progress=progress)
    return deliver(knee_comparison_report.comparison_answer(found), arguments)
