"""How much memory do a million equilibria take?

    python benchmarks/memory.py [--knees 40000]

Compiling takes more memory than running: it happens in a process of its own, which fills a
compilation cache for the one that is measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

from _protocol import ANGLES, arguments, finish, load, peak_memory_mb
from _variants import random_knees, timed_batch

_CACHE = "JAX_COMPILATION_CACHE_DIR"


def measure(options) -> dict[str, object]:
    """Solve in this process; the largest memory before the batch and after it."""
    knee = load(options.knee)
    values = random_knees(knee, options.knees, options.seed)
    timed_batch(knee, tuple(x[:128] for x in values), ANGLES)
    before = peak_memory_mb()
    seconds, found = timed_batch(knee, values, ANGLES)
    arrays = (found.q, found.contact_points, found.status, found.steps)
    return {
        "equilibria": found.status.size,
        "peak_memory_before_MB": before,
        "peak_memory_MB": peak_memory_mb(),
        "answer_MB": sum(x.nbytes for x in arrays) / 1e6,
        "seconds": seconds,
        "converged": float(found.converged.mean()),
    }


def main() -> None:
    options = arguments("memory", __doc__, knees=40_000, seed=0)
    if os.environ.get("KNEEJAX_MEASURED"):
        print(json.dumps(measure(options)))
        return
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"KNEEJAX_MEASURED": "1", _CACHE: cache}
        answers = []
        for more in (["--knees", "128"], []):
            done = subprocess.run(
                [sys.executable, *sys.argv, *more], env=environment, capture_output=True, check=True
            )
            answers.append(json.loads(done.stdout.splitlines()[-1]))
    compiling, rows = answers
    rows["peak_memory_while_compiling_MB"] = compiling["peak_memory_MB"]
    finish(options.out, "Memory of a large batch", rows)


if __name__ == "__main__":
    main()
