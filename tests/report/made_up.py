"""A made-up calibration with every trouble a report must show."""

from __future__ import annotations

import numpy as np

from kneejax.inference.calibration._result import (
    Calibration,
    Ending,
    Estimate,
    Fit,
    Iteration,
    Motion,
    Starts,
)
from kneejax.inference.intervals._estimate import IntervalKind
from kneejax.statics._status import Status

LIGAMENTS = ("ACL", "PCL", "MCL", "LCL")
CONTACTS = ("medial", "lateral")
UNDETERMINED = "MCL.stiffness"
AT_BOUND = "LCL.stiffness"
REASON = "its ligament is slack at every pose"
_FREE = ("adduction", "internal_rotation", "anterior", "superior", "lateral")


def _table(flexion: np.ndarray) -> np.ndarray:
    t = flexion / 120
    return np.stack(
        [
            flexion,
            -1.5 + 5 * t**1.5,
            14 * (1 - np.exp(-2.5 * t)),
            3 + 9 * t - 14 * t**2,
            -24 - 3 * np.cos(2.4 * t),
            1.5 + 3 * np.sin(2 * t),
        ],
        axis=1,
    )


def _estimates(rng: np.random.Generator, spread: float) -> tuple[Estimate, ...]:
    made = []
    stiffness = (5876.0, 2814.0, 8904.0, 10000.0)
    for name, value, start in zip(LIGAMENTS, stiffness, (4500, 3860, 8000, 6000), strict=True):
        full = f"{name}.stiffness"
        lost = full == UNDETERMINED
        bound = full == AT_BOUND
        here = value if bound else value * (1 + spread * rng.normal())
        error = 0.05 * value
        known = (here - 1.96 * error, here + 1.96 * error, IntervalKind.STANDARD_ERROR)
        if lost:
            known = (np.nan, np.nan, IntervalKind.NOT_DETERMINED)
        elif bound:
            known = (8800.0, np.nan, IntervalKind.ONE_SIDED)
        made.append(
            Estimate(
                full, "N", here, float(start), 300.0, 10000.0,
                np.nan if lost or bound else error, bound, 1.0 if lost else 0.0, *known,
            )
        )  # fmt: skip
    strains = (0.037, -0.047, 0.023, 0.039)
    for name, value, start in zip(LIGAMENTS, strains, (0.03, -0.1, 0.07, 0.07), strict=True):
        here = value + 0.05 * spread * rng.normal()
        bent = name == "PCL"
        high = here + (0.02 if bent else 0.008)
        made.append(
            Estimate(
                f"{name}.reference_strain", "", here, start, -0.2, 0.2,
                np.nan if bent else 0.004, False, 0.0, here - 0.008, high,
                IntervalKind.PROFILE if bent else IntervalKind.STANDARD_ERROR,
            )
        )  # fmt: skip
    return tuple(made)


