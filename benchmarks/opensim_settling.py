"""Seconds a balance: OpenSim settling a knee of spheres on planes, and kneejax on the same knee.

    python benchmarks/opensim_settling.py [--knees 8192]

Four ligaments, the pull of the patellar tendon, two spheres on two planes with a linear layer
(`tests/statics/opensim_knee.py`), at 25 angles. OpenSim lets go of the tibia where it rested at the
angle before, flexion locked, and integrates until it rests again; its spheres are meshed three
times, ever finer. kneejax balances many knees with other ligaments at the same angles.
"""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np
from _protocol import ANGLES, arguments, finish

import kneejax as kj
from kneejax.statics import LoadCases, balance_many

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "statics"))

#: Of an icosahedron: each makes four triangles of one.
SUBDIVISIONS = (4, 5, 6)
#: What the two programs may differ by, mm and degrees.
CRITERION = 0.05
# A row of `COLUMNS` in mm, rotations at 30 mm.
_IN_MM = np.r_[np.deg2rad([1.0, 1.0, 1.0]) * 30.0, 1.0, 1.0, 1.0]


def equilibrium(peer, motion) -> dict[str, float]:
    """OpenSim's motion over all angles, and how far from kneejax's it is."""
    ours, begin, rests = np.asarray(motion.to_table()), np.zeros(6), []
    for angle in ANGLES:
        rests.append(peer.solve_equilibrium(angle, begin))
        begin = rests[-1].pose
    apart = np.abs([rest.pose for rest in rests] - ours)
    # How far from its own balance OpenSim stopped, by the force that it leaves unbalanced.
    tangent = np.moveaxis(np.asarray(motion.equilibrium.tangent), -1, 0)
    left = np.linalg.solve(tangent, np.stack([rest.unbalanced for rest in rests])[..., None])
    left = np.abs(left[..., 0] * np.r_[np.rad2deg([1.0, 1.0]), 1.0, 1.0, 1.0])
    return {
        "s_per_equilibrium": float(np.mean([rest.seconds for rest in rests])),
        "slowest_s": max(rest.seconds for rest in rests),
        "processor_s_per_equilibrium": float(np.mean([rest.processor_s for rest in rests])),
        "apart_deg": apart[:, :3].max(),
        "apart_mm": apart[:, 3:].max(),
        "unsettled_deg": left[:, :2].max(),
        "unsettled_mm": left[:, 2:].max(),
        "apart_overall_mm": (apart * _IN_MM).max(),
    }


def balanced(knee, count: int) -> dict[str, float]:
    """kneejax over random ligaments, as far apart as in `batch.py`, at all angles."""
    selection = kj.select(knee, ["*.stiffness", "*.reference_strain"])
    own, draw = np.asarray(selection.read(knee)), np.random.default_rng(0)
    stiffness = draw.uniform(300.0, 9300.0, (count, 4))
    values = np.c_[stiffness, own[4:] + draw.uniform(-0.03, 0.03, (count, 4))]

    def timed():
        wall, processor = time.perf_counter(), time.process_time()
        found = balance_many(knee, selection.apply, values, LoadCases.at(ANGLES))
        return found, time.perf_counter() - wall, time.process_time() - processor

    _, first, _ = timed()
    found, wall, processor = timed()
    equilibria = found.status.size
    return {
        "first_call_s": first,
        "equilibria": equilibria,
        "balanced": float(found.converged.mean()),
        "equilibria_per_second": equilibria / wall,
        "s_per_equilibrium": wall / equilibria,
        "processor_s_per_equilibrium": processor / equilibria,
    }


def main() -> None:
    options = arguments("opensim_settling", __doc__, knees=8192)
    if importlib.util.find_spec("opensim") is None:
        raise SystemExit("opensim_settling needs OpenSim: pip install 'kneejax[opensim]'")
    import opensim
    from opensim_knee import SettlingKnee, sphere_knee

    knee = sphere_knee()
    motion = kj.passive_flexion(knee, ANGLES)
    if not np.asarray(motion.stable).all():
        raise SystemExit("the knee of spheres on planes does not stand at every angle")
    ours = balanced(knee, options.knees)
    rows: dict[str, object] = {"opensim": opensim.GetVersion(), "angles": len(ANGLES)}
    rows |= {f"kneejax_{key}": value for key, value in ours.items()}
    apart = []
    for subdivisions in SUBDIVISIONS:
        begun = time.perf_counter()
        peer = SettlingKnee(knee, subdivisions)
        ready = time.perf_counter() - begun
        theirs = {"ready_s": ready} | equilibrium(peer, motion)
        times = {
            f"times_{word}": theirs[key] / ours[key]
            for word, key in (
                ("longer", "s_per_equilibrium"),
                ("more_processor_time", "processor_s_per_equilibrium"),
            )
        }
        apart.append(theirs["apart_overall_mm"])
        close = max(theirs["apart_deg"], theirs["apart_mm"]) <= CRITERION
        of_mesh = theirs | {f"within_{CRITERION}_mm_and_deg": close} | times
        rows |= {f"opensim_{peer.triangles}_{key}": value for key, value in of_mesh.items()}
    # Triangles of half the edge: 2 where the error is of second order.
    rows["order_of_apart"] = [float(x) for x in np.log2(np.divide(apart[:-1], apart[1:])).round(2)]
    finish(options.out, "Seconds a balance, settled by OpenSim and solved by kneejax", rows)


if __name__ == "__main__":
    main()
