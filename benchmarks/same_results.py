"""Do the commands give the same numbers as those of another checkout?

    python benchmarks/same_results.py ../before [--only simulate] [--keep FOLDER]

Runs the same commands with both packages and compares every number of every table and document:
relative to the largest of its column or list, 1e-6 are allowed. Times, versions and paths do not
count.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ALLOWED = 1e-6
#: Differences below this are rounding in numbers that should be zero: mm, N, degrees.
NOTHING = 1e-6
COMMANDS = {
    "simulate": "simulate passive-flexion --knee four_ligament --flexion 0:120:10",
    "simulate-load": "simulate passive-flexion --flexion 0:90:30 --load anterior_N=134",
    "simulate-cut": "simulate passive-flexion --knee four_ligament --flexion 0:60:20 --cut ACL",
    "simulate-points": "simulate passive-flexion --knee lenhart2015_reduced --flexion 0:60:20",
    "calibrate": "calibrate",
    "identify": "identify",
    "sensitivity": "sensitivity",
    "map": "map --pair LCL.stiffness LCL.reference_strain --grid 9",
}
_IGNORED = ("seconds", "versions", "settings", "path", "version", "equilibria", "counts")


def main() -> int:
    """Compare, print, and return the number of commands that differ."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="the other checkout")
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--keep", type=Path, help="folder for what the commands write")
    options = parser.parse_args()
    own = Path(__file__).resolve().parents[1]
    folder = options.keep or Path(tempfile.mkdtemp())
    differing = 0
    for name in options.only:
        ours, theirs = (
            _ran(tree, COMMANDS[name], folder / side / name)
            for side, tree in (("ours", own), ("theirs", options.other.resolve()))
        )
        worst = sorted(_differences(ours, theirs), reverse=True)
        differing += bool(worst and worst[0][0] > ALLOWED)
        count = sum(1 for _ in _numbers(ours))
        print(f"{name}: {count} numbers, largest difference {worst[0][0] if worst else 0.0:.2g}")
        for size, place, one, other in worst[:5]:
            if size > ALLOWED:
                print(f"    {size:.2g}  {place}: {one} and {other}")
    return differing


def _ran(tree: Path, command: str, out: Path) -> Path:
    """What a command writes with the package of a checkout."""
    out.mkdir(parents=True, exist_ok=True)
    environment = {**os.environ, "PYTHONPATH": str(tree)}
    words = [sys.executable, "-m", "kneejax.cli", *command.split(), "--out", str(out)]
    done = subprocess.run(words, cwd=out, env=environment, capture_output=True, text=True)
    if done.returncode not in (0, 1):
        raise SystemExit(f"{tree}: {command}: {done.stderr}")
    return out


def _numbers(folder: Path) -> Iterator[tuple[str, str, float]]:
    """Group (column or list), place and number of everything that was written."""
    for path in sorted(folder.rglob("*.csv")):
        with path.open(newline="") as file:
            for line, row in enumerate(csv.DictReader(file)):
                for column, word in row.items():
                    if (number := _number(word)) is not None:
                        yield f"{path.name}:{column}", f"{path.name}:{line}:{column}", number
    for path in sorted(folder.rglob("*.json")):
        for place, value in _leaves(json.loads(path.read_text()), path.name):
            yield place.rsplit(".", 1)[0], place, value


def _number(word) -> float | None:
    try:
        number = float(word)
    except (TypeError, ValueError):
        return None
    return number if math.isfinite(number) else None


def _leaves(value, place: str) -> Iterator[tuple[str, float]]:
    if isinstance(value, dict):
        pairs = ((key, x) for key, x in value.items() if key not in _IGNORED)
    elif isinstance(value, list):
        pairs = enumerate(value)
    else:
        number = None if isinstance(value, bool) else _number(value)
        if number is not None:
            yield place, number
        return
    for key, x in pairs:
        yield from _leaves(x, f"{place}.{key}")


def _differences(ours: Path, theirs: Path) -> Iterator[tuple]:
    mine = {place: (group, x) for group, place, x in _numbers(ours)}
    other = {place: (group, x) for group, place, x in _numbers(theirs)}
    size: dict[str, float] = {}
    for group, x in (*mine.values(), *other.values()):
        size[group] = max(size.get(group, 0.0), abs(x))
    for place in other.keys() - mine.keys():
        yield math.inf, place, None, other[place][1]
    for place in mine.keys() & other.keys():
        (group, x), (_, y) = mine[place], other[place]
        if abs(x - y) > NOTHING:
            yield abs(x - y) / size[group], place, x, y


if __name__ == "__main__":
    sys.exit(main())
