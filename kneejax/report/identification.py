"""What `kneejax identify` found as an answer: estimates, their limits, the tests to make."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.geometry import COLUMNS
from kneejax.inference import Identification, IntervalKind, Posterior, Profile, same_ends, versions
from kneejax.parameters import sums_in_words
from kneejax.report import design as planned
from kneejax.report import information as curvature
from kneejax.report import posterior
from kneejax.report.calibration_parameters import correlation_matrix_figure, limits
from kneejax.report.calibration_verdict import Outcome
from kneejax.report.doubts import accepted_statuses, pose_doubts
from kneejax.report.look.colours import BLUE, GREEN, GREY, VERMILLION
from kneejax.report.look.page import Answer, Drawing, Section, prose
from kneejax.report.look.style import Figure, readable, styled
from kneejax.report.look.tables import NONE, Table, json_safe, listed, number
from kneejax.report.panels import figure_legend, grid
from kneejax.studies import Identified

#: Chi squared per degree of freedom beyond which the noise that was given is doubted.
_MISFIT = 2.0
#: Panels beside each other.
_COLUMNS = 4


def identification_answer(answer: Identified, options: Mapping[str, Any]) -> Answer:
    """What the data of a study determine, what not, and the best tests to make next."""
    study, found, design, sampled = answer.study, answer.found, answer.design, answer.posterior
    names, information = found.selection.names, found.information
    reasons = _reasons(found)
    flexion, accepted = found.motion.table[:, 0], accepted_statuses(study.failures)
    doubts = [*fit_doubts(found), *(posterior.posterior_doubts(sampled) if sampled else ()),
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
                curvature.information_section(information), planned.design_section(design)]
    points = [[one.name, value, rise, *others] for one in found.profiles
              for value, rise, others in zip(one.values, one.rise, one.parameters, strict=True)]
    profiles = Table.plain(("parameter", "value", "rise_of_chi2", *names), points)
    tables = {"parameters": every, "profiles": profiles,
              "candidates": planned.candidates_table(design)}  # fmt: skip
    if design.chosen:
        tables["next_tests"] = planned.next_tests_table(design)
    drawings = {"standard_errors": Drawing(planned.standard_errors_figure, design),
                "profiles": Drawing(profiles_figure, found.profiles, study.truth),
                "spectrum": Drawing(curvature.spectrum_figure, information),
                "correlation": Drawing(correlation_matrix_figure, names, information.correlation),
                "next_tests": Drawing(planned.candidates_figure, design)}  # fmt: skip
    draws = None
    if sampled is not None:
        chains, count, size = sampled.draws.shape
        tables["posterior"] = Table.of({"chain": np.repeat(range(chains), count),
                                        "draw": [*range(count)] * chains,
                                        sampled.names: sampled.draws.reshape(-1, size)})
        drawings |= posterior.posterior_drawings(sampled)
        sections.insert(2, posterior.posterior_section(sampled))
        own = ("divergences", "evaluations", "seconds", "seed")
        draws = {
            "priors": {p.name: {"mean": p.mean, "sd": p.sd} for p in sampled.priors},
            "draws_without_balance": sampled.unbalanced,
        } | {name: getattr(sampled, name) for name in own}
    own = ("eigenvalues", "eigenvectors", "scale", "correlation")
    sentences = curvature.stiff_words(information) + curvature.sloppy_words(information)
    determine = {name: getattr(information, name) for name in own} | {"sentences": sentences}
    return Answer(
        title=study.title,
        asked=f"What do {found.data} measured numbers determine of {len(names)} parameters of knee "
        f"{study.knee.name}, and which test adds most?",
        verdict=became.verdict, badge=became.value,
        sentence=" ".join([sentence, *planned.design_words(design)[:1]]), tables=tables,
        main=[curvature.information_table(information, [not why for why in reasons], known),
              planned.profit_table(design)],
        drawings=drawings, doubts=doubts, sections=sections,
        document=json_safe({
            "study": study.title, "knee": study.knee_name,
            "parameters": {x["name"]: x for x in every.records()}, "frame_offset": found.offsets,
            "noise": dict(zip(COLUMNS[1:], found.noise, strict=True)),
            "noise_estimated": found.noise_estimated, "chi2": found.chi2,
            "measured_numbers": found.data, "information": determine,
            "next_tests": planned.design_words(design), "posterior": draws, "truth": study.truth,
            "warnings": doubts, "settings": dict(options), "seconds": {"total": answer.seconds},
            "versions": versions() if sampled is None else sampled.versions,
        }),
    )  # fmt: skip


def _reasons(found: Identification) -> list[str]:
    """For each parameter that the data do not determine a sentence why; empty for the others.

    By the profile; where none was followed, better known than before by the curvature.
    """
    said = []
    curved = zip(found.selection.names, found.information.determined,
                 curvature.reason_words(found.information), strict=True)  # fmt: skip
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
    by_name, names, moved = {one.name: one for one in found.profiles}, found.selection.names, []
    if not by_name:
        return []
    bent = [name for name, one in zip(names, found.intervals, strict=True)
            if one.kind is not IntervalKind.STANDARD_ERROR]  # fmt: skip
    if sampled is not None:
        drawn = zip(names, sampled.quantiles((0.025, 0.975)), strict=True)
        moved = [name for name, ends in drawn if (one := by_name[name]).closed
                 and not same_ends((one.low, one.high), ends)]  # fmt: skip
    notes = [prose("profile.bent", names=", ".join(bent)) if bent else prose("profile.alike")]
    if moved:
        notes.append(prose("posterior.moved", names=", ".join(moved)))
    elif sampled is not None:
        notes.append("Posterior and profiles agree where the data limit a parameter.")
    return notes


@styled
def profiles_figure(
    profiles: Sequence[Profile], truth: Mapping[str, float] | None = None
) -> Figure:
    """Draw how the misfit grows as each parameter leaves its estimate."""
    from scipy.interpolate import PchipInterpolator

    rows = -(-len(profiles) // _COLUMNS)
    figure, panels = grid(rows, min(_COLUMNS, len(profiles)), 1.62 * rows + 0.55, right=0.18,
                          bottom=0.7, apart=(0.22, 0.55), shown=len(profiles),
                          sharey=True)  # fmt: skip
    for axes, profile in zip(panels.flat, profiles, strict=False):
        known = (truth or {}).get(profile.name)
        axes.set_title(readable(profile.name, profile.unit), fontsize=8)
        top = 1.75 * profile.threshold
        axes.set_ylim(-0.04 * top, top)
        x, rise = profile.values, profile.rise
        if len(x) > 2:
            # Between its points a monotone cubic of the signed root of the rise.
            root = np.sign(x - profile.estimate) * np.sqrt(np.maximum(rise, 0.0))
            x = np.linspace(x[0], x[-1], 200)
            rise = PchipInterpolator(profile.values, root)(x) ** 2
        left, right = float(profile.values[0]), float(profile.values[-1])
        pad = 0.04 * (right - left) or abs(left) * 0.05 or 1.0
        left, right = left - pad, right + pad
        axes.set_xlim(left, right)
        axes.axvspan(profile.low, profile.high, color=BLUE, alpha=0.13, linewidth=0,
                     label="95 % confidence")  # fmt: skip
        if np.isfinite(profile.standard_error) and profile.standard_error > 0:
            line = np.linspace(left, right, 200)
            bowl = ((line - profile.estimate) / profile.standard_error) ** 2
            axes.plot(line, bowl, "--", color=GREY, linewidth=1.4, label="by the standard error")
        axes.plot(x, rise, color=BLUE, label="profile")
        axes.plot(profile.values, profile.rise, ".", color=BLUE, markersize=3.5)
        axes.axhline(profile.threshold, color=GREY, linewidth=1.0, linestyle=":",
                     label=f"95 % limit: {profile.threshold:.2f}")  # fmt: skip
        axes.plot([profile.estimate], [0.0], "o", color=VERMILLION, markersize=4, clip_on=False,
                  zorder=5, label="estimate")  # fmt: skip
        ends = {"left": 0.03, "right": 0.97}
        if known is not None and left <= known <= right:
            axes.axvline(known, color=GREEN, linewidth=1.2, label="truth")
        elif known is not None:
            side = "right" if known > right else "left"
            axes.text(ends[side], 0.9, "truth beyond", ha=side, fontsize=6.5, color=GREEN,
                      transform=axes.transAxes)  # fmt: skip
        opened = (profile.low_open, profile.high_open)
        for why, (side, place) in zip(opened, ends.items(), strict=True):
            if why:
                words = "open: bound" if why == "its bound" else "open: no\nbalance beyond"
                axes.text(place, 0.95, words, ha=side, va="top", fontsize=6.5, color=VERMILLION,
                          transform=axes.transAxes, zorder=6,
                          bbox={"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1.0})
        axes.locator_params(axis="x", nbins=3)
        axes.tick_params(labelsize=7)
    for axes in panels[:, 0]:
        axes.set_ylabel("Rise of $\\chi^2$")
    figure_legend(figure, ncols=6, handlelength=1.6, bbox_to_anchor=(0.5, 0.0), columnspacing=1.0,
                  fontsize=7.5)  # fmt: skip
    return figure
