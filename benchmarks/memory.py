"""How much memory do a million equilibria take?

    python benchmarks/memory.py [--knees 40000] [--chunk 128] [--threads 2]

Compiling takes more memory than running: it happens in a process of its own, which fills a
compilation cache for the one that is measured.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile

import numpy as np
from _engine import Engine, random_knees
from _protocol import ANGLES, arguments, finish, load, peak_memory_mb

_CACHE = "JAX_COMPILATION_CACHE_DIR"


def measure(options) -> dict[str, object]:
    """Solve in this process; the largest memory before the batch and after it."""
    knee = load(options.knee)
    stiffness, slack_length = random_knees(knee, options.knees, options.seed)
    engine = Engine(knee, ANGLES, options.chunk, options.threads)
    engine.solve(stiffness[:, : options.chunk], slack_length[:, : options.chunk])
    before = peak_memory_mb()
    done = engine.solve(stiffness, slack_length)
    return {
        "equilibria": options.knees * len(ANGLES),
        "peak_memory_before_MB": before,
        "peak_memory_MB": peak_memory_mb(),
        "answer_MB": sum(x.nbytes for x in done.values() if isinstance(x, np.ndarray)) / 1e6,
        "seconds": done["seconds"][-1],
        "converged": done["converged"][-1],
    }


def main() -> None:
    options = arguments("memory", __doc__, knees=40_000, chunk=128, threads=2, seed=0)
    if os.environ.get("KNEEJAX_MEASURED"):
        print(json.dumps(measure(options)))
        return
    with tempfile.TemporaryDirectory() as cache:
        environment = os.environ | {"KNEEJAX_MEASURED": "1", _CACHE: cache}
        answers = []
        for more in (["--knees", str(options.chunk)], []):
            done = subprocess.run(
                [sys.executable, *sys.argv, *more], env=environment, capture_output=True, check=True
            )
            answers.append(json.loads(done.stdout.splitlines()[-1]))
    compiling, rows = answers
    rows["peak_memory_while_compiling_MB"] = compiling["peak_memory_MB"]
    finish(options.out, "Memory of a large batch", rows)


if __name__ == "__main__":
    main()
