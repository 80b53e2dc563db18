"""Global sensitivity: Sobol and Morris indices of any model, by SALib (extra `sensitivity`)."""

from __future__ import annotations

import dataclasses
import importlib
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kneejax.numerics import Named
from kneejax.parameters import UnsuitableData

#: Method -> measures in the order of tables; the first ranks the parameters.
MEASURES = {"sobol": ("total_order", "first_order"), "morris": ("mu_star", "sigma", "mu")}
#: What SALib calls a measure, where it has a name of its own; and measures without an interval.
_SALIB_NAMES, _BARE = {"total_order": "ST", "first_order": "S1"}, ("sigma", "mu")
#: Samples where nobody says how many.
USUAL_SAMPLES = {"sobol": 256, "morris": 64}
#: Fewest blocks from which anything is computed.
FEWEST = {"sobol": 32, "morris": 4}
#: Beyond this part of blocks left out, what is left no longer stands for the ranges.
MOST_LEFT_OUT = 0.1
_LEVELS, _RESAMPLES = 4, 200
# Of the variance of an output that only rounding makes vary.
_CONSTANT = 1e-12


@dataclasses.dataclass(frozen=True)
class GlobalIndices(Named):
    """How much of each output each parameter explains over its range.

    Sobol: `first_order` is the part of an output's variance that a parameter explains by itself,
    `total_order` the part that it has a share in. Morris: `mu_star` is the mean size of the change
    of an output over a parameter's range (by slopes across two thirds of it), `mu` the same with
    its sign, `sigma` how much it depends on where everything stands.

    Attributes:
        method: `sobol` or `morris`.
        names: parameters, `(p,)`.
        outputs: their names.
        lower: lower ends of the ranges, `(p,)`.
        upper: upper ends, `(p,)`.
        measures: name -> values, `(outputs, p)`; NaN for an output that does not vary.
        half_widths: name -> half widths of the confidence intervals, `(outputs, p)`; of those
            measures that have one.
        confidence: of these intervals, e.g. 0.95.
        runs: evaluations of the model.
        failed: those without an answer.
        blocks: groups of runs that belong together: `p + 2` a Sobol point, `p + 1` a trajectory.
        left_out: blocks left out because one of their runs failed.
    """

    method: str
    names: tuple[str, ...]
    outputs: tuple[str, ...]
    lower: np.ndarray
    upper: np.ndarray
    measures: dict[str, np.ndarray]
    half_widths: dict[str, np.ndarray]
    confidence: float
    runs: int
    failed: int
    blocks: int
    left_out: int

    OVER = {"parameter": {"lower": "", "upper": ""}}

    def _named(self) -> dict[str, tuple]:
        over = "output parameter"
        halves = {f"{name}_half_width": (over, x) for name, x in self.half_widths.items()}
        labels = {"output": ("output", self.outputs), "parameter": ("parameter", self.names)}
        measures = {name: (over, x) for name, x in self.measures.items()}
        return super()._named() | labels | measures | halves

    @property
    def doubtful(self) -> bool:
        """Whether so much was left out that the indices no longer stand for the ranges."""
        return self.left_out > MOST_LEFT_OUT * self.blocks

    @property
    def treatment(self) -> str:
        """What was done about failed runs, in a sentence; empty if there are none."""
        if not self.failed:
            return ""
        kind = "Saltelli blocks" if self.method == "sobol" else "trajectories"
        sentence = (
            f"{self.failed} of {self.runs} runs failed; the {self.left_out} of {self.blocks} "
            f"{kind} that contain one were left out whole, so the indices describe the part of the "
            "ranges in which the model has an answer"
        )
        if self.blocks - self.left_out < FEWEST[self.method]:
            return sentence + ": too few are left, nothing was computed; narrow the ranges"
        return sentence + ("; narrow the ranges for a fair picture" if self.doubtful else "")


