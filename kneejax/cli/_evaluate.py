"""`kneejax evaluate KNEE POSES.csv`."""

from __future__ import annotations

from kneejax.cli._deliver import deliver
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Evaluate
from kneejax.experiments import evaluate
from kneejax.files import counted, load_knee, read_poses
from kneejax.geometry import Pose
from kneejax.report import evaluation_answer


def run(arguments: Evaluate) -> int:
    """Evaluate given poses, write ligaments.csv and contact.csv."""
    knee = load_knee(arguments.knee)
    table = read_poses(arguments.poses, arguments.convention)
    with stages_on_terminal(counted(len(table), "pose")):
        answer = evaluation_answer(knee, table, evaluate(knee, Pose.from_table(table)))
    return deliver(answer, arguments)
