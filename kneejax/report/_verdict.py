"""What a reader must know first: whether it worked, and what to doubt."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report._numbers import change, listed, number
from kneejax.report._style import COORDINATES
from kneejax.statics._status import Status, converged

if TYPE_CHECKING:
    from kneejax.inference._result import Calibration, Estimate, Fit, Motion

#: Published counts: procedure or step -> pattern search steps, Simpack calls.
PAPER_COUNTS = {
    "I": (53, 167),
    "I.1": (31, 98),
    "I.2": (22, 69),
    "II": (52, 159),
    "II.1": (22, 65),
    "II.2": (30, 94),
    "III": (84, 233),
}
#: Where they stand.
PAPER = (
    "Influence of Ligament Modelling on Knee Joint Kinematics with Respect to "
    "Multibody Optimisation, Table 2"
)

_NOT_DETERMINED = "not determined"
#: Method of a study -> the optimiser, and what ends it when it has converged.
_SEARCHES = {
    "least_squares": (
        "bounded Levenberg-Marquardt with exact Jacobians (optimistix)",
        "further steps, or what they promised to gain, became negligible",
    ),
    "lbfgsb": (
        "L-BFGS-B with exact gradients (jaxopt)",
        "the projected gradient fell below the tolerance",
    ),
}


def undetermined(estimate: Estimate) -> bool:
    """Whether the data say nothing certain about a parameter."""
    unsure = estimate.remark.startswith(_NOT_DETERMINED)
    return unsure or not math.isfinite(estimate.standard_error)


def remark(estimate: Estimate) -> str:
    """What a reader must know about an estimate; empty if nothing."""
    said = estimate.remark
    if not undetermined(estimate) or said.startswith(_NOT_DETERMINED):
        return said
    return f"{_NOT_DETERMINED}: {said}" if said else _NOT_DETERMINED


def optimiser(calibration: Calibration) -> str:
    """Which optimiser searched, in words; empty if the settings do not say."""
    return _words_of_method(calibration)[0]


def ending(calibration: Calibration, fit: Fit) -> str:
    """Why a search ended, in words."""
    why = _words_of_method(calibration)[1]
    word, _, rest = fit.message.partition(";")
    if word != "converged" or not why:
        return fit.message
    return f"{word}: {why}" + (f";{rest}" if rest else "")


def search(calibration: Calibration, fit: Fit) -> str:
    """Which optimiser searched, and why it ended."""
    return "; ".join(filter(None, [optimiser(calibration), ending(calibration, fit)]))


def _words_of_method(calibration: Calibration) -> tuple[str, str]:
    return _SEARCHES.get(str(calibration.settings.get("method", "")), ("", ""))


def row_status(motion: Motion) -> np.ndarray:
    """Status of every row; a row of NaN that claims to be balanced has not converged.

    Args:
        motion: poses with status.

    Returns:
        Integers of `Status`.
    """
    status = np.array(motion.status, int)
    lost = ~np.isfinite(np.asarray(motion.table, float)).all(axis=1)
    return np.where(lost & converged(status), int(Status.NOT_CONVERGED), status)


def _pose_doubts(
    motion: Motion, flexion: np.ndarray, accepted: tuple[Status, ...] = ()
) -> list[str]:
    status = row_status(motion)
    sentences = []
    for outcome in sorted(set(status.tolist()) - {Status.BALANCED, *accepted}, reverse=True):
        rows = np.flatnonzero(status == outcome)
        where = listed([f"{flexion[row]:g}" for row in rows], 8)
        word = Status(outcome).word.replace("_", " ")
        told = [i for i in rows if i < len(motion.doubts) and motion.doubts[i]]
        detail = f" At {flexion[told[0]]:g} deg: {motion.doubts[told[0]]}." if told else ""
        sentences.append(
            f"{len(rows)} of {len(status)} poses {word} (flexion {where} deg): "
            f"{Status(outcome).sentence}.{detail}"
        )
    return sentences


def _doubts(fit: Fit, flexion: np.ndarray, accepted: tuple[Status, ...] = ()) -> list[str]:
    sentences = []
    if not fit.success:
        sentences.append(f"search not converged: {fit.message}")
    bound = [e.name for e in fit.estimates if e.at_bound]
    if bound:
        sentences.append(
            f"{listed(bound, 40)} ended on a bound: the best value may lie outside; "
            f"widen the bounds or fix the parameter{'s' * (len(bound) > 1)}."
        )
    reasons: dict[str, list[str]] = {}
    for e in fit.estimates:
        # What ended on a bound has been said.
        if undetermined(e) and not e.at_bound:
            said = e.remark.removeprefix(f"{_NOT_DETERMINED} by these data").lstrip(": ")
            reasons.setdefault(said.rstrip("."), []).append(e.name)
    for reason, names in reasons.items():
        why = reason or "their standard errors are missing or wider than half their bounds"
        if not reason and len(names) == 1:
            why = "its standard error is missing or wider than half its bounds"
        verb = "are" if len(names) > 1 else "is"
        sentences.append(f"{listed(names, 40)} {verb} not determined by the data: {why}.")
    return sentences + _pose_doubts(fit.motion, flexion, accepted)


def warnings(calibration: Calibration, accepted: tuple[Status, ...] = ()) -> list[str]:
    """Everything to doubt: searches, bounds, undetermined parameters and poses.

    Args:
        calibration: what to judge.
        accepted: statuses of poses that are no doubt here.

    Returns:
        Sentences, those on the answer first; empty if nothing is doubtful.
    """
    flexion = np.asarray(calibration.measured, float)[:, 0]
    found: dict[str, list[str]] = {}
    for fit in calibration.fits:
        for sentence in _doubts(fit, flexion, accepted):
            found.setdefault(sentence, []).append(fit.procedure)
    several = len(calibration.fits) > 1
    sentences = []
    for sentence, procedures in found.items():
        plural = "s" if len(procedures) > 1 else ""
        who = f"Procedure{plural} {', '.join(procedures)}: " if several else ""
        sentences.append(who + sentence)
    sentences += [
        f"Start: {sentence}" for sentence in _pose_doubts(calibration.start, flexion, accepted)
    ]
    return sentences


def answer_warnings(calibration: Calibration) -> list[str]:
    """Everything to doubt about the answer: what decides the exit status.

    Args:
        calibration: what to judge; procedures after the first are there to compare.

    Returns:
        Sentences; empty if nothing is doubtful.
    """
    return warnings(dataclasses.replace(calibration, fits=calibration.fits[:1]))


def fails(calibration: Calibration) -> bool:
    """Whether the answer is doubtful enough for exit status 1.

    A study that names its `failures` accepts poses with any other status, as long as they balance.
    """
    named = calibration.settings.get("failures") or ()
    accepted = tuple(s for s in Status if s.converged and s.word not in named) if named else ()
    return bool(warnings(dataclasses.replace(calibration, fits=calibration.fits[:1]), accepted))


def verdict(calibration: Calibration) -> str:
    """Say in one paragraph what the calibration achieved.

    Args:
        calibration: what to judge.

    Returns:
        Plain sentences.
    """
    fit = calibration.fit
    doubts = len(answer_warnings(calibration))
    others = len(warnings(calibration)) - doubts
    parts = [
        f"Procedure {fit.procedure} "
        + ("converged" if fit.success else "DID NOT CONVERGE")
        + (f", with {doubts} warning{'s' * (doubts > 1)}." if doubts else ".")
    ]
    if others > 0:
        concern = "warnings concern" if others > 1 else "warning concerns"
        parts.append(
            f"{others} {'further ' * (doubts > 0)}{concern} only procedures that are there "
            "to compare."
        )
    fell = change(calibration.start_objective, fit.objective)
    parts.append(
        f"The weighted sum of squares went from {number(calibration.start_objective)} to "
        f"{number(fit.objective)}{f' ({fell})' if fell else ''} with {len(fit.estimates)} free "
        f"parameters and {len(calibration.measured)} poses."
    )
    worst = [
        f"{number(value, 3)} {unit}"
        for unit in ("mm", "deg")
        if (value := _worst(fit.rmse, unit)) is not None
    ]
    if worst:
        parts.append(
            f"The fitted motion follows the measured one within {' and '.join(worst)} "
            "(largest root mean square error of a translation and of a rotation)."
            if len(worst) == 2
            else f"The largest root mean square error of a coordinate is {worst[0]}."
        )
    if calibration.truth:
        shared = [e for e in fit.estimates if e.name in calibration.truth]
        inside = sum(
            abs(e.value - calibration.truth[e.name]) <= 1.96 * e.standard_error
            for e in shared
            if not undetermined(e)
        )
        known = sum(not undetermined(e) for e in shared)
        parts.append(
            "The data are synthetic, so the true values are known: "
            f"{inside} of {known} determined parameters lie within 1.96 standard errors of them."
        )
    return " ".join(parts)


def _worst(rmse: dict[str, float], unit: str) -> float | None:
    values = [
        value
        for name, value in rmse.items()
        if name in COORDINATES and COORDINATES[name].unit == unit and math.isfinite(value)
    ]
    return max(values, default=None)


def stage_counts(fit: Fit) -> list[tuple[str, int]]:
    """Residual evaluations of each stage, in order.

    Args:
        fit: a fit; its stage counts, or else its history, are read.

    Returns:
        `(stage, evaluations)`; empty if there is only one stage.
    """
    totals = {"residual", "jacobian", "equilibria"}
    stages = {key: count for key, count in fit.evaluations.items() if key not in totals}
    if not stages:
        last: dict[str, int] = {}
        for step in fit.history:
            last[step.stage] = step.evaluations
        ends = [0, *last.values()]
        stages = {stage: ends[i + 1] - ends[i] for i, stage in enumerate(last)}
    return list(stages.items()) if len(stages) > 1 else []
