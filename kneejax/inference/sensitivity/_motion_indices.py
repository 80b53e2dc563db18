"""Global sensitivity of a knee's motion: indices whose model is the batch of balances."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence

import numpy as np

from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.inference.fit import DEFAULT_WEIGHTS
from kneejax.inference.sensitivity._global_indices import (
    USUAL_SAMPLES,
    GlobalIndices,
    check_request,
    global_indices,
)
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

#: Half a range where none is stated, in standard deviations of the prior: that of a uniform
#: distribution is then the same.
_DEVIATIONS = 3.0**0.5
#: Angles at which the coordinates themselves are outputs.
_ANGLES = 5


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

    outputs = _outputs(flexion[at])
    indices = global_indices(
        model, selection.names, lower, upper, method=method, samples=samples, seed=seed,
        outputs=[one.name for one in outputs],
    )  # fmt: skip
    return MotionIndices(indices, outputs, tuple(left_out.tolist()))


def _outputs(flexion_deg: np.ndarray) -> tuple[Output, ...]:
    units = [(name, COORDINATES[name].unit) for name in FREE_COORDINATES]
    poses = [
        Output(f"{name} at {angle:g} deg", unit, name, float(angle))
        for name, unit in units
        for angle in flexion_deg
    ]
    errors = [Output(f"rmse of {name}", unit, name, None) for name, unit in units]
    return (*poses, *errors, Output("objective", "", "", None))


def index_ranges(
    knee: Knee,
    selection: Selection,
    bounds: Mapping[str, tuple[float, float]] | None,
    ranges: Mapping[str, tuple[float, float]] | None,
    priors: Mapping[str, float] | None,
    *,
    method: str,
    samples: int,
) -> tuple[np.ndarray, np.ndarray]:
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
