"""How many equilibria a second, over random four-ligament knees and 25 angles?

    python benchmarks/batch.py [--knees 8192] [--chunk 128] [--threads 2] [--peers 20]

Beside it, in the same run: a loop of `scipy.optimize.root` over the same equations in plain NumPy
(`_numpy_knee.py`), with the same prediction from angle to angle, on the first few knees.
"""

from __future__ import annotations

import time

import numpy as np
from _engine import Engine, random_knees
from _numpy_knee import UNITS, NumpyKnee
from _protocol import ANGLES, arguments, finish, load, peak_memory_mb
from scipy import optimize


def peer(knee, engine, stiffness, slack_length, analytic: bool):
    """Poses `(angles, 5, knees)` of a SciPy loop, its seconds and evaluations a pose."""
    model, count = NumpyKnee(knee), stiffness.shape[1]
    poses = np.full((len(ANGLES), 5, count), np.nan)
    calls, begun = 0, time.perf_counter()
    for row in range(count):
        model.stiffness, model.slack = stiffness[:, row, None], slack_length[:, row, None]
        model.meeting = np.moveaxis(engine.own.meeting[..., 0], 0, 1)[..., None]
        past = [engine.own.q[:, 0] / UNITS]
        for k, angle in enumerate(np.deg2rad(ANGLES)):
            if len(past) < 3:
                guess = 2 * past[-1] - past[-2] if len(past) == 2 and k > 1 else past[-1]
            else:
                guess = 3 * past[-1] - 3 * past[-2] + past[-3]
            found = optimize.root(
                model.residual, guess, (angle,), jac=model.jacobian if analytic else None
            )
            calls += found.nfev + found.get("njev", 0)
            if found.success:
                past = ([] if k == 0 else past[-2:]) + [found.x]
                poses[k, :, row] = found.x * UNITS
    return poses, time.perf_counter() - begun, calls / (count * len(ANGLES))


def main() -> None:
    options = arguments("batch", __doc__, knees=8192, chunk=128, threads=2, peers=20, seed=0)
    knee = load(options.knee)
    stiffness, slack_length = random_knees(knee, options.knees, options.seed)
    begun = time.perf_counter()
    engine = Engine(knee, ANGLES, options.chunk, options.threads)
    first = slice(0, min(options.chunk, options.knees))
    engine.solve(stiffness[:, first], slack_length[:, first])
    ready = time.perf_counter() - begun
    done = engine.solve(stiffness, slack_length)
    total = options.knees * len(ANGLES)
    rows = {
        "knees": options.knees,
        "chunk": options.chunk,
        "threads": options.threads,
        "equilibria": total,
        "equilibria_per_second": total / done["seconds"][-1],
        "seconds_after_each_pass": done["seconds"],
        "seconds_until_ready": ready,
        "converged_after_each_pass": done["converged"],
        "stable": float(done["stable"].mean()),
        "mean_steps": float(done["steps"].mean()),
        "peak_memory_MB": peak_memory_mb(),
    }
    few = slice(0, min(options.peers, options.knees))
    for name, analytic in (("hybr", False), ("hybr_with_jacobian", True)):
        poses, seconds, calls = peer(
            knee, engine, stiffness[:, few], slack_length[:, few], analytic
        )
        apart = np.abs(poses - done["q"][..., few]) / UNITS[:, None]
        same = np.nanmax(apart, axis=1) < 1e-5
        rows |= {
            f"scipy_{name}_per_second": apart.shape[0] * apart.shape[2] / seconds,
            f"scipy_{name}_evaluations_per_pose": calls,
            f"scipy_{name}_converged": float(np.isfinite(poses[:, 0]).mean()),
            f"scipy_{name}_same_to_1e-5": float(same.mean()),
            f"times_faster_than_{name}": (total / done["seconds"][-1])
            / (apart.shape[0] * apart.shape[2] / seconds),
        }
    finish(options.out, "Equilibria a second over random knees", rows)


if __name__ == "__main__":
    main()
