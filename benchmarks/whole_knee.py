"""How fast is a knee with every fibre, obstacles and contact summed over points?

    python benchmarks/whole_knee.py [--knee lenhart2015] [--poses 20000] [--knees 512]

Poses that are given, a second: straight fibres alone, all fibres, and all fibres with contact. Then
equilibria a second of random variations of the knee's ligaments over flexion.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import numpy as np
from _protocol import arguments, finish, first_and_median, load, peak_memory_mb
from _variants import timed_batch

import kneejax as kj
from kneejax.experiments import evaluate
from kneejax.geometry import Pose
from kneejax.mechanics import Knee
from kneejax.statics import sound

FLEXION = np.arange(0.0, 91.0, 5.0)


def straightened(knee: Knee) -> Knee:
    """The knee's fibres as straight lines, without contact."""
    return eqx.tree_at(lambda k: k.ligaments.courses, without_contact(knee), ())


def without_contact(knee: Knee) -> Knee:
    return dataclasses.replace(knee, contacts=(), contact_names=())


def poses_near(knee: Knee, count: int) -> Pose:
    """Poses around the knee's own motion: within 1 degree and 0.5 mm."""
    motion = np.asarray(kj.passive_flexion(knee, FLEXION).to_table())
    motion = motion[np.isfinite(motion).all(axis=1)]
    table = np.resize(motion, (count, 6))
    draw = np.random.default_rng(0).uniform(-1.0, 1.0, (count, 6))
    return Pose.from_table(table + draw * [1.0, 1.0, 1.0, 0.5, 0.5, 0.5])


def main() -> None:
    options = arguments("whole_knee", __doc__, poses=20000, knees=512)
    knee = load("lenhart2015" if options.knee == "four_ligament" else options.knee)
    poses = poses_near(knee, options.poses)
    rows = {"knee": knee.name, "fibres": len(knee.ligaments.names), "poses": options.poses}
    for name, part in (
        ("straight_fibres", straightened(knee)),
        ("fibres", without_contact(knee)),
        ("fibres_and_contact", knee),
    ):
        first, again = first_and_median(lambda k: evaluate(k, poses), part, repeats=5)
        rows[f"{name}_poses_per_second"] = options.poses / again
        rows[f"{name}_first_call_seconds"] = first
        print(f"{name}: {options.poses / again:,.0f} poses a second", flush=True)

    values = varied(knee, options.knees)
    timed_batch(knee, tuple(x[:32] for x in values), FLEXION)
    seconds, found = timed_batch(knee, values, FLEXION)
    rows |= {
        "equilibria": found.status.size,
        "equilibria_per_second": found.status.size / seconds,
        "balanced_and_stable": float(sound(found.status).mean()),
        "steps_median": float(np.median(found.steps)),
        "peak_memory_mb": peak_memory_mb(),
    }
    finish(options.out, "How fast is a whole knee?", rows)


def varied(knee: Knee, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Stiffness within 20 and slack length within 2 per cent of the knee's, `(count, fibres)`."""
    draw = np.random.default_rng(0)
    ligaments = knee.ligaments
    own = (np.asarray(x) for x in (ligaments.stiffness, ligaments.slack_length))
    size = (count, len(ligaments.names))
    return tuple(
        x * (1.0 + part * draw.uniform(-1.0, 1.0, size))
        for x, part in zip(own, (0.2, 0.02), strict=True)
    )


if __name__ == "__main__":
    main()
