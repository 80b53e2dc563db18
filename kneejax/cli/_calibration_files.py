"""Files of a calibration: its numbers, the calibrated knee, and the report."""

from __future__ import annotations

import json
from pathlib import Path

from kneejax._whole_files import written_place
from kneejax.files import InputProblem, write_calibrated_knee, write_poses, write_rows, write_text
from kneejax.geometry import PATELLA
from kneejax.inference import Calibration
from kneejax.statics import Status

#: Files of every calibration.
FILES = ("result.json", "parameters.csv", "poses.csv", "report.html", "knee.yaml")


def write_results(result: Calibration, out: Path, *, svg: bool, figures: bool = True) -> str:
    """Write what was found, the calibrated knee and the report.

    Args:
        result: of a study.
        out: folder.
        svg: whether figures are written as SVG too.
        figures: whether they are files at all; the report holds them.

    Returns:
        Why there is no calibrated knee, where the search ended at none; empty otherwise.
    """
    from kneejax.report import (
        PARAMETER_COLUMNS,
        motion_words,
        parameters_rows,
        reading_table,
        result_document,
        write_report,
    )

    write_text(out / "result.json", json.dumps(result_document(result), indent=1) + "\n")
    rows = [[row[c] for c in PARAMETER_COLUMNS] for row in parameters_rows(result)]
    write_rows(out / "parameters.csv", list(PARAMETER_COLUMNS), rows)
    motion = result.fit.motion
    words = [Status(s) for s in motion.status]
    write_poses(
        out / "poses.csv",
        motion.table,
        status=words,
        converged=[w.converged for w in words],
        stable=[w.sound for w in words],
        doubts=motion_words(motion),
        patella=motion.other_bones.get(PATELLA),
    )
    if result.fit.tests:
        write_rows(out / "tests.csv", *reading_table(result))
    write_report(result, out, svg=svg, figures=figures)
    return _write_knee(out)


def _write_knee(out: Path) -> str:
    """Write the calibrated knee; why not, where the search ended at none."""
    try:
        write_calibrated_knee(written_place(out / "result.json"), out / "knee.yaml")
    except InputProblem as problem:
        return str(problem)
    return ""
