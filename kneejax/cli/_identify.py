"""`kneejax identify [STUDY.yaml]`."""

from __future__ import annotations

import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy as np

from kneejax.cli._given import check_within
from kneejax.cli._study_problem import StudyProblem, study_and_knee, with_measurement
from kneejax.files import InputProblem, read_candidates, write_rows, write_text
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import (
    Candidate,
    Design,
    Identification,
    Posterior,
    design_tests,
    identify,
    imported,
    versions,
)
from kneejax.mechanics import RANGES, Range, load_words

#: Nothing is measured without noise.
_NOISE = {
    name: dataclasses.replace(RANGES[name], or_zero=False) for name in ("noise_mm", "noise_deg")
}


def run(arguments: argparse.Namespace) -> int:
    """Say what the data of a study determine; write tables and figures."""
    from kneejax.cli._priors import read_priors

    begun = time.perf_counter()
    if arguments.next_tests < 1:
        raise InputProblem("--next-tests", "tests", str(arguments.next_tests), "one or more")
    for quantity in ("noise_mm", "noise_deg"):
        noise = getattr(arguments, quantity)
        if noise is not None:
            check_within(f"--{quantity.replace('_', '-')}", quantity, [noise], _NOISE[quantity])
    for name, most in (("chains", 1000), ("draws", 1_000_000)):
        check_within(f"--{name}", name, [getattr(arguments, name)], Range(1, most))
    if arguments.posterior:
        # Better known before the work than after it.
        for module, package in (("blackjax", "BlackJAX"), ("arviz", "ArviZ")):
            imported(module, package)
    candidates = _candidates(arguments.candidates)
    study, knee = study_and_knee(arguments.study)
    priors = read_priors(arguments.prior, knee, study.parameters)
    asked = with_measurement(study, knee, calibrated=False)
    noise_mm, noise_deg = _noise(asked, arguments)
    found = identify(
        asked.knee,
        asked.measured,
        asked.study.parameters,
        noise_mm=noise_mm,
        noise_deg=noise_deg,
        bounds=dict(asked.study.bounds),
        weights=np.array([asked.study.weights[name] for name in FREE_COORDINATES]),
        offsets=asked.study.frame_offset,
    )
    sampled = _sampled(found, asked, arguments, priors) if arguments.posterior else None
    design = design_tests(
        found.selection,
        asked.knee,
        found.information,
        found.noise,
        candidates,
        count=arguments.next_tests,
        criterion=arguments.criterion,
    )
    seconds = time.perf_counter() - begun
    return _write(found, sampled, design, asked, arguments, seconds)


def _noise(asked: StudyProblem, arguments) -> tuple[float | None, float | None]:
    """As given here, or as the study states it."""
    mm, deg, study = arguments.noise_mm, arguments.noise_deg, asked.study
    return study.noise_mm if mm is None else mm, study.noise_deg if deg is None else deg


def _candidates(path: Path | None) -> list[Candidate] | None:
    if path is None:
        return None
    return [
        Candidate(row.name or load_words(row.loads), row.flexion_deg, **row.loads)
        for row in read_candidates(path)
    ]


def _sampled(found: Identification, asked: StudyProblem, arguments, priors) -> Posterior:
    from kneejax.inference import posterior

    return posterior(
        found.problem,
        found.vector,
        float(found.noise[2]),
        float(found.noise[0]),
        priors=priors,
        bounds=dict(asked.study.bounds),
        chains=arguments.chains,
        draws=arguments.draws,
        seed=arguments.seed,
        truth=asked.truth,
    )


