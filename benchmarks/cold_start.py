"""How long does `kneejax calibrate` take as a whole process, cold and warm?

    python benchmarks/cold_start.py [--repeats 3]

Cold: an empty JAX compilation cache, as on a machine that has never run it. Warm: the same
command again, median. Each run is a new process in an empty folder.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from _protocol import arguments, finish

RUN = "import sys; from kneejax.cli import main; sys.exit(main(['calibrate', '--out', 'result']))"


def run(cache: Path) -> tuple[float, int]:
    """Seconds and exit status of one process."""
    environment = os.environ | {
        "JAX_COMPILATION_CACHE_DIR": str(cache),
        "XDG_CACHE_HOME": str(cache),
        "PYTHONPATH": str(Path(__file__).resolve().parent.parent),
    }
    with tempfile.TemporaryDirectory() as folder:
        begun = time.perf_counter()
        done = subprocess.run(
            [sys.executable, "-c", RUN], cwd=folder, env=environment, capture_output=True
        )
        seconds = time.perf_counter() - begun
    if done.returncode == 2 or done.stderr.startswith(b"Traceback"):
        raise SystemExit(done.stderr.decode())
    return seconds, done.returncode


def main() -> None:
    options = arguments("cold_start", __doc__, repeats=3)
    with tempfile.TemporaryDirectory() as cache:
        cold, status = run(Path(cache))
        warm = [run(Path(cache))[0] for _ in range(options.repeats)]
        size = sum(f.stat().st_size for f in Path(cache).rglob("*") if f.is_file())
    rows = {
        "cold_s": cold,
        "warm_s": statistics.median(warm),
        "warm_all_s": [round(s, 3) for s in warm],
        "cache_MB": size / 1e6,
        "exit_status": status,
    }
    finish(options.out, "`kneejax calibrate` as a whole process", rows)


if __name__ == "__main__":
    main()
