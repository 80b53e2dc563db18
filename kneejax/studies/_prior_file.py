"""A prior of another cohort, as a file that a study names."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from kneejax.files import said_of
from kneejax.files.reading import Field, load_yaml
from kneejax.mechanics import Knee
from kneejax.parameters import select
from kneejax.studies._study_fields import parameter_names, parameter_values


def with_prior_file(
    study: Field, given: dict[str, Any], knee: Knee, folder: Path
) -> dict[str, Any]:
    """What a study gives, with start and prior of the file that its field `prior` names.

    Of the file count the parameters that the study frees.

    Args:
        study: with a field `prior` that is a text.
        given: fields of the study by name.
        knee: of the study.
        folder: to which the file's path is relative.

    Returns:
        Fields by name, `start` and `prior` as mappings.

    Raises:
        InputProblem: there is no such file, it is none that a cohort wrote, or the study states a
            start that the file states too.
        UnknownParameter: the study frees what its knee does not have.
    """
    path = folder / study["prior"].text()
    if not os.path.isfile(path):
        expected = f"a mapping, or the prior.yaml of a cohort; not at {path}"
        raise study["prior"].problem(expected)
    file = Field(str(path), "", load_yaml(path, "the prior.yaml of a cohort"))
    file.mapping(("start", "prior"))
    means, deviations = (parameter_values(file[name]) for name in ("start", "prior"))
    with said_of(study.file):
        free = select(knee, parameter_names(study["parameters"])).names
    own = given.get("start", {})
    for name in own if isinstance(own, dict) else ():
        if name in deviations:
            place = Field(study.file, f"start.{name}", own[name])
            raise place.problem(f"this start left out: {path.name} says around what {name} lies")
    means = {name: means[name] for name in free if name in means}
    chosen = {name: deviations[name] for name in free if name in deviations}
    return given | {"start": {**own, **means}, "prior": chosen}