def _write(
    found: Identification,
    sampled: Posterior | None,
    design: Design,
    asked: StudyProblem,
    arguments: argparse.Namespace,
    seconds: float,
) -> int:
    from kneejax.report import (
        CANDIDATE_COLUMNS,
        ESTIMATE_COLUMNS,
        accepted_statuses,
        candidates_rows,
        design_text,
        estimate_rows,
        estimates_text,
        information_text,
        json_safe,
        pose_doubts,
        undetermined_words,
    )

    out = arguments.out
    rows = estimate_rows(found, sampled)
    write_rows(
        out / "parameters.csv",
        list(ESTIMATE_COLUMNS),
        [[row[c] for c in ESTIMATE_COLUMNS] for row in rows],
    )
    write_rows(
        out / "profiles.csv",
        ["parameter", "value", "rise_of_chi2", *found.selection.names],
        _profile_rows(found),
    )
    tests = candidates_rows(design)
    write_rows(
        out / "candidates.csv",
        list(CANDIDATE_COLUMNS),
        [[row[c] for c in CANDIDATE_COLUMNS] for row in tests],
    )
    files = ["parameters.csv", "profiles.csv", "candidates.csv"]
    if sampled is not None:
        write_rows(out / "posterior.csv", ["chain", "draw", *sampled.names], _draws(sampled))
        files.append("posterior.csv")
    _draw(found, sampled, design, asked, out)
    doubts = [*found.warnings, *(sampled.warnings if sampled is not None else ())]
    doubts += undetermined_words(found)
    accepted = accepted_statuses(asked.study.failures)
    doubts += pose_doubts(found.motion, found.motion.table[:, 0], accepted)
    document = {
        "study": asked.study.title,
        "knee": asked.study.knee,
        "parameters": {row["name"]: row for row in rows},
        "frame_offset": found.offsets,
        "noise": dict(zip(COLUMNS[1:], found.noise, strict=True)),
        "noise_estimated": found.noise_estimated,
        "chi2": found.chi2,
        "measured_numbers": found.data,
        "information": {
            "eigenvalues": found.information.eigenvalues,
            "eigenvectors": found.information.eigenvectors,
            "scale": found.information.scale,
            "correlation": found.information.correlation,
            "sentences": [*found.information.stiff, *found.information.sloppy],
        },
        "next_tests": list(design.sentences),
        "posterior": None if sampled is None else _posterior_document(sampled),
        "truth": asked.truth,
        "warnings": doubts,
        "settings": {key: str(value) for key, value in vars(arguments).items() if key != "run"},
        "seconds": {"total": seconds},
        "versions": versions() if sampled is None else sampled.versions,
    }
    del document["settings"]["parser"]
    write_text(out / "result.json", json.dumps(json_safe(document), indent=1) + "\n")

    print(f"{asked.study.title} (knee {asked.knee.name})\n")
    print(estimates_text(found, sampled))
    print(f"\n{information_text(found.information)}")
    if sampled is not None:
        from kneejax.report import posterior_summary

        print(f"\n{posterior_summary(sampled)}")
    print(f"\n{design_text(design)}")
    print(f"\nwritten: {out}/{', '.join(files)}, result.json, figures/")
    return 1 if doubts else 0


def _profile_rows(found: Identification):
    for profile in found.profiles:
        for value, rise, others in zip(
            profile.values, profile.rise, profile.parameters, strict=True
        ):
            yield [profile.name, value, rise, *others]


def _draws(sampled: Posterior):
    for chain, draws in enumerate(sampled.draws):
        for number, draw in enumerate(draws):
            yield [chain, number, *draw]


def _posterior_document(sampled: Posterior) -> dict:
    return {
        "priors": {p.name: {"mean": p.mean, "sd": p.sd} for p in sampled.priors},
        "divergences": sampled.divergences,
        "draws_without_balance": sampled.unbalanced,
        "evaluations": sampled.evaluations,
        "seconds": sampled.seconds,
        "seed": sampled.seed,
    }


def _draw(found, sampled, design: Design, asked: StudyProblem, out: Path) -> None:
    from kneejax.report import (
        candidates_figure,
        information_correlation_figure,
        profiles_figure,
        save_figure,
        spectrum_figure,
        standard_errors_figure,
    )

    figures = {
        "spectrum": spectrum_figure(found.information),
        "correlation": information_correlation_figure(found.information),
        "profiles": profiles_figure(found.profiles, asked.truth),
        "next_tests": candidates_figure(design),
        "standard_errors": standard_errors_figure(design),
    }
    if sampled is not None:
        from kneejax.report import posterior_figures

        figures |= posterior_figures(sampled)
    for name, figure in figures.items():
        save_figure(figure, out / "figures", name)
