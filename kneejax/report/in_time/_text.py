"""What a motion through time says of itself, in lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from kneejax.experiments import Transient
from kneejax.geometry import coordinate
from kneejax.mechanics import NAMED_LOADS
from kneejax.statics import Status

# From the unloaded pose, what moves less is not told.
_SMALL = {"mm": 0.05, "deg": 0.05}


def transient_lines(found: Transient) -> Iterator[str]:
    """Where it went, how far beyond, where it came to rest, and whether energy adds up.

    Args:
        found: the motion.
    """
    motion, table = found.trajectory, found.trajectory.to_table()
    rest = None if found.rest is None else np.asarray(found.rest.to_table())[0]
    head = "                           start      peak   at (s)       end"
    yield head + ("   at rest  overshoot" if rest is not None else "")
    for k, name in enumerate(motion.names[:6]):
        values, one = table[:, k], coordinate(name)
        away = np.abs(values - values[0])
        if not np.nanmax(away) > _SMALL[one.unit]:
            continue
        peak = int(np.nanargmax(away))
        last = values[np.isfinite(values)][-1]
        cells = f"{values[0]:10.2f}{values[peak]:10.2f}{found.time_s[peak]:9.3f}{last:10.2f}"
        if rest is not None:
            cells += f"{rest[k]:10.2f}{found.overshoot[name]:11.2f}"
        yield f"{one.axis_label:<22}{cells}"
    yield from _loads(found.sizes)
    if rest is not None:
        yield f"from the balance under the last loads: {found.from_rest_mm:.2g} mm"
    yield from how_exact(found)


def how_exact(found: Transient) -> Iterator[str]:
    """Steps and their error, energies and what is missing of them, and where it ended too early."""
    motion = found.trajectory
    grid = motion.grid
    yield (
        f"{len(grid.time_s)} steps, {int(grid.within().max())} at most between two times; "
        f"error of the steps {motion.error_mm:.1g} mm"
    )
    account = found.account
    yield (
        f"energy, N mm: work {_last(account.work)}, kinetic {_last(account.kinetic)}, potential "
        f"{_last(account.potential)}, dissipated {_last(account.dissipated)}; "
        f"missing at most {float(account.part_missing):.2g} of what changed hands"
    )
    if not account.closes:
        yield "the account of energy does not close: ask for a smaller --error-mm"
    if motion.ended is not Status.BALANCED:
        yield f"the motion ends at {motion.ended_s:.4g} s: {motion.ended.sentence}"


def _last(values) -> str:
    known = np.asarray(values)
    known = known[np.isfinite(known)]
    return f"{known[-1]:.4g}" if len(known) else "-"


def _loads(sizes: Mapping[str, np.ndarray]) -> Iterator[str]:
    for name, values in sizes.items():
        load = NAMED_LOADS[name]
        word = load.positive if values[np.argmax(np.abs(values))] >= 0 else load.negative
        yield f"{word}: {np.abs(values).max():g} {load.unit} at most"
