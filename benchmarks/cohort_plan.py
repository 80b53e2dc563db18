"""What a large cohort would take on 1, 100 and 1,000 cores: a simulation of the scheduler.

    python benchmarks/cohort_plan.py [--knees 10000] [--bootstrap 200] [--picture FILE.png]

Workers take tasks as `kneejax calibrate COHORT` deals them: blocks of eight knees, then draws of
the bootstrap a hundred at a time. Times of tasks scatter about those that benchmarks/cohort.py
measured; a worker begins with imports and with reading compiled programs, dies now and then, and is
started anew, and its task is met once more. Nothing is computed but the clock.
"""

from __future__ import annotations

import argparse
import dataclasses
import heapq
from pathlib import Path

import numpy as np

#: Knees of a block and draws of a task, as `kneejax.cohorts` deals them.
BLOCK, DRAWS = 8, 100


@dataclasses.dataclass(frozen=True)
class Cost:
    """Seconds on one core, as measured (benchmarks/cohort.py), and what goes wrong.

    Attributes:
        knee_s: fit and limits of a knee.
        report_s: its files and its page.
        draw_s: a fit of a bootstrap.
        scatter: of the logarithm of a task's time.
        begin_s: of a worker until its first task: imports, compiled programs from disk.
        compile_s: of the first worker besides, of a structure.
        dies: part of tasks over which a worker dies.
        sum_up_s: of the command for each knee when all is done.
    """

    knee_s: float = 0.5
    report_s: float = 0.45
    draw_s: float = 0.025
    scatter: float = 0.25
    begin_s: float = 12.0
    compile_s: float = 40.0
    dies: float = 0.002
    sum_up_s: float = 0.01


def tasks(knees: int, draws: int, cost: Cost, rng) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of each block of knees, and of each task of the bootstrap."""
    blocks = np.full(-(-knees // BLOCK), BLOCK * (cost.knee_s + cost.report_s))
    redrawn = np.full(knees * -(-draws // DRAWS), min(draws, DRAWS) * cost.draw_s)
    return tuple(x * np.exp(cost.scatter * rng.standard_normal(len(x))) for x in (blocks, redrawn))


def round_of(seconds: np.ndarray, free: list[float], cost: Cost, rng) -> list[float]:
    """When each worker is free after a round, from when they were before it."""
    heapq.heapify(free)
    waiting = list(seconds[::-1])
    while waiting:
        now, took = heapq.heappop(free), waiting.pop()
        if rng.random() < cost.dies:
            # Half of the work is lost, the task waits once more, and the worker begins anew.
            waiting.insert(0, took)
            heapq.heappush(free, now + 0.5 * took + cost.begin_s)
        else:
            heapq.heappush(free, now + took)
    return free


def hours(knees: int, draws: int, cores: int, cost: Cost, seed: int = 0) -> tuple[float, float]:
    """Hours by the clock, and how well the cores are used."""
    rng = np.random.default_rng(seed)
    rounds = tasks(knees, draws, cost, rng)
    # The first worker compiles; the others read what it has kept.
    free = [cost.begin_s + cost.compile_s] * min(cores, sum(map(len, rounds)))
    for seconds in rounds:
        # A round ends before the next begins.
        free = [max(round_of(seconds, free, cost, rng))] * len(free) if len(seconds) else free
    total = max(free) + knees * cost.sum_up_s
    work = sum(float(x.sum()) for x in rounds)
    return total / 3600.0, work / (total * cores)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--knees", type=int, default=10_000)
    parser.add_argument("--bootstrap", type=int, default=200)
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args()
    print(f"{options.knees} knees x {options.bootstrap} bootstraps")
    print(f"{'cores':>6} {'hours':>9} {'used':>6}")
    for cores in (1, 100, 1000):
        took, used = hours(options.knees, options.bootstrap, cores, Cost())
        print(f"{cores:>6} {took:>9.2f} {used:>6.0%}")
    if options.picture:
        draw(options.knees, options.bootstrap).savefig(options.picture, dpi=150)


def draw(knees: int, draws: int):
    """Hours over cores, beside cores that are never idle."""
    from matplotlib.figure import Figure

    cores = np.unique(np.geomspace(1, 4000, 25).round().astype(int))
    found = np.array([hours(knees, draws, int(n), Cost()) for n in cores])
    figure = Figure(figsize=(5.0, 3.2), layout="constrained")
    axes = figure.subplots()
    axes.loglog(cores, found[0, 0] / cores, color="#999999", lw=1, ls="--", label="never idle")
    axes.loglog(cores, found[:, 0], "o-", color="#0072B2", ms=3, lw=1.3, label="simulated")
    axes.set_xlabel("cores")
    axes.set_ylabel("hours by the clock")
    axes.set_title(f"{knees:,} knees, {draws} bootstraps each", loc="left", fontsize=10)
    axes.grid(color="#E6E6E6", lw=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)
    return figure


if __name__ == "__main__":
    main()
