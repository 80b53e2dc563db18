"""`kneejax sensitivity [STUDY.yaml]`: what each parameter does to the motion."""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import json
import textwrap
import time

import numpy as np

from kneejax.cli._given import check_parameter, check_width
from kneejax.cli._progress import balances_on_terminal
from kneejax.cli._study_problem import (
    StudyProblem,
    study_and_knee,
    study_settings,
    with_measurement,
)
from kneejax.files import InputProblem, write_rows, write_text
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import (
    LocalSensitivity,
    MotionIndices,
    Sweeps,
    check_installed,
    local_sensitivity,
    motion_indices,
    sweep,
    versions,
)
from kneejax.parameters import select
from kneejax.statics import Status, failures_of

#: Values of a sweep where no count is given, and samples of a method.
_VALUES, _SAMPLES = 31, {"sobol": 256, "morris": 64}
_MOST_VALUES, _MOST_SAMPLES = 1000, 1_000_000  # of a sweep, of a method


def run(arguments: argparse.Namespace) -> int:
    """Sweep parameters, differentiate the motion by them, and if asked compute global indices."""
    if arguments.knees:
        from kneejax.cli import _sensitivity_knees

        return _sensitivity_knees.run(arguments)
    swept = {name: _values(name, text) for name, text in _pairs("--sweep", arguments.sweep)}
    priors = {name: _width(name, text) for name, text in _pairs("--prior", arguments.prior)}
    ranges = {name: _interval(name, text) for name, text in _pairs("--range", arguments.ranges)}
    if arguments.samples is not None and arguments.samples > _MOST_SAMPLES:
        expected = f"at most {_MOST_SAMPLES:,}"
        raise InputProblem("--samples", "samples", str(arguments.samples), expected)
    _check_used(arguments)
    if arguments.indices:
        # Better known before the work than after it.
        check_installed("SALib", "sensitivity")
    study, knee = study_and_knee(arguments.study)
    # A wrong name, too, is better known before the work.
    select(knee, tuple(swept))
    problem = with_measurement(study, knee, calibrated=False)
    parameters, failures = problem.study.parameters, failures_of(problem.study.failures)
    flexion, seconds = np.unique(problem.measured[:, 0]), {}
    with _timed(seconds, "local"):
        local = local_sensitivity(
            problem.knee, parameters, flexion, scale=arguments.scale, given=priors
        )
    with _timed(seconds, "sweeps"), balances_on_terminal("sweeps") as progress:
        sweeps = sweep(
            problem.knee, swept or parameters, flexion, progress=progress, failures=failures
        )
    indices = None
    if arguments.indices:
        with _timed(seconds, "global"), balances_on_terminal("indices") as progress:
            indices = motion_indices(
                problem.knee,
                parameters,
                problem.measured,
                weights=np.array([problem.study.weights[name] for name in FREE_COORDINATES]),
                offsets=_offsets(problem),
                bounds=problem.study.bounds,
                ranges=ranges,
                priors=priors,
                method=arguments.indices,
                samples=_samples(arguments),
                seed=arguments.seed,
                progress=progress,
                failures=failures,
            )
    return _write(problem, arguments, local, sweeps, indices, seconds)


