"""`kneejax calibrate [STUDY.yaml]`."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import json
import sys
import threading
import time

import numpy as np

from kneejax.cli._study_problem import study_and_knee, study_settings, with_measurement
from kneejax.experiments import evaluate
from kneejax.files import Study, read_measured, write_poses, write_rows, write_text
from kneejax.geometry import FREE_COORDINATES, Pose
from kneejax.inference import Calibration, calibrate, compile_step
from kneejax.mechanics import Knee
from kneejax.parameters import select
from kneejax.statics import Status


def run(arguments: argparse.Namespace) -> int:
    """Calibrate, print the answer, write results and the report."""
    begun = time.perf_counter()
    study, knee = study_and_knee(arguments.study)
    _progress(f"{study.title}: compiling, then balancing every pose")
    poses = len(study.synthetic.flexion_deg) if study.synthetic else len(read_measured(study))
    # XLA compiles without holding Python: what comes last gets ready beside the search.
    threading.Thread(target=_get_ready, args=(knee, study, poses)).start()
    problem = with_measurement(study, knee, calibrated=True)
    result = calibrate(
        problem.knee,
        problem.measured,
        study.parameters,
        bounds=dict(study.bounds),
        weights=np.array([study.weights[name] for name in FREE_COORDINATES]),
        procedures=study.procedures,
        noise_mm=study.noise_mm,
        noise_deg=study.noise_deg,
        offsets=study.frame_offset,
        starts=study.starts,
        seed=study.seed,
        method=study.method,
        cycles=1,
        truth=problem.truth,
        title=study.title,
        settings=study_settings(study),
    )
    seconds = dict(result.seconds, total=time.perf_counter() - begun)
    result = dataclasses.replace(result, seconds=seconds)
    _progress("writing the report")
    return _write(result, arguments.out)


def _get_ready(knee: Knee, study: Study, poses: int) -> None:
    """Import the report; compile a step of the search and the mechanics of as many poses."""
    import kneejax.report  # noqa: F401

    meeting = np.zeros((knee.patch_count, 2, poses))
    # Whatever may be wrong here is met again, and said, where the result is needed.
    with contextlib.suppress(Exception):
        evaluate(knee, Pose.from_table(np.zeros((poses, 6))), meeting)
        unknowns = len(select(knee, study.parameters)) + len(study.frame_offset)
        compile_step(unknowns, 5 * poses)


def _write(result: Calibration, out) -> int:
    from kneejax.report import (
        PARAMETER_COLUMNS,
        calibration_summary,
        outcome,
        parameters_rows,
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
    write_report(result, out)
    print(calibration_summary(result))
    print(f"written: {out}/report.html, result.json, parameters.csv, poses.csv, figures/")
    return outcome(result).exit_status


def _progress(words: str) -> None:
    if sys.stderr.isatty():
        print(f"kneejax: {words} ...", file=sys.stderr)
