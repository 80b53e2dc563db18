"""The calibration that a study asks for."""

from __future__ import annotations

import contextlib
import dataclasses
import threading
import time

import numpy as np

from kneejax.experiments import evaluate
from kneejax.geometry import Pose
from kneejax.inference import Calibration, calibrate, compile_step
from kneejax.inference.fit import Problem, Progress
from kneejax.studies._poses import measured_poses
from kneejax.studies._study import Study


def calibrated(study: Study, progress: Progress | None = None) -> Calibration:
    """Calibrate; see `kneejax.run`."""
    begun = time.perf_counter()
    # XLA compiles without holding Python: what comes last gets ready beside the search.
    threading.Thread(target=_get_ready, args=(study,)).start()
    noise_mm, noise_deg = study.noise
    result = calibrate(
        study.knee_at_start,
        measured_poses(study),
        tuple(study.parameters),
        bounds=dict(study.bounds),
        weights=study.weight_vector,
        procedures=tuple(study.procedures),
        stages=tuple(study.stages),
        noise_mm=noise_mm,
        noise_deg=noise_deg,
        offsets=tuple(study.frame_offset),
        starts=study.starts,
        seed=study.seed,
        method=study.method,
        truth=study.truth,
        title=study.title,
        settings=study.settings(),
        loads=study.acting,
        tests=tuple(study.tests),
        prior=dict(study.prior),
        progress=progress,
    )
    seconds = dict(result.seconds, total=time.perf_counter() - begun)
    return dataclasses.replace(result, seconds=seconds)


def _get_ready(study: Study) -> None:
    """Compile a step of the search, and the mechanics of as many poses."""
    poses = len(study.flexion_deg)
    meeting = np.zeros((study.knee.patch_count, 2, poses))
    # Whatever may be wrong here is met again, and said, where the result is needed.
    with contextlib.suppress(Exception):
        evaluate(study.knee, Pose.from_table(np.zeros((poses, 6))), meeting)
        table, unknowns = np.zeros((poses, 6)), len(study.selection) + len(study.frame_offset)
        problem = Problem.of(study.knee, study.selection, table, np.ones(5), tests=study.tests)
        compile_step(unknowns, problem.cases.count + unknowns * bool(study.prior))
