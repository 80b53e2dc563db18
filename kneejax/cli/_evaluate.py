"""`kneejax evaluate KNEE POSES.csv`."""

from __future__ import annotations

import argparse

import numpy as np

from kneejax.experiments import evaluate, status_of
from kneejax.files import load_knee, read_poses, write_rows
from kneejax.geometry import Pose
from kneejax.statics import Status

LIGAMENT_COLUMNS = ["pose", "flexion_deg", "ligament", "length_mm", "strain", "force_N"]
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
    "status",
]


def run(arguments: argparse.Namespace) -> int:
    """Evaluate given poses, write ligaments.csv and contact.csv."""
    knee = load_knee(arguments.knee)
    table = read_poses(arguments.poses, arguments.convention)
    found = evaluate(knee, Pose.from_table(table))
    status = np.asarray(status_of(found, knee))
    length, strain, tension = (np.asarray(x) for x in (found.length, found.strain, found.tension))
    ligaments = [
        [i, table[i, 0], name, length[i, j], strain[i, j], tension[i, j]]
        for i in range(len(table))
        for j, name in enumerate(knee.ligaments.names)
    ]
    force, center = np.asarray(found.contact_force), np.asarray(found.center)
    scalars = np.stack(
        [
            np.linalg.norm(force, axis=-1),
            *(np.asarray(x) for x in (found.area, found.max_pressure, found.mean_pressure)),
            np.asarray(found.max_depth),
        ],
        axis=-1,
    )
    contacts = [
        [i, name, *scalars[i, j], *center[i, j], *force[i, j], Status(status[i]).word]
        for i in range(len(table))
        for j, name in enumerate(knee.contact_names)
    ]
    write_rows(arguments.out / "ligaments.csv", LIGAMENT_COLUMNS, ligaments)
    write_rows(arguments.out / "contact.csv", CONTACT_COLUMNS, contacts)
    print(f"{len(table)} poses of {knee.name}; written: {arguments.out}/ligaments.csv, contact.csv")
    doubtful = status != Status.BALANCED
    for word in sorted({Status(s) for s in status[doubtful]}):
        rows = np.flatnonzero(status == word)
        print(f"{len(rows)} poses (first row {rows[0]}): {_sentence(word)}")
    return 1 if doubtful.any() else 0


def _sentence(word: Status) -> str:
    # Nothing was balanced here: only what the sentence says of the surfaces applies.
    return word.sentence.removeprefix("balanced, but ")
