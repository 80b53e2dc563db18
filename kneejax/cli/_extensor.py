"""`kneejax simulate patellar-tracking | extension | leg-raise`: the quadriceps pulls."""

from __future__ import annotations

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._deliver import deliver
from kneejax.cli._given import read_loads
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Simulate
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
from kneejax.mechanics import Knee, Range, load_of
from kneejax.numerics import WrongValue
from kneejax.report import extensor_answer

_FLEXION = {"patellar-tracking": "0:120:5", "extension": "0:90:30", "leg-raise": "0:90:5"}
_PULL_N = {"patellar-tracking": 100.0, "extension": 1000.0}
_LONGER = Range(-20.0, 100.0, "mm")
_OF_LEG = ("body_kg", "height_m", "ankle_kg", "femur_deg")

def run_extensor(arguments: Simulate) -> int:
    """Pull, print forces and the patella, write tables and two figures."""
    name = arguments.experiment
    flexion = parse_flexion(arguments.flexion or _FLEXION[name])
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


def _lengths(arguments: Simulate) -> np.ndarray | None:
    """How much longer the quadriceps is to be than at rest, mm."""
    if arguments.quadriceps_mm is None:
        return None
    return parse_range(arguments.quadriceps_mm, "--quadriceps-mm", "lengths", _LONGER, "length")


def _driven(
    arguments: Simulate, knee: Knee, flexion: np.ndarray, lengths: np.ndarray, loads
) -> DrivenExtensor:
    if arguments.experiment == "extension":
        return extension_by_length(knee, flexion, lengths, loads)
    try:
        return leg_raise_by_length(knee, lengths, _shank(arguments))
    except WrongValue as problem:
        expected = problem.expected
        raise InputProblem("--quadriceps-mm", "lengths", problem.found, expected) from None


def _shank(arguments: Simulate) -> Shank:
    usual = {"body_kg": 75.0, "height_m": 1.75, "ankle_kg": 0.0, "femur_deg": 0.0}
    given = {option: getattr(arguments, option) for option in _OF_LEG}
    return Shank.of_person(**{k: usual[k] if given[k] is None else given[k] for k in usual})


def _made(arguments: Simulate, knee: Knee, flexion: np.ndarray, loads) -> Extensor:
    name = arguments.experiment
    if name == "leg-raise":
        return leg_raise(knee, flexion, _shank(arguments))
    pull = arguments.quadriceps_N or _PULL_N[name]
    if name == "patellar-tracking":
        return patellar_tracking(knee, flexion, pull, loads)
    steps = arguments.steps or 20
    return isometric_extension(knee, flexion, pull * np.arange(1, steps + 1) / steps, loads)
