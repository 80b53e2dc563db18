"""What does the exact 25 x 5 x 8 Jacobian of a motion cost over the motion alone?

    python benchmarks/jacobian.py [--repeats 25]

The motion is walked from the reference pose. Its Jacobian comes by `jax.jacfwd`, as a person asks
for it, or as each fit begins (`balance_with_slopes`). All take turns in one run.
"""

from __future__ import annotations

import statistics

import jax
import numpy as np
from _protocol import ANGLES, arguments, finish, load, timed

import kneejax as kj
from kneejax.statics import LoadCases, balance_with_slopes


def main() -> None:
    options = arguments("jacobian", __doc__, repeats=25)
    knee, load_cases = load(options.knee), LoadCases.at(ANGLES)
    selection = kj.select(knee, ["*.stiffness", "*.reference_strain"])
    values = np.asarray(selection.read(knee))

    def motion(x):
        return kj.passive_flexion(selection.apply(knee, x), ANGLES).equilibrium.q

    def for_a_fit(x):
        return balance_with_slopes(knee, selection.apply, x[None], load_cases).jacobian

    ways = {"alone": motion, "by_jacfwd": jax.jacfwd(motion), "for_a_fit": for_a_fit}
    rows: dict[str, object] = {f"{n}_first_s": timed(way, values)[0] for n, way in ways.items()}
    there = 1.02 * values
    turns = [[timed(way, there)[0] for way in ways.values()] for _ in range(options.repeats)]
    median = dict(zip(ways, map(statistics.median, zip(*turns, strict=True)), strict=True))
    rows |= {f"{name}_ms": 1e3 * seconds for name, seconds in median.items()}
    rows |= {f"{name}_ratio": median[name] / median["alone"] for name in list(ways)[1:]}
    finish(options.out, "Motion with its exact Jacobian against the motion alone", rows)


if __name__ == "__main__":
    main()
