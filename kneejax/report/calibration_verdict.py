"""Whether a calibration worked, what to doubt, and what limits the fit: sentences for everyone."""

__all__ = ["Outcome", "calibration_notes", "message"]

import enum
import itertools
import math
from collections import Counter
from collections.abc import Mapping

import numpy as np

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference import Calibration, Ending, Fit, FittedTest, IntervalKind
from kneejax.parameters import sums_in_words
from kneejax.report.calibration_parameters import label_of, reasons, unit_of
from kneejax.report.look.page import Verdict, prose
from kneejax.report.look.tables import change, grouped, listed, number
from kneejax.report.pose_tables import accepted_statuses, pose_doubts, row_status
from kneejax.statics import Status, converged

#: mm and degrees: how far a motion that repeats itself may be from where it was a period before.
_REPEATS_WITHIN = 0.05


class Outcome(enum.Enum):
    """What became of a calibration: the words of its badge and of its first line."""

    GOOD = "Converged"
    DOUBTFUL = "Converged, with warnings"
    POOR = "Poor fit"
    FAILED = "Not converged"

    @property
    def verdict(self) -> Verdict:
        """How far the answer can be trusted."""
        known = {Outcome.GOOD: Verdict.GOOD, Outcome.DOUBTFUL: Verdict.DOUBTFUL}
        return known.get(self, Verdict.FAILED)


def outcome(calibration: Calibration) -> Outcome:
    """What became of a calibration; badge, terminal and exit status all say this."""
    if not calibration.fit.success:
        return Outcome.FAILED
    if calibration.misfits:
        return Outcome.POOR
    return Outcome.DOUBTFUL if split_warnings(calibration)[0] else Outcome.GOOD


def message(fit: Fit, when_converged: str = "converged") -> str:
    """Why a search ended, and how many poses and loads of tests found no equilibrium.

    Args:
        fit: of one procedure.
        when_converged: what is said of a search that converged.
    """
    words = {Ending.CONVERGED: when_converged,
             Ending.FLAT: "converged to within the noise: further steps gained less than the noise",
             Ending.STOPPED: fit.reason or "stopped before it converged"}[fit.ending]  # fmt: skip
    tests = [status for one in fit.tests for status in one.status]
    for status, what in ((row_status(fit.motion), "poses"), (tests, "loads of tests")):
        lost = int((~converged(np.asarray(status, int))).sum())
        words += f"; {lost} of {len(status)} {what} have no balance" if lost else ""
    return words


def _doubts(fit: Fit, flexion: np.ndarray, accepted: tuple[Status, ...]) -> list[str]:
    sentences = [] if fit.success else [f"search not converged: {message(fit)}"]
    if bound := [e.name for e in fit.estimates if e.at_bound]:
        several = "s" * (len(bound) > 1)
        sentences.append(prose("verdict.bound", names=listed(bound, 40), s=several))
    every, starts = (*fit.estimates, *fit.offsets), fit.starts
    failed = grouped((e.reason, e.name) for e in every if e.interval is IntervalKind.NOT_COMPUTED)
    # What ended on a bound has been said.
    lost = grouped((reasons(e), e.name) for e in every
                   if e.interval is IntervalKind.NOT_DETERMINED and not e.at_bound)  # fmt: skip
    sentences += [prose("fit.failed", names=listed(names, 40), reason=reason)
                  for reason, names in failed.items()]  # fmt: skip
    usual = "other parameters compensate whatever its bounds allow"
    sentences += [f"{listed(names, 40)} {'are' if len(names) > 1 else 'is'} not determined by the "
                  f"data: {reason or usual}." for reason, names in lost.items()]  # fmt: skip
    # Ends that the data do not tell from the answer, though a parameter is outside its limits.
    if starts is not None and starts.rivals.any():
        names = [
            f"{e.name} {number(min(e.value, *column))} to {number(max(e.value, *column))}"
            for e, column in zip(every, starts.values[starts.rivals].T, strict=True)
            if (column < np.nan_to_num(e.low, nan=e.lower)).any()
            or (column > np.nan_to_num(e.high, nan=e.upper)).any()
        ]
        apart = f"{int(starts.rivals.sum())} of {len(starts.objectives)}"
        sentences.append(prose("verdict.rivals", apart=apart, names=", ".join(names)))
    sentences += pose_doubts(fit.motion, flexion, accepted)
    return sentences + laxity_doubts(fit.tests, accepted)


