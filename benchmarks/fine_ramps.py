"""Do loads that grow in steps a tenth as long lead random knees to the same poses?

    python benchmarks/fine_ramps.py [--knees 100] [--steps 1000]

Random knees, with and without their ACL, are loaded in so many equal steps and in ten times as
many. At every load that both reach, coordinates are compared (rotations at 30 mm). Loads that one
of the two reaches alone are counted: where a branch ends, steps that are too long may pass over it.
"""

from __future__ import annotations

import time

import numpy as np
from _numpy_knee import UNITS
from _protocol import arguments, finish, load
from _variants import own_values, random_knees, with_ligaments

from kneejax.mechanics import Knee, load_of
from kneejax.parameters import cut
from kneejax.statics import Equilibria, LoadCases, balance_many

#: Load, its size (N or N m) and the flexion, degrees.
TESTS = (
    ("anterior_N", 134.0, 30.0),
    ("anterior_N", -134.0, 90.0),
    ("internal_Nm", 5.0, 60.0),
    ("varus_Nm", 10.0, 0.0),
)
#: Steps of the fine ramp for each of the coarse one.
_FINER = 10


def ramp(knee: Knee, values, test: tuple[str, float, float], steps: int) -> Equilibria:
    """All knees under a load that grows in equal steps, `(knees, steps)`."""
    name, size, flexion = test
    sizes = size * np.arange(1, steps + 1) / steps
    load_cases = LoadCases.at(np.full(steps, flexion), [load_of(**{name: sizes})])
    return balance_many(knee, with_ligaments, values, load_cases)


def compared(coarse: Equilibria, fine: Equilibria) -> dict[str, float]:
    """How far apart they are at the same loads, and how many loads only one of them reaches."""
    fine = fine.at(slice(None), slice(_FINER - 1, None, _FINER))
    both = coarse.converged & fine.converged
    apart = np.abs(coarse.q - fine.q) / UNITS
    return {
        "loads_both_reach": int(both.sum()),
        "loads_one_reaches": int((coarse.converged ^ fine.converged).sum()),
        "apart_mm": float(apart[both].max(initial=0.0)),
    }


def main() -> None:
    options = arguments("fine_ramps", __doc__, knees=100, steps=1000, seed=0)
    whole, rows = load(options.knee), {}
    begun = time.perf_counter()
    for words, knee in (("with_ACL", whole), ("without_ACL", cut(whole, ["ACL"]))):
        stiffness, slack_length = random_knees(knee, options.knees, options.seed)
        values = stiffness * (own_values(knee)[0] > 0), slack_length
        for test in TESTS:
            ramps = [ramp(knee, values, test, n * options.steps) for n in (1, _FINER)]
            label = f"{words}_{test[0]}={test[1]:g}_at_{test[2]:g}"
            rows |= {f"{label}_{key}": number for key, number in compared(*ramps).items()}
    both = [number for key, number in rows.items() if key.endswith("both_reach")]
    rows["loads_compared"] = sum(both)
    rows["largest_apart_mm"] = max(x for key, x in rows.items() if key.endswith("apart_mm"))
    rows["seconds"] = time.perf_counter() - begun
    finish(options.out, f"Ramps of {options.steps} and {_FINER * options.steps} steps", rows)


if __name__ == "__main__":
    main()
