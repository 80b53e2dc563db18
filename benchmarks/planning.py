"""How long does a map of tunnels take, and is the optimum as good as a grid's best point?

    python benchmarks/planning.py [--knee four_ligament] [--points 41] [--repeats 3]

A hamstring graft fixed at 20 degrees under 80 N; every point of the map is fixed, moved through 33
flexions and drawn forward by 100 N at 20 and 90 degrees. The optimum, of four coordinates and the
tension, is held against the best points of two grids over the tibial footprint: with the femur and
the tension as planned, and as the optimum has them.
"""

from __future__ import annotations

import time

import numpy as np
from _protocol import arguments, finish, first_and_median, load

from kneejax.geometry import FEMUR, TIBIA
from kneejax.planning import (
    Limits,
    Protocol,
    Surgery,
    best_of,
    footprint_of,
    optimise,
    reconstruction_of,
    tunnel_map,
)

BASE = np.array([0.0, 0.0, 0.0, 0.0, 80.0])


def main() -> None:
    options = arguments("planning", __doc__, points=41, repeats=3, band=1.0)
    knee = load(options.knee)
    plan = reconstruction_of(knee)
    tibia, femur = (footprint_of(knee, "ACL", bone) for bone in (TIBIA, FEMUR))
    through = Protocol(np.linspace(80.0, 0.0, 33), (20.0, 90.0), 100.0)
    limits = Limits(400.0, options.band, (20.0, 150.0))
    surgery = Surgery(plan, tibia, femur, (plan.torn,), 20.0, through, 5, limits)
    along = np.linspace(-7.0, 7.0, options.points)
    first, seconds = first_and_median(
        lambda: tunnel_map(surgery, BASE, TIBIA, along, along), repeats=options.repeats
    )
    found = optimise(surgery, BASE, np.ones(5, bool))
    begun = time.perf_counter()
    found = optimise(surgery, BASE, np.ones(5, bool))
    rows: dict[str, object] = {
        "points": options.points**2,
        "balances": options.points**2 * (len(through.flexion_deg) + 1),
        "map_first_call_s": first,
        "map_s": seconds,
        "optimum_s": time.perf_counter() - begun,
        "evaluations": found.evaluations,
        "feasible": found.feasible,
        "optimum": float(found.outcome.total[0]),
    }
    for name, rest in (("as planned", BASE), ("as the optimum", found.outcome.choices[0])):
        choices = np.tile(rest, (options.points, options.points, 1))
        choices[..., 0], choices[..., 1] = along, along[:, None]
        grid = surgery.try_out(choices.reshape(-1, 5), grid=choices.shape[:2])
        best = best_of(surgery, grid)
        rows[f"best of the grid, {name}"] = float(grid.total[best])
    finish(options.out, "A map of tunnels, and the optimum", rows)


if __name__ == "__main__":
    main()