def _write(
    problem: StudyProblem,
    arguments: argparse.Namespace,
    local: LocalSensitivity,
    sweeps: Sweeps,
    indices: MotionIndices | None,
    seconds: dict[str, float],
) -> int:
    from kneejax.report import json_safe, sensitivity_doubts, sensitivity_summary

    out, free = arguments.out, COLUMNS[1:]
    files = ["sweeps.csv", "local_sensitivity.csv"]
    header = ["parameter", "value", "flexion_deg", *free, "status", "unphysiological"]
    write_rows(out / files[0], header, _sweep_rows(sweeps))
    header = ["parameter", "value", "unit", "step", "flexion_deg"]
    header += [f"{column}_per_{per}" for per in ("unit", "step") for column in free]
    write_rows(out / files[1], [*header, "status"], _local_rows(local))
    if indices is not None:
        files.append("global_indices.csv")
        write_rows(out / files[-1], *_index_table(indices))
    doubts = sensitivity_doubts(local, sweeps, indices)
    with _timed(seconds, "figures"):
        _draw(problem, arguments, local, sweeps, indices)
    document = _document(problem, arguments, local, sweeps, indices)
    document |= {"doubts": doubts, "seconds": seconds, "versions": _versions(indices)}
    write_text(out / "result.json", json.dumps(json_safe(document), indent=1) + "\n")

    print(f"{problem.study.title} (knee {problem.knee.name})")
    print(sensitivity_summary(local, sweeps, indices))
    for sentence in doubts:
        print(textwrap.fill(f"warning: {sentence}", 98, subsequent_indent=" " * 9))
    print(f"written: {out}/{', '.join(files)}, result.json, figures/")
    return 1 if doubts else 0


def _sweep_rows(sweeps: Sweeps):
    for one in sweeps.sweeps:
        for i, value in enumerate(one.values):
            for j, angle in enumerate(sweeps.flexion_deg):
                word = Status(one.status[i, j]).word
                yield [one.name, value, angle, *one.table[i, j], word, one.unphysiological[i, j]]


def _local_rows(local: LocalSensitivity):
    for i, name in enumerate(local.names):
        head = [name, local.values[i], local.units[i], local.widths[i]]
        for j, angle in enumerate(local.flexion_deg):
            slopes = [*local.derivative[j, :, i], *local.scaled[j, :, i]]
            yield [*head, angle, *slopes, Status(local.status[j]).word]


def _index_table(found: MotionIndices):
    """Header and rows."""
    indices = found.indices
    columns = {**indices.measures}
    columns |= {f"{name}_half_width": half for name, half in indices.half_widths.items()}
    header = ["method", "output", "coordinate", "flexion_deg", "unit"]
    header += ["parameter", "lower", "upper", *columns]
    rows = []
    for k, one in enumerate(found.outputs):
        head = [indices.method, one.name, one.coordinate, one.flexion_deg, one.unit]
        for i, name in enumerate(indices.names):
            limits = [indices.lower[i], indices.upper[i]]
            rows.append([*head, name, *limits, *(values[k, i] for values in columns.values())])
    return header, rows


def _draw(problem, arguments, local, sweeps, indices) -> None:
    from kneejax.report import (
        fit_indices_figure,
        local_curves_figure,
        local_heatmap_figure,
        pose_indices_figure,
        save_figure,
        sweep_figure,
    )

    folder = arguments.out / "figures"
    measured = _in_the_model_frame(problem, sweeps)
    for one in sweeps.sweeps:
        figure = sweep_figure(sweeps, one.name, measured, bool(_offsets(problem)))
        save_figure(figure, folder, f"sweep_{one.name.replace('.', '_')}")
    save_figure(local_curves_figure(local), folder, "local_curves")
    save_figure(local_heatmap_figure(local), folder, "local_heatmap")
    if indices is not None:
        save_figure(fit_indices_figure(indices), folder, f"{arguments.indices}_fit")
        save_figure(pose_indices_figure(indices), folder, f"{arguments.indices}_poses")


def _document(problem, arguments, local, sweeps, indices) -> dict:
    """What result.json holds besides doubts, seconds and versions."""
    document = {
        "title": problem.study.title,
        "knee": problem.knee.name,
        "study": study_settings(problem.study),
        "truth": problem.truth,
        "options": {
            "sweep": arguments.sweep,
            "scale": arguments.scale,
            "prior": arguments.prior,
            "global": arguments.indices,
            "samples": _samples(arguments) if arguments.indices else None,
            "range": arguments.ranges,
            "seed": arguments.seed,
        },
        "own_motion": [Status(s).word for s in sweeps.status],
        "steps": dict(zip(local.names, local.widths, strict=True)),
        "sweeps": {
            one.name: {
                "own": one.own,
                "unit": one.unit,
                "from": one.values[0],
                "to": one.values[-1],
                "values": len(one.values),
                "poses": {s.word: int((one.status == s).sum()) for s in Status},
                "unphysiological": int(one.unphysiological.sum()),
            }
            for one in sweeps.sweeps
        },
    }
    if indices is not None:
        found = indices.indices
        document["global"] = {
            "method": found.method,
            "confidence": found.confidence,
            "runs": found.runs,
            "failed": found.failed,
            "blocks": found.blocks,
            "left_out": found.left_out,
            "treatment": found.treatment,
            "flexion_deg_left_out": indices.left_out_deg,
        }
    return document


