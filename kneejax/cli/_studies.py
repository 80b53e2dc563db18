"""What the data of a study determine, and how; plans of an operation; claims of papers."""

import dataclasses
import functools
import importlib
import importlib.metadata
import json
import threading
import time
from pathlib import Path

import numpy as np

from kneejax import files, planning, studies
from kneejax.cli._command import is_given
from kneejax.cli._deliver import deliver, say, write_results
from kneejax.cli.options import studies as options
from kneejax.cohorts import is_cohort
from kneejax.files.reading import load_json
from kneejax.files.results import CLAIM
from kneejax.inference import Candidate, versions
from kneejax.mechanics import Knee, load_words
from kneejax.numerics import adding_up, check_installed
from kneejax.studies import stages_on_terminal

#: Packages without which no map is written. Better known before the work than after it.
_OF_MAPS = ("xarray", "h5netcdf", "h5py")
_COMMENT = """A computation on a model: {}
Nothing here supports a decision about a patient."""


def _installed(*packages: str) -> dict[str, str]:
    """Versions of these, and of what every number depends on."""
    return versions() | {name: importlib.metadata.version(name) for name in packages}


def calibrate(arguments: options.Calibrate) -> int:
    """Calibrate, print the answer, write results, the calibrated knee and the report."""
    if is_cohort(arguments.study):
        from kneejax.cli import _cohort

        return _cohort.run(arguments)
    begun = time.perf_counter()
    for name in ("bootstrap", "blocks", "jobs", "scheduler", "shard"):
        value = getattr(arguments, name)
        if is_given(value):
            expected = ("this option with a cohort alone (a folder, a pattern in quotes or a "
                        f"cohort file), not {arguments.study}")
            given = "/".join(map(str, value)) if isinstance(value, tuple) else str(value)
            raise files.InputProblem("calibrate", f"--{name}", given, expected)
    study = studies.read_study(arguments.study)
    for new in ("knee.yaml", "result.json"):
        files.check_new(arguments.out / new, study.knee_name)
    arguments.results.check_free("result.json", "parameters.csv", "poses.csv", "report.html",
                                 "knee.yaml")
    reading = time.perf_counter() - begun
    # XLA compiles without holding Python: what comes last is imported beside the search.
    threading.Thread(target=importlib.import_module, args=("kneejax.report.calibration",)).start()
    with stages_on_terminal("calibration") as progress:
        result = studies.calibrate(study, progress=progress)
    seconds = {"imports": arguments.results.imports_s, "reading": reading, **result.seconds}
    result = dataclasses.replace(result, seconds=adding_up(seconds))
    with stages_on_terminal("figures and report"):
        answer, missing = write_results(result, arguments.out, svg=arguments.svg)
    status = say(answer, arguments.out, ["poses.csv", *["knee.yaml"] * (not missing)])
    if missing:
        print(f"not written: {arguments.out}/knee.yaml: {missing}")
    return max(status, int(bool(missing)))


def objective_maps(arguments: options.Map) -> int:
    """Compute maps of the objective, write them, draw them."""
    for package in _OF_MAPS:
        check_installed(package, "maps")
    question = arguments.question()
    arguments.results.check_free("maps.csv", "result.json", "map.nc")
    study, begun = _study(arguments.study)
    studies.check(study, question)
    about = studies.about_maps(study, question)
    store = files.Checkpoints(arguments.out, about, studies.fingerprint(study, question),
                              begin=lambda: arguments.results.begin(lambda _: False))  # fmt: skip
    with stages_on_terminal() as progress:
        maps = studies.sensitivity_map(study, question, progress=progress, store=store)
    if store.resumed:
        print(f"{store.resumed} finished parts were found in {arguments.out}, and used")
    arguments.results.holds = [CLAIM]
    packages, written = _installed(*_OF_MAPS), []
    for one in maps:
        tail = "" if len(maps) == 1 else f"-{one.names[0]}-{one.names[1]}"
        written.append(f"map{tail}.nc")
        dataset = one.to_dataset({**about, "versions": json.dumps(packages)})
        files.write_netcdf(arguments.out / written[-1], dataset)
    from kneejax.report.maps import map_answer

    shown = written if len(written) < 4 else [f"{len(written)} files map-*.nc"]
    return deliver(map_answer(maps, about, packages, begun), arguments, shown)


