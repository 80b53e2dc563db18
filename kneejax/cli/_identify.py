"""`kneejax identify [STUDY.yaml]`."""

from __future__ import annotations

import json
from pathlib import Path

from kneejax import studies
from kneejax.cli import options
from kneejax.cli._given import said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.files import read_candidates, write_rows, write_text
from kneejax.inference import Candidate, Identification, Posterior
from kneejax.mechanics import load_words
from kneejax.studies import Identified, Identify

#: The chosen tests, to be filled in.
_NEXT = "next_tests.csv"


def run(arguments: options.Identify) -> int:
    """Say what the data of a study determine; write tables and figures."""
    question = _question(arguments)
    study = studies.read_study(arguments.study)
    with said_of_options(question), stages_on_terminal("what the data tell"):
        found = studies.run(study, question)
    return _write(found, arguments)


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


def _write(answer: Identified, arguments: options.Identify) -> int:
    from kneejax import report

    out, found, sampled = arguments.out, answer.found, answer.posterior
    files = _write_tables(answer, out)
    _draw(answer, out, arguments.svg)
    settings = {"command": "identify", "out": out} | arguments.options()
    settings = {name: str(value) for name, value in settings.items()}
    document = report.identification_document(answer, settings)
    write_text(out / "result.json", json.dumps(document, indent=1) + "\n")

    print(f"{answer.study.title} (knee {answer.study.knee.name})\n")
    print(report.estimates_text(found, sampled))
    print(f"\n{report.information_text(found.information)}")
    if sampled is not None:
        print(f"\n{report.posterior_summary(sampled)}")
    print(f"\n{report.design_text(answer.design)}")
    if _NEXT in files:
        print(
            f"\nTo be measured: {out / _NEXT}. Filled in, it is a test of the study:\n"
            f"  tests: [{{name: next, file: {_NEXT}, counted_from: absolute}}]"
        )
    print(f"\nwritten: {out}/{', '.join(files)}, result.json, settings.json, figures/")
    return report.identification_outcome(answer).exit_status


def _write_tables(answer: Identified, out: Path) -> list[str]:
    """Write the tables; the names of the files come back."""
    from kneejax.report import CANDIDATE_COLUMNS, ESTIMATE_COLUMNS, candidates_rows, estimate_rows
    from kneejax.report.design import next_test_table

    found, sampled = answer.found, answer.posterior
    estimates = estimate_rows(found, sampled)
    tests = candidates_rows(answer.design)
    profile_columns = ("parameter", "value", "rise_of_chi2", *found.selection.names)
    tables = {
        "parameters.csv": (ESTIMATE_COLUMNS, ([r[c] for c in ESTIMATE_COLUMNS] for r in estimates)),
        "profiles.csv": (profile_columns, _profile_rows(found)),
        "candidates.csv": (CANDIDATE_COLUMNS, ([r[c] for c in CANDIDATE_COLUMNS] for r in tests)),
    }
    if answer.design.chosen:
        tables[_NEXT] = next_test_table(answer.design)
    if sampled is not None:
        tables["posterior.csv"] = (("chain", "draw", *sampled.names), _draws(sampled))
    for name, (columns, rows) in tables.items():
        write_rows(out / name, list(columns), rows)
    return [*tables]


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


def _draw(answer: Identified, out: Path, svg: bool) -> None:
    from kneejax import report

    found, sampled, design = answer.found, answer.posterior, answer.design
    figures = {
        "spectrum": report.spectrum_figure(found.information),
        "correlation": report.information_correlation_figure(found.information),
        "profiles": report.profiles_figure(found.profiles, answer.study.truth),
        "next_tests": report.candidates_figure(design),
        "standard_errors": report.standard_errors_figure(design),
    }
    if sampled is not None:
        figures |= report.posterior_figures(sampled)
    for name, figure in figures.items():
        report.save_figure(figure, out / "figures", name, svg=svg)
