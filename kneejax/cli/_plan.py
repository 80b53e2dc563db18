"""`kneejax plan acl [PLAN.yaml]`."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json

import numpy as np

from kneejax import files, planning, studies
from kneejax.cli._deliver import deliver
from kneejax.cli.options import PlanAcl
from kneejax.inference import versions
from kneejax.numerics import check_installed
from kneejax.studies import stages_on_terminal

_MAP_PACKAGES = ("xarray", "h5netcdf", "h5py")
_COMMENT = """A computation on a model: {}
Nothing here supports a decision about a patient."""


def run(arguments: PlanAcl) -> int:
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
        for package in _MAP_PACKAGES:
            check_installed(package, "maps")
    with stages_on_terminal(plan.title) as show:
        result = planning.run_plan(plan, show)
    from kneejax.report.plan import plan_answer, plan_document

    used = ["dtaidistance", *(["pymoo"] if result.front is not None else [])]
    packages = versions() | {name: importlib.metadata.version(name) for name in used}
    document = plan_document(result, packages)
    files.write_text(arguments.out / "plan.json", json.dumps(document, indent=1) + "\n")
    written = ["plan.json", *_write_knees(arguments, result)]
    about = {"title": plan.title, "knee": plan.own.name, "versions": json.dumps(packages)}
    for one in result.maps:
        written.append(f"map_{one.bone}.nc")
        files.write_netcdf(arguments.out / written[-1], one.to_dataset(about))
    return deliver(plan_answer(result), arguments, written, result.seconds)


def _write_knees(arguments: PlanAcl, result: planning.PlanResult) -> list[str]:
    """The reconstructed knees as knee files, which every command takes."""
    plan, one = result.plan, result.plan.surgery.plan
    known = {"planned": result.planned}
    if result.optimum is not None:
        known["optimum"] = result.optimum.outcome
    base = files.restated(plan.document, plan.own, f"set by the plan: {plan.title}")
    written = []
    for word, outcome in known.items():
        if not np.isfinite(outcome.slack_mm[0]).all():
            continue
        knee = planning.knee_of_outcome(plan.surgery, outcome)
        tension = " and ".join(f"{x:.4g}" for x in outcome.choices[0, 4 :: len(planning.CHOICES)])
        about = f"{plan.ligament} replaced by a {plan.graft.name} graft, {word} ({plan.title})"
        source = (
            f"{plan.graft.name} graft, {word}: {plan.title}; fixed under {tension} N at "
            f"{plan.surgery.fixation_deg:g} degrees; {plan.graft.source}"
        )
        document = files.reconstructed(base, knee, one.torn, one.bundles, source)
        document["name"] = f"{plan.own.name} {word}"
        document["description"] = f"{document['description'].strip()}; {about}"
        files.write_knee(document, arguments.out / f"{word}.yaml", _COMMENT.format(about))
        written.append(f"{word}.yaml")
    return written
