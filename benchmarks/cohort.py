"""A made-up cohort: seconds of a knee, of a bootstrap and of SciPy's loop; how often limits hold.

    python benchmarks/cohort.py [--knee four_ligament] [--knees 100] [--bootstrap 1000] [--scipy 3]
                                [--attachments 14]

Each knee has its own size and shape, and its own stiffness and reference strain of each ligament;
measured are a passive motion and 12 laxity curves, with noise. Knees are calibrated side by side in
blocks, each with its 95 % limits, as `kneejax calibrate COHORT` does before it writes. SciPy's
least squares takes finite differences of the same balances, for a few knees. Seconds are those of
processors, without compiling: what other programs do beside it does not count. `--attachments N`
frees that many coordinates of attachments beside, each known to a millimetre beforehand; coverage
is told of the others.
"""

from __future__ import annotations

import time

import numpy as np
from _protocol import arguments, finish, peak_memory_mb
from scipy.optimize import least_squares

from kneejax.cohorts import MadeUpKnee, Spread, synthesise
from kneejax.files.knee.file import build_knee
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference.bootstrap import bootstrap
from kneejax.inference.calibration import CalibrationProblem, calibrate_side_by_side
from kneejax.inference.population import in_log, population
from kneejax.parameters import select
from kneejax.studies import Study

#: Knees of a block, as `kneejax.cohorts` deals them.
BLOCK = 8
ANYWHERE_MM = (-120.0, 120.0)
BOUNDS = {"stiffness": (100.0, 30000.0), "reference_strain": (-0.25, 0.25)}


def asked(made: MadeUpKnee, spread: Spread, attachments: int = 0) -> CalibrationProblem:
    """What is asked of a made-up knee: the study that `kneejax cohort synthesise` writes, and where
    some of its attachments are."""
    weights = {"deg": spread.noise_deg**-2.0, "mm": spread.noise_mm**-2.0}
    knee = build_knee(made.document, made.name).knee
    usual = ("*.stiffness", "*.reference_strain")
    places = select(knee, ["*.femoral_attachment", "*.tibial_attachment"])
    names = places.names[:attachments]
    # What is believed of a knee is not where its attachments are.
    draws = np.random.default_rng([1, int(made.name[1:])])
    true = np.asarray(places.read(knee))[:attachments]
    believed = true + spread.attachment_mm * draws.standard_normal(attachments)
    return Study(
        title=made.name, knee=knee.replace(dict(zip(names, believed, strict=True))),
        measured=made.passive, parameters=(*usual, *names), weights=weights,
        bounds=BOUNDS | dict.fromkeys(names, ANYWHERE_MM), procedures=["III"],
        noise_mm=spread.noise_mm, noise_deg=spread.noise_deg, tests=made.tests,
        prior=dict.fromkeys(names, spread.attachment_mm),
    ).problem()  # fmt: skip


def processor_seconds(function, *given):
    """Seconds of processors, by the clock, and the answer."""
    begun, clock = time.process_time(), time.perf_counter()
    answer = function(*given)
    return time.process_time() - begun, time.perf_counter() - clock, answer


def calibrated(problems: list[CalibrationProblem]) -> list:
    """All of them, in blocks."""
    blocks = range(0, len(problems), BLOCK)
    return [x for first in blocks for x in calibrate_side_by_side(problems[first : first + BLOCK])]


def by_differences(own: CalibrationProblem) -> int:
    """Evaluations of SciPy's least squares, which sees balances alone; no limits are made."""
    begin = own.fitted.begin(own.start[None])
    problem = own.fitted.with_used(begin.converged[0])
    width, count = own.upper - own.lower, 0

    def residual(x):
        nonlocal count
        count += 1
        found = problem.balance((own.lower + x * width)[None], begin)
        return np.nan_to_num(problem.residual(found)[0], nan=1e3)

    least_squares(residual, (own.start - own.lower) / width, bounds=(0.0, 1.0), max_nfev=30)
    return count


