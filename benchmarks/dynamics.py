"""A Lachman test of a second at 1 kHz, one knee and 64; drift of energy; a raised leg; OpenSim.

Seconds are medians of a core, of what is compared in turns. OpenSim lets go of a knee of spheres on
planes (`tests/statics/opensim_knee.py`) where it is installed.
"""

import importlib.util
import sys
import time
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import kneejax as kj
from kneejax.dynamics import Given, Grid, Step, gravity_of, march, move_within
from kneejax.experiments import leg_of_person, leg_raise, raised_leg
from kneejax.geometry import COORDINATES
from kneejax.mechanics import Load, add_lane_axis, load_of

STEPS, VARIANTS = 1000, 64


def given_of(start: np.ndarray, lanes: int) -> Given:
    grid = Grid.of(np.linspace(0.0, 1.0, STEPS + 1))
    count = len(grid.time_s)
    full = load_of(anterior_N=100.0)
    part = jnp.clip(grid.time_s / 0.1, 0.0, 1.0)[:, None, None]
    still = jnp.zeros((count, 3, 1))
    load = Load(part * full.force[:, None], still, still, axes=full.axes, point_in=full.point_in)
    q = jnp.repeat(jnp.asarray(start)[:, None], lanes, axis=1)
    held = {"flexion": jnp.broadcast_to(q[0], (count, lanes))}
    steps = Step(jnp.asarray(grid.length_s), jnp.asarray(grid.ratio), (load,), held)
    return Given(q, jnp.zeros_like(q), steps)


def seconds(*calls, times: int = 5, clock=time.process_time) -> list[float]:
    """Of calls in turns, after one of each; medians."""
    took = []
    for _ in range(times + 1):
        row = []
        for call in calls:
            begin = clock()
            jax.block_until_ready(call())
            row.append(clock() - begin)
        took.append(row)
    return np.median(took[1:], axis=0).tolist()


def main() -> None:
    kj.configure()
    knee = kj.load_knee("four_ligament")
    leg = leg_of_person(75.0, 1.75)
    still = kj.passive_flexion(knee, 20.0)
    start = np.asarray(still.equilibrium.state.at(COORDINATES))[:, 0]
    moving = kj.MovingKnee.of(knee, leg).critically_damped()
    one = add_lane_axis(moving)
    factors = jnp.linspace(0.8, 1.2, VARIANTS)
    stiffness = moving.knee.ligaments.stiffness[:, None] * factors
    many = eqx.tree_at(lambda m: m.knee.ligaments.stiffness, one, stiffness)
    few, more = given_of(start, 1), given_of(start, VARIANTS)
    both = [lambda: march(one, few), lambda: march(many, more)]
    alone, batch = seconds(*both)
    waited = seconds(*both, clock=time.perf_counter)
    found = march(one, few)
    looks = float(jnp.mean(found.looks))
    print(f"one knee: {alone:.3f} s of a core, {looks:.2f} looks a step, "
          f"{1e6 * alone / STEPS / looks:.0f} us a look")  # fmt: skip
    print(f"{VARIANTS} variants: {batch:.3f} s of cores, {batch / alone:.1f} times one; "
          f"{waited[1] / waited[0]:.1f} times its wall clock")  # fmt: skip
    free = kj.MovingKnee.of(knee, leg)
    pull = kj.LoadCurve.of([0.0, 0.1], load_of(anterior_N=jnp.array([0.0, 100.0])))
    for within in (1, 2, 4):
        motion = kj.move(free, start, np.linspace(0.0, 1.0, STEPS + 1), loads=pull,
                         held=("flexion",), within=within)  # fmt: skip
        account = motion.account()
        missing, work = float(account.missing[-1]), float(account.work[-1])
        print(f"undamped, {1 / within:g} ms: {missing:.3g} of {work:.4g} N mm missing after 1 s")
    beside_opensim()
    leg_that_is_raised()


def beside_opensim() -> None:
    """Half a second after a damped knee was let go, by both programs."""
    if importlib.util.find_spec("opensim") is None:
        print("OpenSim is not installed: pip install 'kneejax[opensim]'")
        return
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from tests.dynamics.test_motion_opensim import TIMES, begin_of, damped_knee
    from tests.statics.opensim_knee import SettlingKnee

    moving = damped_knee()
    table, start = begin_of(moving)

    def whole():
        return move_within(0.01, moving, start, TIMES, held=("flexion",))

    grid = whole().grid
    ours, last = seconds(whole, lambda: kj.move(moving, start, grid, held=("flexion",)))
    steps = len(grid.time_s)
    print(f"half a second to 0.01 mm: {ours:.2f} s, {last:.3f} on its {steps} last steps")
    exact = move_within(1e-3, moving, start, TIMES, held=("flexion",)).to_table()
    for subdivisions, accuracy in ((5, 1e-3), (5, 1e-5), (6, 1e-5)):
        peer = SettlingKnee(moving.knee, subdivisions, moving)
        runs = [peer.motion(table, TIMES, accuracy) for _ in range(3)]
        took = float(np.median([run.processor_s for run in runs]))
        apart = np.abs(runs[0].poses - exact).max()
        print(f"OpenSim, {peer.triangles} triangles, accuracy {accuracy:g}: {took:.2f} s, "
              f"{apart:.3f} mm or degrees apart")  # fmt: skip


def leg_that_is_raised() -> None:
    """20 s of a quadriceps that becomes shorter, with the legs that are held."""
    knee = kj.load_knee("four_ligament", patella=True)
    leg = leg_of_person(75.0, 1.75)
    moving = kj.MovingKnee.of(knee, leg, gravity_m_s2=gravity_of(0.0)).critically_damped()
    times, angles = np.linspace(0.0, 20.0, 201), np.arange(90.0, -1.0, -10.0)
    (weight,) = moving.loads
    took, held = seconds(
        lambda: raised_leg(moving, angles, times).from_held,
        lambda: leg_raise(knee, angles, weight).quadriceps_N,
        times=3,
    )
    print(f"a leg raised in 20 s: {took - 2.0 * held:.2f} s of a core, and {2.0 * held:.2f} s for "
          "the legs that are held beside it, twice")  # fmt: skip


if __name__ == "__main__":
    main()
