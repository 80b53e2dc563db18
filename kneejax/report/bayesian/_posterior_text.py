"""A posterior for a terminal and for tables."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import Column, Table, number, wrapped

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


def posterior_table(found: Posterior) -> Table:
    """What the draws say of each parameter.

    Args:
        found: the posterior.

    Returns:
        A row per parameter under the columns `POSTERIOR_COLUMNS`; people see mean, spread, 95 %
        limits, the spread of the normal approximation at the most probable parameters (Laplace),
        R-hat and the effective number of draws.
    """
    low, middle, high = found.quantiles((0.025, 0.5, 0.975)).T
    laplace_sd = np.sqrt(np.diag(found.laplace_covariance))
    values = (
        found.names, found.units, found.mean, found.sd, low, middle, high, found.laplace_mean,
        laplace_sd, [p.mean for p in found.priors], [p.sd for p in found.priors],
        [p.lower for p in found.priors], [p.upper for p in found.priors], found.r_hat,
        found.effective_sample_size, found.tail_effective_sample_size,
    )  # fmt: skip
    two = functools.partial(number, digits=2)
    seen = {
        "name": ("parameter", None), "unit": ("unit", None), "mean": ("mean", None),
        "sd": ("sd", two), "quantile_025": ("2.5 %", None), "quantile_975": ("97.5 %", None),
        "laplace_sd": ("Laplace sd", two), "r_hat": ("R-hat", lambda value: f"{value:.3f}"),
        "effective_sample_size": ("eff.", lambda value: f"{value:.0f}"),
    }  # fmt: skip
    columns = [
        Column(name, *seen.get(name, ("", None)), name in ("name", "unit"), name in seen)
        for name in POSTERIOR_COLUMNS
    ]
    plain = [[x if isinstance(x, str) else float(x) for x in column] for column in values]
    return Table(columns, list(zip(*plain, strict=True)))


def draws_table(found: Posterior) -> Table:
    """Every draw of every chain, the table of posterior.csv."""
    columns = [Column(name) for name in ("chain", "draw", *found.names)]
    rows = [
        [chain, number, *draw]
        for chain, draws in enumerate(found.draws)
        for number, draw in enumerate(draws)
    ]
    return Table(columns, rows)


def sampling_words(found: Posterior) -> str:
    """How the posterior was sampled."""
    chains, draws, _ = found.draws.shape
    return (
        f"Posterior by NUTS: {chains} chains of {draws} draws, noise "
        f"{found.settings['noise_mm']:g} mm and {found.settings['noise_deg']:g} degrees, "
        f"{found.divergences} divergent, {number(found.seconds['total'], 3)} s "
        f"({number(found.seconds['compile'], 3)} s until the first draws)"
    )


def posterior_summary(found: Posterior) -> str:
    """Say on a terminal what a posterior is.

    Args:
        found: the posterior.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    lines = [*wrapped(sampling_words(found)), posterior_table(found).terminal()]
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
