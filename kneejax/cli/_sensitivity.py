"""`kneejax sensitivity [STUDY.yaml]`: what each parameter does to the motion."""

from __future__ import annotations

import importlib.metadata
import json
import textwrap
import time

import numpy as np

from kneejax import studies
from kneejax.cli import options
from kneejax.cli._given import said_of_options
from kneejax.cli._progress import stages_on_terminal
from kneejax.files import write_rows, write_text
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import LocalSensitivity, MotionIndices, Sweeps, versions
from kneejax.statics import Status
from kneejax.studies import Sensitivities, Sensitivity


def run(arguments: options.Sensitivity) -> int:
    """Sweep parameters, differentiate the motion by them, and if asked compute global indices."""
    if arguments.knees:
        from kneejax.cli import _sensitivity_knees

        return _sensitivity_knees.run(arguments)
    question = _question(arguments)
    study = studies.read_study(arguments.study)
    with said_of_options(question), stages_on_terminal() as progress:
        found = studies.run(study, question, progress=progress)
    return _write(found, arguments)


def _question(arguments: options.Sensitivity) -> Sensitivity:
    # A count is a whole number; what is none is refused as it was given.
    lines = {
        name: ends and (*ends[:2], *(int(n) if n.is_integer() else n for n in ends[2:]))
        for name, ends in arguments.sweep.items()
    }
    return Sensitivity(
        sweep=lines,
        scale=arguments.scale,
        prior=arguments.prior,
        indices=arguments.indices,
        samples=arguments.samples,
        range=arguments.ranges,
        seed=arguments.seed,
    )


def _write(found: Sensitivities, arguments: options.Sensitivity) -> int:
    from kneejax.report import json_safe, sensitivity_doubts, sensitivity_summary

    out, free = arguments.out, COLUMNS[1:]
    local, sweeps, indices = found.local, found.sweeps, found.indices
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
    begun = time.perf_counter()
    _draw(found, out, arguments.svg)
    seconds = found.seconds | {"figures": time.perf_counter() - begun}
    document = _document(found, arguments)
    document |= {"doubts": doubts, "seconds": seconds, "versions": _versions(indices)}
    write_text(out / "result.json", json.dumps(json_safe(document), indent=1) + "\n")

    print(f"{found.study.title} (knee {found.study.knee.name})")
    print(sensitivity_summary(local, sweeps, indices))
    for sentence in doubts:
        print(textwrap.fill(f"warning: {sentence}", 98, subsequent_indent=" " * 9))
    print(f"written: {out}/{', '.join(files)}, result.json, settings.json, figures/")
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


def _draw(found: Sensitivities, out, svg: bool) -> None:
    from kneejax.report import (
        fit_indices_figure,
        local_curves_figure,
        local_heatmap_figure,
        pose_indices_figure,
        save_figure,
        sweep_figure,
    )

    folder, offsets = out / "figures", tuple(found.study.frame_offset)
    local, sweeps, indices = found.local, found.sweeps, found.indices
    measured = _in_the_model_frame(found.measured, sweeps, offsets)
    figures = {
        f"sweep_{one.name.replace('.', '_')}": sweep_figure(
            sweeps, one.name, measured, bool(offsets)
        )
        for one in sweeps.sweeps
    }
    figures["local_curves"] = local_curves_figure(local)
    figures["local_heatmap"] = local_heatmap_figure(local)
    if indices is not None:
        figures[f"{found.question.indices}_fit"] = fit_indices_figure(indices)
        figures[f"{found.question.indices}_poses"] = pose_indices_figure(indices)
    for name, figure in figures.items():
        save_figure(figure, folder, name, svg=svg)


def _document(found: Sensitivities, arguments: options.Sensitivity) -> dict:
    """What result.json holds besides doubts, seconds and versions."""
    local, sweeps, indices = found.local, found.sweeps, found.indices
    document = {
        "title": found.study.title,
        "knee": found.study.knee.name,
        "study": found.study.settings(),
        "truth": found.study.truth,
        "options": {
            "sweep": arguments.sweep,
            "scale": arguments.scale,
            "prior": arguments.prior,
            "global": arguments.indices,
            "samples": found.question.samples,
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
        one = indices.indices
        names = ("method", "confidence", "runs", "failed", "blocks", "left_out", "treatment")
        document["global"] = {name: getattr(one, name) for name in names} | {
            "flexion_deg_left_out": indices.left_out_deg,
        }
    return document


def _in_the_model_frame(
    measured: np.ndarray, sweeps: Sweeps, offsets: tuple[str, ...]
) -> np.ndarray:
    """The measurement, moved by the constants that the study leaves free onto the knee's motion."""
    measured = np.array(measured)
    row = np.searchsorted(sweeps.flexion_deg, measured[:, 0])
    for name in offsets:
        k = FREE_COORDINATES.index(name)
        apart = sweeps.table[row, k] - measured[:, k + 1]
        if np.isfinite(apart).any():
            measured[:, k + 1] += np.nanmean(apart)
    return measured


def _versions(indices: MotionIndices | None) -> dict[str, str]:
    salib = {"SALib": importlib.metadata.version("SALib")} if indices is not None else {}
    return versions() | salib
