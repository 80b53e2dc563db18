"""How long do paper 1's Figures 3 to 10 take: 8 parameters x 31 values x 25 angles?

    python benchmarks/sweeps.py [--values 31] [--repeats 7] [--peers 3]

Beside it, in the same run: a loop of `kneejax.passive_flexion`, one motion a value, as a user would
write it without the batch engine, and `scipy.optimize.root` over the same equations in plain NumPy
(`batch.py`), on the first few values of the first parameters.
"""

from __future__ import annotations

import time

import numpy as np
from _protocol import ANGLES, arguments, finish, first_and_median, load, peak_memory_mb
from _variants import motion_of
from batch import peer

from kneejax import passive_flexion
from kneejax.inference import sweep

NAMES = ("*.stiffness", "*.reference_strain")


def main() -> None:
    options = arguments("sweeps", __doc__, values=31, repeats=7, peers=3)
    knee = load(options.knee)

    def figures():
        return sweep(knee, NAMES, ANGLES, count=options.values)

    first, seconds = first_and_median(figures, repeats=options.repeats)
    begun = time.process_time()
    done = figures()
    processor = time.process_time() - begun
    status = np.stack([one.status for one in done.sweeps])
    rows = {
        "parameters": len(done.sweeps),
        "values": options.values,
        "angles": len(ANGLES),
        "equilibria": status.size,
        "first_call_s": first,
        "seconds": seconds,
        "processor_seconds": processor,
        "equilibria_per_second": status.size / seconds,
        "balanced_and_stable": float((status < 2).mean()),
        "peak_memory_MB": peak_memory_mb(),
    }

    few = [(one.name, value) for one in done.sweeps for value in one.values[:: options.values - 1]]
    few = few[: max(options.peers, 1)]
    passive_flexion(knee, ANGLES).status.block_until_ready()
    begun = time.perf_counter()
    for name, value in few:
        passive_flexion(knee.replace({name: value}), ANGLES).status.block_until_ready()
    one_by_one = (time.perf_counter() - begun) / len(few)
    rows["seconds_one_motion_at_a_time"] = one_by_one * status.size / len(ANGLES)

    varied = [knee.replace({name: value}) for name, value in few]
    stiffness, slack = (
        np.stack([np.asarray(getattr(k.ligaments, field)) for k in varied])
        for field in ("stiffness", "slack_length")
    )
    _, spent, _ = peer(knee, motion_of(knee, ANGLES), stiffness, slack, True)
    rows["seconds_of_a_scipy_loop"] = spent * status.size / (len(few) * len(ANGLES))
    rows["times_faster_than_scipy"] = rows["seconds_of_a_scipy_loop"] / seconds
    finish(options.out, "Figures 3 to 10 of paper 1", rows)


if __name__ == "__main__":
    main()
