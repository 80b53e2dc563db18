"""Does contact change without a jump, and does it agree with rays between the meshes?

    python benchmarks/contact_scans.py [--paths 200] [--poses 500]

Each path runs 2 mm through a random pose that presses the bones together with 0 to 5 kN. Where its
force bends most, as far as that is below 5 kN, it is looked at more closely, twice, until poses are
1e-6 mm apart; there a change of force between two neighbours is held against the median of all.
Poses of lenhart2015
under 0.8 to 5 kN are held against rays between its meshes (the elastic foundation of
tests/mechanics/raycast_foundation.py), where the meshes are at hand.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import jax
import numpy as np

import kneejax as kj

jax.config.update("jax_enable_x64", True)
kj.use_shared_fusion()

TESTS = Path(__file__).parents[1] / "tests"
KNEES = ("four_ligament", "lenhart2015", "lenhart2015_reduced")
STEPS_MM, STEPS, MOST_N = (4e-3, 3e-5, 1e-6), 513, 5000.0
#: A median change counts at least so much: where a ray ends of a point that is a millimetre apart,
#: what the rounded onset leaves there, 1.5e-7 N, ends with it.
LEAST_N = 1e-7
FLEXION = np.arange(0.0, 91.0, 15.0)
#: Beside the knee's own motion: degrees and mm of the six coordinates.
SPREAD = np.array([5.0, 2.0, 5.0, 2.0, 0.0, 1.5])


def forces(knee: kj.Knee, table: np.ndarray) -> kj.Mechanics:
    return kj.evaluate(knee, kj.Pose.from_table(table))


def pressed_poses(knee: kj.Knee, count: int, rng: np.random.Generator) -> np.ndarray:
    """Poses around the knee's own motion whose contacts carry up to 5 kN each."""
    motion = np.asarray(kj.passive_flexion(knee, FLEXION).to_table())
    motion = motion[np.isfinite(motion).all(axis=1)]
    chosen = motion[rng.integers(0, len(motion), 8 * count)]
    chosen = chosen + rng.uniform(-1.0, 1.0, chosen.shape) * SPREAD
    chosen[:, 4] += rng.uniform(0.0, 3.0, len(chosen))
    force = np.linalg.norm(np.asarray(forces(knee, chosen).contact_force), axis=-1)
    sane = np.isfinite(force).all(axis=1) & (force.max(axis=1) < MOST_N) & (force.max(axis=1) > 0.1)
    return chosen[sane][:count]


def worst_change(knee: kj.Knee, middle: np.ndarray, rng: np.random.Generator) -> tuple[float, ...]:
    """Largest change over the median one, the largest, N, and the force, N, on a path."""
    way = rng.normal(size=6)
    way /= np.linalg.norm(way[3:])
    contacts = knee.contact_names
    return max(_on_path(knee, middle, way, contact) for contact in range(len(contacts)))


def _on_path(knee: kj.Knee, middle: np.ndarray, way: np.ndarray, contact: int):
    for step in STEPS_MM:
        table = middle + step * way * (np.arange(STEPS) - STEPS // 2)[:, None]
        force = np.asarray(forces(knee, table).contact_force)[:, contact]
        bend = np.linalg.norm(np.diff(force, 2, axis=0), axis=1)
        within = np.linalg.norm(force[1:-1], axis=1) < MOST_N
        middle = table[1 + int(np.where(within, bend, -1.0).argmax())]
    change = np.linalg.norm(np.diff(force, axis=0), axis=1)
    usual = max(float(np.median(change)), LEAST_N)
    return float(change.max()) / usual, float(change.max()), float(np.linalg.norm(force[0]))


def scan(name: str, paths: int) -> None:
    knee, rng = kj.load_knee(name), np.random.default_rng(0)
    found = np.array([worst_change(knee, m, rng) for m in pressed_poses(knee, paths, rng)])
    ratio, change, force = found[found[:, 0].argmax()]
    print(
        f"{name}: {len(found)} paths, worst change {ratio:.2f} times the median "
        f"({change:.2g} N at {force:.0f} N), {np.sum(found[:, 0] > 10)} above ten times",
        flush=True,
    )


def against_meshes(poses: int) -> None:
    sys.path[:0] = [str(TESTS / "validation"), str(TESTS / "mechanics")]
    from raycast_foundation import confined_modulus, load_mesh_mm, raycast_contact
    from recorded_lenhart2015 import DATA, read_record

    knee, rng = kj.load_knee("lenhart2015"), np.random.default_rng(0)
    recorded = read_record().table
    table = recorded[rng.integers(0, len(recorded), 3 * poses)]
    table = table + rng.uniform(-1.0, 1.0, table.shape) * [0.0, 1.5, 3.0, 1.5, 0.0, 1.0]
    table[:, 4] += rng.uniform(0.0, 2.6, len(table))
    force = np.asarray(forces(knee, table).contact_force).sum(axis=1)
    size = np.linalg.norm(force, axis=1)
    chosen = np.flatnonzero((size > 800.0) & (size < MOST_N))[:poses]
    meshes = [
        load_mesh_mm(DATA / "meshes" / f"lenhart2015-R-{bone}-cartilage.stl")
        for bone in ("femur", "tibia")
    ]
    rays = [
        raycast_contact(*meshes, table[k], confined_modulus(10.0, 0.45), 6.0).force for k in chosen
    ]
    miss = np.linalg.norm(force[chosen] - rays, axis=1) / np.linalg.norm(rays, axis=1)
    print(
        f"against mesh rays: {len(chosen)} poses, {size[chosen].min():.0f} to "
        f"{size[chosen].max():.0f} N; vector error median {np.median(miss):.2%}, 95 % below "
        f"{np.percentile(miss, 95):.2%}, worst {miss.max():.2%}"
    )


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--paths", type=int, default=200)
    options.add_argument("--poses", type=int, default=500)
    options.add_argument("--knees", nargs="*", default=KNEES)
    options = options.parse_args()
    for name in options.knees:
        scan(name, options.paths)
    if options.poses:
        against_meshes(options.poses)


if __name__ == "__main__":
    main()
