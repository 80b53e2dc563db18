"""What does the exact 25 x 5 x 8 Jacobian of a motion cost over the motion alone?

    python benchmarks/jacobian.py [--repeats 25]

Both start from the knee's own balanced poses after its stiffnesses and strains have been changed
by a little, as in a calibration, and take turns in one run.
"""

from __future__ import annotations

import statistics
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from _protocol import ANGLES, arguments, finish, load, timed

from kneejax.inference import evaluate_poses
from kneejax.mechanics import add_lane_axis
from kneejax.numerics import compiler_options
from kneejax.parameters import select
from kneejax.statics import Guess, first_guess, settle


@partial(jax.jit, static_argnums=0, compiler_options=dict(compiler_options()))
def motion(selection, knee, values, flexion, guess, start, count):
    """Poses alone."""
    return settle(add_lane_axis(selection.apply(knee, values)), flexion, guess, start, count)


def main() -> None:
    options = arguments("jacobian", __doc__, repeats=25)
    knee = load(options.knee)
    selection = select(knee, ["*.stiffness", "*.reference_strain"])
    flexion = jnp.asarray(np.deg2rad(ANGLES))
    start = jnp.broadcast_to(knee.reference_pose.flexion, flexion.shape)
    values = selection.read(knee)
    far = (flexion, jax.jit(first_guess)(add_lane_axis(knee), start), start, jnp.asarray(26))
    first_alone, found = timed(motion, selection, knee, values, *far)
    first_both, _ = timed(evaluate_poses, selection, knee, values, *far)
    rows: dict[str, object] = {"first_call_alone_s": first_alone, "first_call_both_s": first_both}
    warm = (flexion, Guess(found.q, found.meeting), flexion, jnp.asarray(1))
    nearby = values * 1.02
    for name, how, new in (("marching", far, values), ("warm", warm, nearby)):
        alone, both = [], []
        for _ in range(options.repeats):
            alone.append(timed(motion, selection, knee, new, *how)[0])
            seconds, evaluation = timed(evaluate_poses, selection, knee, new, *how)
            both.append(seconds)
        rows |= {
            f"{name}_alone_ms": 1e3 * statistics.median(alone),
            f"{name}_with_jacobian_ms": 1e3 * statistics.median(both),
            f"{name}_ratio": statistics.median(both) / statistics.median(alone),
            f"{name}_converged": float(evaluation.settled.converged.mean()),
            f"{name}_jacobian_finite": bool(jnp.isfinite(evaluation.jacobian).all()),
        }
    finish(options.out, "Motion with its exact Jacobian against the motion alone", rows)


if __name__ == "__main__":
    main()
