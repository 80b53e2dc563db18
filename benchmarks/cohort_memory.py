"""Memory of a worker over many tasks: a leak would show between the twentieth and the last.

    python benchmarks/cohort_memory.py [--tasks 1000] [--knee four_ligament]

One process does what a worker of `kneejax calibrate COHORT` does: a block of knees with its files
and pages, then tasks of a bootstrap with one draw each, in turns over the knees.
"""

from __future__ import annotations

import functools
import resource
import tempfile
from pathlib import Path

from _protocol import arguments, finish, peak_memory_mb

from kneejax.cli import main as kneejax
from kneejax.cli._cohort import compute
from kneejax.cohorts import Task, plan, read_cohort

KNEES = 4


def memory_mb() -> float:
    """Resident set of this process now, MB (Linux)."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def main() -> None:
    options = arguments("cohort_memory", __doc__, tasks=1000)
    folder = Path(tempfile.mkdtemp(prefix="kneejax-memory-"))
    words = ["--knees", str(KNEES), "--knee", options.knee, "--out", str(folder / "made_up")]
    kneejax(["cohort", "synthesise", *words])
    (block,) = plan(read_cohort(folder / "made_up"))
    work = functools.partial(compute, folder / "out", False)
    work(block)
    rows: dict[str, object] = {"after_block_mb": memory_mb()}
    for number in range(options.tasks):
        member = block.members[number % KNEES]
        work(Task((member,), f"{block.fingerprint} {number}", (number, number + 1)))
        if number + 1 in (20, 100, options.tasks // 2, options.tasks):
            rows[f"after_{number + 1}_tasks_mb"] = memory_mb()
            print(number + 1, f"{memory_mb():.1f} MB", flush=True)
    finish(options.out, "Memory of a worker", rows | {"peak_mb": peak_memory_mb()})


if __name__ == "__main__":
    main()
