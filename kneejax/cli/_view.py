"""`kneejax view KNEE [POSES.csv]`."""

from __future__ import annotations

import argparse
import sys

import numpy as np

from kneejax import report
from kneejax.files import InputProblem, load_knee, read_poses
from kneejax.geometry import Pose


def run(arguments: argparse.Namespace) -> int:
    """Draw a knee in space and the pressure on its plateaux; print what was written."""
    knee, out = load_knee(arguments.knee), arguments.out
    if arguments.poses is None:
        table = np.reshape(np.asarray(knee.reference_pose.to_table()), (1, 6))
    else:
        table = read_poses(arguments.poses, arguments.convention)
    try:
        report.need_view_packages()
    except report.MissingPackage as problem:
        expected = f"{problem.package}, which comes with pip install 'kneejax[view]'"
        raise InputProblem("kneejax view", problem.package, "not installed", expected) from None
    scenes = report.scenes(knee, Pose.from_table(table))
    written = [report.write_whole(out / "scene.html", report.scene_page(scenes).encode())]
    if knee.contacts:
        figure = report.pressure_figure(knee, Pose.from_table(table))
        written += report.save_figure(figure, out, "pressure")
    status = 0
    try:
        for name, picture in _pictures(scenes):
            written.append(report.write_whole(out / name, picture))
    except report.CannotRender as problem:
        print(f"kneejax: no pictures in space: {problem}", file=sys.stderr)
        status = 1
    names = ", ".join(path.name for path in written)
    print(f"{len(table)} poses of {knee.name}; written to {out}: {names}")
    return status


def _pictures(scenes: tuple[report.Scene, ...]):
    yield "scene.png", report.picture_png(report.scene_figure(scenes[0]))
    if len(scenes) > 1:
        yield "motion.png", report.picture_png(report.scenes_figure(scenes))
        yield "motion.gif", report.film(scenes)
