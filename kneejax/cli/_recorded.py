"""`kneejax simulate ... --recorded FILE.csv --free NAME`: dampers from a recorded motion."""

from __future__ import annotations

from typing import Any

from kneejax.cli._given import refused
from kneejax.cli._progress import stages_on_terminal
from kneejax.cli.options import Simulate
from kneejax.dynamics import MovingKnee
from kneejax.experiments import MOST_ERROR_MM, beginning
from kneejax.files import InputProblem, read_loads_over_time
from kneejax.geometry import COLUMNS
from kneejax.inference.transients import FittedTransient, Recorded, fit_transient
from kneejax.numerics import WrongValue


def read_recorded(arguments: Simulate, start_s: float) -> Recorded | None:
    """The record, which begins with the motion; None where none was asked for.

    Raises:
        InputProblem: a column that is no free coordinate, or another start.
    """
    if arguments.recorded is None:
        return None
    compared = COLUMNS[1:]
    time_s, loads, seen = read_loads_over_time(arguments.recorded, compared)
    if loads or not seen:
        expected = f"some of {', '.join(compared)}; loads stand in --loads"
        wrong = min(loads, default="time_s alone")
        raise InputProblem(str(arguments.recorded), "header", wrong, expected)
    if abs(time_s[0] - start_s) > 1e-9:
        expected = f"{start_s:g}, where the motion begins"
        raise InputProblem(str(arguments.recorded), "row 1, time_s", f"{time_s[0]:g}", expected)
    return Recorded.of_table(time_s, seen)


def fit_dampers(
    arguments: Simulate,
    moving: MovingKnee,
    recorded: Recorded,
    flexion_deg: float,
    motion: dict[str, Any],
) -> FittedTransient:
    """Find the dampers.

    Args:
        arguments: of the command; what is free begins at the options' sizes.
        moving: the knee, with these.
        recorded: the motion.
        flexion_deg: at which it begins.
        motion: options of `kneejax.experiments.beginning`.

    Raises:
        InputProblem: the motion cannot begin, or ends early with the first sizes.
    """
    usual = {"critical": 1.0, "damping_N_s_per_mm": 0.1, "dissipation_s_per_mm": 1e-3}
    first = {name: getattr(arguments, name) or usual[name] for name in arguments.free}
    with stages_on_terminal(moving.knee.name) as show:

        def told(done: int) -> None:
            show(f"{', '.join(first)} from {len(recorded.time_s)} times", done, done + 1)

        try:
            begin = beginning(moving, flexion_deg, float(recorded.time_s[0]), **motion)
            found = fit_transient(
                moving, begin.start, recorded, first, loads=begin.loads, held=begin.held,
                most_mm=arguments.error_mm or MOST_ERROR_MM, progress=told,
            )  # fmt: skip
        except WrongValue as problem:
            raise refused("simulate", problem) from None
    return found
