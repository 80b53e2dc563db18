"""What is known of a reconstruction where the knee is known within limits only."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from kneejax.mechanics import Knee
from kneejax.planning._limits import missed
from kneejax.planning._reconstruction import reconstruction_of
from kneejax.planning._surgery import Surgery
from kneejax.statics import Status, converged

#: Parts of the draws below each end of an interval, and below its middle.
_PARTS = (0.025, 0.5, 0.975)


@dataclasses.dataclass(frozen=True)
class Intervals:
    """Numbers of knees over draws of the knee.

    Attributes:
        draws: how many knees were drawn.
        quantities: their names: laxity at each test, mm, largest graft force, N, strain distance.
        knees: `intact`, `deficient`, then the choices by name.
        limits: 2.5, 50 and 97.5 % of the draws that balance, `(knees, quantities, 3)`; NaN where
            a knee has no such number.
        known: draws that have the number, `(knees, quantities)`.
        kept: part of the draws in which all limits are kept, `(knees,)`; NaN without a graft.
    """

    draws: int
    quantities: tuple[str, ...]
    knees: tuple[str, ...]
    limits: np.ndarray
    known: np.ndarray
    kept: np.ndarray


def intervals(
    surgery: Surgery,
    knees: Sequence[Knee],
    choices: Mapping[str, np.ndarray],
    progress: Callable[[int, int], None] | None = None,
) -> Intervals:
    """Carry out the same surgery on knees that are drawn.

    Args:
        surgery: on the knee itself; its tunnels stay where they are on the bones.
        knees: drawn, of the same structure.
        choices: name -> what is done, `(choices,)`.
        progress: called with draws done and asked for.
    """
    tests = [f"laxity_{angle:g}_deg_mm" for angle in surgery.protocol.lachman_deg]
    quantities = (*tests, "graft_peak_N", "strain_distance")
    names = ("intact", "deficient", *choices)
    every = np.full((len(knees), len(names), len(quantities)), np.nan)
    within = np.full((len(knees), len(names)), np.nan)
    for row, knee in enumerate(knees):
        own = on_knee(surgery, knee)
        before = own.before
        every[row, :2, : len(tests)] = own.laxity(before)
        found = own.try_out(np.stack(list(choices.values())))
        sound = converged(found.status) | (found.status == Status.GIVES_WAY)
        told = np.column_stack([found.laxity_mm, found.peak_N, found.total])
        every[row, 2:] = np.where(sound[:, None], told, np.nan)
        within[row, 2:] = missed(own, found) <= 0.0
        if progress is not None:
            progress(row + 1, len(knees))
    known = np.isfinite(every).sum(axis=0)
    limits = np.full((len(names), len(quantities), 3), np.nan)
    for place in zip(*np.nonzero(known), strict=True):
        own = every[(slice(None), *place)]
        limits[place] = np.quantile(own[np.isfinite(own)], _PARTS)
    return Intervals(len(knees), quantities, names, limits, known, within.mean(axis=0))


def on_knee(surgery: Surgery, knee: Knee) -> Surgery:
    """The same surgery on another knee of the same structure, grafts at the same places.

    Args:
        surgery: any.
        knee: without grafts.
    """
    plan = surgery.plan
    other = reconstruction_of(
        knee, plan.ligament, len(plan.bundles), sum(plan.stiffness_N), sum(plan.failure_N)
    )
    return dataclasses.replace(surgery, plan=other)
