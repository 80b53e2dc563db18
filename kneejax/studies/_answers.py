"""Answers of a study: what its commands compute after they have read their words."""

__all__ = [
    "Identified", "Sensitivities", "bootstrapped", "calibrate", "check", "identify",
    "run_side_by_side", "sensitivity",
]

import dataclasses
import functools
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from kneejax import inference
from kneejax.experiments import evaluate_beside
from kneejax.files import Calibrated, InputProblem
from kneejax.inference import Calibration, Design, Identification, LocalSensitivity, MotionIndices
from kneejax.inference import sensitivity as checks
from kneejax.inference.bayesian import check_counts, parameter_priors
from kneejax.inference.bootstrap import bootstrap, bootstrap_by_blocks
from kneejax.inference.calibration import CalibrationProblem
from kneejax.inference.design import check_tests
from kneejax.inference.identification import check_enough
from kneejax.inference.sensitivity import USUAL_COUNT, USUAL_SAMPLES
from kneejax.numerics import Named, adding_up, check_installed, lap, stopwatch
from kneejax.parameters import UnknownParameter, UnsuitableData, stated
from kneejax.studies._fields import UNITS, Identify, Map, Sensitivity
from kneejax.studies._maps import check_map
from kneejax.studies._progress import Asked, progress_of
from kneejax.studies._study import Study


@dataclasses.dataclass(frozen=True)
class Identified(Named):
    """What the data of a study determine.

    Attributes:
        study: that was asked.
        question: what was asked.
        found: the fit by maximum likelihood, its limits and profiles.
        posterior: None unless it was asked for.
        design: the tests to make next.
        seconds: that it took.
    """

    study: Study
    question: Identify
    found: Identification
    posterior: inference.Posterior | None
    design: Design
    seconds: float

    def _named(self) -> dict[str, tuple]:
        return self.found._named() | self.design._named()


@dataclasses.dataclass(frozen=True)
class Sensitivities(Named):
    """What each parameter of a study does to the motion.

    Attributes:
        study: that was asked.
        question: what was asked, with the samples that were taken.
        measured: poses of the study, `(n, 6)`, degrees and mm.
        local: exact slopes.
        sweeps: one parameter at a time over a range.
        indices: global ones; None unless they were asked for.
        seconds: that each took: `local`, `sweeps`, `global`.
    """

    study: Study
    question: Sensitivity
    measured: np.ndarray
    local: LocalSensitivity
    sweeps: inference.Sweeps
    indices: MotionIndices | None
    seconds: dict[str, float]

    def _named(self) -> dict[str, tuple]:
        return self.local._named() | ({} if self.indices is None else self.indices._named())


def calibrate(study: Study, *, progress: Asked = None) -> Calibration:
    """Identify a knee's parameters from measured motion and tests, and say how sure they are.

    Args:
        study: as `read_study` reads it, or made in Python.
        progress: called now and then, from any thread, with what is computed; by default a line
            shows it on a terminal or in a notebook, False shows nothing.

    Raises:
        UnsuitableData: no pose balances, or the data do not depend on what is free.

    Example:
        >>> import kneejax as kj
        >>> poses = kj.passive_flexion(kj.load_knee("four_ligament"), [0.0, 30.0]).to_table()
        >>> study = kj.Study(title="ACL", knee="four_ligament", parameters=["ACL.stiffness"],
        ...                  measured=poses, procedures=["III"], start={"ACL.stiffness": 4000.0})
        >>> round(kj.calibrate(study)["ACL.stiffness"].value)
        4500
    """
    with progress_of(progress, "calibration") as show, stopwatch() as watch:
        study = _a_study(study)
        with evaluate_beside(study.knee):
            problem = study.problem()
            lap("data")
            result = inference.calibrate(problem, progress=show)
    return dataclasses.replace(result, seconds=adding_up(watch.parts))


def run_side_by_side(studies: Sequence[Study]) -> list[Calibration | Exception]:
    """Calibrate what several studies ask, those of one form in lanes of one search.

    Args:
        studies: one a knee.

    Returns:
        A `Calibration` each, or what its data explain that there is none.
    """
    several = len({(study.knee.name, study.knee.side) for study in studies}) > 1
    problems: list[CalibrationProblem | Exception] = []
    for study in studies:
        try:
            problems.append(study.problem(nameless=several))
        except (UnsuitableData, UnknownParameter) as problem:
            problems.append(problem)
    solved = [one for one in problems if isinstance(one, CalibrationProblem)]
    found = iter(inference.calibrate_side_by_side(solved))
    answers = [one if isinstance(one, Exception) else next(found) for one in problems]
    return [dataclasses.replace(one, knee=study.knee.name) if isinstance(one, Calibration) else one
            for one, study in zip(answers, studies, strict=True)]  # fmt: skip


