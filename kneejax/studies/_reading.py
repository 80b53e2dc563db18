"""What a study names, read: its knee, its tables, a prior; and what must suit the knee."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationInfo

from kneejax.files import InputProblem
from kneejax.files.reading import Field, load_yaml
from kneejax.studies._checked import Mistakes, deviation, folder_of, of_parameters
from kneejax.studies._lab_tests import StudyTest, measured_test_of, older_name
from kneejax.studies._poses import Measured

if TYPE_CHECKING:
    from kneejax.mechanics import Knee
    from kneejax.studies._study import Study

_deviations, _values = of_parameters(deviation).func, of_parameters(Field.number).func


def usual_procedures(study: Study) -> tuple[str, ...]:
    """Procedures where none are named: the first is the answer, others are there to compare."""
    return ("S",) if study.stages else ("II", "I", "III")


def given_prior(value: Any, info: ValidationInfo) -> Any:
    """Standard deviations by name; of a text the whole path of the file that has them."""
    if not isinstance(value, str):
        return _deviations(value)
    field = Field("", "", value)
    path = folder_of(info) / field.text()
    if not os.path.isfile(path):
        raise field.problem(f"a mapping, or the prior.yaml of a cohort; not at {path}")
    return os.fspath(path)


def _prior_of_cohort(study: Study, knee: Knee) -> dict[str, Any]:
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
        means = _values(file["start"].value)
    with said.gathered("prior"):
        deviations = _deviations(file["prior"].value)
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


def check_fields(study: Study, mistakes: Mistakes) -> None:
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


def _check_tests(study: Study, mistakes: Mistakes) -> None:
    """Of tests no two have one name, and none is better known than the poses can say."""
    from kneejax.inference.fit import check_readable
    from kneejax.parameters import cut

    stated = {"mm": study.noise_mm, "deg": study.noise_deg}
    for number, test in enumerate(study.tests):
        place = f"tests[{number}]"
        with mistakes.gathered(place):
            cut(study.knee, test.cut)
            check_readable(study.knee, test.readings)
            if test.name in [one.name for one in study.tests[:number]]:
                raise InputProblem("", "name", test.name, "every name once")
            for unit, noise in stated.items():
                if test.readings and noise is None:
                    expected = f"noise_{unit} of the study too, against which it counts"
                    raise InputProblem("", "", next(iter(test.readings)), expected)
                if (sd := getattr(test, f"sd_{unit}")) is None:
                    continue
                if not (np.isfinite(sd) and sd > 0):
                    expected = "a standard deviation above 0"
                    raise InputProblem("", f"sd_{unit}", sd, expected)
                if noise is None and study.synthetic is None:
                    expected = f"noise_{unit} of the study too, against which tests are weighed"
                    raise InputProblem("", f"sd_{unit}", sd, expected)


def objects_of(
    study: Study, fields: Mapping[str, Any], mistakes: Mistakes
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
            objects["measured"], acted = study.measured.read(study.flexion_limits_deg)
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
                    said["tests"].append(older_name(fields["tests"][number]) | {"file": test.file})
                    test = measured_test_of(test, knee.pullable)
                objects["tests"].append(test)
    if isinstance(study.prior, str):
        with mistakes.gathered():
            objects |= _prior_of_cohort(study, knee)
    if not study.procedures:
        objects["procedures"] = usual_procedures(study)
    return said, objects


def check_with_knee(study: Study, mistakes: Mistakes) -> None:
    """Names, bounds and data that must suit the knee."""
    from kneejax.inference import Stage
    from kneejax.numerics import check_installed
    from kneejax.parameters import (
        QUANTITIES,
        doubt_prior,
        select,
        start_within,
        stated,
        stated_bounds,
        with_values,
    )

    for name, sizes in study.loads.items():
        if len(sizes) not in (1, len(study.flexion_deg)):
            expected = f"one for all poses, or {len(study.flexion_deg)}, one for each"
            mistakes.keep(InputProblem("", f"loads.{name}", f"{len(sizes)} sizes", expected))
    _check_tests(study, mistakes)
    if study.prior and None in study.noise:
        expected = "noise_mm and noise_deg too, against which a prior counts"
        mistakes.keep(InputProblem("", "prior", ", ".join(study.prior), expected))
    bounded = [name for name in study.bounds if name not in QUANTITIES]
    for name in dict.fromkeys((*study.parameters, *study.truth, *study.start, *bounded)):
        with mistakes.gathered():
            select(study.knee, [name])
    mistakes.check()
    with mistakes.gathered():
        # Of these, too, a value may lead to a knee that there is not.
        with_values(study.knee, study.truth)
    with mistakes.gathered():
        knee, selection = study.knee_at_start, study.selection
        start_within(knee, selection, *stated_bounds(knee, selection, study.bounds))
        deviations = stated(selection, study.prior, "prior")
        for name, sd in zip(selection.names, deviations, strict=True):
            if sd is not None:
                doubt_prior(knee, name, sd)
        for number, stage in enumerate(study.stages):
            for name in stage.parameters:
                if not any(Stage((name,)).frees(own) for own in selection.names):
                    place, expected = f"stages[{number}].parameters", "of the parameters that"
                    raise InputProblem("", place, name, f"{expected} the study frees")
    with mistakes.gathered():
        if study.method == "lbfgsb":
            check_installed("jaxopt", "lbfgsb")
