"""A study from its file: what stands on disk, and what that means."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.files import (
    InputProblem,
    bundled_knees,
    bundled_measurements,
    knee_with,
    load_knee,
    named_document,
    read_loads,
    read_poses,
)
from kneejax.files.reading import Field
from kneejax.geometry import COLUMNS, CONVENTIONS, FEMORAL
from kneejax.mechanics import RANGES
from kneejax.studies._field_names import AS_THEY_ARE, OPTIONAL, REQUIRED
from kneejax.studies._prior_file import with_prior_file
from kneejax.studies._reading_tests import MIRROR, read_tests
from kneejax.studies._study import Study
from kneejax.studies._study_fields import Synthetic, parameter_values


def read_study(name_or_path: str | os.PathLike[str]) -> Study:
    """Read a study, its knee and its measured poses.

    Args:
        name_or_path: name of a bundled study, or a study file; paths in it are relative to its
            folder.

    Returns:
        The study, checked whole.

    Raises:
        InputProblem: the file or one that it names cannot be read, or a field is missing,
            unknown or out of range.
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, or a method that is not installed.

    Example:
        >>> study = read_study("paper1")
        >>> study.knee.name, study.parameters
        ('four_ligament', ('*.stiffness', '*.reference_strain'))
    """
    return study_of(*named_document("studies", name_or_path))


def study_of(study: Field, folder: Path) -> Study:
    """Make a study of what a file says.

    Args:
        study: everything that the file says.
        folder: to which paths in it are relative.

    Returns:
        The study, checked whole.

    Raises:
        InputProblem: as `read_study`, and so do the others.
        UnknownParameter: likewise.
        UnsuitableData: likewise.
    """
    study.mapping(REQUIRED, OPTIONAL)
    for name, value in study.value.items():
        if value is None or (value == [] and name in AS_THEY_ARE):
            raise study[name].problem("a value, or this field left out")
    if "flexion_deg" in study and "synthetic" in study:
        expected = "no limits beside synthetic poses, which have their own flexion_deg"
        raise study["flexion_deg"].problem(expected)
    origin: dict[str, Any] = {
        "knee": _knee(study["knee"], folder),
        "measured": None,
        "flexion_deg": study["flexion_deg"].interval(RANGES["flexion_deg"])
        if "flexion_deg" in study
        else None,
        "overrides": parameter_values(study["set"]) if "set" in study else {},
    }
    poses, acted = None, {}
    if "measured" in study and "synthetic" not in study:
        origin["measured"] = _measured(study["measured"], folder)
        poses, acted = _read_poses(origin["measured"], origin["flexion_deg"], study.file)
    if "patella" in study:
        origin["patella"] = study["patella"].boolean()
    whole = load_knee(origin["knee"], patella=origin.get("patella", False))
    knee = knee_with(whole, origin["overrides"], study.file)
    tests = read_tests(study["tests"], folder, knee.pullable) if "tests" in study else []
    if acted and "loads" in study:
        expected = f"no loads beside those of the measured table ({', '.join(acted)})"
        raise study["loads"].problem(expected)
    given: dict[str, Any] = {name: study[name].value for name in AS_THEY_ARE if name in study}
    if isinstance(given.get("prior"), str):
        given = with_prior_file(study, given, knee, folder)
    return Study(
        title=study["title"].value,
        knee=knee,
        parameters=study["parameters"].value,
        measured=study["measured"].value if poses is None and "measured" in study else poses,
        synthetic=_synthetic(study["synthetic"]) if "synthetic" in study else None,
        **({"loads": acted} if acted else {}) | given,
        tests=[test for test, _ in tests],
        origin=origin | {"tests": [said for _, said in tests]},
        file=study.file,
    )


def _knee(field: Field, folder: Path) -> str:
    name = field.text()
    known = bundled_knees()
    if name in known:
        return name
    path = folder / name
    if not os.path.isfile(path):
        expected = f"a bundled knee ({', '.join(known) or 'none'}) or a knee file; not at {path}"
        raise field.problem(expected, known)
    return os.path.abspath(path)  # results are read elsewhere


def _measured(field: Field, folder: Path) -> dict[str, Any]:
    """Which table was measured, what its columns mean, and who says so."""
    field.mapping(("file", "source"), ("convention", "columns", "mirror"))
    columns = {}
    if "columns" in field:
        renamed = field["columns"].mapping((), COLUMNS)
        columns = {name: renamed[name].text() for name in renamed.value}
    return {
        "file": os.fspath(_table(field["file"], folder)),
        "convention": field["convention"].choice(CONVENTIONS) if "convention" in field else FEMORAL,
        "columns": columns,
        "source": field["source"].text(),
        "mirror": field["mirror"].boolean() if "mirror" in field else False,
    }


def _table(field: Field, folder: Path) -> Path:
    path = folder / field.text()
    if os.path.isfile(path):
        return path
    every = bundled_measurements()
    known = {name: one for name, one in every.items() if one.use == "poses"}
    if field.value in known:
        return known[field.value].path
    if field.value in every:
        other = "a table under tests" if every[field.value].use == "test" else "conditions alone"
        raise field.problem(f"measured poses; {field.value} is {other}")
    raise field.problem(f"a CSV table or a bundled measurement; not at {path}", known)


def _read_poses(
    measured: dict[str, Any], limits: tuple[float, float] | None, file: str
) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Measured poses within limits of flexion, `(n, 6)`, degrees and mm, and loads that acted."""
    table = read_poses(measured["file"], measured["convention"], measured["columns"])
    loads = read_loads(measured["file"])
    if measured["mirror"]:
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
        raise InputProblem(file, "flexion_deg", f"{lower:g} to {upper:g}", expected)
    return table[inside], {name: sizes[inside] for name, sizes in loads.items()}


def _synthetic(field: Field) -> Synthetic:
    field.mapping(("parameters", "flexion_deg"), ("noise_mm", "noise_deg", "seed"))
    return Synthetic(**field.value)