def laxity_doubts(tests: tuple[FittedTest, ...], accepted: tuple[Status, ...] = ()) -> list[str]:
    """What is wrong with a knee under loads, and in motion: a sentence per test and status."""
    found = []
    for own in tests:
        for value in np.unique(own.status):
            status = Status(int(value))
            if status is Status.BALANCED or status in accepted:
                continue
            rows = own.status == value
            where = ", ".join(f"{x:g}" for x in np.unique(own.test.curve_deg[rows]))
            lost = f"{int(rows.sum())} of {len(rows)} loads {status.word} ({status.sentence})"
            found.append(f"Test {own.test.name}: {lost}, at {where} deg.")
        if own.restless > _REPEATS_WITHIN:
            found.append(prose("verdict.restless", test=own.test.name, off=own.restless))
    return found


def warnings(calibration: Calibration) -> list[str]:
    """Everything to doubt, except poses with a status that the study's `failures` accept."""
    return [sentence for sentences in split_warnings(calibration) for sentence in sentences]


def split_warnings(calibration: Calibration) -> tuple[list[str], list[str]]:
    """Everything to doubt about the answer, and about procedures that are there to compare."""
    accepted = accepted_statuses(calibration.settings.get("failures") or ())
    flexion = np.asarray(calibration.measured, float)[:, 0]
    found = grouped((sentence, fit.procedure) for fit in calibration.fits
                    for sentence in _doubts(fit, flexion, accepted))  # fmt: skip
    answer: list[str] = []
    others: list[str] = []
    for one in calibration.misfits:
        label, unit = label_of(one.coordinate), unit_of(one.coordinate)
        test = f"Test {one.test}, {label}" if one.test else f"{label[:1].upper()}{label[1:]}"
        error, against = (f"{number(x, 3)} {unit}".strip() for x in (one.rmse, one.against))
        why = prose(f"verdict.{one.fault.name}", change=change(one.against, one.rmse),
                    times=number(one.rmse / one.against, 2), against=against)  # fmt: skip
        answer.append(f"Poor fit. {test}: RMSE {error}, {why}")
    for sentence, procedures in found.items():
        who = f"Procedure{'s' * (len(procedures) > 1)} {', '.join(procedures)}: "
        ours = calibration.fit.procedure in procedures
        (answer if ours else others).append(who * (len(calibration.fits) > 1) + sentence)
    start = pose_doubts(calibration.start, flexion, accepted)
    return [*answer, *(f"Start: {sentence}" for sentence in start)], others


def verdict(calibration: Calibration) -> str:
    """Say in one paragraph what the calibration achieved."""
    fit, became = calibration.fit, outcome(calibration)
    doubts, others = map(len, split_warnings(calibration))
    compared = [one.procedure for one in calibration.fits[1:]]
    ended = {Outcome.FAILED: "DID NOT CONVERGE", Outcome.POOR: "stopped at a POOR FIT"}
    who = f"Procedure {fit.procedure}" if compared else "The search"
    with_doubts = f", with {doubts} warning{'s' * (doubts > 1)}" * bool(doubts)
    parts = []
    # The badge says the same of a search without comparison or doubt.
    if compared or became is not Outcome.GOOD:
        parts.append(f"{who} {ended.get(became, 'converged')}{with_doubts}.")
    if others:
        more = ("One" if others == 1 else str(others)) + " further" * (doubts > 0)
        about = f"procedure{'s' * (len(compared) > 1)} {' and '.join(compared)}"
        parts.append(f"{more} warning{'s' * (others > 1)}, about {about} (comparison only).")
    known = [f"{number(x, 3)} {unit}" for unit, x in worst_errors(fit.rmse).items() if x == x]
    if known and len(calibration.measured):
        good, errors = became in (Outcome.GOOD, Outcome.DOUBTFUL), " and ".join(known)
        kind = "follows" if good and len(known) == 2 else "largest" if good else "poor"
        parts.append(prose(f"verdict.{kind}", errors=errors))
    # How many parameters have which kind of limits, and how many hold the truth if it is known.
    estimates = [*fit.estimates, *fit.offsets]
    counts = Counter(e.interval for e in estimates if e.interval is not None)
    if not counts:
        return " ".join(parts)
    words = {IntervalKind.STANDARD_ERROR: "by a standard error",
             IntervalKind.PROFILE: "by profile limits", IntervalKind.ONE_SIDED: "from one side",
             IntervalKind.NOT_DETERMINED: "not at all"}  # fmt: skip
    kinds = [f"{counts[kind]} {said}" for kind, said in words.items() if counts[kind]]
    sentence = f"Of {sum(counts.values())} estimates the data limit {', '.join(kinds) or 'none'}"
    for kind, said in ((IntervalKind.PRIOR, "known from the prior alone"),
                       (IntervalKind.NOT_COMPUTED, "without limits, which could not be computed")):
        verb = "is" if counts[kind] == 1 else "are"
        sentence += f"; {counts[kind]} {verb} {said}" if counts[kind] else ""
    parts.append(f"{sentence}.")
    shared = [(e, calibration.truth[e.name]) for e in fit.estimates
              if e.name in calibration.truth and e.interval and e.interval.has_limits]  # fmt: skip
    if shared:
        inside = sum(not (truth < e.low or truth > e.high) for e, truth in shared)
        parts.append(prose("verdict.truth", inside=inside, count=len(shared)))
    return " ".join(parts)