def global_indices(
    model: Callable[[np.ndarray], ArrayLike],
    names: Sequence[str],
    lower: ArrayLike,
    upper: ArrayLike,
    *,
    method: str = "sobol",
    samples: int = 256,
    seed: int = 0,
    outputs: Sequence[str] = ("output",),
    confidence: float = 0.95,
) -> GlobalIndices:
    """Sobol or Morris indices of a model whose parameters are uniform over ranges.

    SALib cannot take runs that failed. Runs belong together in blocks (a point of the sequence
    with its copies in which one coordinate each is exchanged; a trajectory of Morris): a block with
    a failed run is left out whole, which keeps the others valid.

    Args:
        model: values `(runs, p)` -> outputs `(runs, outputs)`, NaN where a run fails.
        names: parameters, `(p,)`.
        lower: lower ends, `(p,)`.
        upper: upper ends, `(p,)`.
        method: `sobol` or `morris`.
        samples: points of the Sobol sequence, a power of two, or trajectories of Morris.
        seed: of the sampling and of the bootstrap.
        outputs: names of the model's outputs.
        confidence: of the intervals, by bootstrap.

    Returns:
        The `GlobalIndices`.

    Raises:
        UnsuitableData: an unknown method, ends exchanged, too few samples, points that are no power
            of two, or SALib is not installed.

    Source: Saltelli et al., Computer Physics Communications 181, 2010; Campolongo et al.,
        Environmental Modelling & Software 22, 2007; computed by SALib.

    Example:
        >>> def model(x):
        ...     return x[:, 0] + 0.0 * x[:, 1]
        >>> found = global_indices(model, ["strong", "idle"], [0, 0], [1, 1], samples=64)
        >>> found.measures["total_order"].round(1).ravel().tolist()
        [1.0, 0.0]
    """
    lower, upper = np.asarray(lower, float), np.asarray(upper, float)
    check_request(method, names, lower, upper, samples)
    bounds = np.column_stack([lower, upper]).tolist()
    problem = {"num_vars": len(names), "names": list(names), "bounds": bounds}
    # To SALib a seed of 0 is none.
    x, analyse = _scheme(method, problem, samples, seed + 1, confidence)
    y = np.asarray(model(x), float).reshape(len(x), len(outputs))
    sound = np.isfinite(y).all(axis=1)
    size = len(x) // samples
    whole = sound.reshape(samples, size).all(axis=1)
    kept = np.repeat(whole, size)

    enough = whole.sum() >= FEWEST[method]
    columns = np.ascontiguousarray(y[kept].T)
    found = [analyse(x[kept], y) if enough and np.ptp(y) > _CONSTANT * np.abs(y).max() else None
             for y in columns]

    def table(key: str) -> np.ndarray:
        unknown = np.full(len(names), np.nan)
        return np.array([unknown if one is None else one[key] for one in found], float)

    keys = {name: _SALIB_NAMES.get(name, name) for name in MEASURES[method]}
    measures = {name: table(key) for name, key in keys.items()}
    halves = {name: table(f"{key}_conf") for name, key in keys.items() if name not in _BARE}
    return GlobalIndices(
        method, tuple(names), tuple(outputs), lower, upper, measures, halves, confidence, len(x),
        int((~sound).sum()), samples, int((~whole).sum()),
    )  # fmt: skip


def check_request(method: str, names, lower: np.ndarray, upper: np.ndarray, samples: int) -> None:
    """Refuse, before anything is computed, what `global_indices` cannot do."""
    if method not in MEASURES:
        raise UnsuitableData(f"unknown method {method!r}: expected one of {', '.join(MEASURES)}")
    for name, low, high in zip(names, lower, upper, strict=True):
        if not low < high:
            raise UnsuitableData(f"{name}: range {low:g} to {high:g}: expected lower below upper")
    if samples < FEWEST[method]:
        kind = "points of the Sobol sequence" if method == "sobol" else "trajectories"
        raise UnsuitableData(f"{samples} {kind}: expected at least {FEWEST[method]}")
    if method == "sobol" and samples & (samples - 1):
        power = 2 ** int(np.ceil(np.log2(samples)))
        raise UnsuitableData(
            f"{samples} points of the Sobol sequence: expected a power of two, such as {power}: "
            "only then are they spread evenly"
        )


def _scheme(method: str, problem: dict, samples: int, seed: int, confidence: float):
    """The runs to make, `(runs, p)`, and what is to be done with their outputs."""
    try:
        analyze = importlib.import_module(f"SALib.analyze.{method}").analyze
        sample = importlib.import_module(f"SALib.sample.{method}").sample
    except ModuleNotFoundError as missing:
        raise UnsuitableData(
            f"global indices need the package SALib ({missing.name} is missing): "
            "pip install 'kneejax[sensitivity]'"
        ) from None
    own = {"calc_second_order": False} if method == "sobol" else {"num_levels": _LEVELS}
    options = {"num_resamples": _RESAMPLES, "conf_level": confidence, "seed": seed, **own}

    def analyse(x: np.ndarray, y: np.ndarray):
        return analyze(problem, *([y] if method == "sobol" else [x, y]), **options)

    return sample(problem, samples, seed=seed, **own), analyse
