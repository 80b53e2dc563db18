"""Do clinical loads leave the fitted surfaces of the bundled knees, and by how much?

    python benchmarks/clinical_loads.py [--step-deg 30]

100 N of drawer, 5 N m of torsion and 10 N m of varus and valgus, 0 to 90 degrees, each grown from
the unloaded balance. A cell is how far the contact of a compartment reaches beyond its fitted
surfaces, mm, and the part of its force that is carried there; 0 is inside.
"""

from __future__ import annotations

import argparse

import numpy as np
from _protocol import RESULTS, finish

import kneejax as kj
from kneejax.experiments import mechanics_of
from kneejax.files import bundled_knees
from kneejax.statics import Status

kj.configure()
TESTS = (
    ("drawer", {"force_N": 100.0}, ("anterior 100 N", "posterior 100 N")),
    ("torsion", {"moment_Nm": 5.0}, ("internal 5 N m", "external 5 N m")),
    ("varus-valgus", {"moment_Nm": 10.0}, ("varus 10 N m", "valgus 10 N m")),
)


def of_knee(knee, flexion) -> dict[str, list[str]]:
    """Load -> what becomes of it at every flexion."""
    found = {}
    for name, size, ends in TESTS:
        (test,) = kj.lab_tests(name, flexion, both=True, steps=2, **size)
        (curves,) = kj.load_curves(knee, test)
        mechanics = mechanics_of(curves)
        for end, step in zip(ends, (-1, 0), strict=True):
            rows = curves.nodes[:, step]
            found[end] = [_cell(mechanics, curves.motion.status, row) for row in rows]
    return found


def _cell(mechanics, status, row: int) -> str:
    state = Status(int(status[row]))
    if not state.converged:
        return state.word
    known = np.asarray(mechanics.known[row])
    words = "" if state in (Status.BALANCED, Status.OUTSIDE_REGION) else f", {state.word}"
    if known.all():
        return "0" + words
    far, share = (np.asarray(getattr(mechanics, x)[row]) for x in ("beyond_mm", "beyond_share"))
    worst = int(np.nanargmax(np.where(known, -np.inf, far)))
    return f"{far[worst]:.1f} ({100 * share[worst]:.0f} %){words}"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", default=RESULTS / "clinical_loads.json")
    parser.add_argument("--step-deg", type=float, default=30.0)
    options = parser.parse_args()
    flexion = np.arange(0.0, 90.1, options.step_deg)
    print("| knee | load | " + " | ".join(f"{x:g}" for x in flexion) + " |")
    print("|---" * (2 + len(flexion)) + "|")
    inside, rows = {}, {}
    for name in bundled_knees():
        cells = of_knee(kj.load_knee(name), flexion)
        for load, own in cells.items():
            print(f"| `{name}` | {load} | " + " | ".join(own) + " |", flush=True)
            rows[f"{name}, {load}"] = "; ".join(own)
        every = [cell for own in cells.values() for cell in own]
        inside[f"{name}, inside, percent"] = 100.0 * np.mean([cell == "0" for cell in every])
    question = "Clinical loads on the bundled knees, mm outside the fitted surfaces"
    finish(options.out, question, inside | rows)


if __name__ == "__main__":
    main()
