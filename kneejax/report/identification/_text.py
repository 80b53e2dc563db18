"""What data determine, as tables: estimates with limits by curvature, profile and posterior."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.inference import Interval, IntervalKind, same_ends
from kneejax.parameters import sums_in_words
from kneejax.report.identification._information_words import reason_words
from kneejax.report.look import aligned, number, wrapped

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


def estimate_rows(found: Identification, sampled: Posterior | None = None) -> list[dict[str, Any]]:
    """List estimates and their limits for a table.

    Args:
        found: the fit, its information and its profiles.
        sampled: the posterior, if it was sampled.

    Returns:
        One dictionary per parameter, with the keys `ESTIMATE_COLUMNS` in that order.
    """
    by_name = {profile.name: profile for profile in found.profiles}
    ends = None if sampled is None else sampled.quantiles((0.025, 0.975))
    rows = []
    for i, name in enumerate(found.selection.names):
        profile, interval = by_name.get(name), _interval(found, i)
        rows.append(
            {
                "name": name,
                "value": float(found.values[i]),
                "unit": found.selection.unit(i),
                "lower": float(found.lower[i]),
                "upper": float(found.upper[i]),
                "at_bound": bool(found.at_bound[i]),
                "standard_error": float(found.information.standard_error[i]),
                "profile_low": profile.low if profile else None,
                "profile_high": profile.high if profile else None,
                "profile_low_open": profile.low_open if profile else None,
                "profile_high_open": profile.high_open if profile else None,
                "posterior_mean": None if sampled is None else float(sampled.mean[i]),
                "posterior_sd": None if sampled is None else float(sampled.sd[i]),
                "posterior_low": None if ends is None else float(ends[i, 0]),
                "posterior_high": None if ends is None else float(ends[i, 1]),
                "r_hat": None if sampled is None else float(sampled.r_hat[i]),
                "effective_sample_size": None
                if sampled is None
                else float(sampled.effective_sample_size[i]),
                "interval": None if interval is None else interval.kind.value,
                "determined": _determined(found, i),
                "reason": "" if _determined(found, i) else _why(found, i),
            }
        )
    return rows


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
    head = ["parameter", "estimate", "standard error"]
    if found.profiles:
        head.append("95 % by profile")
    if sampled is not None:
        head.append("95 % by posterior")
    table = [[*head, "unit"]]
    for row in estimate_rows(found, sampled):
        words = [row["name"], number(row["value"], 4), _error(row)]
        if found.profiles:
            low = "open" if row["profile_low_open"] else number(row["profile_low"], 4)
            high = "open" if row["profile_high_open"] else number(row["profile_high"], 4)
            words.append(f"{low} to {high}")
        if sampled is not None:
            ends = number(row["posterior_low"], 4), number(row["posterior_high"], 4)
            words.append(" to ".join(ends))
        table.append([*words, row["unit"]])
    kind = "estimated from the misfit" if found.noise_estimated else "as given"
    noise = f"{number(found.noise[2], 3)} mm and {number(found.noise[0], 3)} degrees ({kind})"
    lines = wrapped(
        f"Fit by maximum likelihood: chi squared {number(found.chi2, 4)} for {found.data} measured "
        f"numbers, noise {noise}."
    )
    lines += ["", *aligned(table, (0, len(table[0]) - 1))]
    lines += wrapped(sums_in_words(found.problem.knee, found.selection.names))
    said, warnings = agreement(found, sampled), fit_doubts(found)
    lines += [""] * bool(said or warnings)
    for sentence in said:
        lines += wrapped(sentence, "note: ")
    for warning in warnings:
        lines += wrapped(warning, "warning: ")
    return "\n".join(lines)


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


def _error(row: dict[str, Any]) -> str:
    """The standard error where it tells the limits."""
    means = row["interval"] in (None, IntervalKind.STANDARD_ERROR.value)
    return number(row["standard_error"], 2) if means else number(np.nan)


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
