"""Calibration: which ligaments make the model move as measured, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.inference.calibration._question import Question
from kneejax.inference.calibration._result import Calibration
from kneejax.inference.calibration._search import USUAL_CYCLES, Stage
from kneejax.inference.calibration._side_by_side import calibrate_side_by_side
from kneejax.inference.fit import Progress
from kneejax.mechanics import Knee, Load


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
        starts: number of starts of procedure III, besides the knee's own drawn from the prior, or
            between the bounds where there is none.
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
    question = Question(
        knee, measured, parameters, bounds, weights, procedures, stages, noise_mm, noise_deg,
        offsets, starts, seed, method, cycles, truth, title, settings, loads, tests, prior,
    )  # fmt: skip
    (found,) = calibrate_side_by_side([question], progress=progress)
    if isinstance(found, Exception):
        raise found
    return found
