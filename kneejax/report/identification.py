"""What `kneejax identify` found as an answer: estimates, their limits, the tests to make."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.geometry import COLUMNS
from kneejax.inference import Identification, IntervalKind, Posterior, same_ends, versions
from kneejax.parameters import sums_in_words
from kneejax.report import identification_figures as figures
from kneejax.report import information as words
from kneejax.report.calibration_parameters import correlation_matrix_figure, limits
from kneejax.report.calibration_verdict import Outcome
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.tables import NONE, Column, Table, json_safe, listed, number
from kneejax.report.pose_tables import accepted_statuses, pose_doubts
from kneejax.studies import Identified

#: Chi squared per degree of freedom beyond which the noise that was given is doubted.
_MISFIT = 2.0
#: Above this R-hat, below this effective size, chains are not to be trusted (Vehtari et al. 2021).
_R_HAT, _EFFECTIVE_PER_CHAIN = 1.01, 100.0
# Of all trajectories; fewer than that only count (`Posterior.divergences`).
_FEW = 1e-3
# A posterior as wide as this part of its prior says little beyond it.
_LITTLE = 0.9


def identification_answer(answer: Identified, options: Mapping[str, Any]) -> Answer:
    """What the data of a study determine, what not, and the best tests to make next."""
    study, found, design, sampled = answer.study, answer.found, answer.design, answer.posterior
    names, information = found.selection.names, found.information
    reasons = _reasons(found)
    flexion, accepted = found.motion.table[:, 0], accepted_statuses(study.failures)
    doubts = [*fit_doubts(found), *(posterior_doubts(sampled) if sampled else ()),
              *filter(None, reasons), *pose_doubts(found.motion, flexion, accepted)]  # fmt: skip
    became = Outcome.DOUBTFUL if doubts else Outcome.GOOD
    became = became if found.converged else Outcome.FAILED
    lost = [*itertools.compress(names, reasons)]
    sentence = f"The data determine {len(names) - len(lost)} of {len(names)} parameters"
    sentence += f", not {listed(lost, 6)}." if lost else "."
    every = _parameters_table(found, sampled, reasons)
    known: dict[str, list[str]] = {}
    if found.profiles:
        ends = {one.name: limits(np.nan if one.low_open else one.low,
                                 np.nan if one.high_open else one.high)
                for one in found.profiles}  # fmt: skip
        known["95 % limits, by profile"] = [ends.get(name) or NONE for name in names]
    if sampled is not None:
        drawn = sampled.quantiles((0.025, 0.975)).tolist()
        known["95 % limits, by posterior"] = [limits(*pair) for pair in drawn]
    kind = "estimated from the misfit" if found.noise_estimated else "as given"
    noise = f"{number(found.noise[2], 3)} mm and {number(found.noise[0], 3)} degrees ({kind})"
    text = [
        f"Fit by maximum likelihood: chi squared {number(found.chi2, 4)} for {found.data} measured "
        f"numbers, noise {noise}.", *_agreement(found, sampled),
        *filter(None, [sums_in_words(found.problem.knee, names)]),
    ]  # fmt: skip
    sections = [Section("Limits by profile", text, drawings=["profiles"], printed=True),
                words.information_section(information), words.design_section(design)]
    points = [[one.name, value, rise, *others] for one in found.profiles
              for value, rise, others in zip(one.values, one.rise, one.parameters, strict=True)]
    tables = {"parameters": every,
              "profiles": Table(("parameter", "value", "rise_of_chi2", *names), points),
              "candidates": words.candidates_table(design)}  # fmt: skip
    if design.chosen:
        tables["next_tests"] = words.next_tests_table(design)
    drawings = {"standard_errors": Drawing(figures.standard_errors_figure, design),
                "profiles": Drawing(figures.profiles_figure, found.profiles, study.truth),
                "spectrum": Drawing(figures.spectrum_figure, information),
                "correlation": Drawing(correlation_matrix_figure, names, information.correlation),
                "next_tests": Drawing(figures.candidates_figure, design)}  # fmt: skip
    draws = None
    if sampled is not None:
        chains, count, size = sampled.draws.shape
        tables["posterior"] = Table.of({"chain": np.repeat(range(chains), count),
                                        "draw": [*range(count)] * chains,
                                        sampled.names: sampled.draws.reshape(-1, size)})
        drawings |= posterior_drawings(sampled)
        sections.insert(2, posterior_section(sampled))
        own = ("divergences", "evaluations", "seconds", "seed")
        draws = {
            "priors": {p.name: {"mean": p.mean, "sd": p.sd} for p in sampled.priors},
            "draws_without_balance": sampled.unbalanced,
        } | {name: getattr(sampled, name) for name in own}
    own = ("eigenvalues", "eigenvectors", "scale", "correlation")
    sentences = words.stiff_words(information) + words.sloppy_words(information)
    determine = {name: getattr(information, name) for name in own} | {"sentences": sentences}
    return Answer(
        title=study.title,
        asked=prose("identify", data=found.data, count=len(names), knee=study.knee.name),
        verdict=became.verdict, badge=became.value,
        sentence=" ".join([sentence, *words.design_words(design)[:1]]), tables=tables,
        main=[words.information_table(information, [not why for why in reasons], known),
              words.profit_table(design)],
        drawings=drawings, doubts=doubts, sections=sections,
        document=json_safe({
            "study": study.title, "knee": study.knee_name,
            "parameters": {x["name"]: x for x in every.records()}, "frame_offset": found.offsets,
            "noise": dict(zip(COLUMNS[1:], found.noise, strict=True)),
            "noise_estimated": found.noise_estimated, "chi2": found.chi2,
            "measured_numbers": found.data, "information": determine,
            "next_tests": words.design_words(design), "posterior": draws, "truth": study.truth,
            "warnings": doubts, "settings": dict(options), "seconds": {"total": answer.seconds},
            "versions": versions() if sampled is None else sampled.versions,
        }),
    )  # fmt: skip


def _reasons(found: Identification) -> list[str]:
    """Why a parameter is not determined, by profile or else by curvature; empty if it is."""
    said = []
    curved = zip(found.selection.names, found.information.determined,
                 words.reason_words(found.information), strict=True)  # fmt: skip
    for i, (name, determined, reason) in enumerate(curved):
        interval = found.intervals[i] if found.intervals else None
        kind = None if interval is None else interval.kind
        usual = f"{name} is not determined: other parameters compensate whatever its bounds allow."
        if determined if kind is None else kind.from_data:
            said.append("")
        elif kind is IntervalKind.PRIOR:
            said.append(f"{name} is known from its prior alone: the data do not narrow it.")
        elif interval is not None and kind is IntervalKind.NOT_COMPUTED:
            said.append(f"The 95 % limits of {name} could not be computed: {interval.reason}.")
        else:
            said.append(reason or usual)
    return said


def _parameters_table(
    found: Identification, sampled: Posterior | None, reasons: Sequence[str]
) -> Table:
    """The table of parameters.csv: limits by curvature, profile and posterior."""
    names, profiles = found.selection.names, {one.name: one for one in found.profiles}
    drawn = dict.fromkeys(("posterior_mean", "posterior_sd", "posterior_low", "posterior_high",
                           "r_hat", "effective_sample_size"))  # fmt: skip
    if sampled is not None:
        numbers = (sampled.mean, sampled.sd, *sampled.quantiles((0.025, 0.975)).T, sampled.r_hat,
                   sampled.effective_sample_size)  # fmt: skip
        drawn = dict(zip(drawn, numbers, strict=True))
    kinds = [one.kind.value for one in found.intervals] or [None] * len(names)
    return Table.of({
        "name": names, "value": found.values,
        "unit": [found.selection.unit(i) for i in range(len(names))], "lower": found.lower,
        "upper": found.upper, "at_bound": found.at_bound,
        "standard_error": found.information.standard_error,
        **{f"profile_{field}": [getattr(profiles.get(name), field, None) for name in names]
           for field in ("low", "high", "low_open", "high_open")},
        **drawn, "interval": kinds, "determined": [not why for why in reasons], "reason": reasons,
    })  # fmt: skip


def fit_doubts(found: Identification) -> list[str]:
    """What a reader of the fit must know."""
    notes = []
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
    if held := ", ".join(itertools.compress(found.selection.names, found.at_bound)):
        notes.append(prose("fit.bound", names=held))
    return notes


def _agreement(found: Identification, sampled: Posterior | None) -> list[str]:
    """Where standard error, profile and posterior differ."""
    by_name, names = {one.name: one for one in found.profiles}, found.selection.names
    if not by_name:
        return []
    bent = [name for name, one in zip(names, found.intervals, strict=True)
            if one.kind is not IntervalKind.STANDARD_ERROR]  # fmt: skip
    notes = [prose("profile.bent", names=", ".join(bent)) if bent else prose("profile.alike")]
    if sampled is not None:
        drawn = zip(names, sampled.quantiles((0.025, 0.975)), strict=True)
        moved = [name for name, ends in drawn if (one := by_name[name]).closed
                 and not same_ends((one.low, one.high), ends)]  # fmt: skip
        notes.append(prose("posterior.moved", names=", ".join(moved)) if moved else
                     prose("posterior.alike"))  # fmt: skip
    return notes


def posterior_drawings(found: Posterior) -> dict[str, Drawing]:
    """All figures of a posterior, with captions; pairs of several parameters."""
    drawn = {"posterior": figures.marginals_figure, "predictive": figures.predictive_figure}
    drawn |= {"posterior_pairs": figures.pairs_figure} if len(found.names) > 1 else {}
    return {name: Drawing(figure, found) for name, figure in drawn.items()}


def posterior_section(found: Posterior) -> Section:
    """What a posterior is: how it was drawn, and a row for each parameter."""
    low, high = found.quantiles((0.025, 0.975)).T
    table = Table.of({
        Column("name", "parameter"): found.names, "unit": found.units,
        Column("mean"): found.mean, Column("sd", show="2"): found.sd,
        Column("quantile_025", "2.5 %"): low, Column("quantile_975", "97.5 %"): high,
        Column("laplace_sd", "Laplace sd", "2"): np.sqrt(np.diag(found.laplace_covariance)),
        Column("r_hat", "R-hat", ".3f"): found.r_hat,
        Column("effective_sample_size", "eff.", ".0f"): found.effective_sample_size,
    })  # fmt: skip
    chains, draws, _ = found.draws.shape
    seconds = {part: number(found.seconds[part], 3) for part in ("total", "compile")}
    sampled = prose("posterior", chains=chains, draws=draws, found=found, **seconds)
    drawings = [*posterior_drawings(found)]
    return Section("Posterior", [sampled], [table], drawings, printed=True)


def posterior_doubts(result: Posterior) -> list[str]:
    """Sentences on what a reader must know before the numbers are used."""
    said, count = [], result.divergent.size
    if result.unbalanced:
        said.append(prose("posterior.unbalanced", lost=result.unbalanced, count=count))
    diverged = result.divergences - result.unbalanced
    if diverged > _FEW * count:
        said.append(prose("posterior.diverged", lost=diverged, count=count))
    least = np.fmin(result.effective_sample_size, result.tail_effective_sample_size)
    enough = _EFFECTIVE_PER_CHAIN * len(result.draws)
    spread = np.array([prior.spread for prior in result.priors])
    for kind, where in (("chains", ~(result.r_hat <= _R_HAT)), ("few", ~(least >= enough)),
                        ("prior", result.sd > _LITTLE * spread)):  # fmt: skip
        if names := ", ".join(itertools.compress(result.names, where)):
            limits = {"r_hat": _R_HAT, "enough": f"{enough:.0f}"}
            said.append(prose(f"posterior.{kind}", names=names, **limits))
    if (data := result.measured[:, 1:].size) < len(result.names):
        said.append(prose("posterior.data", data=data, count=len(result.names)))
    return said