def _study(name_or_path: str) -> "tuple[studies.Study, str]":
    """A study, and where it begins: at its start, or of a calibration's result at its fit."""
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
        for row in files.read_candidates(table)]  # fmt: skip
    question = arguments.question(candidates=candidates)
    study = studies.read_study(arguments.study)
    with stages_on_terminal("fit and limits") as show:
        found = studies.identify(study, question, progress=show)
    from kneejax.report.identification import identification_answer

    asked = {"command": arguments.command, "out": arguments.out, **arguments.options()}
    answer = identification_answer(found, {name: str(value) for name, value in asked.items()})
    return deliver(answer, arguments, seconds={"total": found.seconds})


def sensitivity(arguments: options.Sensitivity) -> int:
    """Sweep parameters, differentiate the motion by them, and if asked compute global indices."""
    if arguments.knees:
        return _knees_side_by_side(arguments)
    # A count is a whole number; what is none is refused as it was given.
    lines = {name: ends and (*ends[:2], *(int(n) if n.is_integer() else n for n in ends[2:]))
             for name, ends in vars(arguments)["sweep"].items()}  # fmt: skip
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
        found = knee_comparison.compare_knees(knees, progress=functools.partial(show, "knees"))
    return deliver(knee_comparison_report.comparison_answer(found), arguments)


def plan_acl(arguments: options.PlanAcl) -> int:
    """Carry out a plan; print, write tables, maps and the report."""
    check_installed("dtaidistance", "planning")
    plan = studies.read_plan(arguments.plan)
    if arguments.points is not None:
        plan = dataclasses.replace(plan, map_points=arguments.points)
    if arguments.front and not plan.population:
        if not plan.free:
            expected = "what is free, for a front to be found"
            raise files.InputProblem(plan.file, "optimum", False, expected)
        said = plan.said | {"front": True}
        plan = dataclasses.replace(plan, population=planning.POPULATION, said=said)
    if plan.population:
        check_installed("pymoo", "planning")
    if plan.map_points:
        for package in _OF_MAPS:
            check_installed(package, "maps")
    with stages_on_terminal(plan.title) as show:
        result = planning.run_plan(plan, show)
    from kneejax.report.plan import plan_answer, plan_document

    packages = _installed("dtaidistance", *["pymoo"] * (result.front is not None))
    document = plan_document(result, packages)
    files.write_text(arguments.out / "plan.json", json.dumps(document, indent=1) + "\n")
    written = ["plan.json", *_write_knees(arguments, result)]
    about = {"title": plan.title, "knee": plan.own.name, "versions": json.dumps(packages)}
    for one in result.maps:
        written.append(f"map_{one.bone}.nc")
        files.write_netcdf(arguments.out / written[-1], one.to_dataset(about))
    return deliver(plan_answer(result), arguments, written, result.seconds)


def _write_knees(arguments: options.PlanAcl, result: "planning.PlanResult") -> list[str]:
    """The reconstructed knees as knee files, which every command takes."""
    plan, one = result.plan, result.plan.surgery.plan
    known = {"planned": result.planned}
    if result.optimum is not None:
        known["optimum"] = result.optimum.outcome
    base = files.restated(plan.document, plan.own, f"set by the plan: {plan.title}")
    known = {word: x for word, x in known.items() if np.isfinite(x.slack_mm[0]).all()}
    for word, outcome in known.items():
        knee = planning.knee_of_outcome(plan.surgery, outcome)
        tension = " and ".join(f"{x:.4g}" for x in outcome.choices[0, 4 :: len(planning.CHOICES)])
        about = f"{plan.ligament} replaced by a {plan.graft.name} graft, {word} ({plan.title})"
        source = (f"{plan.graft.name} graft, {word}: {plan.title}; fixed under {tension} N at "
                  f"{plan.surgery.fixation_deg:g} degrees; {plan.graft.source}")
        document = files.reconstructed(base, knee, one.torn, one.bundles, source)
        document["name"] = f"{plan.own.name} {word}"
        document["description"] = f"{document['description'].strip()}; {about}"
        files.write_knee(document, arguments.out / f"{word}.yaml", _COMMENT.format(about))
    return [f"{word}.yaml" for word in known]


def reproduce(arguments: options.Reproduce) -> int:
    """Reproduce one of papers 1 to 5. A claim that is not reproduced is an answer like any other:
    status 0. Status 1 says that something computed on the way is doubtful."""
    given = {name: getattr(arguments, name) for name in ("knee", "patella")}
    known = {name: value for name, value in given.items() if value}
    paper = importlib.import_module(f"kneejax.papers.paper{arguments.paper}")
    return deliver(paper.reproduce(stages_on_terminal, **known), arguments)
