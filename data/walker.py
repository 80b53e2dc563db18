"""Walker's coupled motion (1988), as poses of a knee."""

from pathlib import Path

import numpy as np

from kneejax.files.tables.tables import Table
from kneejax.geometry import FEMORAL, convert_table

_TABLE = Path(__file__).parent / "measurements" / "walker1988.csv"


def coupled_motion(straight: np.ndarray) -> np.ndarray:
    """Poses over flexion, `(n, 6)`: one in extension, `(6,)`, plus what changes, degrees and mm."""
    table = Table.read(_TABLE)
    columns = np.array([cells for _, cells in table.rows], float).T
    change = dict(zip(table.header, columns, strict=True))
    poses = np.repeat(convert_table(straight[None], FEMORAL, "tibial"), len(table.rows), axis=0)
    poses[:, 0] = change["flexion_deg"]
    poses[:, 1] += change["varus_deg"]
    poses[:, 2] += change["internal_rotation_deg"]
    # The femur's origin along the tibia's axes is the negative of the tibia's own.
    poses[:, 3] -= change["femur_anterior_mm"]
    poses[:, 4] -= change["femur_superior_mm"]
    return convert_table(poses, "tibial", FEMORAL)
