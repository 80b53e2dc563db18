"""Calibration: which ligaments make the model move as measured, and how sure that is."""

from __future__ import annotations

import importlib.metadata
import platform
import time
from typing import Any

import jax.numpy as jnp
import numpy as np

from kneejax.experiments import doubts, with_flips
from kneejax.experiments import evaluate as evaluate_mechanics
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference._information import slack_poses
from kneejax.inference._parameters import (
    QUANTITIES,
    UnsuitableData,
    select,
    start_within,
    stated_bounds,
)
from kneejax.inference._problem import DEFAULT_WEIGHTS, Evaluation, Problem
from kneejax.inference._result import Calibration, Estimate, Fit, Motion
from kneejax.inference._search import METHODS, Trail, run_procedure, several_starts
from kneejax.inference._uncertainty import uncertainty
from kneejax.mechanics import Knee
from kneejax.statics import Status

_PACKAGES = ("kneejax", "jax", "jaxlib", "optimistix", "equinox", "lineax", "numpy", "jaxopt")
#: A parameter counts as undetermined when its standard error is beyond this part of its bounds.
_UNSURE = 0.5


def calibrate(
    knee: Knee,
    measured: np.ndarray,
    parameters: tuple[str, ...] = ("*.stiffness", "*.reference_strain"),
    *,
    bounds: dict[str, tuple[float, float]] | None = None,
    weights: np.ndarray | None = None,
    procedures: tuple[str, ...] = ("II", "I", "III"),
    offsets: tuple[str, ...] = (),
    starts: int = 1,
    seed: int = 0,
    method: str = "least_squares",
    cycles: int = 200,
    truth: dict[str, float] | None = None,
    title: str = "Calibration",
    settings: dict[str, Any] | None = None,
) -> Calibration:
    """Identify parameters of a knee from measured poses.

    Args:
        knee: gives everything that is not free, and the start of what is.
        measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; flexion is
            prescribed, the other five are compared.
        parameters: names, with `*` for every ligament.
        bounds: by name; those of paper 1 for stiffness and reference strain by default.
        weights: `(5,)`; by default 8 per degree^2 and 1 per mm^2 (paper 1).
        procedures: any of `I`, `II`, `III`; the first is reported as the answer.
        offsets: free coordinates whose constant difference between measured and model frame is
            unknown too.
        starts: number of starts of procedure III, drawn between the bounds besides the knee's.
        seed: of those draws.
        method: `least_squares`, or `lbfgsb` to minimise the objective by jaxopt's L-BFGS-B, which
            takes seconds for each step of a procedure.
        cycles: how often procedures I and II may repeat their two steps (paper 1: once).
        truth: values that made the data, for synthetic studies.
        title: for the report.
        settings: recorded with the result.

    Returns:
        The `Calibration`.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, numbers that are not finite,
            no pose that balances, or a method that is unknown or not installed.

    Source: paper 1, sections 2.3 and 3.4.
    """
    begun = time.perf_counter()
    if method not in METHODS:
        raise UnsuitableData(f"unknown method {method!r}: expected one of {', '.join(METHODS)}")
    selection = select(knee, parameters)
    offset_rows = tuple(FREE_COORDINATES.index(name) for name in offsets)
    weights = DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    problem = Problem(knee, selection, np.asarray(measured, float), weights, offset_rows)
    if not np.isfinite(problem.measured).all():
        row = int(np.flatnonzero(~np.isfinite(problem.measured).all(axis=1))[0])
        raise UnsuitableData(f"measured row {row} is not finite: leave it out")
    lower, upper = stated_bounds(knee, selection, bounds or {})
    start = np.r_[start_within(knee, selection, lower, upper), np.zeros(len(offset_rows))]
    # A frame is rarely off by more than 10 mm or 10 degrees.
    wide = np.full(len(offset_rows), 10.0)
    lower, upper = np.r_[lower, -wide], np.r_[upper, wide]

    first = problem.poses(start)
    ready = time.perf_counter()
    balanced = np.asarray(first.settled.converged)
    if not balanced.any():
        raise UnsuitableData("no measured flexion has a balance with the start's parameters")
    problem.use_only(balanced)
    fits, spread = [], ()
    for procedure in procedures:
        problem.keep(start, first)
        begin, reached = start, ()
        if starts > 1 and procedure == "III":
            draws = np.random.default_rng(seed).uniform(lower, upper, (starts - 1, len(start)))
            ends, spread = several_starts(problem, np.vstack([start, draws]), lower, upper)
            reached = tuple(float(z) for z in np.sort(spread))
            begin = ends[np.argmin(spread)]
            problem.keep(start, first)
        trail = run_procedure(problem, procedure, begin, lower, upper, cycles, method=method)
        fits.append(_fit(problem, procedure, trail, start, lower, upper, reached))
    error = problem.error(start, first)
    total = time.perf_counter() - begun
    return Calibration(
        title=title,
        knee=knee.name,
        measured=problem.measured,
        start=_motion(problem, start, first),
        start_rmse=_rmse(problem, error),
        start_partial_objectives=_partial(problem, error),
        start_objective=_objective(problem, error),
        fits=tuple(fit for fit, _ in fits),
        ligaments=knee.ligaments.names,
        contacts=knee.contact_names,
        truth=dict(truth or {}),
        frame_offset=fits[0][1],
        notes=_notes(problem, fits[0][0]),
        seconds={
            "total": total,
            "compile": ready - begun,
            "solve": total - (ready - begun),
        },
        versions=versions(),
        settings=dict(settings or {}),
    )


