"""What a command says of poses that are not simply balanced."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kneejax.experiments import Mechanics, status_of, with_flips
from kneejax.mechanics import Knee
from kneejax.report import pose_words
from kneejax.statics import Status


def say_status(
    status: np.ndarray, places: Sequence[str], unit: str, doubts: Sequence[str], *, given: bool
) -> bool:
    """Print each outcome with its poses, its next step and what is wrong in numbers.

    Args:
        status: `Status` values, one a pose.
        places: what each pose is called, e.g. its flexion.
        unit: of those, e.g. `degrees`.
        doubts: one text per pose, see `kneejax.report.pose_words`.
        given: whether the poses were given, not balanced.

    Returns:
        Whether there was anything but balanced poses.
    """
    status = np.asarray(status)
    for word in sorted({Status(s) for s in status[status != Status.BALANCED]}):
        rows = np.flatnonzero(status == word).tolist()
        print(f"{_listed(places, rows, unit)}: {word.remark if given else word.sentence}")
        _details(rows, places, doubts)
    _details(np.flatnonzero(status == Status.BALANCED).tolist(), places, doubts)
    return bool((status != Status.BALANCED).any())


def say_given(knee: Knee, found: Mechanics, rows: Sequence[int]) -> np.ndarray:
    """Say what is wrong with poses that were given, not balanced.

    Args:
        knee: with which they were evaluated.
        found: their mechanics.
        rows: what each pose is called.

    Returns:
        `Status` values, `(poses,)`.
    """
    status = with_flips(status_of(found, knee), found)
    say_status(status, [str(row) for row in rows], "(row)", pose_words(knee, found), given=True)
    return status


def _listed(places: Sequence[str], rows: list[int], unit: str) -> str:
    words = [places[i] for i in rows]
    if len(words) > 12:
        words = [*words[:10], f"... {words[-1]} ({len(words)} poses)"]
    return f"{', '.join(words)} {unit}"


def _details(rows: list[int], places: Sequence[str], doubts: Sequence[str]) -> None:
    """The first, the last and a middle one of the poses that have something to tell."""
    told = [i for i in rows if doubts[i]]
    for i in sorted({told[0], told[len(told) // 2], told[-1]} if told else ()):
        print(f"  at {places[i]}: {doubts[i]}")
