"""What a reader must know first: whether it worked, and what to doubt."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections import Counter
from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import COORDINATES
from kneejax.inference import Ending, Fault, IntervalKind, Misfit
from kneejax.report.calibration._estimates import limits, reasons, undetermined
from kneejax.report.calibration._starts import rivals_words
from kneejax.report.calibration._tests import label_of, laxity_doubts, readings, unit_of
from kneejax.report.look import change, listed, number
from kneejax.report.motion import accepted_statuses, pose_doubts, row_status
from kneejax.statics import Status, converged

if TYPE_CHECKING:
    from kneejax.inference import Calibration, Fit

#: Method of a study -> the optimiser, and what ends it when it has converged.
_SEARCHES = {
    "least_squares": (
        "bounded Levenberg-Marquardt with exact Jacobians (optimistix)",
        "the search stopped: further steps no longer improve the fit",
    ),
    "lbfgsb": (
        "L-BFGS-B with exact gradients (jaxopt)",
        "the projected gradient fell below the tolerance",
    ),
}


class Outcome(enum.Enum):
    """What became of a calibration: the words of its badge and of its first line."""

    GOOD = "Converged"
    DOUBTFUL = "Converged, with warnings"
    POOR = "Poor fit"
    FAILED = "Not converged"

    @property
    def exit_status(self) -> int:
        """Of `kneejax calibrate`: 0 if there is nothing to doubt."""
        return 0 if self is Outcome.GOOD else 1


def outcome(calibration: Calibration) -> Outcome:
    """What became of a calibration; badge, terminal and exit status all say this.

    Args:
        calibration: what to judge; procedures after the first are there to compare.
    """
    if not calibration.fit.success:
        return Outcome.FAILED
    if calibration.misfits:
        return Outcome.POOR
    return Outcome.DOUBTFUL if answer_warnings(calibration) else Outcome.GOOD


def message(fit: Fit) -> str:
    """Why a search ended, whatever its method, and how many poses it could not balance."""
    return _ending(fit, "converged")


def _ending(fit: Fit, converged_words: str) -> str:
    words = {
        Ending.CONVERGED: converged_words,
        Ending.FLAT: "converged to within the noise: further steps gained less than the noise",
        Ending.STOPPED: fit.reason or "stopped before it converged",
    }[fit.ending]
    lost = int((~converged(row_status(fit.motion))).sum())
    words += f"; {lost} of {len(fit.motion.status)} poses have no balance" if lost else ""
    gone = sum(int((~converged(one.status)).sum()) for one in fit.tests)
    loads = sum(len(one.status) for one in fit.tests)
    return words + (f"; {gone} of {loads} loads of tests have no balance" if gone else "")


def optimiser(calibration: Calibration) -> str:
    """Which optimiser searched, in words; empty if the settings do not say."""
    return _words_of_method(calibration)[0]


def ending(calibration: Calibration, fit: Fit) -> str:
    """Why a search ended, in words."""
    return _ending(fit, _words_of_method(calibration)[1] or "converged")


def search(calibration: Calibration, fit: Fit) -> str:
    """Which optimiser searched, and why it ended."""
    return "; ".join(filter(None, [optimiser(calibration), ending(calibration, fit)]))


def _words_of_method(calibration: Calibration) -> tuple[str, str]:
    return _SEARCHES.get(str(calibration.settings.get("method", "")), ("", ""))


def _doubts(fit: Fit, flexion: np.ndarray, accepted: tuple[Status, ...] = ()) -> list[str]:
    sentences = []
    if not fit.success:
        sentences.append(f"search not converged: {message(fit)}")
    bound = [e.name for e in fit.estimates if e.at_bound]
    if bound:
        sentences.append(
            f"{listed(bound, 40)} ended on a bound: the best value may lie outside; "
            f"widen the bounds or fix the parameter{'s' * (len(bound) > 1)}."
        )
    lost: dict[str, list[str]] = {}
    failed: dict[str, list[str]] = {}
    for e in (*fit.estimates, *fit.offsets):
        # What ended on a bound has been said.
        if undetermined(e) and not e.at_bound:
            lost.setdefault(reasons(e), []).append(e.name)
        if e.beside:
            sentences.append(
                f"{e.name}, {number(e.value)}, lies outside its limits ({limits(e)}): "
                + (
                    f"a better fit is at {number(e.likeliest)}; start there."
                    if e.same_sum
                    else "limits follow the likelihood, and the weights are not 1/noise^2. The "
                    f"likeliest value is {number(e.likeliest)}; weigh coordinates by their noise, "
                    "or doubt the model."
                )
            )
        if e.interval is IntervalKind.NOT_COMPUTED:
            failed.setdefault(e.reason, []).append(e.name)
    for reason, names in failed.items():
        sentences.append(
            f"The 95 % limits of {listed(names, 40)} could not be computed: {reason}. That says "
            "nothing about whether the data determine them."
        )
    for reason, names in lost.items():
        why = reason or "other parameters make up for whatever its bounds allow"
        verb = "are" if len(names) > 1 else "is"
        sentences.append(f"{listed(names, 40)} {verb} not determined by the data: {why}.")
    if fit.starts is not None and fit.starts.rivals.any():
        sentences.append(rivals_words(fit))
    sentences += pose_doubts(fit.motion, flexion, accepted)
    return sentences + laxity_doubts(fit.tests, accepted)


def misfit_words(calibration: Calibration) -> list[str]:
    """Why a fit is poor, a sentence per coordinate."""
    return [_misfit(one) for one in calibration.misfits]


def _misfit(one: Misfit) -> str:
    label, unit = label_of(one.coordinate), unit_of(one.coordinate)
    test = f"Test {one.test}, {label}" if one.test else f"{label[:1].upper()}{label[1:]}"
    said = f"{test}: RMSE {f'{number(one.rmse, 3)} {unit}'.strip()}, "
    against = f"{number(one.against, 3)} {unit}".strip()
    return {
        Fault.WORSE_THAN_START: f"{said}{change(one.against, one.rmse)} than at the start "
        f"({against}): the fit gives it up for others. The model lacks something, or the weights "
        "are wrong.",
        Fault.BEYOND_NOISE: f"{said}{number(one.rmse / one.against, 2)} times the stated noise "
        f"({against}): the model lacks something, or the noise is larger; limits are too narrow.",
        Fault.LARGE: f"{said}more than {against}. Check side, signs and frames.",
    }[one.fault]


def warnings(calibration: Calibration) -> list[str]:
    """Everything to doubt: searches, bounds, undetermined parameters and poses.

    A study that names its `failures` accepts poses with any other status, as long as they balance.

    Args:
        calibration: what to judge.

    Returns:
        Sentences, those on the answer first; empty if nothing is doubtful.
    """
    accepted = accepted_statuses(calibration.settings.get("failures") or ())
    flexion = np.asarray(calibration.measured, float)[:, 0]
    found: dict[str, list[str]] = {}
    for fit in calibration.fits:
        for sentence in _doubts(fit, flexion, accepted):
            found.setdefault(sentence, []).append(fit.procedure)
    several = len(calibration.fits) > 1
    sentences = [f"Poor fit. {sentence}" for sentence in misfit_words(calibration)]
    for sentence, procedures in found.items():
        plural = "s" if len(procedures) > 1 else ""
        who = f"Procedure{plural} {', '.join(procedures)}: " if several else ""
        sentences.append(who + sentence)
    sentences += [
        f"Start: {sentence}" for sentence in pose_doubts(calibration.start, flexion, accepted)
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


def verdict(calibration: Calibration) -> str:
    """Say in one paragraph what the calibration achieved.

    Args:
        calibration: what to judge.

    Returns:
        Plain sentences.
    """
    fit, became = calibration.fit, outcome(calibration)
    doubts = len(answer_warnings(calibration))
    others = len(warnings(calibration)) - doubts
    compared = [one.procedure for one in calibration.fits[1:]]
    ended = {Outcome.FAILED: "DID NOT CONVERGE", Outcome.POOR: "stopped at a POOR FIT"}
    parts = [
        f"Procedure {fit.procedure} {ended.get(became, 'converged')}"
        + (f", with {doubts} warning{'s' * (doubts > 1)}." if doubts else ".")
    ]
    if others > 0:
        more = ("One" if others == 1 else str(others)) + " further" * (doubts > 0)
        parts.append(
            f"{more} warning{'s' * (others > 1)}, about procedure{'s' * (len(compared) > 1)} "
            f"{' and '.join(compared)} (comparison only)."
        )
    fell = change(calibration.start_objective, fit.objective)
    parts.append(
        f"The weighted sum of squares went from {number(calibration.start_objective)} to "
        f"{number(fit.objective)}{f' ({fell})' if fell else ''} with {len(fit.estimates)} free "
        f"parameter{'s' * (len(fit.estimates) != 1)} and {data_words(calibration)}."
    )
    worst = [
        f"{number(value, 3)} {unit}"
        for unit in ("mm", "deg")
        if (value := _worst(fit.rmse, unit)) is not None
    ]
    if worst and len(calibration.measured):
        good = became in (Outcome.GOOD, Outcome.DOUBTFUL)
        parts.append(
            f"The fitted motion follows the measured one within {' and '.join(worst)} "
            "(largest root mean square error of a translation and of a rotation)."
            if good and len(worst) == 2
            else f"{'Largest RMSE' if good else 'Poor fit: RMSE'} {' and '.join(worst)}."
        )
    known = known_words(calibration)
    return " ".join([*parts, *filter(None, [known])])


def data_words(calibration: Calibration) -> str:
    """How much was measured: poses, and readings of tests under load."""
    count, tests = len(calibration.measured), len(calibration.fit.tests)
    words = [f"{count} pose{'s' * (count != 1)}"] if count else []
    if tests:
        words.append(f"{readings(calibration)} readings of {tests} test{'s' * (tests > 1)}")
    return " and ".join(words)


def noise_of(calibration: Calibration, unit: str) -> float:
    """Standard deviation of the coordinates of a unit that count; NaN where none is known."""
    known = [
        sd
        for name, sd in calibration.noise.items()
        if COORDINATES[name].unit == unit and math.isfinite(sd)
    ]
    return known[0] if known else math.nan


def known_words(calibration: Calibration) -> str:
    """How many parameters have which kind of limits, and how many hold the truth if it is known."""
    estimates = [*calibration.fit.estimates, *calibration.fit.offsets]
    counts = Counter(e.interval for e in estimates if e.interval is not None)
    if not counts:
        return ""
    words = {
        IntervalKind.STANDARD_ERROR: "by a standard error",
        IntervalKind.PROFILE: "by profile limits",
        IntervalKind.ONE_SIDED: "from one side",
        IntervalKind.NOT_DETERMINED: "not at all",
    }
    kinds = [f"{counts[kind]} {said}" for kind, said in words.items() if counts[kind]]
    sentence = f"Of {sum(counts.values())} estimates the data limit {', '.join(kinds) or 'none'}"
    for kind, said in (
        (IntervalKind.PRIOR, "known from the prior alone"),
        (IntervalKind.NOT_COMPUTED, "without limits, which could not be computed"),
    ):
        verb = "is" if counts[kind] == 1 else "are"
        sentence += f"; {counts[kind]} {verb} {said}" if counts[kind] else ""
    sentence += "."
    shared = [
        e
        for e in calibration.fit.estimates
        if e.name in calibration.truth and e.interval is not None and e.interval.has_limits
    ]
    if calibration.truth and shared:
        inside = sum(
            not (calibration.truth[e.name] < e.low or calibration.truth[e.name] > e.high)
            for e in shared
        )
        sentence += (
            " The data are synthetic, so the true values are known: "
            f"{inside} of {len(shared)} lie within the 95 % limits."
        )
    return sentence


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
