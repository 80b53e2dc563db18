"""How long does a 101 x 101 map of the objective take, and how much memory?

    python benchmarks/map.py [--grid 101] [--repeats 3] [--peers 1000]

Beside it, in the same run: `scipy.optimize.root` over the same equations in plain NumPy, walking
from angle to angle as in `batch.py`, on so many equilibria of the same grid, extrapolated.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time

import numpy as np
from _numpy_knee import UNITS
from _protocol import ANGLES, arguments, finish, first_and_median, load, peak_memory_mb, true_knee
from _variants import motion_of
from batch import peer

import kneejax as kj
from kneejax.inference import sensitivity_map, synthetic_motion
from kneejax.statics import LoadCases, balance_many

PAIR = ("PCL.stiffness", "PCL.reference_strain")
_ROWS = "KNEEJAX_MAP_ROWS"


def main() -> None:
    options = arguments("map", __doc__, grid=101, repeats=3, peers=1000)
    knee = load(options.knee)
    measured = synthetic_motion(true_knee(knee), {}, ANGLES)
    rows_of_grid = int(os.environ.get(_ROWS, options.grid))

    def draw():
        return sensitivity_map(knee, measured, PAIR, grid=(options.grid, rows_of_grid))

    if _ROWS in os.environ:
        sensitivity_map(knee, measured, PAIR, grid=(5, 5))
        begun = time.perf_counter()
        draw()
        print(json.dumps([time.perf_counter() - begun, peak_memory_mb()]))
        return
    first, seconds = first_and_median(draw, repeats=options.repeats)
    begun, found = time.process_time(), draw()
    equilibria = found.objective.size * len(ANGLES)
    rows = {
        "grid": f"{options.grid}x{options.grid}",
        "equilibria": equilibria,
        "first_call_s": first,
        "seconds": seconds,
        "processor_seconds": time.process_time() - begun,
        "equilibria_per_second": equilibria / seconds,
        "coloured": float(found.drawn.mean()),
        "without_balance": float((found.lost > 0).mean()),
    }
    for times in (1, 10):
        taken, peak = in_a_process_of_its_own(options.grid * times)
        rows |= {f"seconds_{times}_times_the_rows": taken, f"peak_memory_MB_{times}": peak}
    rows |= by_scipy(knee, found, options.peers, seconds)
    finish(options.out, "Map of the objective over two parameters", rows)


def in_a_process_of_its_own(rows: int) -> tuple[float, float]:
    """Seconds after compiling, and the largest memory of the process, compiling included."""
    done = subprocess.run(
        [sys.executable, *sys.argv], env=os.environ | {_ROWS: str(rows)}, capture_output=True,
        check=True, text=True,
    )  # fmt: skip
    return tuple(json.loads(done.stdout.splitlines()[-1]))


def by_scipy(knee, found, count: int, seconds: float) -> dict[str, object]:
    """The same equilibria by a loop, on grid points spread evenly."""
    points = np.linspace(0, found.objective.size - 1, max(count // len(ANGLES), 1)).astype(int)
    row, column = np.unravel_index(points, found.objective.shape)
    values = np.column_stack([found.x[column], found.y[row]])
    chosen = kj.select(knee, PAIR)
    ours = balance_many(knee, chosen.apply, values, LoadCases.at(ANGLES))
    varied = [chosen.apply(knee, v) for v in values]
    stiffness, slack = (
        np.stack([np.asarray(getattr(k.ligaments, field)) for k in varied])
        for field in ("stiffness", "slack_length")
    )
    poses, spent, _ = peer(knee, motion_of(knee, ANGLES), stiffness, slack, True)
    same = np.nanmax(np.abs(poses - ours.q) / UNITS, axis=2) < 1e-5
    whole = spent * found.objective.size / len(points)
    return {
        "scipy_equilibria": poses[..., 0].size,
        "scipy_seconds_extrapolated": whole,
        "scipy_converged": float(np.isfinite(poses[..., 0]).mean()),
        "scipy_same_to_1e-5": float(same.mean()),
        "times_faster_than_scipy": whole / seconds,
    }


if __name__ == "__main__":
    main()