def versions() -> dict[str, str]:
    """Versions of everything that a number in a result depends on."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _fit(problem: Problem, procedure: str, trail: Trail, start, lower, upper, reached):
    found = problem.poses(trail.x)
    error, jacobian = problem.error(trail.x, found), problem.jacobian(found)
    width = upper - lower
    on_bound = (trail.x - lower < 1e-9 * width) | (upper - trail.x < 1e-9 * width)
    # Rows without a balance say nothing, and rows left out may be NaN.
    shown = np.where(problem.used, error, np.nan)
    sure = uncertainty(jacobian, shown, problem.weights, on_bound)
    names, size = problem.selection.names, len(problem.selection)
    slack = _slack_ligaments(problem, trail.x, found)
    estimates = []
    for i, name in enumerate(names):
        bar, remark = float(sure.standard_error[i]), ""
        if on_bound[i]:
            remark = "on its bound: the data would move it further"
        elif not bar < _UNSURE * width[i]:
            remark = "not determined by these data"
            if slack.get(problem.selection.ligament(i), 0.0) == 1.0:
                remark += ": its ligament is slack at every pose"
            elif slack.get(problem.selection.ligament(i), 0.0) > 0:
                part = slack[problem.selection.ligament(i)]
                remark += f": its ligament is slack at {part:.0%} of the poses"
        estimates.append(
            Estimate(
                name,
                QUANTITIES[problem.selection.quantity(i)],
                float(trail.x[i]),
                float(start[i]),
                float(lower[i]),
                float(upper[i]),
                bar,
                bool(on_bound[i]),
                remark,
            )
        )
    offset = tuple(
        (FREE_COORDINATES[row], float(trail.x[size + k]), float(sure.standard_error[size + k]))
        for k, row in enumerate(problem.offsets)
    )
    failed = int((~np.asarray(found.settled.converged)).sum())
    message = "converged" if trail.converged else trail.reason or "stopped before it converged"
    if trail.flat:
        message = "converged to within the noise: further steps gained nothing that counts"
    if failed:
        message += f"; {failed} of {len(problem.measured)} poses have no balance"
    fit = Fit(
        procedure,
        tuple(estimates),
        _objective(problem, error),
        _partial(problem, error),
        _rmse(problem, error),
        sure.correlation[:size, :size],
        _motion(problem, trail.x, found),
        tuple(trail.history),
        {
            "residual": trail.evaluations,
            "jacobian": trail.evaluations,
            "equilibria": trail.evaluations * len(problem.measured),
            **trail.counts,
        },
        bool(trail.converged and not failed),
        message,
        reached,
    )
    return fit, offset


def _motion(problem: Problem, x: np.ndarray, found: Evaluation) -> Motion:
    knee = problem.selection.apply(problem.knee, jnp.asarray(x[: len(problem.selection)]))
    mechanics = evaluate_mechanics(knee, found.settled.pose, found.settled.meeting)
    table = np.column_stack([problem.measured[:, 0], np.asarray(found.table).T])
    return Motion(
        table,
        with_flips(found.settled.status, mechanics),
        np.asarray(mechanics.tension),
        np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1),
        doubts(knee, mechanics),
    )


def _slack_ligaments(problem: Problem, x: np.ndarray, found: Evaluation) -> dict[str, float]:
    """Ligament or group -> part of the poses at which it is slack."""
    knee = problem.selection.apply(problem.knee, jnp.asarray(x[: len(problem.selection)]))
    slack = slack_poses(knee, found.settled.pose, found.settled.meeting)
    return {name: float(np.mean(where)) for name, where in slack.items()}


def _squares(problem: Problem, error: np.ndarray) -> np.ndarray:
    return np.where(problem.used, error, 0.0) ** 2


def _objective(problem: Problem, error: np.ndarray) -> float:
    return float((problem.weights[:, None] * _squares(problem, error)).sum())


def _partial(problem: Problem, error: np.ndarray) -> dict[str, float]:
    sums = _squares(problem, error).sum(axis=1)
    return dict(zip(FREE_COORDINATES, (float(s) for s in sums), strict=True))


def _rmse(problem: Problem, error: np.ndarray) -> dict[str, float]:
    means = _squares(problem, error).sum(axis=1) / problem.used.sum()
    return dict(zip(FREE_COORDINATES, (float(m) ** 0.5 for m in means), strict=True))


def _notes(problem: Problem, fit: Fit) -> tuple[str, ...]:
    notes = []
    unsure = [e.name for e in fit.estimates if e.remark.startswith("not determined")]
    if unsure:
        notes.append(
            "These data do not determine " + ", ".join(unsure) + ": their standard errors exceed "
            "half the width of their bounds. Fix them, or measure where those ligaments are tight."
        )
    bound = [e.name for e in fit.estimates if e.at_bound]
    if bound:
        notes.append(
            "On a bound: " + ", ".join(bound) + ". The model lacks something that these try to "
            "make up for, or the bounds are too narrow."
        )
    columns = dict(zip(FREE_COORDINATES, COLUMNS[1:], strict=True))
    units = {c: "degrees" if columns[c].endswith("_deg") else "mm" for c in FREE_COORDINATES}
    share = {
        c: w * fit.partial_objectives[c]
        for c, w in zip(FREE_COORDINATES, problem.weights, strict=True)
    }
    worst = max(share, key=share.__getitem__)
    if fit.objective > 0:
        notes.append(
            f"What is left of the objective is {share[worst] / fit.objective:.0%} "
            f"{worst.replace('_', ' ')} (rmse {fit.rmse[worst]:.3g} {units[worst]})."
        )
    left_out = int((~problem.used).sum())
    if left_out:
        poses = "1 pose was" if left_out == 1 else f"{left_out} poses were"
        notes.append(
            f"{poses} left out: the start's parameters find no balance there "
            f"({Status.NOT_CONVERGED.sentence})."
        )
    return tuple(notes)
