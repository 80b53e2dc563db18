"""Which ligaments are slack, and where."""

from __future__ import annotations

import numpy as np

from kneejax.experiments._evaluate import evaluate as evaluate_mechanics
from kneejax.geometry import Pose, State
from kneejax.mechanics import Knee


def slack_poses(
    knee: Knee, poses: Pose | State, contact_points: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Where each ligament and group of a knee is slack.

    Args:
        knee: any knee.
        poses: of the tibia, fields of shape `(n,)`; a `State` where other bones move too.
        contact_points: contact points if they are known.

    Returns:
        Ligament or group -> `(n,)`, true where no fibre of it is strained.
    """
    strain = np.asarray(evaluate_mechanics(knee, poses, contact_points).strain)
    names = knee.ligaments.names
    slack = {name: column <= 0.0 for name, column in zip(names, strain.T, strict=True)}
    for group, fibres in knee.groups:
        slack[group] = np.all([slack[fibre] for fibre in fibres], axis=0)
    return slack
