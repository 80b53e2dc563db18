"""The knee that a command was asked for: `--knee`, `--set` and `--cut`."""

from __future__ import annotations

from kneejax.cli.options import Simulate
from kneejax.files import knee_with, load_knee
from kneejax.mechanics import Knee
from kneejax.parameters import cut


def whole_knee(arguments: Simulate, *, patella: bool = False) -> Knee:
    """The knee with the parameters that were set, before anything is cut."""
    return knee_with(load_knee(arguments.knee, patella=patella), arguments.values, "--set")


def asked_knee(arguments: Simulate, *, patella: bool = False) -> Knee:
    """The knee in which what was cut does not act."""
    return cut(whole_knee(arguments, patella=patella), arguments.cut)


def knee_words(arguments: Simulate, knee: Knee) -> str:
    """What a knee is called, with what was cut."""
    return knee.name + (f" without {', '.join(arguments.cut)}" if arguments.cut else "")
