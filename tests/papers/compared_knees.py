"""Three made-up knees side by side, one of them with troubles."""

from __future__ import annotations

import numpy as np

from kneejax.papers.knee_comparison import (
    LIMITS,
    Change,
    KneeComparison,
    KneeStudy,
    OneAtATime,
    Outcome,
)
from kneejax.papers.varus_valgus import DIRECTIONS, VarusValgus
from kneejax.statics import Equilibria, Status

SETTINGS = OneAtATime(axial_steps=2, moment_steps=8)
_VALUES = {"prestretch": (-0.1, 0.1), "youngs_modulus": (-100.0, 100.0)}
TENSION = {
    "varus": {"ACL": 90.0, "PCL": 0.0, "MCL": 3.0, "LCL": 400.0},
    "valgus": {"ACL": 60.0, "PCL": 0.0, "MCL": 500.0, "LCL": 2.0},
}
#: Averages in varus and valgus, in the order of `LIMITS`; those of prestretch are thrice as large.
AVERAGES = {
    "ACL": ((0.0, 0.0), (0.2, 0.1), (2.0, 4.0), (0.3, 0.3)),
    "PCL": ((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)),
    "MCL": ((0.0, 0.0), (0.1, 0.5), (2.0, 5.0), (0.2, 0.5)),
    "LCL": ((0.0, 0.0), (0.5, 0.1), (5.0, 2.0), (0.5, 0.2)),
}


def outcome(run, row, change, values, none=False):
    """What one change did in one direction; `values` in the order of `LIMITS`."""
    sign = DIRECTIONS[run.ramp.direction]
    peak = np.array([[3.0 + 0.01 * row, 2.0], [3.0, 2.0]])
    center = np.array([[[1.0, -28, -20], [2, -27, 22]], [[1, -28, -20], [2, -27, 21]]])
    if none:
        peak[0] = center[0] = np.nan
    return Outcome(
        change, run.ramp.direction, float(run.moment_reached_Nm[row]), *values[:2],
        np.nan if none else 40.0 * sign, peak, center, *values[2:], run.ending[row],
    )  # fmt: skip


def study(name, *, factor=1.0, attachments=True, tension=None, lost=False, **changed):
    """A knee; `changed` replaces averages of a ligament, e.g. `LCL=((0.0, 0.0), ...)`."""
    changes, averages = [], []
    for ligament, pairs in (AVERAGES | changed).items():
        for quantity, values in _VALUES.items():
            scale = factor * (3.0 if quantity == "prestretch" else 1.0)
            changes += [Change(ligament, quantity, value) for value in values]
            averages += [scale * np.array(pairs)] * len(values)
        if attachments:
            changes += [Change(ligament, "attachment", value) for value in (1.0, 2.0, 3.0)]
            averages += [np.full((len(LIMITS), 2), 0.1)] * 3
    runs, outcomes = {}, []
    for direction in DIRECTIONS:
        ramp = SETTINGS.ramp(direction)
        count = len(changes) + 1
        slope = 0.15 + 0.002 * np.arange(count)[:, None]
        q = np.zeros((count, len(ramp), 5))
        q[..., 0] = np.deg2rad(slope * ramp.moment_Nm)
        status = np.full((count, len(ramp)), int(Status.BALANCED))
        if lost:
            status[0, -2:], status[1] = Status.OUTSIDE_REGION, Status.NOT_CONVERGED
        nothing, reached = np.zeros((count, len(ramp), 0, 2)), np.ones(status.shape)
        steps = np.zeros(status.shape, int)
        balances = Equilibria(q, nothing, status, steps, reached, status, reached)
        run = VarusValgus(ramp, balances)
        runs[direction] = run
        for row, (change, own) in enumerate(zip(changes, averages, strict=True), 1):
            values = own[:, [*DIRECTIONS].index(direction)].tolist()
            outcomes.append(outcome(run, row, change, values, none=lost and row == 1))
    doubts = ("unchanged, it holds 30 of 40 N m in varus",) if lost else ()
    return KneeStudy(
        name, ("medial", "lateral"), tuple(changes), runs, tension or TENSION, tuple(outcomes),
        doubts, 12.0,
    )  # fmt: skip


def comparison(*knees):
    """The knees given, or three, of which the last has lost variants and no attachments."""
    made = knees or (
        study("one"),
        study("another_$knee$", factor=1.3),
        study("a_third", factor=4.0, attachments=False, lost=True),
    )
    return KneeComparison(tuple(made), SETTINGS, {"python": "3", "kneejax": "0"})
