"""What became of every knee of a cohort, read back from what its task has written."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from kneejax.cohorts._cohort import Cohort
from kneejax.cohorts._execute import KneeDone
from kneejax.files.reading import read_text

#: What the result of a knee says of a fit that leaves more than noise.
POOR = "Poor fit"


@dataclasses.dataclass(frozen=True)
class KneeEstimate:
    """What a knee's data say of one parameter.

    Attributes:
        value: the estimate.
        low: lower 95 % limit; NaN if the data give none.
        high: upper one; likewise.
        standard_error: NaN where it would not tell the limits.
        interval: which of these mean something, in words; empty where nobody asked.
        at_bound: whether it lies on a bound.
        start: where the search began.
    """

    value: float
    low: float
    high: float
    standard_error: float
    interval: str
    at_bound: bool
    start: float


@dataclasses.dataclass(frozen=True, eq=False)
class KneeAnswer:
    """What became of a knee.

    Attributes:
        name: of the knee.
        about: what else is known of it.
        failed: why there is no answer; empty where there is one.
        outcome: in words, as its own report says; empty where it failed.
        message: how its search ended.
        seconds: that it took.
        rmse: coordinate -> root mean square error of the poses, mm or degrees.
        tests: test and coordinate -> root mean square error of its curves.
        objective: weighted sum of squares.
        parameters: name -> what is known of it.
        correlation: of the estimates, `(p, p)`.
        good: whether its search converged to a fit that is none of the poor ones: only such a knee
            tells of the others.
    """

    name: str
    about: Mapping[str, float | str]
    failed: str = ""
    outcome: str = ""
    message: str = ""
    seconds: float = math.nan
    rmse: Mapping[str, float] = dataclasses.field(default_factory=dict)
    tests: Mapping[str, float] = dataclasses.field(default_factory=dict)
    objective: float = math.nan
    parameters: Mapping[str, KneeEstimate] = dataclasses.field(default_factory=dict)
    correlation: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros((0, 0)))
    good: bool = False


def read_answers(
    cohort: Cohort, done: Mapping[str, KneeDone], folders: Path
) -> tuple[KneeAnswer, ...]:
    """Read what the tasks of a cohort have found.

    Args:
        cohort: whose knees.
        done: name -> what became of it; knees that are missing are left out.
        folders: in which each knee has a folder of its name.

    Returns:
        One a knee, in the order of the cohort.
    """
    found = []
    for member in cohort.members:
        one = done.get(member.name)
        if one is None:
            continue
        if one.failed:
            found.append(KneeAnswer(member.name, member.about, one.failed, seconds=one.seconds))
            continue
        text = read_text(folders / member.name / "result.json", "the result of a knee")
        found.append(_answer(member.name, member.about, one.seconds, json.loads(text)))
    return tuple(found)


def parameter_units(answers: Sequence[KneeAnswer], folders: Path) -> dict[str, str]:
    """Parameter -> its unit, of all that any knee has."""
    units: dict[str, str] = {}
    for one in answers:
        if not one.failed and any(name not in units for name in one.parameters):
            text = read_text(folders / one.name / "result.json", "the result of a knee")
            units |= json.loads(text)["units"]
    return units


def _answer(name: str, about, seconds: float, document: dict[str, Any]) -> KneeAnswer:
    parameters = {key: _estimate(one) for key, one in document["parameters"].items()}
    tests = {
        f"{one['test']}, {one['coordinate']}": _number(one["fitted"])
        for one in document["tests"]
        if one["flexion_deg"] is None
    }
    return KneeAnswer(
        name,
        about,
        outcome=document["outcome"],
        message=document["message"],
        seconds=seconds,
        rmse={key: _number(x) for key, x in document["rmse"].items()},
        tests=tests,
        objective=_number(document["objective"]),
        parameters=parameters,
        correlation=np.array(document["correlation"]["matrix"], float),
        good=bool(document["success"]) and document["outcome"] != POOR,
    )


def _estimate(one: dict[str, Any]) -> KneeEstimate:
    value, low, high, error, start = (
        _number(one[key]) for key in ("value", "low", "high", "standard_error", "start")
    )
    interval, at_bound = one["interval"] or "", bool(one["at_bound"])
    return KneeEstimate(value, low, high, error, interval, at_bound, start)


def _number(value: float | None) -> float:
    """As JSON holds it: null is not a number."""
    return math.nan if value is None else float(value)
