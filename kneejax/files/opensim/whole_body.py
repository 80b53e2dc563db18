"""A movement handed to OpenSim: what it needs is checked before, what it says is read after."""

__all__ = ["WholeBody", "ask_opensim", "whole_body"]

import dataclasses
import json
import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from kneejax.files.opensim.acting import read_external_loads
from kneejax.files.opensim.engine import FORCES, MOMENTS, REACTIONS
from kneejax.files.opensim.frames import flexion_coordinate
from kneejax.files.opensim.joints import coordinate_columns, read_joints
from kneejax.files.opensim.knee import find_knee
from kneejax.files.opensim.model import Model, read_model
from kneejax.files.opensim.xml import parse_xml
from kneejax.files.reading import InputProblem, write_text
from kneejax.files.tables.storage import Storage, angles_rad, common_times, read_storage
from kneejax.geometry import TIBIA
from kneejax.numerics import check_installed

#: Instants of static optimisation where no number is asked for: it is the slow part.
_USUAL_INSTANTS = 151
_UNEVEN_S = 1e-6  # steps of a table that differ by more are made even, s
#: What reserves give before a muscle would be spared for them: N m, and N at the ground.
_RESERVE = 1.0
_NAME = "reserves.xml"
#: What stands before a sentence of OpenSim.
_BEFORE = re.compile(r"^(\[\w+\]|RuntimeError:)\s*(std::exception in '.*?': )?")
_ACTUATORS = "reserves and residuals of OpenSim: a ForceSet (.xml)"


@dataclasses.dataclass(frozen=True)
class WholeBody:
    """A movement that OpenSim can be asked about."""

    model: Path  # that moves
    motion: Path  # table of coordinates, as it was given
    coordinates: Storage  # the same by the coordinates' own names, rad or degrees, and m
    loads: Path | None  # external loads; None where the model's own contacts press its feet
    side: str  # `r` or `l`
    bones: tuple[str, str]  # bodies that are the femur and the tibia
    joint: str  # the knee's
    tibia_is_child: bool  # whether that joint's child goes with the tibia, not with the femur
    time_s: tuple[float, float]  # begin and end
    every: int  # rows of the motion from one instant of static optimisation to the next
    actuators: Path | None = None  # reserves and residuals; None for those that are made


@dataclasses.dataclass(frozen=True)
class WholeBodyForces:
    """Tables that OpenSim wrote."""

    moments: Path  # generalised forces of inverse dynamics
    forces: Path  # of muscles and actuators, of static optimisation
    reactions: Path  # of the knee on the tibia


def whole_body(
    model_path: str | os.PathLike[str], motion: str | os.PathLike[str],
    loads: str | os.PathLike[str] | None, *, side: str,
    actuators: str | os.PathLike[str] | None = None, instants: int | None = None,
    time_s: tuple[float, float] | None = None, femur: str | None = None, tibia: str | None = None,
) -> WholeBody:  # fmt: skip
    """Check a movement before OpenSim is asked about it.

    Args:
        model_path: the model (.osim).
        motion: its coordinates over time (.sto, .mot).
        loads: forces from the ground (.xml, whose table is sought beside it); None where the model
            has contacts of its own.
        side: `r` or `l`, of the knee that is meant.
        actuators: a ForceSet of reserves and residuals (.xml); by default a weak one is made for
            every coordinate.
        instants: of static optimisation, about; by default at most 151.
        time_s: begin and end; by default all that the tables cover.
        femur: body of the model that is the femur, with `tibia`; by default found by names.
        tibia: likewise.

    Returns:
        The movement.

    Raises:
        MissingPackage: OpenSim is not installed.
        InputProblem: a file cannot be read, times do not overlap, angles are in the other unit
            than the header says, or the model has no such knee.
    """
    check_installed("opensim", "opensim")
    model = read_model(model_path)
    bones = find_knee(model, side, femur, tibia)
    table = read_storage(motion)
    tables = [table] if loads is None else [table, read_external_loads(loads, model).table]
    if actuators is not None:
        file = parse_xml(actuators, _ACTUATORS)
        if next(file.root.iter("ForceSet"), None) is None:
            raise file.root.problem("", file.root.tag, _ACTUATORS)
    common_times(tables)
    begin, end = max(x.time[0] for x in tables), min(x.time[-1] for x in tables)
    if time_s is not None:
        if not begin <= time_s[0] < time_s[1] <= end:
            expected = f"two times from {begin:g} to {end:g} s, which the tables cover"
            raise InputProblem("--time-s", "time", f"{time_s[0]:g}:{time_s[1]:g}", expected)
        begin, end = time_s
    columns, flexion = coordinate_columns(model, table), flexion_coordinate(bones)
    if flexion not in columns:
        expected = f"a column of the coordinate {flexion} of {model.name}"
        raise InputProblem(table.file, "columns", f"no {flexion}", expected, table.columns)
    angles_rad(table, columns[flexion])
    even = table.time  # analyses take rows at even distances
    if np.ptp(np.diff(even)) > _UNEVEN_S:
        even = np.linspace(even[0], even[-1], len(even))
    values = dict(zip(columns, table.at(even, list(columns.values())), strict=True))
    coordinates = dataclasses.replace(table, time=even, columns=values)
    rows = int(np.sum((even >= begin) & (even <= end)))
    every = max(1, int(np.ceil((rows - 1) / ((instants or _USUAL_INSTANTS) - 1))))
    lower = {name for name in bones.rigid if bones.bone_of(name) == TIBIA}
    joint = next(x for x in bones.joints[::-1] if {x.parent, x.child} & lower)
    pressing, helping = (None if path is None else Path(path) for path in (loads, actuators))
    return WholeBody(Path(model_path), Path(motion), coordinates, pressing, side,
                     (bones.femur, bones.tibia), joint.name, joint.child in lower,
                     (float(begin), float(end)), every, helping)


