"""`kneejax joint export JOINT.yaml`."""

from __future__ import annotations

import numpy as np

from kneejax.cli.options import JointExport
from kneejax.files import export_joint, read_joint, write_poses, write_text

#: Splines that leave more than this of a pose, degrees or mm, are doubtful.
_DOUBTFUL = 1e-6


def run(arguments: JointExport) -> int:
    """Write the joint for OpenSim and as a table of coupled coordinates; say how well."""
    file = read_joint(arguments.joint)
    found = export_joint(file)
    low, high = np.ceil(found.flexion_deg[0]), np.floor(found.flexion_deg[-1])
    table = file.joint.pose(np.deg2rad(np.arange(low, high + 1.0))).to_table()
    out = arguments.out
    write_text(out / "custom_joint.xml", found.snippet)
    write_text(out / "joint.osim", found.model)
    write_poses(out / "coupled_coordinates.csv", np.asarray(table))
    turn, shift = found.error[:2].max(), found.error[2:].max()
    print(
        f"{file.name}: flexion {found.flexion_deg[0]:g} to {found.flexion_deg[-1]:g} degrees, "
        f"{len(found.flexion_deg)} knots; splines within {turn:.1e} degrees and {shift:.1e} mm"
    )
    print(f"written: {out}/custom_joint.xml, joint.osim, coupled_coordinates.csv, settings.json")
    if found.error.max() > _DOUBTFUL:
        print("doubtful: the joint turns its axis too sharply for a cubic spline of OpenSim")
        return 1
    return 0
