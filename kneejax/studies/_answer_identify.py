"""What the data of a study determine, and what to measure next."""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from kneejax.files.reading import Field, InputProblem
from kneejax.inference import (
    Design,
    Identification,
    Posterior,
    design_tests,
    identify,
    posterior,
    usual_candidates,
)
from kneejax.inference.bayesian import check_counts, parameter_priors
from kneejax.inference.design import check_tests
from kneejax.inference.identification import check_enough
from kneejax.mechanics import RANGES, range_of_parameter
from kneejax.numerics import check_installed
from kneejax.studies._poses import measured_poses
from kneejax.studies._questions import Identify
from kneejax.studies._study import Study

_MOST_CHAINS, _MOST_DRAWS, _MOST_TESTS = 1000, 1_000_000, 1000


@dataclasses.dataclass(frozen=True)
class Identified:
    """What the data of a study determine.

    Attributes:
        study: that was asked.
        question: what was asked.
        found: the fit by maximum likelihood, its limits and profiles.
        posterior: None unless it was asked for.
        design: the tests to make next.
        seconds: that it took.
    """

    study: Study
    question: Identify
    found: Identification
    posterior: Posterior | None
    design: Design
    seconds: float


def check(study: Study, question: Identify) -> None:
    """Refuse what cannot be answered; see `kneejax.studies.check`."""
    for name in ("noise_mm", "noise_deg"):
        if (noise := getattr(question, name)) is not None:
            # Nothing is measured without noise.
            Field(name, name, noise).number(dataclasses.replace(RANGES[name], or_zero=False))
    Field("next_tests", "tests", question.next_tests).integer(1, _MOST_TESTS)
    Field("chains", "chains", question.chains).integer(1, _MOST_CHAINS)
    Field("draws", "draws", question.draws).integer(1, _MOST_DRAWS)
    Field("seed", "seed", question.seed).integer(0)
    given = question.candidates
    check_tests(
        usual_candidates() if given is None else given, question.next_tests, question.criterion
    )
    for name, (mean, width) in question.prior.items():
        allowed = range_of_parameter(name)
        Field("prior", name, mean).number(allowed)
        if width != math.inf:
            Field("prior", name, width).number(allowed and allowed.spread)
    parameter_priors(study.knee_at_start, study.selection, question.prior, study.limits)
    if question.posterior:
        if study.tests:
            names = ", ".join(test.name for test in study.tests)
            expected = "a study without tests: the posterior is of passive motion so far"
            raise InputProblem(study.file, "tests", names, expected)
        for package in ("blackjax", "arviz"):
            check_installed(package, "posterior")
        check_counts(question.chains, question.draws)
    if None in _noise(study, question):
        weighed = study.weight_vector > 0
        counted = int(weighed.sum()) * len(study.flexion_deg)
        counted += sum(int(np.isfinite(one.observed[:, weighed]).sum()) for one in study.tests)
        check_enough(counted, len(study.selection) + len(study.frame_offset))


def identified(study: Study, question: Identify) -> Identified:
    """Fit, sample if asked to, and choose tests; see `kneejax.run`."""
    begun = time.perf_counter()
    noise_mm, noise_deg = _noise(study, question)
    found = identify(
        study.knee_at_start,
        measured_poses(study),
        tuple(study.parameters),
        noise_mm=noise_mm,
        noise_deg=noise_deg,
        bounds=dict(study.bounds),
        weights=study.weight_vector,
        offsets=tuple(study.frame_offset),
        loads=study.acting,
        tests=tuple(study.tests),
        prior=dict(study.prior),
    )
    sampled = _sampled(study, question, found) if question.posterior else None
    design = design_tests(
        found.selection,
        study.knee_at_start,
        found.information,
        found.noise,
        question.candidates,
        count=question.next_tests,
        criterion=question.criterion,
    )
    return Identified(study, question, found, sampled, design, time.perf_counter() - begun)


def _noise(study: Study, question: Identify) -> tuple[float | None, float | None]:
    """As given with the question, or as the study states it; mm and degrees."""
    mm, deg = study.noise
    return (
        mm if question.noise_mm is None else question.noise_mm,
        deg if question.noise_deg is None else question.noise_deg,
    )


def _sampled(study: Study, question: Identify, found: Identification) -> Posterior:
    return posterior(
        found.problem,
        found.vector,
        float(found.noise[2]),
        float(found.noise[0]),
        priors=question.prior,
        bounds=study.limits,
        chains=question.chains,
        draws=question.draws,
        seed=question.seed,
        truth=study.truth,
    )
