"""Tests of a study whose rows are frames of a knee in motion."""

from __future__ import annotations

import numpy as np

from kneejax.dynamics import gravity_of
from kneejax.experiments import Frames, leg_of_person
from kneejax.files import InputProblem, LabTable
from kneejax.files.reading import Field
from kneejax.mechanics import RANGES
from kneejax.numerics import WrongValue

#: Field of a test -> field of `Frames` that it gives.
_OF_FRAMES = {
    "critical": "critical",
    "damping_N_s_per_mm": "damping_N_s_per_mm",
    "period_s": "period_s",
    "error_mm": "most_mm",
}
_COUNTS = {"harmonics": 12, "cycles_before": 100}
#: A person where nobody says which.
_USUAL = {"body_kg": 75.0, "height_m": 1.75, "ankle_kg": 0.0}


def read_frames(item: Field, table: LabTable, flexion_deg: np.ndarray) -> Frames | None:
    """What `in_time` of a test says, with the times of its table; None without.

    Raises:
        InputProblem: a field is not what it should be, or the table has no times that serve.
    """
    if "in_time" not in item:
        return None
    given = item["in_time"].mapping((), (*_USUAL, "femur_deg", *_OF_FRAMES, *_COUNTS))
    if table.time_s is None:
        expected = "a column time_s too, or columns: {time_s: ...}"
        raise Field(item.file, f"{item.path}.file", item["file"].value).problem(expected)
    person = {
        name: given[name].number(RANGES[name]) if name in given else size
        for name, size in _USUAL.items()
    }
    asked = {
        field: given[name].number(RANGES[name])
        for name, field in _OF_FRAMES.items()
        if name in given
    }
    asked |= {
        name: given[name].integer(int(name == "harmonics"), most)
        for name, most in _COUNTS.items()
        if name in given
    }
    for name in _COUNTS:
        if name in given and "period_s" not in given:
            raise given[name].problem("period_s too, of a motion that repeats itself")
    if "femur_deg" in given:
        asked["gravity_m_s2"] = gravity_of(given["femur_deg"].number(RANGES["femur_deg"]))
    try:
        return Frames(table.time_s, flexion_deg, leg_of_person(**person), **asked)
    except WrongValue as problem:
        raise refused(given, problem) from None


def refused(field: Field, problem: WrongValue) -> InputProblem:
    """What a test does not take, said of the field that gave it."""
    place = f"{field.path}.{problem.field}"
    return InputProblem(field.file, place, problem.found, problem.expected)
