"""What every benchmark shares: the knee, timing, versions and the JSON file."""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import sys
import time
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import kneejax as kj  # noqa: E402
from kneejax.inference import versions  # noqa: E402
from kneejax.numerics import use_shared_fusion  # noqa: E402

#: Environment variable that keeps XLA's fusion as it is in this process.
PLAIN = "KNEEJAX_PLAIN_FUSION"
if not os.environ.get(PLAIN):
    use_shared_fusion()

RESULTS = Path(__file__).parent / "results"
#: The usual angles, degrees: 25 poses.
ANGLES = np.arange(0.0, 121.0, 5.0)
#: Paper 1, Table 3: the values that make the data of the calibration benchmark.
TRUTH = {
    "ACL.stiffness": 5876.0,
    "PCL.stiffness": 2814.0,
    "MCL.stiffness": 8904.0,
    "LCL.stiffness": 7048.0,
    "ACL.reference_strain": 0.037,
    "PCL.reference_strain": -0.047,
    "MCL.reference_strain": 0.023,
    "LCL.reference_strain": 0.039,
}


def arguments(name: str, doc: str | None, **numbers: int) -> argparse.Namespace:
    """Command line of a benchmark: `--out`, `--knee` and whole numbers with their defaults."""
    parser = argparse.ArgumentParser(description=(doc or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=RESULTS / f"{name}.json")
    parser.add_argument("--knee", default="four_ligament")
    for key, value in numbers.items():
        parser.add_argument(f"--{key.replace('_', '-')}", type=int, default=value)
    return parser.parse_args()


def load(name: str):
    """A bundled knee or a knee file."""
    return kj.load_knee(name)


def true_knee(knee):
    """The knee with paper 1's Table 3 values."""
    return knee.replace(TRUTH)


def timed(function, *args):
    """Seconds of a call until its arrays are ready, and its value."""
    begun = time.perf_counter()
    value = jax.block_until_ready(function(*args))
    return time.perf_counter() - begun, value


def first_and_median(function, *args, repeats: int = 7) -> tuple[float, float]:
    """Seconds of the first call (tracing and compiling included) and median of the next ones."""
    first, _ = timed(function, *args)
    return first, statistics.median(timed(function, *args)[0] for _ in range(repeats))


def peak_memory_mb() -> float:
    """Largest resident set of this process so far, MB."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)


def finish(out: Path, question: str, rows: dict[str, object]) -> None:
    """Print a table and write it as JSON, with versions and the machine's load."""
    width = max(map(len, rows))
    print(question)
    for key, value in rows.items():
        print(f"  {key:<{width}}  {_shown(value)}")
    record = {
        "question": question,
        "results": rows,
        "versions": versions(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg(),
        "date": time.strftime("%Y-%m-%dT%H:%M:%S%z"),
    }
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_text(json.dumps(record, indent=2, default=float) + "\n", encoding="utf-8")


def _shown(value: object) -> str:
    return f"{value:,.4g}" if isinstance(value, float) and abs(value) < 1e4 else (
        f"{value:,.0f}" if isinstance(value, float) else str(value)
    )
