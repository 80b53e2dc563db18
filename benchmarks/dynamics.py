"""A Lachman test of a second at 1 kHz: one knee, 64 variants, drift of energy, and order."""

import time

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

import kneejax as kj
from kneejax.dynamics import Given, Grid, march
from kneejax.experiments import leg_of_person
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
    steps = jnp.asarray(grid.length_s), jnp.asarray(grid.ratio)
    return Given(q, jnp.zeros_like(q), *steps, (load,), held)


def seconds(call, times: int = 5) -> float:
    jax.block_until_ready(call())
    took = []
    for _ in range(times):
        begin = time.process_time()
        jax.block_until_ready(call())
        took.append(time.process_time() - begin)
    return min(took)


def main() -> None:
    kj.configure()
    knee = kj.load_knee("four_ligament")
    leg = leg_of_person(75.0, 1.75)
    still = kj.passive_flexion(knee, 20.0)
    start = np.asarray(still.settled.state.at(COORDINATES))[:, 0]
    moving = kj.MovingKnee.of(knee, leg).critically_damped()
    one = add_lane_axis(moving)
    alone = seconds(lambda: march(one, given_of(start, 1)))
    found = march(one, given_of(start, 1))
    looks = float(jnp.mean(found.looks))
    print(f"one knee: {alone:.3f} s of a core, {looks:.2f} looks a step, "
          f"{1e6 * alone / STEPS / looks:.0f} us a look")  # fmt: skip
    factors = jnp.linspace(0.8, 1.2, VARIANTS)
    stiffness = moving.knee.ligaments.stiffness[:, None] * factors
    many = eqx.tree_at(lambda m: m.knee.ligaments.stiffness, one, stiffness)
    batch = seconds(lambda: march(many, given_of(start, VARIANTS)), 3)
    print(f"{VARIANTS} variants: {batch:.3f} s of a core, {batch / alone:.1f} times one")
    free = kj.MovingKnee.of(knee, leg)
    pull = kj.LoadCurve.of([0.0, 0.1], load_of(anterior_N=jnp.array([0.0, 100.0])))
    for within in (1, 2, 4):
        motion = kj.move(free, start, np.linspace(0.0, 1.0, STEPS + 1), loads=pull,
                         held=("flexion",), within=within)  # fmt: skip
        account = motion.account()
        missing, work = float(account.missing[-1]), float(account.work[-1])
        print(f"undamped, {1 / within:g} ms: {missing:.3g} of {work:.4g} N mm missing after 1 s")


if __name__ == "__main__":
    main()
