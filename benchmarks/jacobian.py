"""What does the exact 25 x 5 x 8 Jacobian of a motion cost over the motion alone?

    python benchmarks/jacobian.py [--repeats 25]

Two ways to come by the motion: walked from the reference pose, as `passive_flexion` does, and
searched from balances of nearly the same knee, as each step of a calibration does. Motion alone and
motion with Jacobian take turns in one run.
"""

from __future__ import annotations

import statistics

import jax
import numpy as np
from _protocol import ANGLES, arguments, finish, load, timed

import kneejax as kj
from kneejax.mechanics import add_lane_axis
from kneejax.numerics import compiled
from kneejax.parameters import select
from kneejax.statics import Guess, settle


@compiled(static_argnums=(0,))
def searched(selection, knee, values, flexion, guess):
    """Poses alone, from near ones."""
    lanes = add_lane_axis(selection.apply(knee, values))
    return settle(lanes, {"flexion": flexion}, guess).q


@compiled(static_argnums=(0,))
def searched_with_jacobian(selection, knee, values, flexion, guess):
    """The same with derivatives by all parameters."""
    def poses(x):
        return settle(add_lane_axis(selection.apply(knee, x)), {"flexion": flexion}, guess).q

    q, push = jax.linearize(poses, values)
    return q, jax.vmap(push, out_axes=-1)(np.eye(len(values)))


def main() -> None:
    options = arguments("jacobian", __doc__, repeats=25)
    knee = load(options.knee)
    selection = select(knee, ["*.stiffness", "*.reference_strain"])
    values = np.asarray(selection.read(knee))
    found = kj.passive_flexion(knee, ANGLES).settled
    near = found.prescribed["flexion"], Guess(found.q, found.meeting, found.tangent)

    def walked(x):
        return kj.passive_flexion(selection.apply(knee, x), ANGLES).settled.q

    ways = {
        "walked": (walked, lambda x: jax.jacfwd(walked)(x)),
        "searched": (
            lambda x: searched(selection, knee, x, *near),
            lambda x: searched_with_jacobian(selection, knee, x, *near),
        ),
    }
    rows: dict[str, object] = {}
    for name, both in ways.items():
        first = [timed(way, values)[0] for way in both]
        rows |= {f"{name}_first_s": first[0], f"{name}_with_jacobian_first_s": first[1]}
        seconds = [[timed(way, 1.02 * values)[0] for way in both] for _ in range(options.repeats)]
        alone, with_jacobian = (statistics.median(x) for x in zip(*seconds, strict=True))
        rows |= {
            f"{name}_ms": 1e3 * alone,
            f"{name}_with_jacobian_ms": 1e3 * with_jacobian,
            f"{name}_ratio": with_jacobian / alone,
        }
    finish(options.out, "Motion with its exact Jacobian against the motion alone", rows)


if __name__ == "__main__":
    main()
