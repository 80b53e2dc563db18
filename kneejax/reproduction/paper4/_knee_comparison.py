"""Knees side by side: one ligament changed at a time under varus and valgus moments.

The study of paper 4: how far each variant holds the load, how its rotation, its peak contact
pressure and the place of that differ from the unchanged knee's, and scores by its Table 5.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Mapping

import jax.numpy as jnp
import numpy as np

from kneejax.experiments import DIRECTIONS, VarusValgus, peak_pressure, varus_valgus
from kneejax.geometry import State
from kneejax.inference import versions
from kneejax.mechanics import Knee
from kneejax.parameters import UnsuitableData, fibre_rows
from kneejax.reproduction.paper4._fibre_changes import Change, Fibres, changes_of, with_fibres
from kneejax.reproduction.paper4._knee_scores import LIMITS, score
from kneejax.reproduction.paper4._one_at_a_time import (
    Influence,
    KneeComparison,
    KneeStudy,
    OneAtATime,
    Outcome,
)

Progress = Callable[[int, int], None]


def compare_knees(
    knees: Mapping[str, Knee],
    settings: OneAtATime | None = None,
    progress: Progress | None = None,
) -> KneeComparison:
    """Change one ligament at a time in several knees, under varus and valgus moments.

    Args:
        knees: name -> knee, each with the ligaments of the settings.
        settings: paper 4's by default.
        progress: called with how many balances are done, and of how many.

    Returns:
        Outcomes and scores of every knee.

    Raises:
        UnknownParameter: a knee lacks a ligament.
        UnsuitableData: no knees.

    Source: paper 4, sections 2.2 to 2.4.
    """
    settings = settings or OneAtATime()
    if not knees:
        raise UnsuitableData("no knees; expected one or more")
    # All are looked at before the first is computed.
    work = {name: _changes(knee, settings) for name, knee in knees.items()}
    variants = {name: len(changes) + 1 for name, (changes, _) in work.items()}
    each, done, studies = settings.steps * len(DIRECTIONS), 0, []
    for name, (changes, fibres) in work.items():
        shown = _from(progress, done * each, sum(variants.values()) * each)
        studies.append(_study(name, knees[name], changes, fibres, settings, shown))
        done += variants[name]
    return KneeComparison(tuple(studies), settings, versions())


def _changes(knee: Knee, settings: OneAtATime) -> tuple[tuple[Change, ...], Fibres]:
    return changes_of(
        knee,
        settings.ligaments,
        settings.prestretch,
        settings.modulus_MPa,
        settings.reference_modulus_MPa,
    )


def _from(progress: Progress | None, before: int, total: int | None) -> Progress | None:
    """Progress of a part: what was done before it is added, and the whole's total said."""
    if progress is None:
        return None
    return lambda done, own: progress(before + done, total or own)


def _study(
    name: str,
    knee: Knee,
    changes: tuple[Change, ...],
    fibres: Fibres,
    settings: OneAtATime,
    progress: Progress | None,
) -> KneeStudy:
    """One knee; the fibres of the unchanged knee come first."""
    begun, runs, outcomes = time.perf_counter(), {}, []
    for place, direction in enumerate(DIRECTIONS):
        shown = _from(progress, place * (len(changes) + 1) * settings.steps, None)
        ramp = settings.ramp(direction)
        runs[direction] = varus_valgus(knee, ramp, with_fibres, fibres, shown)
        for parameter in dict.fromkeys(change.parameter for change in changes):
            rows = [i for i, c in enumerate(changes, 1) if c.parameter == parameter]
            some = [changes[i - 1] for i in rows]
            outcomes += _outcomes(knee, runs[direction], direction, some, rows, settings)
    return KneeStudy(
        name,
        knee.contact_names,
        changes,
        runs,
        {direction: _tensions(knee, run, settings.ligaments) for direction, run in runs.items()},
        tuple(outcomes),
        _influences(outcomes),
        _doubts(runs, outcomes, settings),
        time.perf_counter() - begun,
    )


def _tensions(knee: Knee, run: VarusValgus, ligaments: tuple[str, ...]) -> dict[str, float]:
    """Of each ligament at the last step that the unchanged knee holds, N."""
    step = max(int(run.reached[0]) - 1, 0)
    held = {"flexion": np.deg2rad(run.ramp.flexion_deg)}
    state = State.of(held, jnp.asarray(run.balances.q[0, step]))
    tension = np.asarray(knee.ligaments.tension(state))
    return {name: float(tension[fibre_rows(knee, name)].sum()) for name in ligaments}


