"""Pictures of docs/simple_joints.md, by the very commands that the page prints.

    python docs/figures/make_simple_joints.py MEASURED.csv [FOLDER]

MEASURED.csv is `measured/dynamic_mri_passive_knee_kinematics.csv` of lenhart2015, which is not
bundled (see data/studies/lenhart2015_mri.yaml for its source). Results are written into FOLDER, by
default a temporary one; what the commands print is shown. Takes some three minutes, most of them
the calibration of the contact knee.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import jax
import numpy as np
import yaml

jax.config.update("jax_enable_x64", True)

import kneejax as kj  # noqa: E402
from kneejax.files import read_poses, write_poses  # noqa: E402
from kneejax.joints import condyle_axes  # noqa: E402
from kneejax.mechanics import condyle_points  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
from make_what_data_tell import HERE, keep  # noqa: E402

#: The most medial and the most lateral 15 points of the model's femur bone, mm.
EPICONDYLES = [[3.0, 12.7, -40.6], [4.7, 6.1, 39.3]]
COLUMNS = {
    "flexion_deg": "knee_flex_deg",
    "adduction_deg": "knee_add_deg",
    "internal_rotation_deg": "knee_rot_deg",
    "anterior_mm": "knee_tx_mm",
    "superior_mm": "knee_ty_mm",
    "lateral_mm": "knee_tz_mm",
}
STUDY = """\
title: The two ends of the passive motion, cine-MRI
knee: lenhart2015_reduced
measured: {file: ends.csv, source: 'cine-MRI, lenhart2015 (Apache-2.0)'}
parameters: ["*.reference_strain"]
procedures: [III]
frame_offset: [adduction, internal_rotation, anterior, superior, lateral]
"""
COMMANDS = (
    "calibrate ends.yaml --out ends",
    "joint fit mri.csv --axes axes.yaml --at 10 45 --out joint",
    "joint compare mri.csv --axes axes.yaml --calibrate-at 10 45 --average-within 2 "
    "--knee lenhart2015_reduced --knee ends/result.json --out compare",
    "joint fit --knee lenhart2015_reduced --flexion 0:90:5 --at 0 45 90 --out knee",
    "reproduce 5 --out paper5",
)
PICTURES = {
    "compare/figures/joints.png": "simple_joints_compare.png",
    "knee/figures/motion.png": "simple_joints_knee.png",
    "paper5/figures/means.png": "simple_joints_paper5.png",
}


def main() -> None:
    """Write the inputs, run the commands, keep the pictures."""
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(sys.argv[2] if len(sys.argv) > 2 else temporary).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        write_inputs(Path(sys.argv[1]), folder)
        for words in COMMANDS:
            print(f"\n$ kneejax {words}", flush=True)
            call = [sys.executable, "-m", "kneejax.cli", *words.split()]
            done = subprocess.run(call, cwd=folder)
            if done.returncode > 1:
                raise SystemExit(done.returncode)
        for source, name in PICTURES.items():
            keep(folder / source, HERE / name)


def write_inputs(measured: Path, folder: Path) -> None:
    """The measured poses in the package's columns, their ends, a study of these, axis points."""
    table = read_poses(measured, columns=COLUMNS)
    write_poses(folder / "mri.csv", table)
    ends = np.abs(table[:, :1] - [10.0, 45.0]).min(axis=1) <= 2.0
    write_poses(folder / "ends.csv", table[ends])
    (folder / "ends.yaml").write_text(STUDY)
    points = condyle_axes(*condyle_points(kj.load_knee("lenhart2015_reduced"))).points
    axes = {"extension": points[0], "flexion": points[1], "epicondyles": np.array(EPICONDYLES)}
    document = {
        name: {"medial_mm": two[0].round(2).tolist(), "lateral_mm": two[1].round(2).tolist()}
        for name, two in axes.items()
    }
    (folder / "axes.yaml").write_text(yaml.safe_dump(document, sort_keys=False))


if __name__ == "__main__":
    main()
