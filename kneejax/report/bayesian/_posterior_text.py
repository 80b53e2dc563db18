"""A posterior for a terminal and for tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look import aligned, number, with_error, wrapped

if TYPE_CHECKING:
    from kneejax.inference import Posterior

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
    for sentence in found.warnings:
        lines += wrapped(sentence, "warning: ")
    return "\n".join(lines)