def bootstrapped(
    study: Study, draws: Sequence[int], answer: Calibrated, by_blocks: bool = False
) -> np.ndarray:
    """Draw the data of a study again, and fit them from its answer.

    Args:
        study: that was calibrated.
        draws: numbers of the draws.
        answer: what its result.json says.
        by_blocks: whether curves are drawn among those that were measured; otherwise the answer
            makes the data, with its noise.

    Returns:
        Values of each draw, `(draws, p)`, parameters, then constants between frames; NaN where its
        fit did not converge.
    """
    values = [answer.found[name] for name in study.selection.names]
    values += [answer.frame_offset[name] for name in study.frame_offset]
    noise = [answer.noise.get(name, np.inf) for name in UNITS]
    problem = study.problem().weighing(np.array(noise))
    if by_blocks:
        return bootstrap_by_blocks(problem, values, draws, study.seed)
    return bootstrap(problem, values, noise, draws, study.seed)


def identify(
    study: Study, options: Identify | None = None, *, progress: Asked = None, **fields: Any
) -> Identified:
    """Say what the data of a study determine, and which tests to make next.

    Where the noise is stated, it weighs: of the study's weights count only which are zero.

    Args:
        study: that is asked.
        options: what is asked; or its fields by name, as `next_tests=2`.
        progress: as of `calibrate`.
        **fields: of `Identify`.

    Raises:
        InputProblem: a field is out of range.
        UnsuitableData: too few data or candidates, no pose that balances.

    Example:
        `kj.identify(study, next_tests=2)` compiles for long; options are checked at once:

        >>> import kneejax as kj
        >>> try:
        ...     kj.identify(kj.read_study("passive_flexion"), next_tests=-1)
        ... except kj.InputProblem as problem:
        ...     print(problem)
        next_tests: next_tests: -1: expected a whole number from 1 to 1000
    """
    options = options or Identify(**fields)
    check(_a_study(study), options)
    begun = time.perf_counter()
    noise_mm, noise_deg = _noise(study, options)
    asked = study.replace(noise_mm=noise_mm, noise_deg=noise_deg)
    if None not in (noise_mm, noise_deg):
        asked = asked.replace(weights={name: 0.0 for name, x in asked.weights.items() if x == 0})
    with progress_of(progress, "fit and limits") as show:
        known = _known_before(study, options)
        spread = {name: sd for name, (_, sd) in known.items() if np.isfinite(sd)}
        found, sampled = inference.identify(asked.problem(), spread=spread), None
        if options.posterior:
            drawn = None if show is None else functools.partial(show, "posterior")
            sampled = inference.posterior(
                found.problem, found.vector, float(found.noise[2]), float(found.noise[0]),
                priors=known, bounds=study.limits, chains=options.chains,
                draws=options.draws, seed=options.seed, truth=study.truth, progress=drawn)
        if show is not None:
            show("tests to make next", 0, 0)
        prior = [spread.get(name, np.inf) for name in study.selection.names]
        design = inference.design_tests(found.selection, study.knee_at_start, found.information,
                                        found.noise, options.candidates, count=options.next_tests,
                                        criterion=options.criterion, prior=prior)  # fmt: skip
    return Identified(study, options, found, sampled, design, time.perf_counter() - begun)


def sensitivity(
    study: Study, options: Sensitivity | None = None, *, progress: Asked = None, **fields: Any
) -> Sensitivities:
    """Say what each parameter of a study does to the motion: slopes, sweeps, global indices.

    Args:
        study: that is asked.
        options: what is asked; or its fields by name, as `scale="percent"`.
        progress: as of `calibrate`; `sweeps` and `indices` are counted in balances.
        **fields: of `Sensitivity`.

    Raises:
        InputProblem: a field is out of range, or the study has loads or tests.
        UnknownParameter: a name that the knee does not have, or that is not free.
        UnsuitableData: too few samples, or a package that is not installed.

    Example:
        `kj.sensitivity(study)` compiles for long; options are checked at once:

        >>> import kneejax as kj
        >>> try:
        ...     kj.sensitivity(kj.read_study("passive_flexion"), scale="percents")
        ... except kj.InputProblem as problem:
        ...     print(problem)
        scale: scale: percents: expected one of prior, percent; did you mean percent?
    """
    options = options or Sensitivity(**fields)
    check(_a_study(study), options)
    measured = study.poses()
    knee, parameters = study.knee_at_start, study.parameters
    flexion, seconds, begun = np.unique(measured[:, 0]), {}, time.perf_counter()
    indices, spread = None, _spread(study, options)
    with progress_of(progress, "slopes") as show:
        local = inference.local_sensitivity(knee, parameters, flexion, scale=options.scale,
                                            given=spread)
        seconds["local"] = time.perf_counter() - begun
        begun = time.perf_counter()
        sweeps = inference.sweep(knee, _swept(study, options), flexion,
                                 failures=study.counted_failures,
                                 progress=show and functools.partial(show, "sweeps"))  # fmt: skip
        seconds["sweeps"] = time.perf_counter() - begun
        if options.indices is not None:
            options, begun = options.replace(samples=_samples(options)), time.perf_counter()
            indices = inference.motion_indices(
                knee, parameters, measured, weights=study.first_weights,
                offsets=study.frame_offset, bounds=study.limits, ranges=options.range,
                priors=spread, method=options.indices, samples=options.samples,
                seed=options.seed, failures=study.counted_failures,
                progress=show and functools.partial(show, "indices"))  # fmt: skip
            seconds["global"] = time.perf_counter() - begun
    return Sensitivities(study, options, measured, local, sweeps, indices, seconds)


