"""`kneejax simulate patellar-tracking | extension | leg-raise`: the quadriceps pulls."""

from __future__ import annotations

import argparse

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._deliver import deliver
from kneejax.cli._given import check_within, read_loads
from kneejax.cli._progress import stages_on_terminal
from kneejax.experiments import (
    DrivenExtensor,
    Extensor,
    Shank,
    extension_by_length,
    isometric_extension,
    leg_raise,
    leg_raise_by_length,
    patellar_tracking,
)
from kneejax.files import InputProblem, parse_flexion, parse_range
from kneejax.mechanics import RANGES, Knee, Range, load_of
from kneejax.numerics import WrongValue
from kneejax.report import extensor_answer

_FLEXION = {"patellar-tracking": "0:120:5", "extension": "0:90:30", "leg-raise": "0:90:5"}
_PULL_N = {"patellar-tracking": 100.0, "extension": 1000.0}
_MOST_STEPS = 200
_LONGER = Range(-20.0, 100.0, "mm")
_OF_LEG = ("body_kg", "height_m", "ankle_kg", "femur_deg")
#: Option -> what it may be.
_SIZES = {
    "quadriceps_N": Range(1.0, 12000.0, "N"),
    **{name: RANGES[name] for name in _OF_LEG},
}


def run_extensor(arguments: argparse.Namespace) -> int:
    """Pull, print forces and the patella, write tables and two figures."""
    name = arguments.experiment
    flexion = parse_flexion(arguments.flexion or _FLEXION[name])
    _check(arguments)
    lengths = _lengths(arguments)
    loads = read_loads(arguments.load)
    knee = asked_knee(arguments, patella=True)
    acting, driven = [load_of(**loads)] if loads else [], None
    with stages_on_terminal(knee.name):
        if lengths is None:
            found = _made(arguments, knee, flexion, acting)
        else:
            driven = _driven(arguments, knee, flexion, lengths, acting)
            found = driven.found
    answer = extensor_answer(
        knee_words(arguments, knee), name, found, loads=loads, driven=driven
    )
    return deliver(answer, arguments)


def _check(arguments: argparse.Namespace) -> None:
    """Refuse sizes that no person has, and options of another experiment."""
    name = arguments.experiment
    strange = _OF_LEG if name != "leg-raise" else ("quadriceps_N", "load")
    for option in strange:
        if getattr(arguments, option) not in (None, []):
            expected = "leg-raise" if option in _OF_LEG else "patellar-tracking or extension"
            raise InputProblem("simulate", f"--{option}", name, f"{expected} with it")
    for option, allowed in _SIZES.items():
        value = getattr(arguments, option)
        if value is not None:
            check_within(f"--{option}", option, [value], allowed)
    steps = arguments.steps
    if steps is not None and not 1 <= steps <= _MOST_STEPS:
        raise InputProblem("--steps", "steps", str(steps), f"between 1 and {_MOST_STEPS}")


def _lengths(arguments: argparse.Namespace) -> np.ndarray | None:
    """How much longer the quadriceps is to be than at rest, mm."""
    if arguments.quadriceps_mm is None:
        return None
    name, option = arguments.experiment, "--quadriceps_mm"
    if name == "patellar-tracking":
        raise InputProblem("simulate", option, name, "extension or leg-raise with it")
    for other in ("quadriceps_N", "steps", "flexion" if name == "leg-raise" else "quadriceps_N"):
        if getattr(arguments, other) is not None:
            raise InputProblem("simulate", f"--{other}", name, f"{option} without it: a result")
    return parse_range(arguments.quadriceps_mm, option, "lengths", _LONGER, "length")


def _driven(
    arguments: argparse.Namespace, knee: Knee, flexion: np.ndarray, lengths: np.ndarray, loads
) -> DrivenExtensor:
    if arguments.experiment == "extension":
        return extension_by_length(knee, flexion, lengths, loads)
    try:
        return leg_raise_by_length(knee, lengths, _shank(arguments))
    except WrongValue as problem:
        expected = problem.expected
        raise InputProblem("--quadriceps_mm", "lengths", problem.found, expected) from None


def _shank(arguments: argparse.Namespace) -> Shank:
    usual = {"body_kg": 75.0, "height_m": 1.75, "ankle_kg": 0.0, "femur_deg": 0.0}
    given = {option: getattr(arguments, option) for option in _OF_LEG}
    return Shank.of_person(**{k: usual[k] if given[k] is None else given[k] for k in usual})


def _made(arguments: argparse.Namespace, knee: Knee, flexion: np.ndarray, loads) -> Extensor:
    name = arguments.experiment
    if name == "leg-raise":
        return leg_raise(knee, flexion, _shank(arguments))
    pull = arguments.quadriceps_N or _PULL_N[name]
    if name == "patellar-tracking":
        return patellar_tracking(knee, flexion, pull, loads)
    steps = arguments.steps or 20
    return isometric_extension(knee, flexion, pull * np.arange(1, steps + 1) / steps, loads)
