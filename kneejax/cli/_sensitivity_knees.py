"""`kneejax sensitivity --knees K1 K2 ...`: paper 4's study, knees side by side."""

from __future__ import annotations

import json

from kneejax.cli import options
from kneejax.cli._progress import balances_on_terminal
from kneejax.files import InputProblem, load_knee, write_rows, write_text
from kneejax.mechanics import Knee


def run(arguments: options.Sensitivity) -> int:
    """Change one ligament at a time in each knee, print scores, write tables and figures."""
    knees, out = _loaded(arguments.knees), arguments.out
    from kneejax.papers import knee_comparison_report as shown
    from kneejax.papers.knee_comparison import compare_knees
    from kneejax.report import save_figure

    with balances_on_terminal("knees") as progress:
        found = compare_knees(knees, progress=progress)
    tables = shown.comparison_tables(found)
    for name, (columns, rows) in tables.items():
        write_rows(out / name, columns, rows)
    document = shown.comparison_document(found)
    write_text(out / "result.json", json.dumps(document, indent=1) + "\n")
    save_figure(shown.score_figure(found), out / "figures", "scores", svg=arguments.svg)
    for one in found.parameters:
        figure = shown.ramp_figure(found, one)
        save_figure(figure, out / "figures", one.replace(".", "-"), svg=arguments.svg)
    print(shown.comparison_summary(found))
    print(f"written: {out}/{', '.join([*tables, 'result.json'])}, settings.json, figures/")
    return 1 if found.doubts else 0


def _loaded(names: list[str]) -> dict[str, Knee]:
    knees: dict[str, Knee] = {}
    for name in names:
        knee = load_knee(name)
        if knee.name in knees:
            raise InputProblem("--knees", "knee", name, f"every knee once; {knee.name} is twice")
        knees[knee.name] = knee
    return knees
