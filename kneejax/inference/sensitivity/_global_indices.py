"""Sobol and Morris indices of any model, by SALib (extra `sensitivity`), and of a knee's motion."""

__all__ = [
    "USUAL_SAMPLES", "GlobalIndices", "MotionIndices", "Output", "global_indices", "index_ranges",
    "motion_indices",
]

import dataclasses
import importlib
from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference.fit import DEFAULT_WEIGHTS
from kneejax.mechanics import Knee
from kneejax.numerics import Named
from kneejax.parameters import (
    Selection,
    UnsuitableData,
    doubt_value,
    looked_up,
    prior_scales,
    select,
    stated,
)
from kneejax.statics import FAILURES, LoadCases, Progress, Status, balance_many, fails

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
#: Half a range where none is stated, in standard deviations of the prior: that of a uniform
#: distribution is then the same.
_DEVIATIONS = 3.0**0.5
#: Angles at which the coordinates themselves are outputs.
_ANGLES = 5


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


@dataclasses.dataclass(frozen=True)
class Output:
    """One number of a motion.

    Attributes:
        name: for tables.
        unit: `mm`, `deg`, or empty.
        coordinate: the free coordinate; empty for the objective.
        flexion_deg: where; None for what sums over all angles.
    """

    name: str
    unit: str
    coordinate: str
    flexion_deg: float | None


@dataclasses.dataclass(frozen=True)
class MotionIndices(Named):
    """Global indices of a knee's motion.

    Attributes:
        indices: see `GlobalIndices`; their outputs are, in order, those below.
        outputs: each coordinate at some angles, then each coordinate's root mean square error
            against the measurement, then the objective.
        left_out_deg: measured angles that count nowhere: the knee itself does not balance there.
    """

    indices: GlobalIndices
    outputs: tuple[Output, ...]
    left_out_deg: tuple[float, ...]

    def _named(self) -> dict[str, tuple]:
        units = {"output_unit": ("output", [one.unit for one in self.outputs])}
        return self.indices._named() | units

    @property
    def flexion_deg(self) -> tuple[float, ...]:
        """Angles at which coordinates are outputs."""
        angles = (one.flexion_deg for one in self.outputs if one.flexion_deg is not None)
        return tuple(dict.fromkeys(angles))

    def row(self, coordinate: str, flexion_deg: float | None = None) -> int:
        """Row of an output; the objective is the coordinate without a name."""
        wanted = (coordinate, flexion_deg)
        return [(one.coordinate, one.flexion_deg) for one in self.outputs].index(wanted)


def motion_indices(
    knee: Knee,
    parameters: Sequence[str],
    measured: np.ndarray,
    *,
    weights: np.ndarray | None = None,
    offsets: Sequence[str] = (),
    bounds: Mapping[str, tuple[float, float]] | None = None,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    priors: Mapping[str, float] | None = None,
    method: str = "sobol",
    samples: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    failures: Collection[Status] = FAILURES,
) -> MotionIndices:
    """Sobol or Morris indices of a motion and of how far it is from a measured one.

    A run fails if the knee does not balance, or not stably, at any angle.

    Args:
        knee: gives everything that is not varied, and the middle of the ranges.
        parameters: names or wildcards.
        measured: poses to compare with, `(n, 6)`, degrees and mm.
        weights: of the objective, `(5,)`; by default 8 per degree^2 and 1 per mm^2 (paper 1).
        offsets: free coordinates whose constant difference to the measurement is unknown; each
            run gets the one that suits it best.
        bounds: name, wildcard or quantity -> limits that no usual range exceeds.
        ranges: likewise, ranges; those of the same standard deviation as the prior otherwise.
        priors: likewise, standard deviations; usual ones otherwise (see `prior_scales`).
        method: `sobol` or `morris`.
        samples: points of the Sobol sequence (a power of two, 256 by default), or trajectories of
            Morris (64 by default).
        seed: of the sampling and of the bootstrap.
        progress: called now and then with balances done and asked for.
        failures: statuses of balances that count for nothing.

    Returns:
        The `MotionIndices`.

    Raises:
        UnknownParameter: a name that the knee or the selection does not have.
        UnsuitableData: see `global_indices`; or one parameter only, which explains all there is.
    """
    samples = USUAL_SAMPLES.get(method, 0) if samples is None else samples
    selection = select(knee, tuple(parameters))
    lower, upper = index_ranges(
        knee, selection, bounds, ranges, priors, method=method, samples=samples
    )
    base = np.asarray(selection.read(knee))
    measured = np.asarray(measured, float)
    # Load cases ascend; a measurement may run to and fro.
    flexion = np.unique(measured[:, 0])
    own = balance_many(knee, selection.apply, base[None], LoadCases.at(flexion))
    held = ~fails(own.status[0], failures)
    if not held.any():
        raise UnsuitableData("the knee itself is balanced and stable at no measured flexion")
    flexion, left_out = flexion[held], flexion[~held]
    measured = measured[np.isin(measured[:, 0], flexion)]
    row = np.searchsorted(flexion, measured[:, 0])
    at = np.unique(np.linspace(0, len(flexion) - 1, _ANGLES).round().astype(int))
    weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    free = [FREE_COORDINATES.index(name) for name in offsets]

    def model(values: np.ndarray) -> np.ndarray:
        load_cases = LoadCases.at(flexion)
        found = balance_many(knee, selection.apply, values, load_cases, progress=progress)
        failed = np.any(fails(found.status, failures), axis=1)
        error = found.table[:, row] - measured[:, 1:]
        error[..., free] -= error[..., free].mean(axis=1, keepdims=True)
        poses = np.swapaxes(found.table[:, at], 1, 2).reshape(len(values), -1)
        rmse = np.sqrt((error**2).mean(axis=1))
        objective = (error**2).sum(axis=1) @ weights
        return np.where(failed[:, None], np.nan, np.column_stack([poses, rmse, objective]))

    units = [(name, COORDINATES[name].unit) for name in FREE_COORDINATES]
    outputs = (
        *(Output(f"{name} at {angle:g} deg", unit, name, angle)
          for name, unit in units for angle in flexion[at].tolist()),
        *(Output(f"rmse of {name}", unit, name, None) for name, unit in units),
        Output("objective", "", "", None),
    )  # fmt: skip
    indices = global_indices(
        model, selection.names, lower, upper, method=method, samples=samples, seed=seed,
        outputs=[one.name for one in outputs],
    )  # fmt: skip
    return MotionIndices(indices, outputs, tuple(left_out.tolist()))


def index_ranges(
    knee: Knee, selection: Selection, bounds: Mapping[str, tuple[float, float]] | None,
    ranges: Mapping[str, tuple[float, float]] | None, priors: Mapping[str, float] | None, *,
    method: str, samples: int,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Ends of each parameter's range, `(p,)` each; refuses as `motion_indices` does, whose
    arguments these are."""
    if len(selection) < 2:
        raise UnsuitableData(f"global indices of {selection}: expected at least two parameters")
    base = np.asarray(selection.read(knee))
    half = _DEVIATIONS * prior_scales(selection, base, priors)
    lower, upper = base - half, base + half
    asked_for = stated(selection, ranges or {}, "range")
    pairs = zip(looked_up(selection, bounds or {}), asked_for, strict=True)
    for i, (limits, asked) in enumerate(pairs):
        if limits is not None:
            lower[i], upper[i] = max(lower[i], limits[0]), min(upper[i], limits[1])
        if asked is not None:
            lower[i], upper[i] = asked
            doubt_value(knee, selection.names[i], asked[1])
    check_request(method, selection.names, lower, upper, samples)
    return lower, upper
