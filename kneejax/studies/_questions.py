"""What may be asked of a study, with every default. Plain data: help is printed without JAX.

A field is the option of the command of the same name, but for `indices`, which is `--global`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from kneejax.inference import Candidate


@dataclasses.dataclass(frozen=True)
class Identify:
    """Asks what the data can tell, what they cannot, and what should be measured next.

    Attributes:
        noise_mm: standard deviation of measured positions; the study's otherwise.
        noise_deg: of measured rotations; likewise.
        posterior: whether to sample it (packages BlackJAX and ArviZ).
        prior: name, `*.quantity` or quantity -> mean and standard deviation of a normal prior,
            which may be infinite; for the posterior.
        chains: of the posterior's samples.
        draws: of each chain, after warm-up.
        seed: of the random numbers.
        next_tests: how many tests to choose.
        criterion: what they make small: `D`, the volume of the confidence region, or `A`, the
            mean squared standard error.
        candidates: tests to choose from; None for a usual set.
    """

    noise_mm: float | None = None
    noise_deg: float | None = None
    posterior: bool = False
    prior: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    chains: int = 4
    draws: int = 1000
    seed: int = 0
    next_tests: int = 3
    criterion: str = "D"
    candidates: Sequence[Candidate] | None = None


@dataclasses.dataclass(frozen=True)
class Map:
    """Asks how the objective looks over pairs of parameters.

    Attributes:
        pair: pairs of parameters; the first goes along x.
        all_pairs: whether every pair of the study's parameters is meant too.
        grid: points along x and y.
        range: parameter of a pair -> lowest and highest value; the study's bounds otherwise.
    """

    pair: Sequence[tuple[str, str]] = ()
    all_pairs: bool = False
    grid: tuple[int, int] = (41, 41)
    range: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """Asks what each parameter does to the motion.

    Attributes:
        sweep: name or wildcard -> first and last value, and how many if not as many as usual; None
            for the usual ones. Empty for all of the study's parameters.
        scale: of local derivatives: per standard deviation of a `prior`, or per `percent`.
        prior: name, `*.quantity` or quantity -> standard deviation; usual ones otherwise.
        indices: global indices of the motion too: `sobol` or `morris` (package SALib).
        samples: points of Sobol's sequence, a power of two, or Morris trajectories; None for 256
            or 64.
        range: name, `*.quantity` or quantity -> lowest and highest value, for global indices; as
            wide as its prior otherwise.
        seed: of the random numbers.
    """

    sweep: Mapping[str, tuple[float, ...] | None] = dataclasses.field(default_factory=dict)
    scale: str = "prior"
    prior: Mapping[str, float] = dataclasses.field(default_factory=dict)
    indices: str | None = None
    samples: int | None = None
    range: Mapping[str, tuple[float, float]] = dataclasses.field(default_factory=dict)
    seed: int = 0
