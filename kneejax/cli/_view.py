"""`kneejax view KNEE [POSES.csv]`."""

from __future__ import annotations

import sys
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from kneejax import report
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import View
from kneejax.experiments import evaluate
from kneejax.files import (
    InputProblem,
    counted,
    load_knee,
    read_mesh_points,
    read_patella_poses,
    read_poses,
)
from kneejax.geometry import FEMUR, PATELLA, TIBIA, Pose, State
from kneejax.mechanics import Knee
from kneejax.statics import Status

#: A bone whose nearest corner is farther than this from a ligament's end on it is in another frame.
_FARTHEST_MM = 50.0


def run(arguments: View) -> int:
    """Draw a knee in space and the pressure on its plateaux; print what was written."""
    knee, state = _knee_and_state(arguments)
    out, count = arguments.out, state.shape[0]
    files = {bone: getattr(arguments, f"{bone}_bone") for bone in (FEMUR, TIBIA, PATELLA)}
    bones = [_bone(knee, bone, path) for bone, path in files.items() if path is not None]
    try:
        report.need_view_packages()
    except report.MissingPackage as problem:
        expected = f"{problem.package}, which comes with pip install 'kneejax[view]'"
        raise InputProblem("kneejax view", problem.package, "not installed", expected) from None
    bones = [report.simplified(bone) for bone in bones]
    with stages_on_terminal(counted(count, "pose")):
        scenes = report.scenes(knee, state, bones)
    written = [report.write_whole(out / "scene.html", report.scene_page(scenes).encode())]
    if knee.contacts:
        figure = report.pressure_figure(knee, state)
        written += report.save_figure(figure, out, "pressure", svg=arguments.svg)
    status = 0
    try:
        for name, picture in _pictures(scenes):
            written.append(report.write_whole(out / name, picture))
    except report.CannotRender as problem:
        print(f"kneejax: no pictures in space: {problem}", file=sys.stderr)
        status = 1
    names = ", ".join(path.name for path in written)
    print(f"{counted(count, 'pose')} of {knee.name}; written to {out}: {names}, settings.json")
    places = [str(row) for row in range(count)]
    found, doubts = report.given_doubts(knee, evaluate(knee, state), places)
    for doubt in doubts:
        print(doubt)
    return max(status, int((found != Status.BALANCED).any()))


def _knee_and_state(arguments: View) -> tuple[Knee, State]:
    """The knee, with its patella where that was asked for or the table says where it is."""
    path = arguments.poses
    patella = arguments.patella or arguments.patella_bone is not None
    table = None if path is None else read_poses(path, arguments.convention)
    own = None if path is None else read_patella_poses(path, needed=patella)
    knee = load_knee(arguments.knee, patella=patella or own is not None)
    if table is None:
        return knee, jax.tree.map(jnp.atleast_1d, knee.at_reference)
    poses = {TIBIA: table} | ({} if own is None else {PATELLA: own})
    return knee, State({bone: Pose.from_table(rows) for bone, rows in poses.items()})


def _bone(knee: Knee, bone: str, path: Path) -> report.BoneMesh:
    """A bone's mesh, if it is where the knee has that bone."""
    mesh = read_mesh_points(path)
    fibres = knee.ligaments
    sides = fibres.femoral_attachment, fibres.tibial_attachment
    ends = [
        np.asarray(side)[row]
        for row, pair in enumerate(fibres.bodies)
        for side, joined in zip(sides, pair, strict=True)
        if joined == bone
    ]
    # A left knee is stored as its mirrored twin; the mesh is as scanned.
    ends = np.reshape(ends, (-1, 3)) * [1.0, 1.0, -1.0 if knee.side == "left" else 1.0]
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
