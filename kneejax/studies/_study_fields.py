"""The fields of a study: what may stand in each, and in which form it is kept."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.files import parse_flexion, said_of
from kneejax.files.reading import Field, InputProblem
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import METHODS, POSES, PROCEDURES, Stage
from kneejax.inference.fit import DEFAULT_WEIGHTS, check_readable
from kneejax.mechanics import (
    NAMED_LOADS,
    RANGES,
    Knee,
    Range,
    load_called,
    load_opposite_to,
    range_of_parameter,
)
from kneejax.parameters import cut
from kneejax.statics import Status

#: What a balance may be at fault for, and a study may count as a failure.
FAULTS = tuple(s.word for s in Status if s.converged and s is not Status.BALANCED)

_PARAMETER = re.compile(r"[A-Za-z*?][\w*?+-]*(\.[\w*?]+)*")
_MOST_STARTS = 1000


@dataclasses.dataclass(frozen=True)
class Synthetic:
    """Poses that the model itself makes, with noise, to see whether they lead back.

    Attributes:
        parameters: parameter -> value that makes the data, in its own unit.
        flexion_deg: prescribed angles, `(n,)`, or a text such as `0:120:5`.
        noise_mm: standard deviation of the noise on displacements.
        noise_deg: standard deviation of the noise on rotations.
        seed: of the noise.
    """

    parameters: Mapping[str, float]
    flexion_deg: np.ndarray
    noise_mm: float = 0.0
    noise_deg: float = 0.0
    seed: int = 0


def plain(value: Any) -> Any:
    """Lists, dictionaries and numbers of Python, as a file would give them."""
    if isinstance(value, Synthetic | Stage):
        return plain(vars(value))
    if isinstance(value, Mapping):
        return {name: plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, MeasuredTest):
        return value
    return [plain(one) for one in value] if isinstance(value, list | tuple) else value


def checked(study: Field) -> dict[str, Any]:
    """Every field of a study in its one form."""
    if not isinstance(study.value["knee"], Knee):
        raise study["knee"].problem("a knee, as kneejax.load_knee gives")
    given = [name for name in ("measured", "synthetic") if study.value[name] is not None]
    tests = study.value["tests"]
    if len(given) > 1 or not (given or tests):
        value = " and ".join(given) or "neither"
        expected = "exactly one of measured, synthetic" + ", or tests" * (not given)
        raise Field(study.file, "measured", value).problem(expected)
    return {
        "title": study["title"].text(),
        "measured": _poses(study["measured"]) if "measured" in given else None,
        "synthetic": _synthetic(study["synthetic"]) if "synthetic" in given else None,
        "tests": _tests(study),
        "parameters": parameter_names(study["parameters"]),
        "start": parameter_values(study["start"]),
        "bounds": {
            name: limits.interval(range_of_parameter(name))
            for name, limits in _by_parameter(study["bounds"])
        },
        "weights": _weights(study["weights"]),
        "procedures": _distinct(study["procedures"], lambda item: item.choice(PROCEDURES)),
        "stages": _stages(study),
        "starts": study["starts"].integer(1, _MOST_STARTS),
        "seed": study["seed"].integer(0),
        "prior": {
            name: _deviation(sd, range_of_parameter(name))
            for name, sd in _by_parameter(study["prior"])
        },
        "noise_mm": _noise(study["noise_mm"], "noise_mm"),
        "noise_deg": _noise(study["noise_deg"], "noise_deg"),
        "frame_offset": _frame_offset(study["frame_offset"]),
        "method": study["method"].choice(METHODS),
        "failures": _distinct(study["failures"], lambda item: item.choice(FAULTS), empty=True),
        "loads": _loads(study["loads"]),
    }


def _stages(study: Field) -> tuple[Stage, ...]:
    """Stages of procedure S, each of data that there are."""
    if not study.value["stages"]:
        return ()
    posed = study.value["measured"] is not None or study.value["synthetic"] is not None
    known = [POSES] * posed + [test.name for test in study.value["tests"]]
    found = []
    for item in study["stages"].items("stages"):
        item.mapping((), ("parameters", "data"))
        parts = {
            "parameters": lambda own: _distinct(own, _parameter, empty=True),
            "data": lambda own: _distinct(own, lambda one: one.choice(known), empty=True),
        }
        found.append(Stage(**{name: parts[name](item[name]) for name in item.value}))
    return tuple(found)


def _tests(study: Field) -> tuple[MeasuredTest, ...]:
    """Tests under load, no two of one name, each no better known than the poses can say."""
    tests = tuple(study.value["tests"])
    for number, test in enumerate(tests):
        if not isinstance(test, MeasuredTest):
            raise study["tests"].problem("tests as kneejax.MeasuredTest makes them")
        with said_of(f"{study.file}: tests[{number}]"):
            cut(study.value["knee"], test.cut)
            check_readable(study.value["knee"], test.readings)
        place = Field(study.file, f"tests[{number}].name", test.name)
        if test.name in [one.name for one in tests[:number]]:
            raise place.problem("every name once")
        for unit in ("mm", "deg"):
            if test.readings and study.value[f"noise_{unit}"] is None:
                place = Field(study.file, f"tests[{number}]", next(iter(test.readings)))
                raise place.problem(f"noise_{unit} of the study too, against which it counts")
        for unit, sd in (("mm", test.sd_mm), ("deg", test.sd_deg)):
            own = Field(study.file, f"tests[{number}].sd_{unit}", sd)
            if sd is None:
                continue
            if not (np.isfinite(sd) and sd > 0):
                raise own.problem("a standard deviation above 0")
            if study.value[f"noise_{unit}"] is None and study.value["synthetic"] is None:
                expected = f"noise_{unit} of the study too, against which tests are weighed"
                raise own.problem(expected)
    return tests


def _poses(field: Field) -> np.ndarray:
    expected = "poses, (n, 6): degrees and mm, all finite"
    try:
        table = np.asarray(field.value, float)
    except (TypeError, ValueError):
        raise field.problem(expected) from None
    if table.ndim != 2 or table.shape[1] != len(COLUMNS) or not len(table):
        raise Field(field.file, field.path, f"shape {table.shape}").problem(expected)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise Field(field.file, f"{field.path}[{row}]", "not finite").problem(expected)
    return table


def _synthetic(field: Field) -> Synthetic:
    angles = field["flexion_deg"]
    if isinstance(angles.value, str):
        flexion = parse_flexion(angles.value, field.file, angles.path)
    else:
        flexion = np.array(angles.numbers(allowed=RANGES["flexion_deg"]))
    return Synthetic(
        parameters=parameter_values(field["parameters"]),
        flexion_deg=flexion,
        noise_mm=field["noise_mm"].number(RANGES["noise_mm"]),
        noise_deg=field["noise_deg"].number(RANGES["noise_deg"]),
        seed=field["seed"].integer(0),
    )


def parameter_values(field: Field) -> dict[str, float]:
    """Values by name or wildcard, each one that such a parameter can have.

    Args:
        field: of a mapping from a parameter to its value.

    Raises:
        InputProblem: something else stands there.
    """
    return {name: value.number(range_of_parameter(name)) for name, value in _by_parameter(field)}


def parameter_names(field: Field) -> tuple[str, ...]:
    """Names or wildcards of parameters, each once.

    Args:
        field: of a list of them.

    Raises:
        InputProblem: something else stands there.
    """
    return _distinct(field, _parameter)


def _by_parameter(field: Field) -> list[tuple[str, Field]]:
    """Names and fields of a mapping whose names are parameters or wildcards."""
    if not isinstance(field.value, dict):
        raise field.problem("a mapping from a parameter to its value")
    for name in field.value:
        _parameter(Field(field.file, field.path, name))
    return [(name, field[name]) for name in field.value]


def _parameter(field: Field) -> str:
    name = field.text()
    if not _PARAMETER.fullmatch(name):
        raise field.problem("a name such as ACL.stiffness, or a wildcard such as *.stiffness")
    return name


def _loads(field: Field) -> dict[str, list[float]]:
    """Sizes by name, one or several each."""
    if not isinstance(field.value, dict):
        raise field.problem(f"a mapping from one of {', '.join(NAMED_LOADS)} to its sizes")
    found = {}
    for name in field.value:
        if name not in NAMED_LOADS:
            known, meant = f"one of {', '.join(NAMED_LOADS)}", load_opposite_to(str(name))
            near = f"{meant} of the opposite sign" if meant else load_called(name) or NAMED_LOADS
            raise InputProblem(field.file, field.path, name, known, near)
        sizes = field[name]
        many = isinstance(sizes.value, list)
        found[name] = list(sizes.numbers(allowed=RANGES[name])) if many else [
            sizes.number(RANGES[name])
        ]  # fmt: skip
    return found


def _weights(field: Field) -> dict[str, float]:
    field.mapping((), ("mm", "deg", *FREE_COORDINATES))
    given = {name: field[name].number(RANGES["weight"]) for name in field.value}
    weights = {}
    for column, usual in zip(COLUMNS[1:], DEFAULT_WEIGHTS.tolist(), strict=True):
        name, unit = column.rsplit("_", 1)
        weights[name] = given.get(name, given.get(unit, usual))
    if not any(weights.values()):
        raise field.problem("a weight above 0 for at least one coordinate")
    return weights


def _deviation(field: Field, allowed: Range | None) -> float:
    sd = field.number(allowed and allowed.spread)
    if not sd > 0:
        raise field.problem("a standard deviation above 0")
    return sd


def _noise(field: Field, name: str) -> float | None:
    if field.value is None:
        return None
    noise = field.number(RANGES[name])
    if not noise > 0:
        raise field.problem("a standard deviation above 0; leave it out to have it estimated")
    return noise


def _frame_offset(field: Field) -> tuple[str, ...]:
    if isinstance(field.value, bool):
        return FREE_COORDINATES if field.value else ()
    if not isinstance(field.value, list):
        raise field.problem(f"true, false, or a list of {', '.join(FREE_COORDINATES)}")
    return _distinct(field, _offset_coordinate, empty=True)


def _offset_coordinate(item: Field) -> str:
    if item.value == "flexion":
        raise item.problem(
            f"one of {', '.join(FREE_COORDINATES)}; flexion is prescribed as it was measured, so "
            "it can have no offset: correct the measured column instead"
        )
    return item.choice(FREE_COORDINATES)


def _distinct(
    field: Field, read: Callable[[Field], str], *, empty: bool = False
) -> tuple[str, ...]:
    """Entries of a list, none of them twice."""
    found: list[str] = []
    for item in () if empty and field.value == [] else field.items("names"):
        name = read(item)
        if name in found:
            raise item.problem("every name once")
        found.append(name)
    return tuple(found)