def _outcomes(
    knee: Knee,
    run: VarusValgus,
    direction: str,
    changes: list[Change],
    rows: list[int],
    settings: OneAtATime,
) -> list[Outcome]:
    """Of the changes of one parameter, which are compared at one moment."""
    both = run.held[rows] & run.held[0] & run.ramp.loaded
    apart = np.where(both, run.adduction_deg[rows] - run.adduction_deg[0], 0.0)
    count = both.sum(axis=1)
    rmse = np.where(count, np.sqrt((apart**2).sum(axis=1) / np.maximum(count, 1)), np.nan)
    late = 100.0 * np.abs(run.time_reached[rows] / run.time_reached[0] - 1.0)
    step, far = _common_step(run, rows, settings.least_Nm)
    peak, center = _peaks(knee, run, [0, *rows], step, [bool(far.any()), *far])
    percent, moved = _compared(peak, center)
    return [
        Outcome(
            change,
            direction,
            float(run.moment_reached_Nm[rows[i]]),
            float(late[i]),
            float(rmse[i]),
            float(run.ramp.moment_Nm[step]) if far[i] else float("nan"),
            peak[i + 1],
            peak[0],
            center[i + 1],
            center[0],
            float(percent[i]),
            float(moved[i]),
            run.ending[rows[i]],
        )
        for i, change in enumerate(changes)
    ]


def _common_step(run: VarusValgus, rows: list[int], least_Nm: float) -> tuple[int, np.ndarray]:
    """The last step that the knee and all variants hold that get far enough, and which do."""
    enough = np.abs(run.moment_reached_Nm) >= least_Nm
    far = enough[rows] & enough[0]
    reached = [run.reached[0], *run.reached[rows][far]]
    return int(max(min(reached) - 1, 0)), far


def _peaks(knee: Knee, run: VarusValgus, variants: list[int], step: int, far: list[bool]):
    """Peak pressure `(variants, contacts)` and its place at a step; NaN for those not so far."""
    found = run.balances
    q, contact_points = (
        np.moveaxis(x[variants, step], 0, -1) for x in (found.q, found.contact_points)
    )
    pose = State.of({"flexion": np.deg2rad(run.ramp.flexion_deg)}, jnp.asarray(q)).tibia
    # Only ligaments are changed: the contacts are the knee's own.
    peaks = peak_pressure(knee, pose, jnp.asarray(contact_points))
    known = np.array(far)
    pressure = np.where(known[:, None], np.asarray(peaks.pressure), np.nan)
    return pressure, np.where(known[:, None, None], np.asarray(peaks.center), np.nan)


def _compared(peak: np.ndarray, center: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Difference of pressure in per cent and of place in mm to the first row, contacts averaged."""
    with np.errstate(invalid="ignore", divide="ignore"):
        percent = np.where(peak[0] > 0, 100.0 * np.abs(peak[1:] / peak[0] - 1.0), np.nan)
    moved = np.linalg.norm(center[1:] - center[0], axis=-1)
    return _mean_known(percent), _mean_known(moved)


def _mean_known(x: np.ndarray) -> np.ndarray:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a mean of nothing is NaN
        return np.nanmean(x, axis=-1)


def _influences(outcomes: list[Outcome]) -> tuple[Influence, ...]:
    answer = []
    for parameter in dict.fromkeys(one.change.parameter for one in outcomes):
        own = [one for one in outcomes if one.change.parameter == parameter]
        for name in LIMITS:
            average = {
                direction: float(
                    _mean_known(
                        np.array([getattr(o, name) for o in own if o.direction == direction])
                    )
                )
                for direction in DIRECTIONS
            }
            scores = {direction: score(name, mean) for direction, mean in average.items()}
            answer.append(Influence(parameter, name, average, scores))
    return tuple(answer)


def _doubts(
    runs: dict[str, VarusValgus], outcomes: list[Outcome], settings: OneAtATime
) -> tuple[str, ...]:
    doubts = []
    for direction, run in runs.items():
        own = [one for one in outcomes if one.direction == direction]
        reached = abs(float(run.moment_reached_Nm[0]))
        if run.reached[0] < len(run.ramp):
            doubts.append(
                f"unchanged, it holds {reached:g} of {settings.full_Nm:g} N m in {direction} "
                f"({run.ending[0]} beyond); variants are compared up to there"
            )
        left_out = sum(abs(one.moment_reached_Nm) < settings.least_Nm for one in own)
        if left_out:
            doubts.append(
                f"{left_out} of {len(own)} variants do not hold {settings.least_Nm:g} N m in "
                f"{direction}: their pressures are left out"
            )
    return tuple(doubts)
