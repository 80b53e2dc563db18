"""The contact knee of `kneejax joint fit --knee` and `joint compare --knee`, and its motion."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import jax
import numpy as np

from kneejax.cli._progress import stages_on_terminal
from kneejax.experiments import passive_flexion
from kneejax.files import counted, load_knee, read_calibrated
from kneejax.geometry import COORDINATES
from kneejax.mechanics import Knee
from kneejax.report import status_doubts
from kneejax.statics import Status


@dataclasses.dataclass(frozen=True)
class ContactKnee:
    """A contact knee that was asked for.

    Attributes:
        knee: with the numbers of its calibration.
        title: what tables and figures call it.
        frame_offset: free coordinate -> what is added to its motion to compare it with the
            measured one, mm or degrees; empty unless a calibration fitted it.
    """

    knee: Knee
    title: str
    frame_offset: Mapping[str, float]


@dataclasses.dataclass(frozen=True)
class KneeMotion:
    """Passive flexion of a contact knee, in the frames of the measurement.

    Attributes:
        table: shape `(n, 6)`, degrees and mm, frame offset added; rows without balance are NaN.
        status: of each pose.
        doubts: a sentence for each status but balanced.
    """

    table: np.ndarray
    status: tuple[Status, ...]
    doubts: tuple[str, ...]


def read_contact_knee(name: str) -> ContactKnee:
    """Read a contact knee.

    Args:
        name: bundled knee, knee file, or the result.json of a calibration.

    Returns:
        The knee.

    Raises:
        InputProblem: there is no such knee.
    """
    knee = load_knee(name)
    calibrated = Path(name).suffix.lower() == ".json"
    offsets = read_calibrated(name).frame_offset if calibrated else {}
    return ContactKnee(knee, knee.name, offsets)


def passive_motion(read: ContactKnee, flexion_deg: np.ndarray) -> KneeMotion:
    """Bend a contact knee.

    Args:
        read: the knee.
        flexion_deg: shape `(n,)`.

    Returns:
        Its motion; poses that do not balance are NaN, and warned of.
    """
    with stages_on_terminal(read.knee.name):
        motion = jax.block_until_ready(passive_flexion(read.knee, flexion_deg))
    table = np.array(motion.to_table())
    for coordinate, shift in read.frame_offset.items():
        table[:, list(COORDINATES).index(coordinate)] += shift
    status = tuple(Status(s) for s in np.asarray(motion.status))
    table[[not s.converged for s in status]] = np.nan
    numbers = np.array([int(one) for one in status])

    def where(rows: np.ndarray) -> str:
        word = status[rows[0]].word
        return f"{read.knee.name}: {counted(len(rows), 'pose')} {word}"

    doubts = status_doubts(numbers, [""] * len(status), where, str)
    return KneeMotion(table, status, tuple(doubts))