def check(study: Study, options: Identify | Map | Sensitivity | None = None) -> None:
    """Refuse what cannot be answered, before anything is computed; every answer does so first.

    Args:
        study: checked when it was made.
        options: of the command.

    Raises:
        InputProblem: a field does not suit the study.
        UnknownParameter: a name that the knee does not have, or that is not free.
        UnsuitableData: too few data, samples or candidates.
        MissingPackage: a package is not installed.
    """
    knee, selection = study.knee_at_start, study.selection
    match options:
        case Identify():
            candidates = options.candidates
            candidates = inference.usual_candidates() if candidates is None else candidates
            check_tests(candidates, options.next_tests, options.criterion)
            parameter_priors(knee, selection, _known_before(study, options), study.limits)
            if options.posterior:
                _passive_alone(study, ["tests"], "the posterior is")
                for package in ("blackjax", "arviz"):
                    check_installed(package, "posterior")
                check_counts(options.chains, options.draws)
            if None in _noise(study, options):
                weighed = study.first_weights > 0
                read = [one.observed[:, weighed] for one in study.tests]
                counted = int(weighed.sum()) * len(study.flexion_deg)
                counted += sum(int(np.isfinite(one).sum()) for one in read)
                check_enough(counted, len(selection) + len(study.frame_offset))
        case Map():
            check_map(study, options)
        case Sensitivity():
            _passive_alone(study, ["loads", "tests"], "sensitivities are")
            checks.sweep_values(knee, _swept(study, options))
            width, spread = np.asarray(selection.read(knee)), _spread(study, options)
            checks.step_widths(selection, width, options.scale, spread)
            if options.indices is not None:
                check_installed("SALib", "sensitivity")
                checks.index_ranges(knee, selection, study.limits, options.range, spread,
                                    method=options.indices, samples=_samples(options))


def _known_before(study: Study, options: Identify) -> dict[str, tuple[float, float]]:
    """Mean and standard deviation of the priors that are stated: asked for, or the study's own
    around its start."""
    asked = stated(study.selection, options.prior, "prior")
    own = stated(study.selection, study.believed, "prior")
    each = zip(asked, study.selection.read(study.knee_at_start).tolist(), own, strict=True)
    found = [said or (sd and (middle, sd)) for said, middle, sd in each]
    return {name: x for name, x in zip(study.selection.names, found, strict=True) if x}


def _spread(study: Study, options: Sensitivity) -> dict[str, float]:
    """Standard deviations of what is known before, those that are stated: as in `_known_before`."""
    both = (stated(study.selection, x, "prior") for x in (options.prior, study.believed))
    each = zip(study.selection.names, *both, strict=True)
    return {name: asked or own for name, asked, own in each if asked or own}


def _passive_alone(study: Study, fields: Sequence[str], what: str) -> None:
    """Refuse a study that has more than passive motion, of which something is computed so far."""
    named = {"loads": [*study.loads], "tests": [test.name for test in study.tests]}
    for field in fields:
        if named[field]:
            expected = f"a study without {field}: {what} of passive motion so far"
            raise InputProblem(study.file, field, ", ".join(named[field]), expected)


def _a_study(study: Study) -> Study:
    if not isinstance(study, Study):
        raise TypeError(f"expected a kneejax.Study, not {type(study).__name__}: "
                        "kj.Study(title=..., knee=knee, measured=poses, parameters=[...])")
    return study


def _noise(study: Study, options: Identify) -> tuple[float | None, float | None]:
    """As given with the options, or as the study states it; mm and degrees."""
    mm, deg = study.noise
    return options.noise_mm or mm, options.noise_deg or deg


def _samples(options: Sensitivity) -> int:
    usual = USUAL_SAMPLES.get(options.indices or "", 0)
    return usual if options.samples is None else options.samples


def _swept(study: Study, options: Sensitivity) -> dict[str, np.ndarray | None]:
    """Name or wildcard -> values, None for the usual ones."""
    asked: Mapping[str, Any] = options.sweep or dict.fromkeys(study.parameters)
    count = {name: int(line[2]) for name, line in asked.items() if line and line[2:]}
    return {name: line and np.linspace(line[0], line[1], count.get(name, USUAL_COUNT))
            for name, line in asked.items()}  # fmt: skip
