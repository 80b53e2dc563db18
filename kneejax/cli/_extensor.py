"""`kneejax simulate patellar-tracking | extension | leg-raise`: the quadriceps pulls."""

from __future__ import annotations

import numpy as np

from kneejax.cli._asked_knee import asked_knee, knee_words
from kneejax.cli._given import read_loads
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli._say_status import say_status
from kneejax.cli.options import Simulate
from kneejax.experiments import (
    DrivenExtensor,
    Extensor,
    Shank,
    extension_by_length,
    isometric_extension,
    leg_raise,
    leg_raise_by_length,
    patellar_tracking,
    with_flips,
)
from kneejax.files import InputProblem, parse_flexion, parse_range, write_rows
from kneejax.mechanics import Knee, Range, load_of
from kneejax.numerics import WrongValue
from kneejax.report import pose_words, search_words

_FLEXION = {"patellar-tracking": "0:120:5", "extension": "0:90:30", "leg-raise": "0:90:5"}
_PULL_N = {"patellar-tracking": 100.0, "extension": 1000.0}
_LONGER = Range(-20.0, 100.0, "mm")
_OF_LEG = ("body_kg", "height_m", "ankle_kg", "femur_deg")

def run_extensor(arguments: Simulate) -> int:
    """Pull, print forces and the patella, write tables and two figures."""
    name = arguments.experiment
    flexion = parse_flexion(arguments.flexion or _FLEXION[name])
    lengths = _lengths(arguments)
    loads = read_loads(arguments.load)
    knee = asked_knee(arguments, patella=True)
    acting, driven = [load_of(**loads)] if loads else [], None
    with stages_on_terminal(knee.name):
        if lengths is None:
            found = _made(arguments, knee, flexion, acting)
        else:
            driven = _driven(arguments, knee, flexion, lengths, acting)
            found = driven.found
    status = with_flips(found.motion.status, found.mechanics)
    said = pose_words(knee, found.mechanics, search_words(found.motion, loads))
    _report(arguments, knee, found, status, driven)
    places = [f"{x:g}" for x in found.flexion_deg]
    doubtful = say_status(status, places, "degrees", said, given=False)
    files = "extensor.csv, forces.csv, tibia_forces.csv, settings.json"
    print(f"written: {arguments.out}/{files}, figures/extensor.png")
    return int(doubtful)


def _lengths(arguments: Simulate) -> np.ndarray | None:
    """How much longer the quadriceps is to be than at rest, mm."""
    if arguments.quadriceps_mm is None:
        return None
    return parse_range(arguments.quadriceps_mm, "--quadriceps-mm", "lengths", _LONGER, "length")


def _driven(
    arguments: Simulate, knee: Knee, flexion: np.ndarray, lengths: np.ndarray, loads
) -> DrivenExtensor:
    if arguments.experiment == "extension":
        return extension_by_length(knee, flexion, lengths, loads)
    try:
        return leg_raise_by_length(knee, lengths, _shank(arguments))
    except WrongValue as problem:
        expected = problem.expected
        raise InputProblem("--quadriceps-mm", "lengths", problem.found, expected) from None


def _shank(arguments: Simulate) -> Shank:
    usual = {"body_kg": 75.0, "height_m": 1.75, "ankle_kg": 0.0, "femur_deg": 0.0}
    given = {option: getattr(arguments, option) for option in _OF_LEG}
    return Shank.of_person(**{k: usual[k] if given[k] is None else given[k] for k in usual})


def _made(arguments: Simulate, knee: Knee, flexion: np.ndarray, loads) -> Extensor:
    name = arguments.experiment
    if name == "leg-raise":
        return leg_raise(knee, flexion, _shank(arguments))
    pull = arguments.quadriceps_N or _PULL_N[name]
    if name == "patellar-tracking":
        return patellar_tracking(knee, flexion, pull, loads)
    steps = arguments.steps or 20
    return isometric_extension(knee, flexion, pull * np.arange(1, steps + 1) / steps, loads)


def _report(
    arguments, knee: Knee, found: Extensor, status: np.ndarray, driven: DrivenExtensor | None
) -> None:
    from kneejax.report import (
        EXTENSOR_COLUMNS,
        extensor_figure,
        extensor_lines,
        extensor_rows,
        save_figure,
        shear_figure,
    )

    title = f"{knee_words(arguments, knee)}: {arguments.experiment}"
    print(title)
    print("\n".join(extensor_lines(found, status)))
    if found.walked.any():
        places = ", ".join(f"{x:g}" for x in found.flexion_deg[found.walked])
        print(
            f"followed anew, the balance lay farther than 1 mm from where expected: {places} deg"
        )
    out, columns, rows = arguments.out, list(EXTENSOR_COLUMNS), extensor_rows(found, status)
    if driven is not None:
        columns += ["longer_mm", "slack"]
        more = zip(driven.longer_mm, driven.slack, strict=True)
        rows = ([*row, x, bool(loose)] for row, (x, loose) in zip(rows, more, strict=True))
        for x, angle in zip(driven.longer_mm[driven.slack], found.flexion_deg[driven.slack],
                            strict=True):  # fmt: skip
            print(
                f"slack: {x:g} mm longer than at rest, at {angle:g} deg: the cable hangs loose, "
                "and the heads pull as at rest"
            )
    write_rows(out / "extensor.csv", columns, rows)
    key = ["flexion_deg", "quadriceps_N", "part"]
    write_rows(out / "forces.csv", [*key, "force_N"], _forces(knee, found))
    axes = [f"{way}_N" for way in ("anterior", "superior", "lateral")]
    write_rows(out / "tibia_forces.csv", [*key, *axes], _on_tibia(found))
    folder = out / "figures"
    folder.mkdir(parents=True, exist_ok=True)
    save_figure(extensor_figure(found, status, title), folder, "extensor", svg=arguments.svg)
    if arguments.experiment != "extension":
        save_figure(shear_figure(found), folder, "shear", svg=arguments.svg)


def _forces(knee: Knee, found: Extensor):
    tension = np.asarray(found.mechanics.tension)
    contact = np.linalg.norm(np.asarray(found.mechanics.contact_force), axis=-1)
    for i, (flexion, pull) in enumerate(zip(found.flexion_deg, found.quadriceps_N, strict=True)):
        parts = [*zip(knee.ligaments.names, tension[i], strict=True)]
        for name, force in [*parts, *zip(knee.contact_names, contact[i], strict=True)]:
            yield [flexion, pull, name, force]


def _on_tibia(found: Extensor):
    for name, forces in found.forces_on_tibia.items():
        for flexion, pull, force in zip(found.flexion_deg, found.quadriceps_N, forces, strict=True):
            yield [flexion, pull, name, *force]
