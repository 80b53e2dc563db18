"""`kneejax identify [STUDY.yaml]`."""

from __future__ import annotations

from pathlib import Path

from kneejax import studies
from kneejax.cli import options
from kneejax.cli._deliver import deliver
from kneejax.cli._given import said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.files import read_candidates
from kneejax.inference import Candidate
from kneejax.mechanics import load_words
from kneejax.studies import Identify


def run(arguments: options.Identify) -> int:
    """Say what the data of a study determine; write the answer."""
    with said_of_options(Identify):
        question = _question(arguments)
    study = studies.read_study(arguments.study)
    with said_of_options(Identify), stages_on_terminal("what the data tell"):
        found = studies.identify(study, question)
    from kneejax.report import identification_answer

    asked = {"command": arguments.command, "out": arguments.out, **arguments.options()}
    answer = identification_answer(found, {name: str(value) for name, value in asked.items()})
    return deliver(answer, arguments, seconds={"total": found.seconds})


def _question(arguments: options.Identify) -> Identify:
    return Identify(
        noise_mm=arguments.noise_mm,
        noise_deg=arguments.noise_deg,
        posterior=arguments.posterior,
        prior=arguments.prior,
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