def _offsets(problem: StudyProblem) -> tuple[str, ...]:
    return tuple(name for name in problem.study.frame_offset if name != "flexion")


def _in_the_model_frame(problem: StudyProblem, sweeps: Sweeps) -> np.ndarray:
    """The measurement, moved by the constants that the study leaves free onto the knee's motion."""
    measured = np.array(problem.measured)
    row = np.searchsorted(sweeps.flexion_deg, measured[:, 0])
    for name in _offsets(problem):
        k = FREE_COORDINATES.index(name)
        apart = sweeps.table[row, k] - measured[:, k + 1]
        if np.isfinite(apart).any():
            measured[:, k + 1] += np.nanmean(apart)
    return measured


def _versions(indices: MotionIndices | None) -> dict[str, str]:
    salib = {"SALib": importlib.metadata.version("SALib")} if indices is not None else {}
    return versions() | salib


@contextlib.contextmanager
def _timed(seconds: dict[str, float], what: str):
    begun = time.perf_counter()
    yield
    seconds[what] = time.perf_counter() - begun


def _samples(arguments: argparse.Namespace) -> int:
    return _SAMPLES[arguments.indices] if arguments.samples is None else arguments.samples


def _check_used(arguments: argparse.Namespace) -> None:
    """An option that would have no effect is a misunderstanding."""
    if arguments.indices is None:
        for option, given in (("--range", arguments.ranges), ("--samples", arguments.samples)):
            if given not in ([], None):
                raise InputProblem(option, "without", "--global", "--global sobol or morris")
        if arguments.prior and arguments.scale == "percent":
            raise InputProblem("--prior", "with", "--scale percent", "--scale prior, or --global")


def _pairs(option: str, words: list[str]) -> list[tuple[str, str]]:
    """`NAME=TEXT`, each name once."""
    pairs = [word.partition("=")[::2] for word in words]
    for i, (name, _) in enumerate(pairs):
        if name in [other for other, _ in pairs[:i]]:
            raise InputProblem(option, "parameter", name, "every parameter once")
    return pairs


def _numbers(option: str, name: str, text: str, form: str, counts: tuple[int, ...]):
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in counts or not np.isfinite(numbers).all():
        raise InputProblem(option, name, text, f"NAME={form}, finite numbers")
    return numbers


def _width(name: str, text: str) -> float:
    (width,) = _numbers("--prior", name, text, "SD", (1,))
    check_width("--prior", name, width)
    return width


def _interval(name: str, text: str) -> tuple[float, float]:
    low, high = _numbers("--range", name, text, "LOW:HIGH", (2,))
    if not low < high:
        raise InputProblem("--range", name, text, "LOW:HIGH, the lower end first")
    check_parameter("--range", name, (low, high))
    return low, high


def _values(name: str, text: str) -> np.ndarray | None:
    """Values of a sweep; None for the usual ones."""
    if not text:
        return None
    low, high, *count = _numbers("--sweep", name, text, "LOW:HIGH:COUNT", (2, 3))
    if not low < high:
        raise InputProblem("--sweep", name, text, "LOW:HIGH:COUNT, the lower end first")
    check_parameter("--sweep", name, (low, high))
    if count and not (2 <= count[0] <= _MOST_VALUES and count[0] == int(count[0])):
        expected = f"LOW:HIGH:COUNT with a whole count from 2 to {_MOST_VALUES}"
        raise InputProblem("--sweep", name, text, expected)
    return np.linspace(low, high, int(count[0]) if count else _VALUES)
