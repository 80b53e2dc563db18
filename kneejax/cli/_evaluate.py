"""`kneejax evaluate KNEE POSES.csv`."""

from __future__ import annotations

import numpy as np

from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._say_status import say_given
from kneejax.cli.options import Evaluate
from kneejax.experiments import Mechanics, Way, evaluate, ways_of
from kneejax.files import counted, load_knee, read_poses, write_rows
from kneejax.geometry import Pose
from kneejax.mechanics import Knee
from kneejax.statics import Status

LIGAMENT_COLUMNS = [
    "pose",
    "flexion_deg",
    "ligament",
    "length_mm",
    "strain",
    "force_N",
    "way",
    "wrap_deg",
]
CONTACT_COLUMNS = [
    "pose",
    "contact",
    "force_N",
    "area_mm2",
    "max_pressure_MPa",
    "mean_pressure_MPa",
    "max_depth_mm",
    "center_anterior_mm",
    "center_superior_mm",
    "center_lateral_mm",
    "force_anterior_N",
    "force_superior_N",
    "force_lateral_N",
    "moment_adduction_Nmm",
    "moment_internal_rotation_Nmm",
    "moment_extension_Nmm",
    "beyond_mm",
    "beyond_share",
    "status",
]


def run(arguments: Evaluate) -> int:
    """Evaluate given poses, write ligaments.csv and contact.csv."""
    knee = load_knee(arguments.knee)
    table = read_poses(arguments.poses, arguments.convention)
    with stages_on_terminal(counted(len(table), "pose")):
        found = evaluate(knee, Pose.from_table(table))
    status, ways = say_given(knee, found, range(len(table))), ways_of(found)
    out = arguments.out
    write_rows(out / "ligaments.csv", LIGAMENT_COLUMNS, _ligaments(knee, table, found, ways))
    write_rows(out / "contact.csv", CONTACT_COLUMNS, _contacts(knee, found, status))
    poses = counted(len(table), "pose")
    print(f"{poses} of {knee.name}; written: {out}/ligaments.csv, contact.csv, settings.json")
    return int((status != Status.BALANCED).any())


def _ligaments(knee: Knee, table: np.ndarray, found: Mechanics, ways: np.ndarray) -> list[list]:
    length, strain, tension = (np.asarray(x) for x in (found.length, found.strain, found.tension))
    words = {way.value: way.word for way in Way}
    angle = np.rad2deg(np.maximum(np.asarray(found.wrap_angle), 0.0))
    return [
        [i, table[i, 0], name, length[i, j], strain[i, j], tension[i, j], words[ways[i, j]],
         angle[i, j]]
        for i in range(len(table))
        for j, name in enumerate(knee.ligaments.names)
    ]  # fmt: skip


def _contacts(knee: Knee, found: Mechanics, status: np.ndarray) -> list[list]:
    force, center = np.asarray(found.contact_force), np.asarray(found.center)
    # About X, Y, Z of the tibia: adduction, internal rotation, extension.
    moment = np.asarray(found.contact_moment)
    scalars = (found.area, found.max_pressure, found.mean_pressure, found.max_depth)
    numbers = np.stack([np.linalg.norm(force, axis=-1), *map(np.asarray, scalars)], axis=-1)
    beyond = np.stack([np.asarray(found.beyond_mm), np.asarray(found.beyond_share)], axis=-1)
    words = [Status(s).word for s in status]
    return [
        [i, name, *numbers[i, j], *center[i, j], *force[i, j], *moment[i, j], *beyond[i, j],
         words[i]]
        for i in range(len(status))
        for j, name in enumerate(knee.contact_names)
    ]  # fmt: skip
