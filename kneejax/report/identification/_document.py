"""What `kneejax identify` found as a JSON document, what to doubt, and what became of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from kneejax.geometry import COLUMNS
from kneejax.inference import versions
from kneejax.report.bayesian import posterior_doubts
from kneejax.report.calibration import Outcome
from kneejax.report.design import design_words
from kneejax.report.identification._information_words import sloppy_words, stiff_words
from kneejax.report.identification._text import estimate_rows, fit_doubts, undetermined_words
from kneejax.report.look import json_safe
from kneejax.report.motion import accepted_statuses, pose_doubts

if TYPE_CHECKING:
    from kneejax.inference import Posterior
    from kneejax.studies import Identified


def identification_doubts(answer: Identified) -> list[str]:
    """Everything to doubt: the fit, the draws, undetermined parameters and poses.

    Args:
        answer: what was found.

    Returns:
        Sentences; empty if nothing is doubtful.
    """
    found, sampled = answer.found, answer.posterior
    doubts = fit_doubts(found) + ([] if sampled is None else posterior_doubts(sampled))
    doubts += undetermined_words(found)
    accepted = accepted_statuses(answer.study.failures)
    return doubts + pose_doubts(found.motion, found.motion.table[:, 0], accepted)


def identification_outcome(answer: Identified) -> Outcome:
    """What became of it; decides the exit status of `kneejax identify`.

    Args:
        answer: what was found.
    """
    if not answer.found.converged:
        return Outcome.FAILED
    return Outcome.DOUBTFUL if identification_doubts(answer) else Outcome.GOOD


def identification_document(answer: Identified, options: Mapping[str, Any]) -> dict[str, Any]:
    """Gather what result.json of an identification holds.

    Args:
        answer: what was found.
        options: of the command, recorded as they are.

    Returns:
        A JSON-safe dictionary; NaN and infinity are null.
    """
    study, found, sampled = answer.study, answer.found, answer.posterior
    information = ("eigenvalues", "eigenvectors", "scale", "correlation")
    told = {name: getattr(found.information, name) for name in information}
    return json_safe(
        {
            "study": study.title,
            "knee": study.knee_name,
            "parameters": {row["name"]: row for row in estimate_rows(found, sampled)},
            "frame_offset": found.offsets,
            "noise": dict(zip(COLUMNS[1:], found.noise, strict=True)),
            "noise_estimated": found.noise_estimated,
            "chi2": found.chi2,
            "measured_numbers": found.data,
            "information": told
            | {"sentences": stiff_words(found.information) + sloppy_words(found.information)},
            "next_tests": design_words(answer.design),
            "posterior": None if sampled is None else _posterior(sampled),
            "truth": study.truth,
            "warnings": identification_doubts(answer),
            "settings": dict(options),
            "seconds": {"total": answer.seconds},
            "versions": versions() if sampled is None else sampled.versions,
        }
    )


def _posterior(sampled: Posterior) -> dict[str, Any]:
    names = ("divergences", "evaluations", "seconds", "seed")
    return {
        "priors": {p.name: {"mean": p.mean, "sd": p.sd} for p in sampled.priors},
        "draws_without_balance": sampled.unbalanced,
    } | {name: getattr(sampled, name) for name in names}
