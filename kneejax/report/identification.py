"""What `kneejax identify` found as an answer: page, files, and the screen after it."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import COLUMNS
from kneejax.inference import versions
from kneejax.report.calibration_parameters import correlation_matrix_figure
from kneejax.report.calibration_verdict import Outcome
from kneejax.report.design import (
    candidates_figure,
    candidates_table,
    design_notes,
    design_tables,
    design_text,
    design_words,
    goal_words,
    next_tests_table,
    standard_errors_figure,
)
from kneejax.report.doubts import accepted_statuses, pose_doubts
from kneejax.report.estimates import (
    agreement,
    estimates_table,
    estimates_text,
    fit_doubts,
    fit_words,
    identified_table,
    profiles_table,
    undetermined_words,
)
from kneejax.report.identification_figures import profiles_figure, spectrum_figure
from kneejax.report.information import (
    CURVATURE,
    information_notes,
    information_table,
    information_text,
    information_words,
    sloppy_words,
    stiff_words,
)
from kneejax.report.look.page import Answer, Drawing, Section
from kneejax.report.look.tables import Column, Table, json_safe, listed, number
from kneejax.report.posterior import (
    draws_table,
    posterior_doubts,
    posterior_drawings,
    posterior_summary,
    posterior_table,
    sampling_words,
)

if TYPE_CHECKING:
    from kneejax.studies import Identified


_TO_MEASURE = (
    "To be measured: next_tests.csv. Filled in, it is a test of the study:\n"
    "  tests: [{name: next, file: next_tests.csv, counted_from: absolute}]"
)


def identification_answer(answer: Identified, options: Mapping[str, Any]) -> Answer:
    """What the data of a study determine, what not, and the best tests to make next.

    Args:
        answer: what was found.
        options: of the command, recorded as they are.

    Returns:
        The answer; its tables are parameters, profiles, candidates and, where there are any,
        next_tests and the draws of the posterior.
    """
    study, found, design = answer.study, answer.found, answer.design
    sampled, became = answer.posterior, identification_outcome(answer)
    names = found.selection.names
    lost = [row[0] for row in identified_table(found).rows if not row[-2]]
    sentence = f"The data determine {len(names) - len(lost)} of {len(names)} parameters"
    sentence += f", not {listed(lost, 6)}." if lost else "."
    sections = [
        Section("Limits by profile", [fit_words(found), *agreement(found, sampled)],
                drawings=["profiles"]),
        Section("What the data determine by curvature",
                [CURVATURE, *information_words(found.information),
                 *information_notes(found.information)],
                [information_table(found.information)], ["spectrum", "correlation"]),
        Section("Tests to make next",
                [f"What to measure next: {goal_words(design)}", *design_words(design),
                 *design_notes(design)],
                design_tables(design), ["next_tests"]),
    ]  # fmt: skip
    tables = {
        "parameters": identified_table(found, sampled), "profiles": profiles_table(found),
        "candidates": candidates_table(design),
    }
    if design.chosen:
        tables["next_tests"] = next_tests_table(design)
    drawings = _drawings(answer)
    text = [f"{study.title} (knee {study.knee.name})", estimates_text(found, sampled)]
    text.append(information_text(found.information))
    if sampled is not None:
        tables["posterior"] = draws_table(sampled)
        words = [f"{sampling_words(sampled)}.", *posterior_doubts(sampled)]
        drawn = posterior_drawings(sampled)
        sections.append(Section("Posterior", words, [posterior_table(sampled)], [*drawn]))
        drawings |= drawn
        text.append(posterior_summary(sampled))
    text += [design_text(design), *[_TO_MEASURE] * bool(design.chosen)]
    return Answer(
        title=study.title,
        asked=f"What do {found.data} measured numbers determine of {len(names)} parameters of knee "
        f"{study.knee.name}, and which test adds most?",
        verdict=became.verdict,
        badge=became.value,
        sentence=" ".join([sentence, *design_words(design)[:1]]),
        tables=tables,
        main=[estimates_table(found, sampled), _next(answer)],
        drawings=drawings,
        picture="standard_errors",
        doubts=identification_doubts(answer),
        sections=sections,
        text="\n\n".join(text),
        document=identification_document(answer, options),
        exit_status=became.exit_status,
    )


def _next(answer: Identified) -> Table:
    """The chosen tests, and what each does to the parameter that gains most."""
    design, two = answer.design, functools.partial(number, digits=2)
    rows = []
    for step, test in enumerate(design.tests):
        before, after = design.standard_errors[step : step + 2]
        i = int(np.argmax(before / after))
        rows.append([str(step + 1), str(test), design.names[i], before[i], after[i]])
    columns = [
        Column("step", " ", words=True), Column("test", "test to make next", words=True),
        Column("parameter", "gains most", words=True), Column("before", "std. error before", two),
        Column("after", show=two),
    ]  # fmt: skip
    return Table(columns, rows)


def _drawings(answer: Identified) -> dict[str, Drawing]:
    found, design, one = answer.found, answer.design, functools.partial
    information = found.information
    return {
        "standard_errors": Drawing(
            one(standard_errors_figure, design),
            "Expected standard error of each parameter before and after the chosen tests, as a "
            "fraction of the spread between knees. Left of the line the data determine it.",
        ),
        "profiles": Drawing(
            one(profiles_figure, found.profiles, answer.study.truth),
            "How the misfit grows as each parameter leaves its estimate, the others fitted again; "
            "the parabola is that of the standard error, the band the 95 % limits.",
        ),
        "spectrum": Drawing(
            one(spectrum_figure, information),
            "How many times better each combination of parameters is known than the prior, and "
            "the weight of each parameter in it.",
        ),
        "correlation": Drawing(
            one(correlation_matrix_figure, information.names, information.correlation),
            "Correlation of the estimates by curvature; hatched where there is none.",
        ),
        "next_tests": Drawing(
            one(candidates_figure, design),
            "What each candidate would add as the next test; numbers are the chosen order, "
            "hatched candidates are left out.",
        ),
    }


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
    draws = None
    if sampled is not None:
        names = ("divergences", "evaluations", "seconds", "seed")
        draws = {
            "priors": {p.name: {"mean": p.mean, "sd": p.sd} for p in sampled.priors},
            "draws_without_balance": sampled.unbalanced,
        } | {name: getattr(sampled, name) for name in names}
    return json_safe(
        {
            "study": study.title,
            "knee": study.knee_name,
            "parameters": {x["name"]: x for x in identified_table(found, sampled).records()},
            "frame_offset": found.offsets,
            "noise": dict(zip(COLUMNS[1:], found.noise, strict=True)),
            "noise_estimated": found.noise_estimated,
            "chi2": found.chi2,
            "measured_numbers": found.data,
            "information": told
            | {"sentences": stiff_words(found.information) + sloppy_words(found.information)},
            "next_tests": design_words(answer.design),
            "posterior": draws,
            "truth": study.truth,
            "warnings": identification_doubts(answer),
            "settings": dict(options),
            "seconds": {"total": answer.seconds},
            "versions": versions() if sampled is None else sampled.versions,
        }
    )
