"""What is wrong with the poses of a motion, in sentences."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import listed
from kneejax.report.motion._pose_words import pose_words
from kneejax.statics import Status, converged

if TYPE_CHECKING:
    from kneejax.inference import Motion


def row_status(motion: Motion) -> np.ndarray:
    """Status of every row; a row of NaN that claims to be balanced has not converged.

    Args:
        motion: poses with status.

    Returns:
        Integers of `Status`.
    """
    status = np.array(motion.status, int)
    lost = ~np.isfinite(np.asarray(motion.table, float)).all(axis=1)
    return np.where(lost & converged(status), int(Status.NOT_CONVERGED), status)


def accepted_statuses(failures: Collection[str]) -> tuple[Status, ...]:
    """What a study that names its `failures` accepts: all balances with another status.

    Args:
        failures: words of statuses; where there are none, nothing but `balanced` is accepted.
    """
    return tuple(s for s in Status if s.converged and s.word not in failures) if failures else ()


def motion_words(motion: Motion) -> tuple[str, ...]:
    """What is wrong with each pose, in words and numbers; nothing where no forces are known."""
    if motion.knee is None or motion.mechanics is None:
        return ("",) * len(motion.status)
    return pose_words(motion.knee, motion.mechanics)


def pose_doubts(
    motion: Motion, flexion: np.ndarray, accepted: tuple[Status, ...] = ()
) -> list[str]:
    """Say what is wrong with the poses of a motion.

    Args:
        motion: as it was found.
        flexion: of its poses, degrees.
        accepted: statuses of which nothing is said.

    Returns:
        A sentence per status.
    """
    status, words = row_status(motion), motion_words(motion)
    sentences = []
    for outcome in sorted(set(status.tolist()) - {Status.BALANCED, *accepted}, reverse=True):
        rows = np.flatnonzero(status == outcome)
        where = listed([f"{flexion[row]:g}" for row in rows], 8)
        word = Status(outcome).word.replace("_", " ")
        told = [i for i in rows if words[i]]
        detail = f" At {flexion[told[0]]:g} deg: {words[told[0]]}." if told else ""
        sentences.append(
            f"{len(rows)} of {len(status)} poses {word} (flexion {where} deg): "
            f"{Status(outcome).sentence}.{detail}"
        )
    return sentences