def coverage(knees: list[MadeUpKnee], answers: list, spread: Spread) -> dict[str, float]:
    """How often limits hold the truth, of knees and of the population."""
    good = [k for k, one in enumerate(answers) if not isinstance(one, Exception)
            and one.fit.success and not one.misfits]  # fmt: skip
    rows: dict[str, float] = {"answers": float(len(good))}
    names = list(knees[0].truth)
    low, high = (
        np.array([[getattr(answers[k][name], end) for name in names] for k in good])
        for end in ("low", "high")
    )
    truth = np.array([[knees[k].truth[name] for name in names] for k in good])
    told = np.isfinite(low) & np.isfinite(high)
    held = (low <= truth) & (truth <= high)
    rows |= {"limits_told": float(told.mean()), "limits_hold": float(held[told].mean())}
    rows["limits_hold_worst_parameter"] = float(
        min(held[told[:, i], i].mean() for i in range(len(names)) if told[:, i].any())
    )
    for what in ("mean", "spread", "shrunk"):
        rows[f"population_{what}_holds"] = 0.0
    for i, name in enumerate(names):
        log = in_log(name)
        ends = np.log([low[:, i], high[:, i]]) if log else np.array([low[:, i], high[:, i]])
        found = population(ends.mean(axis=0), np.ptp(ends, axis=0) / 3.92, log)
        own = np.log(truth[:, i]) if log else truth[:, i]
        # What was drawn, not what was drawn from: knees without a balance were drawn again.
        inside = np.abs(own - found.shrunk) <= 1.96 * found.deviation
        rows["population_mean_holds"] += _within(own.mean(), found.mean_limits) / len(names)
        deviation = own.std(ddof=1)
        rows["population_spread_holds"] += _within(deviation, found.spread_limits) / len(names)
        rows["population_shrunk_holds"] += float(inside.mean()) / len(names)
    return rows


def _within(x: float, limits: tuple[float, float]) -> float:
    return float(limits[0] <= x <= limits[1])


def main() -> None:
    options = arguments("cohort", __doc__, knees=100, bootstrap=1000, scipy=3, seed=0,
                        attachments=0)  # fmt: skip
    spread = Spread()
    made = list(synthesise(options.knees, options.seed, options.knee, spread))
    problems = [asked(one, spread, options.attachments) for one in made]
    first, _, _ = processor_seconds(calibrated, problems[:BLOCK])
    one, _, _ = processor_seconds(calibrated, problems[:1])
    alone, _, _ = processor_seconds(calibrated, problems[:1])
    cpu, clock, answers = processor_seconds(calibrated, problems)
    parameters = len(answers[0].fit.estimates)
    rows: dict[str, float] = {
        "knees": options.knees,
        "parameters": parameters,
        "load_cases": len(problems[0].fitted.cases.load_cases),
        "first_block_cpu_s": first,
        "cohort_cpu_s": cpu,
        "cohort_clock_s": clock,
        "knee_cpu_s": cpu / options.knees,
        "knee_by_itself_cpu_s": alone,
        "redrawn": sum(x.redrawn for x in made),
    }
    rows |= coverage(made, answers, spread)
    finish(options.out, "A made-up cohort", rows)
    answer = answers[0]
    values = [e.value for e in answer.fit.estimates]
    noise = [answer.noise[name] for name in FREE_COORDINATES]
    if options.bootstrap:
        bootstrap(problems[0], values, noise, range(min(100, options.bootstrap)))
    cpu, clock, draws = processor_seconds(
        bootstrap, problems[0], values, noise, range(options.bootstrap)
    )
    rows |= {
        "bootstraps": options.bootstrap, "bootstraps_cpu_s": cpu, "bootstraps_clock_s": clock,
        "bootstraps_converged": float(np.isfinite(draws).all(axis=1).mean())
        if options.bootstrap
        else 0.0,
    }  # fmt: skip
    taken, evaluations = 0.0, 0
    for problem in problems[: options.scipy]:
        cpu, _, count = processor_seconds(by_differences, problem)
        taken, evaluations = taken + cpu, evaluations + count
    if options.scipy:
        rows |= {
            "scipy_knee_cpu_s": taken / options.scipy,
            "scipy_evaluations": evaluations / options.scipy,
            "scipy_over_cohort": taken / options.scipy / rows["knee_cpu_s"],
        }
    finish(options.out, "A made-up cohort", rows | {"peak_memory_mb": peak_memory_mb()})


if __name__ == "__main__":
    main()
