"""`kneejax identify [STUDY.yaml]`."""

from __future__ import annotations

import argparse
from pathlib import Path

from kneejax import studies
from kneejax.cli._deliver import deliver
from kneejax.cli._given import read_numbers, read_texts, said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._settings import options_of
from kneejax.files import read_candidates
from kneejax.inference import Candidate
from kneejax.mechanics import load_words
from kneejax.studies import Identify


def run(arguments: argparse.Namespace) -> int:
    """Say what the data of a study determine; write the answer."""
    with said_of_options(Identify):
        question = _question(arguments)
    study = studies.read_study(arguments.study)
    with said_of_options(Identify), stages_on_terminal("what the data tell"):
        found = studies.identify(study, question)
    from kneejax.report import identification_answer

    options = {"command": arguments.command, "out": arguments.out, **options_of(arguments)}
    answer = identification_answer(found, {name: str(value) for name, value in options.items()})
    return deliver(answer, arguments, seconds={"total": found.seconds})


def _question(arguments: argparse.Namespace) -> Identify:
    form = "NAME=MEAN:SD, e.g. ACL.stiffness=4500:900"
    priors = read_numbers("--prior", read_texts("--prior", arguments.prior), form, (2,))
    return Identify(
        noise_mm=arguments.noise_mm,
        noise_deg=arguments.noise_deg,
        posterior=arguments.posterior,
        prior=priors,
        chains=arguments.chains,
        draws=arguments.draws,
        seed=arguments.seed,
        next_tests=arguments.next_tests,
        criterion=arguments.criterion,
        candidates=_candidates(arguments.candidates),
    )


def _candidates(path: Path | None) -> list[Candidate] | None:
    if path is None:
        return None
    return [
        Candidate(row.name or load_words(row.loads), row.flexion_deg, **row.loads)
        for row in read_candidates(path)
    ]