def worst_errors(rmse: Mapping[str, float]) -> dict[str, float]:
    """Unit -> the largest error of a coordinate that has it, NaN where none is known."""
    return {
        unit: max((x for name, x in rmse.items() if name in COORDINATES
                   and COORDINATES[name].unit == unit and math.isfinite(x)), default=math.nan)
        for unit in ("mm", "deg")
    }  # fmt: skip


def noise_words(calibration: Calibration) -> str:
    """The noise by which limits are what they are; empty where none is known."""
    sizes = []
    for unit in ("mm", "deg"):
        known = [x for name, x in calibration.noise.items() if COORDINATES[name].unit == unit]
        sizes += [f"{number(x, 3)} {unit}" for x in known if math.isfinite(x)][:1]
    if len(sizes) < 2:
        return ""
    kind = "estimated from the misfit" if calibration.noise_estimated else "as stated"
    if any((calibration.settings.get("weights") or {}).values()) and calibration.noise_estimated:
        kind = "in the ratio of the study's weights, estimated from the misfit"
    return f"Noise {' and '.join(sizes)}, {kind}; limits are at 95 % confidence."


def calibration_notes(calibration: Calibration) -> list[str]:
    """Sentences on what limits a fit: data, bounds, and where the misfit is.

    Args:
        calibration: what to judge.
    """
    fit = calibration.fit
    every = (*fit.estimates, *fit.offsets)
    kinds = {"undetermined": [e.interval is IntervalKind.NOT_DETERMINED for e in every],
             "prior": [e.interval is IntervalKind.PRIOR for e in every],
             "bound": [e.at_bound for e in every]}  # fmt: skip
    notes = [prose(f"notes.{kind}", names=", ".join(e.name for e in itertools.compress(every, own)))
             for kind, own in kinds.items() if any(own)]  # fmt: skip
    notes += filter(None, [sums_in_words(fit.motion.knee, [e.name for e in fit.estimates])])
    if fit.objective > 0:
        shares = zip(FREE_COORDINATES, calibration.weights, strict=True)
        share = {name: weight * fit.partial_objectives[name] for name, weight in shares}
        worst = max(share, key=share.__getitem__)
        unit = "degrees" if COORDINATES[worst].unit == "deg" else "mm"
        error = f" (RMSE {fit.rmse[worst]:.3g} {unit})" if np.isfinite(fit.rmse[worst]) else ""
        notes.append(prose("notes.misfit", percent=100 * share[worst] / fit.objective,
                           where=worst.replace("_", " ") + error))  # fmt: skip
    if calibration.left_out:
        poses = "1 pose was" if calibration.left_out == 1 else f"{calibration.left_out} poses were"
        notes.append(prose("notes.left_out", poses=poses, why=Status.NOT_CONVERGED.sentence))
    return notes
