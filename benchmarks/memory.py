"""How much memory do a million equilibria take?

    python benchmarks/memory.py [--knees 40000]

Knees times 25 angles through the chunks of `_engine.py`; the largest resident set of the process
before (imports, compiling, one chunk) and after.
"""

from __future__ import annotations

import numpy as np
from _engine import Engine, random_knees
from _protocol import ANGLES, arguments, finish, load, peak_memory_mb


def main() -> None:
    options = arguments("memory", __doc__, knees=40_000, chunk=1024, threads=2, seed=0)
    knee = load(options.knee)
    stiffness, slack_length = random_knees(knee, options.knees, options.seed)
    engine = Engine(knee, ANGLES, options.chunk, options.threads)
    engine.solve(stiffness[:, : options.chunk], slack_length[:, : options.chunk])
    before = peak_memory_mb()
    done = engine.solve(stiffness, slack_length)
    rows = {
        "equilibria": options.knees * len(ANGLES),
        "peak_memory_before_MB": before,
        "peak_memory_MB": peak_memory_mb(),
        "answer_MB": sum(x.nbytes for x in done.values() if isinstance(x, np.ndarray)) / 1e6,
        "seconds": done["seconds"][-1],
        "converged": float(np.isfinite(done["q"][:, 0]).mean()),
    }
    finish(options.out, "Memory of a large batch", rows)


if __name__ == "__main__":
    main()
