"""What does the eight-parameter calibration cost: kneejax, pattern search and SLSQP?

    python benchmarks/calibration.py [--limit 2000]

Data: the knee with paper 1's Table 3 values, 25 angles, noise of 0.1 mm and 0.1 degrees. Start:
the knee's own (Table 1) values. All three see the same objective and bounds; the peers move
parameters scaled to 0..1 and get their poses from kneejax, without a Jacobian.
"""

from __future__ import annotations

import time
import warnings
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from _protocol import ANGLES, TRUTH, arguments, finish, load, true_knee
from scipy import optimize

import kneejax as kj
from kneejax.inference import Problem
from kneejax.inference.fit import DEFAULT_WEIGHTS, TABLE_UNITS
from kneejax.mechanics import add_lane_axis
from kneejax.numerics import compiler_options
from kneejax.parameters import default_bounds, select
from kneejax.statics import Guess, solve_equilibrium

NAMES = ("*.stiffness", "*.reference_strain")


@partial(jax.jit, static_argnums=0, compiler_options=dict(compiler_options()))
def poses(selection, knee, values, flexion, guess):
    """Free coordinates in degrees and mm, `(5, n)`."""
    found = solve_equilibrium(
        add_lane_axis(selection.apply(knee, values)), {"flexion": flexion}, guess
    )
    return found.q * jnp.asarray(TABLE_UNITS)[:, None]


def measured_poses(knee, seed: int) -> np.ndarray:
    """Poses of the true knee with noise, `(25, 6)`."""
    table = np.array(kj.passive_flexion(true_knee(knee), ANGLES).to_table())
    table[:, 1:] += np.random.default_rng(seed).normal(0.0, 0.1, (len(ANGLES), 5))
    return table


class Objective:
    """Paper 1's objective of parameters scaled to 0..1, counting; large without a balance."""

    def __init__(self, knee, measured: np.ndarray):
        self.knee, self.selection = knee, select(knee, NAMES)
        self.problem = Problem.of(knee, self.selection, measured, DEFAULT_WEIGHTS)
        start = self.selection.read(knee)
        self.lower, self.upper = (np.asarray(b) for b in default_bounds(knee, self.selection))
        self.start = (np.asarray(start) - self.lower) / (self.upper - self.lower)
        self.near = kj.passive_flexion(knee, measured[:, 0]).equilibrium
        self.calls = 0

    def __call__(self, x: np.ndarray) -> float:
        """Value at scaled parameters; searches for poses begin at the start's."""
        self.calls += 1
        values = jnp.asarray(self.lower + np.clip(x, 0, 1) * (self.upper - self.lower))
        near = self.near
        guess = Guess(near.q, near.contact_points)
        table = poses(self.selection, self.knee, values, near.prescribed["flexion"], guess)
        error = np.asarray(table) - self.problem.cases.target.T
        value = float((DEFAULT_WEIGHTS[:, None] * error**2).sum())
        return value if np.isfinite(value) else 1e6


def pattern_search(objective: Objective, limit: int) -> float:
    """pymoo's bounded pattern search."""
    from pymoo.algorithms.soo.nonconvex.pattern import PatternSearch
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.optimize import minimize

    class Wrapped(ElementwiseProblem):
        def __init__(self):
            super().__init__(n_var=8, n_obj=1, xl=np.zeros(8), xu=np.ones(8))

        def _evaluate(self, x, out, *args, **kwargs):
            out["F"] = objective(x)

    found = minimize(Wrapped(), PatternSearch(x0=objective.start), ("n_eval", limit), seed=1)
    return float(found.F[0])


def slsqp(objective: Objective, limit: int) -> float:
    """SciPy's SLSQP with its finite differences."""
    found = optimize.minimize(
        objective,
        objective.start,
        method="SLSQP",
        bounds=[(0.0, 1.0)] * 8,
        options={"maxiter": limit // 9, "ftol": 1e-10},
    )
    return float(found.fun)


def main() -> None:
    options = arguments("calibration", __doc__, limit=2000, seed=0)
    knee = load(options.knee)
    measured = measured_poses(knee, options.seed)
    study = kj.Study(
        title="eight numbers", knee=knee, measured=measured, parameters=NAMES, procedures=["III"]
    )
    kj.calibrate(study)  # compiles
    begun = time.perf_counter()
    found = kj.calibrate(study)
    fit = found.fits[0]
    rows: dict[str, object] = {
        "objective_start": found.start_objective,
        "kneejax_evaluations": fit.evaluations["residual"],
        "kneejax_seconds": time.perf_counter() - begun,
        "kneejax_objective": fit.objective,
        "kneejax_success": fit.success,
        "kneejax_parameters": {
            e.name: {"value": e.value, "truth": TRUTH[e.name], "standard_error": e.standard_error}
            for e in fit.estimates
        },
    }
    warnings.simplefilter("ignore")
    objective = Objective(knee, measured)
    objective(objective.start)  # compiles
    for name, search in (("pattern_search", pattern_search), ("slsqp", slsqp)):
        objective.calls, begun = 0, time.perf_counter()
        reached = search(objective, options.limit)
        rows |= {
            f"{name}_evaluations": objective.calls,
            f"{name}_seconds": time.perf_counter() - begun,
            f"{name}_objective": reached,
        }
    finish(options.out, "Calibration of eight parameters", rows)


if __name__ == "__main__":
    main()
