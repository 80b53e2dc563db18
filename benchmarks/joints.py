"""How many poses a second does a simple joint give in closed form, beside searches for them?

    python benchmarks/joints.py [--poses 100000] [--one-by-one 2000] [--repeats 15]

The peers solve paper 5's constraint equations: Newton's method in NumPy on all poses at once, and
SciPy's fsolve from pose to pose, as a kinematic analysis in time does.
"""

from __future__ import annotations

import time

import jax
import jax.numpy as jnp
import numpy as np
from _numpy_joint import NumpyJoint
from _protocol import arguments, finish, first_and_median

from kneejax.geometry import FREE_COORDINATES, Pose, State
from kneejax.joints import axis_between, generalised_axis, moving_axis

#: Paper 5's mean poses (EOS), Grood and Suntay's translations taken as femoral ones.
POSES = np.array([
    [0.0, 0.05, 5.06, -3.39, -34.63, 4.80],
    [20.0, -1.14, 8.26, 0.61, -35.62, 2.88],
    [45.0, -2.30, 9.61, 4.81, -35.49, 2.68],
    [60.0, -2.59, 10.16, 6.88, -35.01, 2.90],
    [90.0, -2.62, 11.29, 10.58, -33.48, 2.58],
])  # fmt: skip
AXES = np.array([[[6, 8, -21.5], [1, 11, 23]], [[0.5, 1.5, -21], [-2, 1, 23.5]]])


# A table is made of what comes out, not inside: see docs/architecture.md, no stacks inside.
@jax.jit
def poses(joint, flexion):
    """Poses, six arrays."""
    return joint.pose(flexion)


@jax.jit
def with_slope(joint, flexion):
    """Poses and their exact derivative by flexion."""
    return jax.jvp(joint.pose, (flexion,), (jnp.ones_like(flexion),))


def main() -> None:
    options = arguments("joints", __doc__, poses=100_000, one_by_one=2_000, repeats=15)
    flexion = jnp.asarray(np.deg2rad(np.linspace(-10.0, 120.0, options.poses)))
    moving = moving_axis(AXES, Pose.from_table(POSES[[0, -1]]))
    all_five = Pose.from_table(POSES)
    general = generalised_axis(axis_between(*AXES, all_five.flexion), all_five)
    rows: dict[str, object] = {"poses": options.poses}
    for name, joint in (("moving_axis", moving), ("five_poses", general)):
        for what, function in (("", poses), ("_with_slope", with_slope)):
            first, steady = first_and_median(function, joint, flexion, repeats=options.repeats)
            rows[f"{name}{what}_first_call_s"] = first
            rows[f"{name}{what}_poses_per_second"] = options.poses / steady
    rows |= _peers(moving, np.asarray(flexion), options.one_by_one)
    rate = rows["moving_axis_poses_per_second"]
    for name in ("newton", "fsolve"):
        rows[f"times_faster_than_{name}"] = rate / rows[f"{name}_poses_per_second"]
    finish(options.out, "Poses a second of simple joints, in closed form and by search", rows)


def _peers(joint, flexion: np.ndarray, few: int) -> dict[str, object]:
    peer, rows = NumpyJoint(joint), {}
    start = np.r_[np.deg2rad(POSES[0, 1:3]), POSES[0, 3:]]
    begun = time.perf_counter()
    found, steps = peer.newton(flexion, np.repeat(start[:, None], len(flexion), axis=1))
    rows["newton_poses_per_second"] = len(flexion) / (time.perf_counter() - begun)
    rows["newton_steps"] = steps
    rows["newton_apart"] = _apart(joint, flexion, found)
    some = np.linspace(flexion[0], flexion[-1], few)
    begun = time.perf_counter()
    found = peer.one_by_one(some, start)
    rows["fsolve_poses_per_second"] = few / (time.perf_counter() - begun)
    rows["fsolve_apart"] = _apart(joint, some, found)
    return rows


def _apart(joint, flexion: np.ndarray, found: np.ndarray) -> float:
    """Largest difference between closed form and search, rad and mm."""
    ours = State({"tibia": joint.pose(flexion)}).at(FREE_COORDINATES)
    return float(np.abs(np.asarray(ours) - found).max())


if __name__ == "__main__":
    main()
