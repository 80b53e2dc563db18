"""What `kneejax identify` found as an answer: estimates, their limits, the tests to make."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.geometry import COLUMNS
from kneejax.inference import Interval, IntervalKind, same_ends, versions
from kneejax.parameters import sums_in_words
from kneejax.report import design as planned
from kneejax.report import information as curvature
from kneejax.report import posterior
from kneejax.report.calibration_parameters import correlation_matrix_figure, limits
from kneejax.report.calibration_verdict import Outcome
from kneejax.report.doubts import accepted_statuses, pose_doubts
from kneejax.report.identification_figures import profiles_figure, spectrum_figure
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.tables import (
    NONE,
    Column,
    Table,
    json_safe,
    listed,
    number,
    with_error,
)

if TYPE_CHECKING:
    from kneejax.inference import Identification, Posterior
    from kneejax.studies import Identified

#: Chi squared per degree of freedom beyond which the noise that was given is doubted.
_MISFIT = 2.0
#: Columns of a posterior in parameters.csv.
_MOMENTS = ("posterior_mean", "posterior_sd")
_ENDS = ("posterior_low", "posterior_high")
_QUALITY = ("r_hat", "effective_sample_size")


def identification_answer(answer: Identified, options: Mapping[str, Any]) -> Answer:
    """What the data of a study determine, what not, and the best tests to make next.

    Args:
        answer: what was found.
        options: of the command, recorded as they are.

    Returns:
        The answer; its tables are parameters, profiles, candidates and, where there are any,
        next_tests and the draws of the posterior.
    """
    study, found, design, sampled = answer.study, answer.found, answer.design, answer.posterior
    names, information, became = found.selection.names, found.information, _outcome(answer)
    every = identified_table(found, sampled)
    lost = [row[0] for row in every.rows if not row[-2]]
    sentence = f"The data determine {len(names) - len(lost)} of {len(names)} parameters"
    sentence += f", not {listed(lost, 6)}." if lost else "."
    told, known = _agreement(found, sampled), _shown(found, sampled)
    summed = sums_in_words(found.problem.knee, names)
    sections = [
        Section("Limits by profile", [_fit_words(found), *told, *[summed] * bool(summed)],
                drawings=["profiles"], printed=True),
        curvature.information_section(information), planned.design_section(design),
    ]  # fmt: skip
    tables = {"parameters": every, "profiles": _profiles_table(found),
              "candidates": planned.candidates_table(design)}  # fmt: skip
    if design.chosen:
        tables["next_tests"] = planned.next_tests_table(design)
    drawings = {"standard_errors": Drawing(planned.standard_errors_figure, design),
                "profiles": Drawing(profiles_figure, found.profiles, study.truth),
                "spectrum": Drawing(spectrum_figure, information),
                "correlation": Drawing(correlation_matrix_figure, names, information.correlation),
                "next_tests": Drawing(planned.candidates_figure, design)}  # fmt: skip
    if sampled is not None:
        tables["posterior"] = posterior.draws_table(sampled)
        drawings |= posterior.posterior_drawings(sampled)
        sections.insert(2, posterior.posterior_section(sampled))
    return Answer(
        title=study.title,
        asked=f"What do {found.data} measured numbers determine of {len(names)} parameters of knee "
        f"{study.knee.name}, and which test adds most?",
        verdict=became.verdict, badge=became.value,
        sentence=" ".join([sentence, *planned.design_words(design)[:1]]), tables=tables,
        main=[known, planned.profit_table(design)], drawings=drawings, doubts=_doubts(answer),
        sections=sections, document=_document(answer, every, options),
    )


def _doubts(answer: Identified) -> list[str]:
    """Everything to doubt: the fit, the draws, undetermined parameters and poses."""
    found, sampled = answer.found, answer.posterior
    doubts = fit_doubts(found) + ([] if sampled is None else posterior.posterior_doubts(sampled))
    rows = range(len(found.selection.names))
    doubts += [_why(found, i) for i in rows if not _determined(found, i)]
    accepted = accepted_statuses(answer.study.failures)
    return doubts + pose_doubts(found.motion, found.motion.table[:, 0], accepted)


def _outcome(answer: Identified) -> Outcome:
    """What became of it; decides the exit status of `kneejax identify`."""
    if not answer.found.converged:
        return Outcome.FAILED
    return Outcome.DOUBTFUL if _doubts(answer) else Outcome.GOOD


def _document(answer: Identified, every: Table, options: Mapping[str, Any]) -> dict[str, Any]:
    """What result.json holds."""
    study, found, sampled, draws = answer.study, answer.found, answer.posterior, None
    names = ("eigenvalues", "eigenvectors", "scale", "correlation")
    told = {name: getattr(found.information, name) for name in names}
    if sampled is not None:
        names = ("divergences", "evaluations", "seconds", "seed")
        draws = {
            "priors": {p.name: {"mean": p.mean, "sd": p.sd} for p in sampled.priors},
            "draws_without_balance": sampled.unbalanced,
        } | {name: getattr(sampled, name) for name in names}
    return json_safe(
        {
            "study": study.title, "knee": study.knee_name,
            "parameters": {x["name"]: x for x in every.records()}, "frame_offset": found.offsets,
            "noise": dict(zip(COLUMNS[1:], found.noise, strict=True)),
            "noise_estimated": found.noise_estimated, "chi2": found.chi2,
            "measured_numbers": found.data,
            "information": told
            | {"sentences": curvature.stiff_words(found.information)
               + curvature.sloppy_words(found.information)},
            "next_tests": planned.design_words(answer.design), "posterior": draws,
            "truth": study.truth, "warnings": _doubts(answer), "settings": dict(options),
            "seconds": {"total": answer.seconds},
            "versions": versions() if sampled is None else sampled.versions,
        }
    )  # fmt: skip


def identified_table(found: Identification, sampled: Posterior | None = None) -> Table:
    """The table of parameters.csv: limits by curvature, profile and posterior."""
    names, profiles = found.selection.names, {one.name: one for one in found.profiles}
    known = [_determined(found, i) for i in range(len(names))]
    intervals = [_interval(found, i) for i in range(len(names))]
    drawn: dict[Any, Any] = dict.fromkeys((*_MOMENTS, *_ENDS, *_QUALITY))
    if sampled is not None:
        drawn = {
            _MOMENTS: np.stack([sampled.mean, sampled.sd], axis=1),
            _ENDS: sampled.quantiles((0.025, 0.975)),
            _QUALITY: np.stack([sampled.r_hat, sampled.effective_sample_size], axis=1),
        }
    return Table.of({
        "name": names, "value": found.values,
        "unit": [found.selection.unit(i) for i in range(len(names))], "lower": found.lower,
        "upper": found.upper, "at_bound": found.at_bound,
        "standard_error": found.information.standard_error,
        **{f"profile_{field}": [getattr(profiles.get(name), field, None) for name in names]
           for field in ("low", "high", "low_open", "high_open")},
        **drawn, "interval": [None if one is None else one.kind.value for one in intervals],
        "determined": known,
        "reason": ["" if sure else _why(found, i) for i, sure in enumerate(known)],
    })  # fmt: skip


def _shown(found: Identification, sampled: Posterior | None) -> Table:
    """Estimates as people read them, with what curvature, profile and posterior say of each."""
    table, more = curvature.information_table(found.information), []
    records = identified_table(found, sampled).records()
    if found.profiles:
        ends = [[np.nan if row[f"profile_{end}_open"] or row[f"profile_{end}"] is None
                 else row[f"profile_{end}"] for end in ("low", "high")] for row in records]
        more.append(("95 % limits, by profile", [limits(*pair) or NONE for pair in ends]))
    if sampled is not None:
        drawn = [limits(row["posterior_low"], row["posterior_high"]) for row in records]
        more.append(("95 % limits, by posterior", drawn))
    at = table.names.index("scale")
    columns = [*table.columns[:at], *(Column(head, words=True) for head, _ in more),
               *table.columns[at:]]  # fmt: skip
    rows = []
    for i, (row, own) in enumerate(zip(table.rows, records, strict=True)):
        cells = [*row[:at], *(cell[i] for _, cell in more), *row[at:]]
        cells[1] = with_error(row[1], row[2])[0]
        cells[-1] = curvature.remark(own["determined"], own["at_bound"])
        rows.append(cells)
    return Table(columns, rows, spare=("times_better", "scale"))


def _profiles_table(found: Identification) -> Table:
    """Every point of every profile, profiles.csv."""
    columns = ("parameter", "value", "rise_of_chi2", *found.selection.names)
    rows = [[one.name, value, rise, *others] for one in found.profiles
            for value, rise, others in zip(one.values, one.rise, one.parameters, strict=True)]
    return Table([*map(Column, columns)], rows)


def _interval(found: Identification, i: int) -> Interval | None:
    return found.intervals[i] if found.intervals else None


def _determined(found: Identification, i: int) -> bool:
    """By the profile; where none was followed, better known than before by the curvature."""
    interval = _interval(found, i)
    return bool(found.information.determined[i]) if interval is None else interval.kind.from_data


def _why(found: Identification, i: int) -> str:
    name, interval = found.selection.names[i], _interval(found, i)
    if interval is not None and interval.kind is IntervalKind.PRIOR:
        return f"{name} is known from its prior alone: the data do not narrow it."
    if interval is not None and interval.kind is IntervalKind.NOT_COMPUTED:
        return f"The 95 % limits of {name} could not be computed: {interval.reason}."
    usual = f"{name} is not determined: other parameters compensate whatever its bounds allow."
    return curvature.reason_words(found.information)[i] or usual


def _fit_words(found: Identification) -> str:
    """How the parameters were fitted, and by which noise."""
    kind = "estimated from the misfit" if found.noise_estimated else "as given"
    noise = f"{number(found.noise[2], 3)} mm and {number(found.noise[0], 3)} degrees ({kind})"
    return (
        f"Fit by maximum likelihood: chi squared {number(found.chi2, 4)} for {found.data} measured "
        f"numbers, noise {noise}."
    )


def fit_doubts(found: Identification) -> list[str]:
    """What a reader of the fit must know."""
    notes, names = [], found.selection.names
    if not found.converged:
        notes.append("The fit did not converge: free fewer parameters or start nearer.")
    if found.lost:
        notes.append(f"{found.lost} measured poses count nowhere: the start has no balance there.")
    per_freedom = found.chi2 / max(found.spare, 1)
    if not found.noise_estimated and found.spare > 0 and per_freedom > _MISFIT:
        notes.append(prose("fit.misfit", times=f"{np.sqrt(per_freedom):.2g}"))
    if found.spare <= 0:
        notes.append(prose("fit.data", data=found.data, count=len(found.values)))
    notes += [prose("fit.better", name=profile.name, better=f"{profile.better:.3g}")
              for profile in found.profiles if profile.better]  # fmt: skip
    if held := [n for n, on in zip(names, found.at_bound, strict=True) if on]:
        notes.append(prose("fit.bound", names=", ".join(held)))
    return notes


def _agreement(found: Identification, sampled: Posterior | None) -> list[str]:
    """Where standard error, profile and posterior differ."""
    by_name, bent, moved = {profile.name: profile for profile in found.profiles}, [], []
    if not by_name:
        return []
    for i, name in enumerate(found.selection.names):
        profile = by_name[name]
        if found.intervals[i].kind is not IntervalKind.STANDARD_ERROR:
            bent.append(name)
        if sampled is not None and profile.closed:
            drawn = sampled.quantiles((0.025, 0.975))[i]
            moved += [name] * (not same_ends((profile.low, profile.high), drawn))
    notes = [prose("profile.bent", names=", ".join(bent)) if bent else prose("profile.alike")]
    if moved:
        notes.append(prose("posterior.moved", names=", ".join(moved)))
    elif sampled is not None:
        notes.append("Posterior and profiles agree where the data limit a parameter.")
    return notes
