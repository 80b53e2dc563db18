"""What data determine, as tables: estimates with limits by curvature, profile and posterior."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.inference import Interval, IntervalKind, same_ends
from kneejax.parameters import sums_in_words
from kneejax.report.calibration_parameters import limits
from kneejax.report.information import reason_words
from kneejax.report.look.tables import NONE, Column, Table, number, with_error, wrapped

if TYPE_CHECKING:
    from kneejax.inference import Identification, Posterior


#: Chi squared per degree of freedom beyond which the noise that was given is doubted.
_MISFIT = 2.0
#: Columns of the table of estimates.
ESTIMATE_COLUMNS = (
    "name", "value", "unit", "lower", "upper", "at_bound", "standard_error", "profile_low",
    "profile_high", "profile_low_open", "profile_high_open", "posterior_mean", "posterior_sd",
    "posterior_low", "posterior_high", "r_hat", "effective_sample_size", "interval",
    "determined", "reason",
)  # fmt: skip


def identified_table(found: Identification, sampled: Posterior | None = None) -> Table:
    """The table of parameters.csv of an identification.

    Args:
        found: the fit, its information and its profiles.
        sampled: the posterior, if it was sampled.

    Returns:
        A row per parameter under the columns `ESTIMATE_COLUMNS`.
    """
    by_name = {profile.name: profile for profile in found.profiles}
    ends = None if sampled is None else sampled.quantiles((0.025, 0.975))
    rows = []
    for i, name in enumerate(found.selection.names):
        profile, interval = by_name.get(name), _interval(found, i)
        followed: list[Any] = [None] * 4
        if profile:
            followed = [profile.low, profile.high, profile.low_open, profile.high_open]
        drawn: list[Any] = [None] * 6
        if sampled is not None and ends is not None:
            moments = (sampled.mean[i], sampled.sd[i], *ends[i])
            drawn = [*moments, sampled.r_hat[i], sampled.effective_sample_size[i]]
        known = _determined(found, i)
        rows.append(
            [name, float(found.values[i]), found.selection.unit(i), float(found.lower[i]),
             float(found.upper[i]), bool(found.at_bound[i]),
             float(found.information.standard_error[i]), *followed,
             *(None if x is None else float(x) for x in drawn),
             None if interval is None else interval.kind.value, known,
             "" if known else _why(found, i)]
        )  # fmt: skip
    return Table([Column(name) for name in ESTIMATE_COLUMNS], rows)


def estimates_table(found: Identification, sampled: Posterior | None = None) -> Table:
    """Estimates with their limits as people read them.

    Args:
        found: the fit, its information and its profiles.
        sampled: the posterior, if it was sampled.

    Returns:
        Estimate, standard error where it gives the limits, 95 % limits by the profile and by the
        posterior, and whether the data determine the parameter.
    """
    heads = ["parameter", "estimate", "standard error", "unit"]
    heads += ["95 % limits"] * bool(found.profiles) + ["95 % by posterior"] * (sampled is not None)
    rows = []
    for row in identified_table(found, sampled).records():
        means = row["interval"] in (None, IntervalKind.STANDARD_ERROR.value)
        error = row["standard_error"] if means and row["standard_error"] is not None else np.nan
        cells = [row["name"], *with_error(row["value"], error), row["unit"]]
        if found.profiles:
            low = None if row["profile_low_open"] else row["profile_low"]
            high = None if row["profile_high_open"] else row["profile_high"]
            ends = (np.nan if end is None else end for end in (low, high))
            cells.append(limits(*ends) or NONE)
        if sampled is not None:
            cells.append(limits(row["posterior_low"], row["posterior_high"]))
        cells.append("" if row["determined"] else "not determined")
        rows.append(cells)
    right = ("estimate", "standard error")
    columns = [*(Column(head, words=head not in right) for head in heads), Column("determined", " ",
                                                                                  words=True)]
    return Table(columns, rows)


def profiles_table(found: Identification) -> Table:
    """Every point of every profile, the table of profiles.csv."""
    columns = ("parameter", "value", "rise_of_chi2", *found.selection.names)
    rows = [
        [profile.name, value, rise, *others]
        for profile in found.profiles
        for value, rise, others in zip(
            profile.values, profile.rise, profile.parameters, strict=True
        )
    ]
    return Table([Column(name) for name in columns], rows)


def undetermined_words(found: Identification) -> list[str]:
    """A sentence on each parameter that the data do not determine.

    Args:
        found: the fit, its information and its profiles.
    """
    rows = range(len(found.selection.names))
    return [_why(found, i) for i in rows if not _determined(found, i)]


def _interval(found: Identification, i: int) -> Interval | None:
    return found.intervals[i] if found.intervals else None


def _determined(found: Identification, i: int) -> bool:
    """By the profile; where none was followed, better known than before by the curvature."""
    interval = _interval(found, i)
    if interval is None:
        return bool(found.information.determined[i])
    return interval.kind.from_data


def _why(found: Identification, i: int) -> str:
    name, interval = found.selection.names[i], _interval(found, i)
    if interval is not None and interval.kind is IntervalKind.PRIOR:
        return f"{name} is known from its prior alone: the data do not narrow it."
    if interval is not None and interval.kind is IntervalKind.NOT_COMPUTED:
        return f"The 95 % limits of {name} could not be computed: {interval.reason}."
    usual = f"{name} is not determined: other parameters make up for whatever its bounds allow."
    return reason_words(found.information)[i] or usual


def estimates_text(found: Identification, sampled: Posterior | None = None) -> str:
    """Show estimates and their limits on a terminal.

    Args:
        found: the fit, its information and its profiles.
        sampled: the posterior, if it was sampled.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    lines = wrapped(fit_words(found))
    lines += ["", estimates_table(found, sampled).terminal()]
    lines += wrapped(sums_in_words(found.problem.knee, found.selection.names))
    said, warnings = agreement(found, sampled), fit_doubts(found)
    lines += [""] * bool(said or warnings)
    for sentence in said:
        lines += wrapped(sentence, "note: ")
    for warning in warnings:
        lines += wrapped(warning, "warning: ")
    return "\n".join(lines)


