"""Calibration: which ligaments make the model move as measured, and how sure that is."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import platform
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.calibration._answers import (
    fit_of,
    motion_of,
    objective_of,
    partial_objectives_of,
    rmse_of,
    starts_of,
    surety_of,
)
from kneejax.inference.calibration._fitted_test import fitted_tests, misfits_of_test
from kneejax.inference.calibration._quality import misfits
from kneejax.inference.calibration._result import Calibration, Fit
from kneejax.inference.calibration._search import (
    METHODS,
    USUAL_CYCLES,
    Stage,
    procedures_of,
    run_procedure,
    several_starts,
)
from kneejax.inference.fit import DEFAULT_WEIGHTS, Problem, Progress, check_finite
from kneejax.inference.intervals import Surety, check_all_stated, stated_noise
from kneejax.mechanics import Knee, Load
from kneejax.parameters import (
    Selection,
    UnsuitableData,
    select,
    start_within,
    stated_bounds,
)
from kneejax.statics import Slopes

_PACKAGES = ("kneejax", "jax", "jaxlib", "optimistix", "equinox", "lineax", "numpy", "jaxopt")


def calibrate(
    knee: Knee,
    measured: np.ndarray,
    parameters: tuple[str, ...] = ("*.stiffness", "*.reference_strain"),
    *,
    bounds: dict[str, tuple[float, float]] | None = None,
    weights: np.ndarray | None = None,
    procedures: Sequence[str] = (),
    stages: Sequence[Stage] = (),
    noise_mm: float | None = None,
    noise_deg: float | None = None,
    offsets: tuple[str, ...] = (),
    starts: int = 1,
    seed: int = 0,
    method: str = "least_squares",
    cycles: int = USUAL_CYCLES,
    truth: dict[str, float] | None = None,
    title: str = "Calibration",
    settings: dict[str, Any] | None = None,
    loads: Sequence[Load] = (),
    tests: Sequence[MeasuredTest] = (),
    prior: Mapping[str, float] | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """Identify parameters of a knee from measured poses, and from how far it gave under load.

    Args:
        knee: gives everything that is not free, and the start of what is.
        measured: `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; flexion is
            prescribed, the other five are compared. It may be empty where there are tests.
        parameters: names, with `*` for every ligament.
        bounds: by name; those of paper 1 for stiffness and reference strain by default.
        weights: `(5,)`; by default 8 per degree^2 and 1 per mm^2 (paper 1).
        procedures: any of `I`, `II`, `III`, `S`; the first is reported as the answer, and alone
            gets error bars. By default `S` where there are stages, otherwise `II`, `I` and `III`.
        stages: of procedure `S`, in turn. Error bars are those of all data together.
        noise_mm: standard deviation of measured displacements; by default estimated from what the
            likeliest fit leaves.
        noise_deg: of measured rotations; likewise.
        offsets: free coordinates whose constant difference between measured and model frame is
            unknown too.
        starts: number of starts of procedure III, drawn between the bounds besides the knee's.
        seed: of those draws.
        method: `least_squares`, or `lbfgsb` to minimise the objective by jaxopt's L-BFGS-B, which
            takes seconds for each step of a procedure.
        cycles: how often procedures I and II may go through their two steps: once, as paper 1, by
            default.
        truth: values that made the data, for synthetic studies.
        title: for the report.
        settings: recorded with the result.
        loads: on the tibia while the poses were measured, each one for all poses or one per pose.
        tests: under load that were made; they count like poses, each by its standard deviation.
        prior: name, `*.quantity` or quantity -> standard deviation of a normal prior around the
            start's value. Weights are one over the noise's variances then, which must be stated.
        progress: called now and then with what is computed and, of a search, how far off the knee
            still is.

    Returns:
        The `Calibration`.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: bounds that exclude the start, numbers that are not finite,
            no pose that balances, a method that is unknown or not installed, or a test that says
            how well it was measured where nobody says so of the poses.

    Source: paper 1, sections 2.3 and 3.4.
    """
    begun, procedures = time.perf_counter(), procedures_of(procedures, stages)
    if method not in METHODS:
        raise UnsuitableData(f"unknown method {method!r}: expected one of {', '.join(METHODS)}")
    selection, stated = select(knee, parameters), stated_noise(noise_mm, noise_deg)
    weights = _weights(weights, stated, prior, tests)
    problem = Problem.of(knee, selection, measured, weights, offsets, loads, tests, stated)
    check_finite(problem.measured)
    box = _box(knee, selection, bounds or {}, len(offsets))
    if prior:
        problem = problem.with_prior(box[0], prior)

    search = {"cycles": cycles, "method": method, "stages": stages, "progress": progress}
    _tell(search, "first balances")
    first = problem.begin(box[0][None])
    ready = time.perf_counter()
    problem = problem.balanced_by(first)
    fits, surety = _fits(problem, first, box, procedures, stated, starts, seed, search)
    answer = _calibration(problem, first, fits, surety, stated)
    solved = time.perf_counter()
    return dataclasses.replace(
        answer,
        title=title,
        truth=dict(truth or {}),
        settings=dict(settings or {}),
        seconds={"total": solved - begun, "compile": ready - begun, "solve": solved - ready},
    )


def _weights(weights, stated: np.ndarray, prior, tests: Sequence[MeasuredTest]) -> np.ndarray:
    """Of squared errors of poses, `(5,)`."""
    if not prior and not any(test.readings for test in tests):
        return DEFAULT_WEIGHTS if weights is None else np.asarray(weights, float)
    check_all_stated(stated, "prior" if prior else "readings")
    # One over the variances: against these, what is not of a pose counts in its own.
    counts = np.ones(5) if weights is None else np.asarray(weights, float) > 0
    return np.where(counts, stated**-2.0, 0.0)


def _calibration(
    problem: Problem, first: Slopes, fits: Sequence[Fit], surety: Surety, stated: np.ndarray
) -> Calibration:
    """What the fits tell, beside what the start was."""
    knee, error = problem.knee, problem.error(first)
    start_rmse = rmse_of(problem, error)
    start_tests = fitted_tests(problem, first)
    poses = int(problem.used[problem.cases.posed].sum())
    poor = misfits(fits[0].rmse, start_rmse, stated, problem.weights, poses)
    for own, before in zip(fits[0].tests, start_tests, strict=True):
        poor += misfits_of_test(own, before, stated, problem.weights)
    return Calibration(
        title="",
        knee=knee.name,
        measured=problem.measured,
        start=motion_of(problem, first),
        start_rmse=start_rmse,
        start_partial_objectives=partial_objectives_of(problem, error),
        start_objective=objective_of(problem, first),
        start_tests=start_tests,
        fits=tuple(fits),
        ligaments=knee.ligaments.names,
        contacts=knee.contact_names,
        truth={},
        noise=dict(zip(FREE_COORDINATES, map(float, surety.noise), strict=True)),
        noise_estimated=surety.noise_estimated,
        misfits=poor,
        weights=problem.weights,
        left_out=int((~problem.used).sum()),
        seconds={},
        versions=versions(),
        settings={},
    )


def _box(knee: Knee, selection: Selection, bounds, offsets: int) -> tuple[np.ndarray, ...]:
    """Start, lower and upper bounds of parameters, then of constants between frames."""
    lower, upper = stated_bounds(knee, selection, bounds)
    start = start_within(knee, selection, lower, upper)
    # A frame is rarely off by more than 10 mm or 10 degrees.
    wide = np.full(offsets, 10.0)
    return np.r_[start, 0.0 * wide], np.r_[lower, -wide], np.r_[upper, wide]


def _fits(
    problem: Problem, first: Slopes, box, procedures, stated, starts: int, seed: int, search
) -> tuple[list[Fit], Surety]:
    """The answer of each procedure, and how sure that of the first is."""
    (start, lower, upper), fits, surety = box, [], None
    for procedure in procedures:
        begin, reached = first, None
        if starts > 1 and procedure == "III":
            _tell(search, f"procedure III, {starts} starts side by side")
            draws = np.random.default_rng(seed).uniform(lower, upper, (starts - 1, len(start)))
            reached = several_starts(problem, np.vstack([start, draws]), lower, upper)
            begin = problem.begin(reached[0][[np.argmin(reached[1])]])
        trail = run_procedure(problem, procedure, begin, lower, upper, **search)
        if not fits:
            _tell(search, f"95 % limits of {len(start)} numbers")
            surety = surety_of(problem, trail.known, stated, lower, upper)
        own = surety if not fits else None
        fit = fit_of(problem, procedure, trail, start, lower, upper, own)
        if reached is not None:
            fit = dataclasses.replace(fit, starts=starts_of(problem, fit, *reached))
        fits.append(fit)
    assert surety is not None
    return fits, surety


def _tell(search: Mapping[str, Any], what: str) -> None:
    if search["progress"] is not None:
        search["progress"](what, 0, 0)


def versions() -> dict[str, str]:
    """Versions of everything that a number in a result depends on."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
