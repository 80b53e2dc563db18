"""A patella beside the tibia: what it costs, and how many random knees balance under a quadriceps.

    python benchmarks/patella.py [--knee lenhart2015_reduced] [--knees 500] [--seed 0]

Rates: the motion of the knee of two bones and of three, in turns, warm. Random knees: attachments
on the patella moved by up to 3 mm along each axis, tendon longer or shorter by up to 5 %, pulls of
20 to 1,500 N at 0 to 120 degrees. A balance is sound that is stable and on its surfaces.
"""

from __future__ import annotations

import collections
import dataclasses
import time

import jax
import jax.numpy as jnp
import numpy as np
from _protocol import arguments, finish

import kneejax as kj
from kneejax.geometry import PATELLA, TIBIA
from kneejax.mechanics import QUADRICEPS, Knee, pull_of
from kneejax.statics import LoadCases, Status, balance_many, sound

FLEXION_DEG = (0.0, 30.0, 60.0, 90.0, 120.0)
PULLS_N = (20.0, 100.0, 500.0, 1500.0)
MOVED_MM, LONGER = 3.0, 0.05
_SOUND = (Status.BALANCED, Status.OVERSTRETCHED)


def with_patella_changed(knee: Knee, value: jax.Array) -> Knee:
    """A knee whose patellar attachments and tendon are others: mm for each, then a part."""
    ligaments = knee.ligaments
    first = np.array([k for k, pair in enumerate(ligaments.bodies) if pair[0] == PATELLA])
    second = np.array([k for k, pair in enumerate(ligaments.bodies) if pair[1] == PATELLA])
    moved = value[:-1].reshape(-1, 3, *value.shape[1:])
    ends = ligaments.femoral_attachment.at[first].add(moved[: len(first)])
    tendon = [k for k in first if ligaments.bodies[k] == (PATELLA, TIBIA)]
    return dataclasses.replace(
        knee,
        ligaments=dataclasses.replace(
            ligaments,
            femoral_attachment=outside(ligaments.courses, ends),
            tibial_attachment=ligaments.tibial_attachment.at[second].add(moved[len(first) :]),
            slack_length=ligaments.slack_length.at[jnp.array(tendon)].multiply(1.0 + value[-1]),
        ),
    )


def outside(courses, ends: jax.Array) -> jax.Array:
    """Attachments pushed out of what their fibres go around on the patella: a shift of some mm
    leads into it half of the time."""
    for course in courses:
        if course.obstacle is not None and course.obstacle_bone == PATELLA:
            rows, placed = np.array(course.rows), course.obstacle.frame.placement
            x, y, z = placed.apply_inverse(tuple(jnp.moveaxis(ends[rows], 1, 0)))
            sizes = course.obstacle.semi_axes_along_frame
            size = jnp.sqrt(sum((c / a) ** 2 for c, a in zip((x, y, z), sizes, strict=True)))
            out = jnp.maximum(1.0, 1.001 / size)
            there = placed.apply((out * x, out * y, out * z))
            ends = ends.at[rows].set(jnp.stack(there, axis=1))
    return ends


def seconds(knees: dict[str, Knee], flexion: np.ndarray, rounds: int = 5) -> dict[str, float]:
    """Median seconds of a motion of each knee, in turns; what compiles is left out."""
    taken: dict[str, list[float]] = {name: [] for name in knees}
    for turn in range(rounds + 1):
        for name, knee in knees.items():
            begun = time.perf_counter()
            jax.block_until_ready(kj.passive_flexion(knee, flexion).pose.anterior)
            if turn:
                taken[name].append(time.perf_counter() - begun)
    return {name: float(np.median(one)) for name, one in taken.items()}


def main() -> None:
    options = arguments("patella", __doc__, knees=500, seed=0)
    name = "lenhart2015_reduced" if options.knee == "four_ligament" else options.knee
    knees = {"two": kj.load_knee(name), "three": kj.load_knee(name, patella=True)}
    taken = seconds(knees, np.arange(0.0, 121.0, 5.0))
    rows: dict[str, object] = {f"{bones}_bones_s": s for bones, s in taken.items()}
    rows["rate_of_three"] = taken["two"] / taken["three"]

    knee = knees["three"]
    count = 3 * sum(PATELLA in pair for pair in knee.ligaments.bodies)
    rng = np.random.default_rng(options.seed)
    values = np.c_[
        rng.uniform(-MOVED_MM, MOVED_MM, (options.knees, count)),
        rng.uniform(-LONGER, LONGER, options.knees),
    ]
    rest = float(knee.muscles.tension.sum())
    flexion, pull = (x.ravel() for x in np.meshgrid(FLEXION_DEG, PULLS_N, indexing="ij"))
    load_cases = LoadCases.at(flexion, [pull_of(QUADRICEPS, pull - rest)])
    begun = time.perf_counter()
    found = balance_many(knee, with_patella_changed, values, load_cases)
    rows["random_s"] = time.perf_counter() - begun
    status = np.asarray(found.status)
    rows["sound"] = float(np.isin(status, _SOUND).mean())
    rows["stable"] = float(sound(status).mean())
    for kind, many in collections.Counter(status.ravel().tolist()).items():
        rows[Status(kind).word.replace(" ", "_")] = many
    lost = (~np.isin(status, _SOUND)).reshape(-1, len(FLEXION_DEG), len(PULLS_N)).mean(axis=0)
    for angle, parts in zip(FLEXION_DEG, lost, strict=True):
        rows[f"lost_at_{angle:g}_deg"] = " ".join(f"{part:.2f}" for part in parts)
    silent = ~np.isfinite(found.q).all(axis=-1) & np.isin(status, _SOUND)
    rows["silent"] = int(silent.sum())
    finish(options.out, f"a patella beside the tibia, {name}", rows)


if __name__ == "__main__":
    main()
