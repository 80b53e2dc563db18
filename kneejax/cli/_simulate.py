"""`kneejax simulate EXPERIMENT`."""

from __future__ import annotations

import argparse

import equinox as eqx
import numpy as np

from kneejax.cli._say_status import say_status
from kneejax.experiments import doubts, evaluate, passive_flexion, with_flips
from kneejax.files import InputProblem, load_knee, parse_flexion, write_poses, write_rows
from kneejax.inference import with_values
from kneejax.mechanics import Knee, Load
from kneejax.statics import Status

_FORCES = ("anterior", "superior", "lateral")
_MOMENTS = ("adduction", "internal_rotation")


def run(arguments: argparse.Namespace) -> int:
    """Simulate, print a table, write poses.csv, forces.csv and a figure."""
    flexion = parse_flexion(arguments.flexion)
    knee = with_values(load_knee(arguments.knee), _pairs("--set", arguments.values))
    knee = _with_loads(knee, _pairs("--load", arguments.load))
    motion = passive_flexion(knee, flexion)
    mechanics = evaluate(knee, motion.pose, motion.settled.meeting)
    table, status = np.array(motion.to_table()), with_flips(motion.status, mechanics)
    said = doubts(knee, mechanics)
    table[:, 0] = flexion
    tension = np.asarray(mechanics.tension)
    contact = np.linalg.norm(np.asarray(mechanics.contact_force), axis=-1)

    print("flexion  adduction  int.rot.  anterior  superior  lateral  status")
    for row, s in zip(table, status, strict=True):
        numbers = f"{row[0]:7.1f}  {row[1]:9.2f}  {row[2]:8.2f}  {row[3]:8.2f}  {row[4]:8.2f}"
        print(f"{numbers}  {row[5]:7.2f}  {Status(s).word}")
    words = [Status(s) for s in status]
    write_poses(
        arguments.out / "poses.csv",
        table,
        status=words,
        converged=np.asarray(motion.settled.converged),
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
    _figure(arguments.out, flexion, table, status, knee, tension, contact)
    angles = [f"{angle:g}" for angle in flexion]
    doubtful = say_status(status, angles, "degrees", said, given=False)
    print(f"written: {arguments.out}/poses.csv, forces.csv, figures/simulation.png and .svg")
    return int(doubtful)


def _forces(knee: Knee, mechanics, i: int):
    for j, name in enumerate(knee.ligaments.names):
        yield name, [float(mechanics.tension[i, j])]
    for j, name in enumerate(knee.contact_names):
        yield name, [float(np.linalg.norm(np.asarray(mechanics.contact_force)[i, j]))]


def _figure(out, flexion, table, status, knee, tension, contact) -> None:
    from kneejax.report import save_figure, simulation_figure

    figure = simulation_figure(
        flexion, table, status, knee.ligaments.names, tension, knee.contact_names, contact
    )
    (out / "figures").mkdir(parents=True, exist_ok=True)
    save_figure(figure, out / "figures", "simulation")


def _pairs(option: str, words: list[str]) -> dict[str, float]:
    pairs = {}
    for word in words:
        name, found, value = word.partition("=")
        try:
            number = float(value)
        except ValueError:
            number = float("nan")
        if not found or not np.isfinite(number):
            raise InputProblem(option, name, value, "NAME=NUMBER with a finite number")
        pairs[name] = number
    return pairs


def _with_loads(knee: Knee, loads: dict[str, float]) -> Knee:
    known = (*_FORCES, *_MOMENTS)
    for name in loads:
        if name not in known:
            raise InputProblem("--load", "direction", name, f"one of {', '.join(known)}", known)
    if not loads:
        return knee
    force = Load([loads.get(name, 0.0) for name in _FORCES], axes="femur", name="force")
    # Moments about the tibia's anterior (adduction) and long (internal rotation) axes.
    turn = [loads.get("adduction", 0.0), loads.get("internal_rotation", 0.0), 0.0]
    moment = Load(moment=turn, axes="tibia", name="moment")
    return eqx.tree_at(lambda k: k.loads, knee, (*knee.loads, force, moment))
