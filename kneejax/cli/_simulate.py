"""`kneejax simulate EXPERIMENT`."""

from __future__ import annotations

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._displacement import (
    displacement,
    displacement_lines,
    displacement_table,
    pose_lines,
)
from kneejax.cli._given import read_loads
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._say_status import say_status
from kneejax.cli.options import EXTENSOR, Simulate
from kneejax.experiments import branches, evaluate, passive_flexion, with_flips
from kneejax.files import parse_flexion, write_poses, write_rows
from kneejax.geometry import COLUMNS, FEMORAL, convert_table
from kneejax.mechanics import Knee, Load, load_of, load_words
from kneejax.report import pose_words, search_words
from kneejax.statics import Status


def run(arguments: Simulate) -> int:
    """Move a knee through flexion or time, load it, or let its quadriceps pull."""
    if arguments.in_time and arguments.experiment == "leg-raise":
        from kneejax.cli._raised_leg import run_raised_leg

        return run_raised_leg(arguments)
    if arguments.in_time:
        from kneejax.cli._in_time import run_in_time

        return run_in_time(arguments)
    if arguments.experiment in EXTENSOR:
        from kneejax.cli._extensor import run_extensor

        return run_extensor(arguments)
    if arguments.experiment == "passive-flexion":
        return _passive_flexion(arguments)
    from kneejax.cli._laboratory import run_test

    return run_test(arguments)


def _passive_flexion(arguments: Simulate) -> int:
    """Simulate, print a table, write poses.csv, forces.csv and a figure."""
    flexion = parse_flexion(arguments.flexion or "0:120:5")
    loads, knee = read_loads(arguments.load), asked_knee(arguments)
    with stages_on_terminal(knee.name):
        motion = passive_flexion(knee, flexion, [load_of(**loads)] if loads else [])
        mechanics = evaluate(knee, motion.pose, motion.equilibrium.contact_points)
    table, status = np.array(motion.to_table()), with_flips(motion.status, mechanics)
    said = pose_words(knee, mechanics, search_words(motion, loads))
    table[:, 0] = flexion
    shown = convert_table(table, FEMORAL, arguments.convention)
    tension = np.asarray(mechanics.tension)
    contact = np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1)

    print(f"{knee_words(arguments, knee)}, {load_words(loads)}")
    print("\n".join(pose_lines(shown, status, arguments.convention)))
    words = [Status(s) for s in status]
    write_poses(
        arguments.out / "poses.csv",
        table,
        status=words,
        converged=np.asarray(motion.equilibrium.converged),
        stable=np.asarray(motion.stable),
        doubts=said,
        convention=arguments.convention,
    )
    rows = [
        [flexion[i], name, *values]
        for i in range(len(flexion))
        for name, values in _forces(knee, mechanics, i)
    ]
    write_rows(arguments.out / "forces.csv", ["flexion_deg", "part", "force_N"], rows)
    files = ["poses.csv", "forces.csv", "settings.json"]
    if loads:
        moved = displacement(motion, passive_flexion(knee, flexion))
        write_rows(arguments.out / "displacement.csv", *displacement_table(flexion, moved))
        files.append("displacement.csv")
        print("\n".join(displacement_lines(flexion, moved)))
    if arguments.branches:
        _branches(arguments, knee, flexion, [load_of(**loads)] if loads else [])
        files.append("branches.csv")
    _figure(arguments, flexion, shown, status, knee, tension, contact)
    doubtful = say_status(status, [f"{x:g}" for x in flexion], "degrees", said, given=False)
    print(f"written: {arguments.out}/{', '.join(files)}, figures/simulation.png")
    return int(doubtful)


def _branches(arguments, knee: Knee, flexion: np.ndarray, loads: list[Load]) -> None:
    """Say and write which stable balances there are besides those of the test."""
    found = branches(knee, flexion, loads)
    poses = np.array([[flexion[b.load_case], *b.pose[1:]] for b in found]).reshape(-1, 6)
    shown = convert_table(poses, FEMORAL, arguments.convention)
    others = np.array([not branch.by_test for branch in found], bool)
    if others.any():
        print("Besides these, the knee also balances at:")
        status = np.array([branch.status for branch in found])
        print("\n".join(pose_lines(shown[others], status[others], arguments.convention)))
    else:
        print("No other stable balance was found at any of these angles.")
    header = [*COLUMNS, "status", "by_test", "apart_mm", "starts"]
    rows = [
        [*row, branch.status.word, int(branch.by_test), branch.apart_mm, branch.starts]
        for row, branch in zip(shown, found, strict=True)
    ]
    write_rows(arguments.out / "branches.csv", header, rows)


def _forces(knee: Knee, mechanics, i: int):
    for j, name in enumerate(knee.ligaments.names):
        yield name, [float(mechanics.tension[i, j])]
    for j, name in enumerate(knee.contact_names):
        yield name, [float(np.linalg.norm(np.asarray(mechanics.contact_force)[i, j]))]


def _figure(arguments, flexion, table, status, knee, tension, contact) -> None:
    from kneejax.report import save_figure, simulation_figure

    figure = simulation_figure(
        flexion,
        table,
        status,
        knee.ligaments.names,
        tension,
        knee.contact_names,
        contact,
        convention=arguments.convention,
    )
    folder = arguments.out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(figure, folder, "simulation", svg=arguments.svg)
