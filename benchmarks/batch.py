"""How many equilibria a second, over random four-ligament knees and 25 angles?

    python benchmarks/batch.py [--knees 8192] [--peers 20]

Beside it, in the same run: a loop of `scipy.optimize.root` over the same equations in plain NumPy
(`_numpy_knee.py`), with the same prediction from angle to angle, on the first few knees.
"""

from __future__ import annotations

import time

import numpy as np
from _numpy_knee import UNITS, NumpyKnee
from _protocol import ANGLES, arguments, finish, load, peak_memory_mb
from _variants import motion_of, random_knees, timed_batch
from scipy import optimize

from kneejax.statics import sound


def peer(knee, own, stiffness, slack_length, analytic: bool):
    """Poses `(knees, angles, 5)` of a SciPy loop, its seconds and evaluations a pose.

    Args:
        knee: gives everything else.
        own: its own motion, where searches begin.
        stiffness: `(knees, ligaments)`.
        slack_length: likewise.
        analytic: whether the search gets a Jacobian.
    """
    model, count = NumpyKnee(knee), len(stiffness)
    poses = np.full((count, len(ANGLES), 5), np.nan)
    calls, begun = 0, time.perf_counter()
    for row in range(count):
        model.stiffness, model.slack = stiffness[row, :, None], slack_length[row, :, None]
        model.contact_points = own.contact_points[0, 0].T[..., None]
        past = [own.q[0, 0] / UNITS]
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
                poses[row, k] = found.x * UNITS
    return poses, time.perf_counter() - begun, calls / (count * len(ANGLES))


def main() -> None:
    options = arguments("batch", __doc__, knees=8192, peers=20, seed=0)
    knee = load(options.knee)
    stiffness, slack_length = random_knees(knee, options.knees, options.seed)
    few = slice(0, min(options.peers, options.knees))
    ready, _ = timed_batch(knee, (stiffness[few], slack_length[few]), ANGLES)
    begun = time.process_time()
    seconds, found = timed_batch(knee, (stiffness, slack_length), ANGLES)
    rows = {
        "knees": options.knees,
        "equilibria": found.status.size,
        "equilibria_per_second": found.status.size / seconds,
        "processor_seconds": time.process_time() - begun,
        "seconds_until_ready": ready,
        "converged": float(found.converged.mean()),
        "stable": float(sound(found.status).mean()),
        "mean_steps": float(found.steps.mean()),
        "peak_memory_MB": peak_memory_mb(),
    }
    own = motion_of(knee, ANGLES)
    for name, analytic in (("hybr", False), ("hybr_with_jacobian", True)):
        poses, spent, calls = peer(knee, own, stiffness[few], slack_length[few], analytic)
        apart = np.abs(poses - found.q[few]) / UNITS
        same = np.nanmax(apart, axis=2) < 1e-5
        a_second = apart.shape[0] * apart.shape[1] / spent
        rows |= {
            f"scipy_{name}_per_second": a_second,
            f"scipy_{name}_evaluations_per_pose": calls,
            f"scipy_{name}_converged": float(np.isfinite(poses[..., 0]).mean()),
            f"scipy_{name}_same_to_1e-5": float(same.mean()),
            f"times_faster_than_{name}": found.status.size / seconds / a_second,
        }
    finish(options.out, "Equilibria a second over random knees", rows)


if __name__ == "__main__":
    main()
