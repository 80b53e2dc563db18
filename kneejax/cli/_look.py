"""Look at a knee: its numbers, what poses do to it, and how it stands in space."""

import sys
from collections.abc import Iterator
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np

from kneejax import files, report
from kneejax.cli._deliver import deliver
from kneejax.cli.options.knees import Describe, Evaluate, View
from kneejax.experiments import evaluate
from kneejax.geometry import FEMUR, PATELLA, TIBIA, Pose, State
from kneejax.mechanics import Knee
from kneejax.numerics import check_installed
from kneejax.parameters import UnknownParameter, default_bounds, select
from kneejax.quantities import FIBRE_QUANTITIES
from kneejax.report.describe import knee_text
from kneejax.report.flexion import evaluation_answer
from kneejax.report.pose_tables import given_doubts
from kneejax.statics import Status
from kneejax.studies import stages_on_terminal

#: A bone whose nearest corner is farther than this from a ligament's end on it is in another frame.
_FARTHEST_MM = 50.0
_OF_CONTACTS = ("youngs_modulus", "poisson_ratio", "layer_thickness")


def describe_knee(asked: Describe) -> int:
    """Print a knee: ligaments, contacts, loads, frames, adaptations; or its parameters."""
    read = files.load_knee_file(asked.knee)
    print("\n".join(_parameter_lines(read.knee, asked.fibres)) if asked.parameters
          else knee_text(read.knee, read.document, asked.fibres))  # fmt: skip
    return 0


def _parameter_lines(knee: Knee, fibres: bool) -> Iterator[str]:
    """A knee's parameters with value, unit and the bounds of a fit, a line each."""
    grouped = {fibre for _, members in knee.groups for fibre in members}
    owners = [name for name, _ in knee.groups]
    owners += [name for name in knee.ligaments.names if fibres or name not in grouped]
    names = [f"{owner}.{quantity}" for owner in owners for quantity in FIBRE_QUANTITIES]
    names += [f"{owner}.{quantity}" for owner in knee.contact_names for quantity in _OF_CONTACTS]
    yield f"{knee.name}: names as `parameters:` of a study and --set take them; *.stiffness is"
    yield "the stiffness of every ligament. Bounds hold in a fit unless the study states others."
    yield f"{'parameter':<36} {'value':>10} {'unit':<5} {'lower':>10} {'upper':>10}"
    for name in names:
        try:
            one = select(knee, [name])
        except UnknownParameter:  # e.g. an attachment on a bone that the ligament does not reach
            continue
        bounds = zip(one.names, np.asarray(one.read(knee)), *default_bounds(knee, one), strict=True)
        for i, (full, value, lower, upper) in enumerate(bounds):
            row = f"{full:<36} {value:>10.4g} {one.unit(i):<5} {lower:>10.4g} {upper:>10.4g}"
            yield row if np.isfinite(value) else f"{full:<36} {'none':>10} {one.unit(i)}".rstrip()


def evaluate_poses(arguments: Evaluate) -> int:
    """Evaluate given poses, write ligaments.csv and contact.csv."""
    knee = files.load_knee(arguments.knee)
    table = files.read_poses(arguments.poses, arguments.convention)
    with stages_on_terminal(files.counted(len(table), "pose")):
        answer = evaluation_answer(knee, table, evaluate(knee, Pose.from_table(table)))
    return deliver(answer, arguments)


def view_knee(arguments: View) -> int:
    """Draw a knee in space and the pressure on its plateaux; print what was written."""
    path = arguments.poses
    patella = arguments.patella or arguments.patella_bone is not None
    table = None if path is None else files.read_poses(path, arguments.convention)
    own = None if path is None else files.read_patella_poses(path, needed=patella)
    # With its patella where that was asked for, or where the table says where it is.
    knee = files.load_knee(arguments.knee, patella=patella or own is not None)
    if table is None:
        state = jax.tree.map(jnp.atleast_1d, knee.at_reference)
    else:
        poses = {TIBIA: table} | ({} if own is None else {PATELLA: own})
        state = State({bone: Pose.from_table(rows) for bone, rows in poses.items()})
    out, count = arguments.out, state.shape[0]
    meshes = {bone: getattr(arguments, f"{bone}_bone") for bone in (FEMUR, TIBIA, PATELLA)}
    bones = [_bone(knee, bone, path) for bone, path in meshes.items() if path is not None]
    for module in ("pyvista", "viser"):
        check_installed(module, "view")
    with stages_on_terminal(files.counted(count, "pose")):
        scenes = report.scenes(knee, state, bones)
    written = [report.write_whole(out / "scene.html", report.scene_page(scenes).encode())]
    if knee.contacts:
        figure = report.pressure_figure(knee, state)
        written += report.save_figure(figure, out, "pressure", svg=arguments.svg)
    status, pictures = 0, {"scene.png": lambda: report.picture_png(report.scene_figure(scenes[0])),
                           "motion.png": lambda: report.picture_png(report.scenes_figure(scenes)),
                           "motion.gif": lambda: report.film(scenes)}  # fmt: skip
    try:
        for name, draw in pictures.items():
            if name == "scene.png" or len(scenes) > 1:
                written.append(report.write_whole(out / name, draw()))
    except report.CannotRender as problem:
        print(f"kneejax: no pictures in space: {problem}", file=sys.stderr)
        status = 1
    names, poses = ", ".join(path.name for path in written), files.counted(count, "pose")
    print(f"{poses} of {knee.name}; written to {out}: {names}, settings.json")
    found, doubts = given_doubts(knee, evaluate(knee, state), list(map(str, range(count))))
    for doubt in doubts:
        print(doubt)
    return max(status, int((found != Status.BALANCED).any()))


def _bone(knee: Knee, bone: str, path: Path) -> "report.BoneMesh":
    """A bone's mesh, if it is where the knee has that bone."""
    mesh, fibres = files.read_mesh_points(path), knee.ligaments
    sides = fibres.femoral_attachment, fibres.tibial_attachment
    ends = [np.asarray(side)[row] for row, pair in enumerate(fibres.bodies)
            for side, joined in zip(sides, pair, strict=True) if joined == bone]  # fmt: skip
    # A left knee is stored as its mirrored twin; the mesh is as scanned.
    ends = np.reshape(ends, (-1, 3)) * [1.0, 1.0, -1.0 if knee.side == "left" else 1.0]
    far = max((np.linalg.norm(mesh.points_mm - end, axis=1).min() for end in ends), default=0.0)
    if far > _FARTHEST_MM:
        value = f"{far:.0f} mm from the end of a ligament"
        expected = f"the {bone}'s mesh in its frame, within {_FARTHEST_MM:g} mm of every ligament"
        raise files.InputProblem(path, f"--{bone}-bone", value, expected)
    return report.BoneMesh(bone, mesh.points_mm, mesh.faces)