def ask_opensim(body: WholeBody, folder: Path, model: Path | None = None) -> WholeBodyForces:
    """Inverse dynamics, static optimisation and the knee's reaction, by OpenSim.

    Args:
        body: from `whole_body`.
        folder: where the tables come to lie.
        model: in place of the movement's own, with the same coordinates but those of the knee.

    Returns:
        The tables.

    Raises:
        InputProblem: OpenSim stopped; with the last that it said.
    """
    asked, actuators = model or body.model, body.actuators or folder / _NAME
    folder.mkdir(parents=True, exist_ok=True)
    if body.actuators is None:
        write_text(actuators, _reserves(read_model(asked)))
    motion, table = folder / "coordinates.sto", body.coordinates
    rows = np.column_stack([table.time, *table.columns.values()])
    text = "\n".join("\t".join(f"{x:.17g}" for x in row) for row in rows.tolist())
    degrees, names = "yes" if table.in_degrees else "no", "\t".join(["time", *table.columns])
    size = f"nRows={len(rows)}\nnColumns={rows.shape[1]}\ninDegrees={degrees}"
    write_text(motion, f"coordinates\nversion=1\n{size}\nendheader\n{names}\n{text}\n")
    paths = {"model": asked, "motion": motion, "loads": body.loads, "actuators": actuators,
             "folder": folder}
    settings = {name: str(Path(x).absolute()) if x else "" for name, x in paths.items()} | {
        "joint": body.joint, "tibia": "child" if body.tibia_is_child else "parent",
        "begin_s": body.time_s[0], "end_s": body.time_s[1], "every": body.every,
    }  # fmt: skip
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "settings.json"
        file.write_text(json.dumps(settings), encoding="utf-8")
        words = [sys.executable, "-m", "kneejax.files.opensim.engine", str(file)]
        done = subprocess.run(words, capture_output=True, text=True, cwd=place, check=False)
    found = WholeBodyForces(*(folder / name for name in (MOMENTS, FORCES, REACTIONS)))
    if done.returncode or not found.reactions.is_file():
        lines = [x.strip() for x in (done.stdout + done.stderr).splitlines() if x.strip()]
        last = [x for x in lines if "rror" in x or "xception" in x] or lines
        said = _BEFORE.sub("", last[-1]) if last else f"nothing (status {done.returncode})"
        expected = f"a movement that it can compute; it said: {said}"
        raise InputProblem(os.fspath(asked), "OpenSim", "stopped", expected)
    return found


def _reserves(model: Model) -> str:
    """A weak actuator for every coordinate that may move."""
    rows = []
    for joint in read_joints(model):
        kind = "residual" if joint.on_ground else "reserve"
        rows += [
            f"<CoordinateActuator name={quoteattr(f'{one.name}_{kind}')}>"
            f"<coordinate>{one.name}</coordinate><optimal_force>{_RESERVE:g}</optimal_force>"
            "<min_control>-Inf</min_control><max_control>Inf</max_control></CoordinateActuator>\n"
            for one in joint.coordinates if not one.locked]
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<OpenSimDocument Version="40000">\n'
        f'<ForceSet name="reserves"><objects>\n{"".join(rows)}</objects></ForceSet>\n'
        "</OpenSimDocument>\n")
