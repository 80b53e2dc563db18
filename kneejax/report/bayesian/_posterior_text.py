"""A posterior for a terminal and for tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look import aligned, number, with_error, wrapped

if TYPE_CHECKING:
    from kneejax.inference import Posterior

#: Above this R-hat, below this effective size, chains are not to be trusted (Vehtari et al. 2021).
_R_HAT, _EFFECTIVE_PER_CHAIN = 1.01, 100.0
# Of all trajectories; fewer than that only count (`Posterior.divergences`).
_FEW = 1e-3
# A posterior as wide as this part of its prior says little beyond it.
_LITTLE = 0.9
#: Columns of a table of a posterior.
POSTERIOR_COLUMNS = (
    "name", "unit", "mean", "sd", "quantile_025", "median", "quantile_975", "laplace_mean",
    "laplace_sd", "prior_mean", "prior_sd", "lower", "upper", "r_hat", "effective_sample_size",
    "tail_effective_sample_size",
)  # fmt: skip


def posterior_rows(found: Posterior) -> list[dict[str, Any]]:
    """List a posterior's parameters, for a table.

    Args:
        found: the posterior.

    Returns:
        One dictionary per parameter, with the keys `POSTERIOR_COLUMNS` in that order.
    """
    low, middle, high = found.quantiles((0.025, 0.5, 0.975)).T
    laplace_sd = np.sqrt(np.diag(found.laplace_covariance))
    columns = (
        found.names, found.units, found.mean, found.sd, low, middle, high, found.laplace_mean,
        laplace_sd, [p.mean for p in found.priors], [p.sd for p in found.priors],
        [p.lower for p in found.priors], [p.upper for p in found.priors], found.r_hat,
        found.effective_sample_size, found.tail_effective_sample_size,
    )  # fmt: skip
    plain = [[x if isinstance(x, str) else float(x) for x in column] for column in columns]
    return [dict(zip(POSTERIOR_COLUMNS, row, strict=True)) for row in zip(*plain, strict=True)]


def posterior_summary(found: Posterior) -> str:
    """Say on a terminal what a posterior is.

    Args:
        found: the posterior.

    Returns:
        Lines of fewer than 100 columns, without a final line break; `Laplace sd` is that of the
        normal approximation at the most probable parameters, `eff.` the effective number of draws.
    """
    chains, draws, _ = found.draws.shape
    lines = wrapped(
        f"Posterior by NUTS: {chains} chains of {draws} draws, noise "
        f"{found.settings['noise_mm']:g} mm and {found.settings['noise_deg']:g} degrees, "
        f"{found.divergences} divergent, {number(found.seconds['total'], 3)} s "
        f"({number(found.seconds['compile'], 3)} s until the first draws)"
    )
    rows = [("parameter", "mean", "sd", "2.5 %", "97.5 %", "unit", "Laplace sd", "R-hat", "eff.")]
    for row in posterior_rows(found):
        mean, sd = with_error(row["mean"], row["sd"])
        decimals = len(mean.partition(".")[2])
        rows.append(
            (
                row["name"],
                mean,
                sd,
                f"{row['quantile_025']:.{decimals}f}",
                f"{row['quantile_975']:.{decimals}f}",
                row["unit"],
                with_error(row["laplace_mean"], row["laplace_sd"])[1],
                f"{row['r_hat']:.3f}",
                f"{row['effective_sample_size']:.0f}",
            )
        )
    lines += aligned(rows, (0, 5))
    for sentence in posterior_doubts(found):
        lines += wrapped(sentence, "warning: ")
    return "\n".join(lines)


def posterior_doubts(result: Posterior) -> list[str]:
    """Sentences on what a reader must know before the numbers are used."""
    said, count = [], result.divergent.size
    if result.unbalanced:
        said.append(
            f"{result.unbalanced} of {count} trajectories ran into parameters with which a pose "
            "has no balance; the posterior ends there. Narrower priors or bounds keep away from it."
        )
    diverged = result.divergences - result.unbalanced
    if diverged > _FEW * count:
        said.append(
            f"{diverged} of {count} trajectories diverged: the posterior bends more sharply than "
            "the step size follows. Draw longer warm-ups, or give narrower priors."
        )
    apart = [n for n, r in zip(result.names, result.r_hat, strict=True) if not r <= _R_HAT]
    if apart:
        said.append(
            f"The chains disagree about {', '.join(apart)} (R-hat above {_R_HAT}): draw more, or "
            "look for several modes in the pair plot."
        )
    least = np.fmin(result.effective_sample_size, result.tail_effective_sample_size)
    enough = _EFFECTIVE_PER_CHAIN * len(result.draws)
    few = [n for n, e in zip(result.names, least, strict=True) if not e >= enough]
    if few:
        said.append(
            f"Fewer than {enough:.0f} effective draws of {', '.join(few)}: quantiles are rough; "
            "draw more."
        )
    prior_spread = np.array([prior.spread for prior in result.priors])
    idle = [n for n, s in zip(result.names, result.sd > _LITTLE * prior_spread, strict=True) if s]
    if idle:
        said.append(
            f"These data say little about {', '.join(idle)}: what is shown is the prior, or what "
            "the bounds leave of it."
        )
    if result.measured[:, 1:].size < len(result.names):
        said.append(
            f"{result.measured[:, 1:].size} measured numbers for {len(result.names)} parameters: "
            "the priors decide between them."
        )
    return said
