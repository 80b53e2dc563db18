"""Limits that a plan keeps, and what the knee's uncertainty leaves of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from kneejax.mechanics import Knee
from kneejax.planning._reconstruction import reconstruction_of
from kneejax.planning._surgery import CHOICES, Outcome, Surgery
from kneejax.statics import Status, converged

#: By how much a constraint may be missed, as a part of its limit.
TOLERANCE = 1e-4
#: Of the polygons that stand for ellipses: within 0.001 of them.
_SIDES = 64


def missed(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """By how much each variant misses its worst limit, as a part of that, `(v,)`.

    Args:
        surgery: with its limits.
        outcome: of any choices.

    Returns:
        0 where all limits are kept; infinite where the knee has no balance somewhere.
    """
    return np.maximum(excess(surgery, outcome), 0.0)


def excess(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """As `missed`, but negative where all limits are kept: by how much there is room, `(v,)`."""
    each = outcome.choices.reshape(len(outcome.choices), -1, len(CHOICES))
    inside = (1.0 - foot.outside(each[..., own]) ** 2 for foot, own in _tunnels(surgery))
    worst = -np.hstack([*inside, limits_room(surgery, outcome)]).min(axis=1)
    known = np.isfinite(outcome.total) & converged(outcome.status) & np.isfinite(worst)
    return np.where(known, worst, np.inf)


def criteria_names(surgery: Surgery) -> tuple[str, ...]:
    """Of the criteria of `criteria_of`."""
    tests = [f"laxity_{angle:g}_deg_mm" for angle in surgery.protocol.lachman_deg]
    return *tests, "graft_peak_N", "strain_distance"


def criteria_of(outcome: Outcome) -> np.ndarray:
    """What is to be small, `(v, criteria)`: laxity at each test, mm, largest graft force, N, and
    strain distance."""
    return np.column_stack([outcome.laxity_mm, outcome.peak_N, outcome.total])


def best_of(surgery: Surgery, outcome: Outcome) -> int:
    """The variant of the least strain distance among those that keep all limits; where none does,
    the one that misses them least."""
    return int(ranked(missed(surgery, outcome), outcome.total)[0])


def ranked(far: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Rows of variants, the best first as `best_of` has it, by `missed` and strain distance."""
    kept = far <= TOLERANCE
    return np.argsort(np.where(kept, total, np.inf) if kept.any() else far, kind="stable")


def bounds(surgery: Surgery, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Smallest and largest of each choice."""
    wide = np.r_[surgery.tibia.semi_axes_mm, surgery.femur.semi_axes_mm]
    low, high = surgery.limits.tension_N
    bundles = size // len(CHOICES)
    return np.tile(np.r_[-wide, low], bundles), np.tile(np.r_[wide, high], bundles)


def limits_room(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """What is left of the limits of graft forces and laxity, as a part of each, `(v, limits)`:
    negative where it is missed."""
    count, limits = len(outcome.choices), surgery.limits
    graft = 1.0 - outcome.graft_N.reshape(count, -1) / limits.graft_N
    off = (outcome.laxity_mm - surgery.laxity(surgery.before)[0]) / limits.band_mm
    return np.hstack([graft, 1.0 - off, 1.0 + off])


def room_slopes(surgery: Surgery, outcome: Outcome) -> np.ndarray:
    """Derivative of `limits_room` of one variant by the choices, `(limits, choices)`."""
    assert outcome.slopes is not None
    size, limits = outcome.choices.shape[1], surgery.limits
    graft = -outcome.slopes["graft_N"][0].reshape(-1, size) / limits.graft_N
    off = outcome.slopes["laxity_mm"][0] / limits.band_mm
    return np.vstack([graft, -off, off])


def polygons(surgery: Surgery, size: int) -> tuple[np.ndarray, np.ndarray]:
    """The footprints as polygons within their ellipses: `sides @ choices <= inside`.

    A limit that is curved would be missed a little by every step of a linear model along it.
    """
    angle = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    normals = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rows = []
    for bundle in range(size // len(CHOICES)):
        for footprint, columns in _tunnels(surgery):
            row = np.zeros((_SIDES, size // len(CHOICES), len(CHOICES)))
            row[:, bundle, columns] = normals / np.array(footprint.semi_axes_mm)
            rows.append(row.reshape(_SIDES, size))
    sides = np.vstack(rows)
    return sides, np.full(len(sides), np.cos(np.pi / _SIDES))


def _tunnels(surgery: Surgery):
    """Footprints, each with the columns of its coordinates among a bundle's choices."""
    return (surgery.tibia, slice(0, 2)), (surgery.femur, slice(2, 4))


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
    quantities, tests = criteria_names(surgery), len(surgery.protocol.lachman_deg)
    names = ("intact", "deficient", *choices)
    every = np.full((len(knees), len(names), len(quantities)), np.nan)
    within = np.full((len(knees), len(names)), np.nan)
    for row, knee in enumerate(knees):
        own = on_knee(surgery, knee)
        before = own.before
        every[row, :2, :tests] = own.laxity(before)
        found = own.try_out(np.stack(list(choices.values())))
        sound = converged(found.status) | (found.status == Status.GIVES_WAY)
        every[row, 2:] = np.where(sound[:, None], criteria_of(found), np.nan)
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
