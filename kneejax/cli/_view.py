"""`kneejax view KNEE [POSES.csv]`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from kneejax import report
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._say_status import say_given
from kneejax.experiments import evaluate
from kneejax.files import InputProblem, counted, load_knee, read_mesh_points, read_poses
from kneejax.geometry import Pose
from kneejax.mechanics import Knee
from kneejax.statics import Status

#: A bone whose nearest corner is farther than this from a ligament's end on it is in another frame.
_FARTHEST_MM = 50.0


def run(arguments: argparse.Namespace) -> int:
    """Draw a knee in space and the pressure on its plateaux; print what was written."""
    knee, out = load_knee(arguments.knee), arguments.out
    if arguments.poses is None:
        table = np.reshape(np.asarray(knee.reference_pose.to_table()), (1, 6))
    else:
        table = read_poses(arguments.poses, arguments.convention)
    files = {"femur": arguments.femur_bone, "tibia": arguments.tibia_bone}
    bones = [_bone(knee, bone, path) for bone, path in files.items() if path is not None]
    try:
        report.need_view_packages()
    except report.MissingPackage as problem:
        expected = f"{problem.package}, which comes with pip install 'kneejax[view]'"
        raise InputProblem("kneejax view", problem.package, "not installed", expected) from None
    bones = [report.simplified(bone) for bone in bones]
    with stages_on_terminal(counted(len(table), "pose")):
        scenes = report.scenes(knee, Pose.from_table(table), bones)
    written = [report.write_whole(out / "scene.html", report.scene_page(scenes).encode())]
    if knee.contacts:
        figure = report.pressure_figure(knee, Pose.from_table(table))
        written += report.save_figure(figure, out, "pressure", svg=arguments.svg)
    status = 0
    try:
        for name, picture in _pictures(scenes):
            written.append(report.write_whole(out / name, picture))
    except report.CannotRender as problem:
        print(f"kneejax: no pictures in space: {problem}", file=sys.stderr)
        status = 1
    names = ", ".join(path.name for path in written)
    print(f"{counted(len(table), 'pose')} of {knee.name}; written to {out}: {names}, settings.json")
    found = say_given(knee, evaluate(knee, Pose.from_table(table)), range(len(table)))
    return max(status, int((found != Status.BALANCED).any()))


def _bone(knee: Knee, bone: str, path: Path) -> report.BoneMesh:
    """A bone's mesh, if it is where the knee has that bone."""
    mesh = read_mesh_points(path)
    fibres = knee.ligaments
    ends = fibres.femoral_attachment if bone == "femur" else fibres.tibial_attachment
    # A left knee is stored as its mirrored twin; the mesh is as scanned.
    ends = np.asarray(ends) * [1.0, 1.0, -1.0 if knee.side == "left" else 1.0]
    far = max((np.linalg.norm(mesh.points_mm - end, axis=1).min() for end in ends), default=0.0)
    if far > _FARTHEST_MM:
        value = f"{far:.0f} mm from the end of a ligament"
        expected = f"the {bone}'s mesh in its frame, within {_FARTHEST_MM:g} mm of every ligament"
        raise InputProblem(path, f"--{bone}-bone", value, expected)
    return report.BoneMesh(bone, mesh.points_mm, mesh.faces)


def _pictures(scenes: tuple[report.Scene, ...]):
    yield "scene.png", report.picture_png(report.scene_figure(scenes[0]))
    if len(scenes) > 1:
        yield "motion.png", report.picture_png(report.scenes_figure(scenes))
        yield "motion.gif", report.film(scenes)
