"""What a study names, read: its knee, its poses, its tests, a prior."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.files import InputProblem
from kneejax.files.reading import Field, load_yaml
from kneejax.studies._checked import MIRROR, Mistakes, by_parameter, deviation
from kneejax.studies._lab_tests import StudyTest, older_name
from kneejax.studies._schema import Measured, StudyFields, StudyStage
from kneejax.studies._test_tables import measured_test_of

if TYPE_CHECKING:
    from kneejax.mechanics import Knee


def usual_procedures(study: StudyFields) -> tuple[str, ...]:
    """Procedures where none are named: the first is the answer, others are there to compare."""
    return ("S",) if study.stages else ("II", "I", "III")


def check_fields(study: StudyFields, mistakes: Mistakes) -> None:
    """What fields say of each other."""

    def refuse(field: str, value: Any, expected: str) -> None:
        mistakes.keep(InputProblem("", field, value, expected))

    poses = {"measured": study.measured, "synthetic": study.synthetic}
    given = [name for name, one in poses.items() if one is not None]
    if len(given) > 1 or not (given or study.tests):
        expected = "exactly one of measured, synthetic" + ", or tests" * (not given)
        refuse("measured", " and ".join(given) or "neither", expected)
    if study.flexion_limits_deg and study.synthetic:
        expected = "no limits beside synthetic poses, which have their own flexion_deg"
        refuse("flexion_deg", [*study.flexion_limits_deg], expected)
    procedures = study.procedures or usual_procedures(study)
    if ("S" in procedures) != bool(study.stages):
        refuse("procedures", [*procedures], "S among procedures and stages, or neither")
    if study.starts > 1 and "III" not in procedures:
        refuse("starts", study.starts, "1: only procedure III has several starts")
    known = ["poses"] * bool(given) + [test.name for test in study.tests]
    for number, stage in enumerate(study.stages):
        for i, name in enumerate(stage.data):
            with mistakes.gathered(f"stages[{number}].data[{i}]"):
                Field("", "", name).choice(known)


def objects_of(
    study: StudyFields, fields: Mapping[str, Any], mistakes: Mistakes
) -> tuple[dict[str, Any], dict[str, Any]]:
    """What the study names, for its record, and the objects that stand for it."""
    from kneejax.files import load_knee
    from kneejax.parameters import with_values

    said: dict[str, Any] = {}
    objects: dict[str, Any] = {"set": {}, "flexion_deg": None}
    knee = study.knee
    if isinstance(knee, str):
        said["knee"] = knee
        with mistakes.gathered():
            knee = load_knee(knee, patella=bool(study.patella))
    said |= {"measured": None, "flexion_deg": study.flexion_limits_deg, "overrides": study.set}
    if isinstance(study.measured, Measured):
        said["measured"] = study.measured.model_dump()
        with mistakes.gathered():
            objects["measured"], acted = _read_poses(study.measured, study.flexion_limits_deg)
            if acted and study.loads:
                expected = f"no loads beside those of the measured table ({', '.join(acted)})"
                raise InputProblem("", "loads", study.loads, expected)
            objects |= {"loads": acted} if acted else {}
    if study.patella is not None:
        said["patella"] = study.patella
    mistakes.check()
    with mistakes.gathered():
        objects["knee"] = knee = with_values(knee, study.set)
    if any(isinstance(test, StudyTest) for test in study.tests):
        objects["tests"], said["tests"] = [], []
        for number, test in enumerate(study.tests):
            with mistakes.gathered(f"tests[{number}]"):
                if isinstance(test, StudyTest):
                    record = older_name(fields["tests"][number])
                    said["tests"].append(record | {"file": test.file})
                    test = measured_test_of(test, knee.pullable)
                objects["tests"].append(test)
    if isinstance(study.prior, str):
        with mistakes.gathered():
            objects |= _prior_of_cohort(study, knee)
    if study.stages:
        from kneejax.inference import Stage

        objects["stages"] = [
            Stage(one.parameters, one.data) if isinstance(one, StudyStage) else one
            for one in study.stages
        ]
    if not study.procedures:
        objects["procedures"] = usual_procedures(study)
    return said, objects


def _read_poses(
    measured: Measured, limits: tuple[float, float] | None
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Poses within limits of flexion, `(n, 6)`, degrees and mm, and loads that acted."""
    from kneejax.files import read_loads, read_poses

    table = read_poses(measured.file, measured.convention, measured.columns)
    loads = read_loads(measured.file)
    if measured.mirror:
        table = table * MIRROR
        # Of a left knee medial and lateral change sides; varus and inwards stay what they are.
        loads |= {"lateral_N": -loads["lateral_N"]} if "lateral_N" in loads else {}
    if limits is None:
        return table, loads
    lower, upper = limits
    # Limits include poses that a conversion moved by rounding.
    inside = (table[:, 0] >= lower - 1e-6) & (table[:, 0] <= upper + 1e-6)
    if not inside.any():
        expected = f"limits within {table[:, 0].min():g} and {table[:, 0].max():g}, as measured"
        raise InputProblem("", "flexion_deg", f"{lower:g} to {upper:g}", expected)
    return table[inside], {name: sizes[inside] for name, sizes in loads.items()}


def _prior_of_cohort(study: StudyFields, knee: Knee) -> dict[str, Any]:
    """Start and prior of the parameters that are free, from what a cohort wrote.

    Raises:
        InputProblem: it is no such file, the study states a start that the file states too, or the
            file is so old that the stiffness of a structure is the mean of its fibres.
        UnknownParameter: the study frees what its knee does not have.
    """
    from kneejax.parameters import MEANING, fibres_summed, select

    path = str(study.prior)
    file = Field(path, "", load_yaml(path, "the prior.yaml of a cohort"))
    ((mark, meaning),) = MEANING.items()
    file.mapping(("start", "prior"), (mark,))
    if mark in file:
        file[mark].choice((meaning,))
    said = Mistakes(path)
    with said.gathered("start"):
        means = by_parameter(Field.number)(file["start"].value)
    with said.gathered("prior"):
        deviations = by_parameter(deviation)(file["prior"].value)
    said.check()
    free = select(knee, study.parameters).names
    for name, value in study.start.items():
        if name in deviations:
            expected = f"this start left out: {Path(path).name} says around what {name} lies"
            raise InputProblem("", f"start.{name}", value, expected)
    means = {name: means[name] for name in free if name in means}
    chosen = {name: deviations[name] for name in free if name in deviations}
    for name in means | chosen:
        if mark not in file and (count := fibres_summed(knee, name)) > 1:
            section = file["start" if name in means else "prior"]
            raise section[name].problem(
                f"the sum over the structure's {count} fibres; this file is older and has their "
                "mean: run its cohort again, or multiply values and deviations of structures by "
                f"their numbers of fibres and add {mark}: {meaning}"
            )
    return {"start": {**study.start, **means}, "prior": chosen}
