"""`kneejax sensitivity --knees K1 K2 ...`: paper 4's study, knees side by side."""

from __future__ import annotations

import json
from pathlib import Path

from kneejax.cli._progress import balances_on_terminal
from kneejax.cli.options import Sensitivity
from kneejax.files import InputProblem, load_knee, write_rows, write_text
from kneejax.mechanics import Knee
from kneejax.reproduction import KneeComparison, compare_knees


def run(arguments: Sensitivity) -> int:
    """Change one ligament at a time in each knee, print scores, write tables and figures."""
    knees = _loaded(arguments.knees)
    with balances_on_terminal("knees") as progress:
        found = compare_knees(knees, progress=progress)
    files = write_tables(found, arguments.out)
    _draw(found, arguments.out, arguments.svg)
    from kneejax.report import comparison_summary

    print(comparison_summary(found))
    print(f"written: {arguments.out}/{', '.join(files)}, settings.json, figures/")
    return 1 if found.doubts else 0


def _loaded(names: list[str]) -> dict[str, Knee]:
    knees: dict[str, Knee] = {}
    for name in names:
        knee = load_knee(name)
        if knee.name in knees:
            raise InputProblem("--knees", "knee", name, f"every knee once; {knee.name} is twice")
        knees[knee.name] = knee
    return knees


def write_tables(found: KneeComparison, out: Path) -> list[str]:
    """Write what was found; the names of the files come back."""
    from kneejax.report import comparison_document
    from kneejax.report import knee_comparison_text as text

    tables = {
        "outcomes.csv": (text.OUTCOME_COLUMNS, text.outcome_rows),
        "pressures.csv": (text.PRESSURE_COLUMNS, text.pressure_rows),
        "scores.csv": (text.SCORE_COLUMNS, text.score_rows),
        "rotations.csv": (text.ROTATION_COLUMNS, text.rotation_rows),
    }
    for name, (columns, rows) in tables.items():
        write_rows(out / name, list(columns), rows(found))
    write_text(out / "result.json", json.dumps(comparison_document(found), indent=1) + "\n")
    return [*tables, "result.json"]


def _draw(found: KneeComparison, out: Path, svg: bool) -> None:
    from kneejax.report import ramp_figure, save_figure, score_figure

    figures = {one.replace(".", "-"): ramp_figure(found, one) for one in found.parameters}
    for name, figure in {"scores": score_figure(found), **figures}.items():
        save_figure(figure, out / "figures", name, svg=svg)