def _fit(procedure: str, poses: int, seed: int, failed: tuple[int, ...]) -> Fit:
    rng = np.random.default_rng(seed)
    flexion = np.linspace(0, 120, poses)
    table = _table(flexion)
    table[:, 1:] += 0.15 * np.sin(flexion / 15 + seed)[:, None]
    status = np.zeros(poses, int)
    forces = np.maximum(0, rng.normal(80, 20, 4) * np.cos(flexion[:, None] / 50 + np.arange(4)))
    contact = 60 + 30 * np.sin(flexion[:, None] / 40 + np.arange(2))
    for row in failed:
        status[row] = Status.NOT_CONVERGED
        table[row] = np.nan
        forces[row] = contact[row] = np.nan
    if failed:
        status[2] = Status.UNSTABLE
    stages = ("III",) if procedure == "III" else (f"{procedure}.1", f"{procedure}.2")
    history, evaluations, objective = [], 1, 5200.0
    for stage in stages:
        for _ in range(5):
            evaluations += 2
            objective *= 0.32 + 0.1 * rng.random()
            history.append(Iteration(stage, evaluations, objective))
    estimates = _estimates(rng, 0.02)
    root = rng.normal(size=(12, 8))
    root[:, 0] += 2 * root[:, 4]
    correlation = np.corrcoef(root.T)
    lost = [e.name for e in estimates].index(UNDETERMINED)
    correlation[lost] = correlation[:, lost] = np.nan
    counts = {"residual": evaluations, "jacobian": 11, "equilibria": evaluations * poses}
    return Fit(
        procedure,
        estimates,
        objective,
        {name: 0.4 + 0.3 * rng.random() for name in _FREE},
        {name: 0.12 + 0.05 * rng.random() for name in _FREE},
        correlation,
        Motion(table, status, forces, contact),
        tuple(history),
        counts,
        procedure != "III",
        "Evaluations used up" if procedure == "III" else "",
        (offset(),),
        Ending.STOPPED if procedure == "III" else Ending.CONVERGED,
        Starts(
            (objective, 1.01 * objective, 410.0),
            np.array([[e.value for e in (*estimates, offset())]] * 3),
            np.array([False, False, True]),
            np.zeros(3, bool),
        ),
    )


def offset(coordinate: str = "lateral", value: float = -0.3, error: float = 0.05) -> Estimate:
    """A constant between frames."""
    return Estimate(
        coordinate, "mm", value, 0.0, -10.0, 10.0, error, False, 0.0, value - 2 * error,
        value + 2 * error, IntervalKind.STANDARD_ERROR,
    )  # fmt: skip


def calibration(poses: int = 25, synthetic: bool = True, **changes) -> Calibration:
    """Make one up: eight parameters, three procedures, one failed pose."""
    rng = np.random.default_rng(0)
    flexion = np.linspace(0, 120, poses)
    measured = _table(flexion)
    measured[:, 1:] += 0.08 * rng.normal(size=(poses, 5))
    start = _table(flexion) + np.array([0, 1.2, -2.5, 1.4, -0.8, 0.6])
    before = np.maximum(0, 60 * np.cos(flexion[:, None] / 45 + 1.1 * np.arange(4)))
    fields = {
        "title": "Four ligaments from a passive flexion",
        "knee": "knee-04",
        "measured": measured,
        "start": Motion(start, np.zeros(poses, int), before, np.full((poses, 2), 40.0)),
        "start_rmse": dict(zip(_FREE, (1.2, 2.5, 1.4, 0.8, 0.6), strict=True)),
        "start_partial_objectives": dict(zip(_FREE, (36.0, 156.0, 49.0, 16.0, 9.0), strict=True)),
        "start_objective": 5200.0,
        "fits": tuple(
            _fit(name, poses, seed, failed)
            for name, seed, failed in (("II", 2, (9,)), ("I", 1, ()), ("III", 3, ()))
        ),
        "ligaments": LIGAMENTS,
        "contacts": CONTACTS,
        "truth": {
            "ACL.stiffness": 5876.0,
            "PCL.stiffness": 2814.0,
            "MCL.stiffness": 8904.0,
            "LCL.stiffness": 9900.0,
            "ACL.reference_strain": 0.037,
            "PCL.reference_strain": -0.047,
            "MCL.reference_strain": 0.023,
            "LCL.reference_strain": 0.039,
        }
        if synthetic
        else {},
        "noise": dict(zip(_FREE, (0.1, 0.1, 0.2, 0.2, 0.2), strict=True)),
        "noise_estimated": True,
        "misfits": (),
        "weights": np.array([8.0, 8.0, 1.0, 1.0, 1.0]),
        "left_out": 1,
        "seconds": {"total": 4.2, "compile": 2.9, "search": 1.1, "other": 0.2},
        "versions": {"kneejax": "0.1.0", "jax": "0.7.0"},
        "settings": {"procedures": ["II", "I", "III"], "weights": {"rotations_mm": 8.0}, "seed": 0},
    }
    return Calibration(**(fields | changes))