def fit_words(found: Identification) -> str:
    """How the parameters were fitted, and by which noise."""
    kind = "estimated from the misfit" if found.noise_estimated else "as given"
    noise = f"{number(found.noise[2], 3)} mm and {number(found.noise[0], 3)} degrees ({kind})"
    return (
        f"Fit by maximum likelihood: chi squared {number(found.chi2, 4)} for {found.data} measured "
        f"numbers, noise {noise}."
    )


def fit_doubts(found: Identification) -> list[str]:
    """What a reader of the fit must know."""
    notes = []
    if not found.converged:
        notes.append("The fit did not converge: free fewer parameters or start nearer.")
    lost = found.lost
    if lost:
        notes.append(f"{lost} measured poses count nowhere: the start has no balance there.")
    per_freedom = found.chi2 / max(found.spare, 1)
    if not found.noise_estimated and found.spare > 0 and per_freedom > _MISFIT:
        notes.append(
            f"The fit misses the data by {np.sqrt(per_freedom):.2g} times the noise that was "
            "given: the model lacks something, or the noise is larger; all limits are too narrow."
        )
    if found.spare <= 0:
        notes.append(
            f"{found.data} measured numbers for {len(found.values)} parameters: fewer data than "
            "unknowns; what follows is what priors leave."
        )
    for profile in found.profiles:
        if profile.better:
            notes.append(
                f"Along the profile of {profile.name} chi squared falls {profile.better:.3g} below "
                "the fit: there is a better fit; start the calibration from there."
            )
    names = [n for n, on in zip(found.selection.names, found.at_bound, strict=True) if on]
    if names:
        notes.append(
            f"On a bound: {', '.join(names)}. Standard errors of the others hold them there."
        )
    return notes


def agreement(found: Identification, sampled: Posterior | None = None) -> list[str]:
    """Say where standard error, profile and posterior tell different stories.

    Args:
        found: the fit, its information and its profiles.
        sampled: the posterior, if it was sampled.

    Returns:
        Sentences; one that says so where all agree.
    """
    by_name = {profile.name: profile for profile in found.profiles}
    if not by_name:
        return []
    bent, moved = [], []
    for i, name in enumerate(found.selection.names):
        profile = by_name[name]
        if found.intervals[i].kind is not IntervalKind.STANDARD_ERROR:
            bent.append(name)
        if sampled is not None:
            drawn = sampled.quantiles((0.025, 0.975))[i]
            if profile.closed and not same_ends((profile.low, profile.high), drawn):
                moved.append(name)
    notes = []
    if bent:
        notes.append(
            f"The standard error does not tell the limits of {', '.join(bent)}: the interval is "
            "asymmetric, or a bound cuts it; use the profile."
        )
    else:
        notes.append("Profiles agree with the standard errors: the problem is nearly linear.")
    if sampled is not None and moved:
        notes.append(
            f"Posterior and profile differ for {', '.join(moved)}: the prior speaks there, or the "
            "valley is wider elsewhere."
        )
    elif sampled is not None:
        notes.append("Posterior and profiles agree where the data limit a parameter.")
    return notes
