"""Tests under load: how long 24 curves take, and how many loads of random knees are answered.

    python benchmarks/laboratory.py [--knee four_ligament] [--knees 500] [--steps 10]

The curves: drawer, torsion and varus-valgus, both ways, at 0, 30, 60 and 90 degrees, in so many
steps. The loads: eight tests of random knees at the same flexions; a load is answered if the knee
balances under it, or if it is said at which turning point the knee gives way.
"""

from __future__ import annotations

import collections
import time

import numpy as np
from _protocol import arguments, finish, load
from _variants import random_knees, with_ligaments

import kneejax as kj
from kneejax.mechanics import Knee
from kneejax.statics import LoadCases, Status, balance_many

FLEXION = (0.0, 30.0, 60.0, 90.0)
#: Tests of random knees, and the sense of their load.
EIGHT = (
    ("drawer", 1), ("drawer", -1), ("torsion", 1), ("torsion", -1), ("varus-valgus", 1),
    ("varus-valgus", -1), ("compression", 1), ("pivot", 1),
)  # fmt: skip


def curve_seconds(knee: Knee, steps: int) -> list[float]:
    """Seconds for 24 curves, again and again; the first call, which compiles, is left out."""
    tests = [
        test
        for name in ("drawer", "torsion", "varus-valgus")
        for test in kj.lab_tests(name, FLEXION, both=True, steps=steps)
    ]
    taken = []
    for _ in range(8):
        begun = time.perf_counter()
        for curves in kj.load_curves(knee, tests):
            np.asarray(curves.displacement)
        taken.append(time.perf_counter() - begun)
    return taken[1:]


def statuses(knee: Knee, values, name: str, sense: int, steps: int) -> np.ndarray:
    """Of all knees at all loads of a test, `(knees, load_cases)`."""
    (test,) = kj.lab_tests(name, FLEXION, steps=steps)
    part = sense * np.tile(np.arange(1, steps + 1) / steps, len(FLEXION))
    load_cases = LoadCases.at(np.repeat(FLEXION, steps), test.loads(part))
    return balance_many(knee, with_ligaments, values, load_cases).status


def main() -> None:
    options = arguments("laboratory", __doc__, knees=500, steps=10, seed=0)
    knee, begun = load(options.knee), time.perf_counter()
    taken = curve_seconds(knee, options.steps)
    rows: dict[str, float] = {
        "curves_s_median": float(np.median(taken)), "curves_s_worst": float(max(taken))
    }  # fmt: skip
    values, counts = random_knees(knee, options.knees, options.seed), collections.Counter()
    for name, sense in EIGHT:
        found = collections.Counter(statuses(knee, values, name, sense, options.steps).ravel())
        counts += found
        lost = found[int(Status.NOT_CONVERGED)]
        rows[f"{name}_{sense:+d}_not_answered_percent"] = 100.0 * lost / found.total()
    rows |= {f"loads_{Status(int(s)).word}": n for s, n in sorted(counts.items())}
    answered = sum(n for s, n in counts.items() if s < Status.TOO_DEEP or s == Status.GIVES_WAY)
    rows["answered_percent"] = 100.0 * answered / counts.total()
    rows["seconds"] = time.perf_counter() - begun
    finish(options.out, f"The laboratory on {knee.name}", rows)


if __name__ == "__main__":
    main()
