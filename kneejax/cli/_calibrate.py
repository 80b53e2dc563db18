"""`kneejax calibrate [STUDY.yaml]`."""

from __future__ import annotations

import argparse
import importlib
import json
import threading
from pathlib import Path

from kneejax import studies
from kneejax.cli._cohort_commands import check_single
from kneejax.cli._progress import stages_on_terminal
from kneejax.cohorts import is_cohort
from kneejax.files import (
    InputProblem,
    check_new,
    write_calibrated_knee,
    write_poses,
    write_rows,
    write_text,
)
from kneejax.inference import Calibration
from kneejax.statics import Status


def run(arguments: argparse.Namespace) -> int:
    """Calibrate, print the answer, write results, the calibrated knee and the report."""
    if is_cohort(arguments.study):
        from kneejax.cli import _cohort

        return _cohort.run(arguments)
    check_single(arguments)
    study = studies.read_study(arguments.study)
    for new in ("knee.yaml", "result.json"):
        check_new(arguments.out / new, study.knee_name)
    # XLA compiles without holding Python: what comes last is imported beside the search.
    threading.Thread(target=importlib.import_module, args=("kneejax.report",)).start()
    with stages_on_terminal("calibration") as progress:
        result = studies.run(study, progress=progress)
    return _written(result, arguments.out, arguments.svg)


def write_results(result: Calibration, out: Path, svg: bool) -> str:
    """Write what was found, the calibrated knee and the report.

    Args:
        result: of a study.
        out: folder.
        svg: whether figures are written as SVG too.

    Returns:
        Why there is no calibrated knee, where the search ended at none; empty otherwise.
    """
    from kneejax.report import (
        PARAMETER_COLUMNS,
        TEST_COLUMNS,
        parameters_rows,
        reading_rows,
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
        doubts=motion.doubts,
    )
    if result.fit.tests:
        write_rows(out / "tests.csv", TEST_COLUMNS, reading_rows(result))
    write_report(result, out, svg=svg)
    return _write_knee(out)


def _written(result: Calibration, out: Path, svg: bool) -> int:
    """Write everything, and say what was found and where it stands."""
    from kneejax.report import calibration_summary, outcome
    from kneejax.report.look import wrapped

    missing = write_results(result, out, svg)
    print(calibration_summary(result))
    knee = "" if missing else "knee.yaml, "
    tables = "parameters.csv, poses.csv" + ", tests.csv" * bool(result.fit.tests)
    files = f"report.html, result.json, {knee}{tables}, settings.json, figures/"
    print("\n".join(wrapped(f"{out}/{files}", "written: ")))
    if missing:
        print(f"not written: {out}/knee.yaml: {missing}")
    return max(outcome(result).exit_status, int(bool(missing)))


def _write_knee(out: Path) -> str:
    """Write the calibrated knee; why not, where the search ended at none."""
    try:
        write_calibrated_knee(out / "result.json", out / "knee.yaml")
    except InputProblem as problem:
        return str(problem)
    return ""
