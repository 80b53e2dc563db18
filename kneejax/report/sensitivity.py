"""What each parameter of a study does to the motion, as an answer: who matters first."""

import importlib.metadata
from collections.abc import Mapping
from typing import Any

import numpy as np

from kneejax.geometry import COLUMNS, COORDINATES, FREE_COORDINATES
from kneejax.inference import LocalSensitivity, MotionIndices, Sweeps, versions
from kneejax.report import sensitivity_figures as figures
from kneejax.report.look.page import Answer, Drawing, Section, Verdict, prose
from kneejax.report.look.style import SHOWN
from kneejax.report.look.tables import NONE, Column, Table, listed, number, runs, trimmed
from kneejax.report.pose_tables import HEADS, words_of
from kneejax.statics import Status, converged
from kneejax.studies import Sensitivities

#: Scale -> one step of it in words.
_STEP = {"prior": "one standard deviation of its prior", "percent": "one per cent of its value"}
_MOST_ROWS = 24


def sensitivity_answer(found: Sensitivities, options: Mapping[str, Any]) -> Answer:
    """What each parameter of a study does to the motion."""
    study, local, sweeps, indices = found.study, found.local, found.sweeps, found.indices
    doubts = sensitivity_doubts(local, sweeps, indices)
    # The measurement, moved by the constants that the study leaves free onto the knee's motion.
    offsets, measured = tuple(study.frame_offset), np.array(found.measured)
    row = np.searchsorted(sweeps.flexion_deg, measured[:, 0])
    for k in map(FREE_COORDINATES.index, offsets):
        apart = sweeps.table[row, k] - measured[:, k + 1]
        if np.isfinite(apart).any():
            measured[:, k + 1] += np.nanmean(apart)
    header = ["parameter", "value", "unit", "step", "flexion_deg"]
    header += [f"{column}_per_{per}" for per in ("unit", "step") for column in COLUMNS[1:]]
    slopes = [
        [name, local.values[i], local.units[i], local.widths[i], angle, *local.derivative[j, :, i],
         *local.scaled[j, :, i], Status(local.status[j]).word]
        for i, name in enumerate(local.names) for j, angle in enumerate(local.flexion_deg)
    ]  # fmt: skip
    poses = [
        [one.name, value, angle, *one.table[i, j], Status(one.status[i, j]).word,
         one.unphysiological[i, j]]
        for one in sweeps.sweeps for i, value in enumerate(one.values)
        for j, angle in enumerate(sweeps.flexion_deg)
    ]  # fmt: skip
    swept = ["parameter", "value", "flexion_deg", *COLUMNS[1:], "status", "unphysiological"]
    tables = {"sweeps": Table(swept, poses),
              "local_sensitivity": Table([*header, "status"], slopes)}  # fmt: skip
    main, method, over_flexion = [_ranked_table(local)], found.question.indices, ["local_curves"]
    drawings = {}
    for one in sweeps.sweeps:
        drawings[f"sweep_{one.name.replace('.', '_')}"] = Drawing(
            figures.sweep_figure, sweeps, one.name, measured, bool(offsets),
            more=f"Motion over {one.name}.",
        )  # fmt: skip
    every_sweep = list(drawings)
    drawings["local_curves"] = Drawing(figures.local_curves_figure, local)
    drawings["local_heatmap"] = Drawing(figures.local_heatmap_figure, local)
    document = {
        "title": study.title, "knee": study.knee.name, "study": study.settings(),
        "truth": study.truth, "options": {**options, "samples": found.question.samples},
        "own_motion": words_of(sweeps.status),
        "steps": dict(zip(local.names, local.widths, strict=True)),
        "sweeps": {
            one.name: {"own": one.own, "unit": one.unit, "from": one.values[0],
                       "to": one.values[-1], "values": len(one.values),
                       "poses": {s.word: int((one.status == s).sum()) for s in Status},
                       "unphysiological": int(one.unphysiological.sum())}
            for one in sweeps.sweeps
        },
    }  # fmt: skip
    packages = versions()
    if indices is not None:
        one = indices.indices
        columns = {**one.measures}
        columns |= {f"{name}_half_width": half for name, half in one.half_widths.items()}
        rows = [
            [one.method, output.name, output.coordinate, output.flexion_deg, output.unit, name,
             one.lower[i], one.upper[i], *(values[k, i] for values in columns.values())]
            for k, output in enumerate(indices.outputs) for i, name in enumerate(one.names)
        ]  # fmt: skip
        tables["global_indices"] = Table(["method", "output", "coordinate", "flexion_deg", "unit",
                                          "parameter", "lower", "upper", *columns], rows)
        names = ("method", "confidence", "runs", "failed", "blocks", "left_out", "treatment")
        document["global"] = {name: getattr(one, name) for name in names}
        document["global"]["flexion_deg_left_out"] = indices.left_out_deg
        packages |= {"SALib": importlib.metadata.version("SALib")}
        main.append(_index_table(indices))
        drawings[f"{method}_fit"] = Drawing(figures.fit_indices_figure, indices)
        drawings[f"{method}_poses"] = Drawing(figures.pose_indices_figure, indices)
        over_flexion = ["local_heatmap", "local_curves", f"{method}_poses"]
    document |= {"doubts": doubts, "seconds": found.seconds, "versions": packages}
    lost = not converged(np.maximum(local.status, sweeps.status)).any()
    return Answer(
        title=f"{study.title} (knee {study.knee.name})",
        asked=prose("sensitivity", count=len(local.names), angles=len(local.flexion_deg),
                    first=local.flexion_deg.min(), last=local.flexion_deg.max()),
        verdict=Verdict.FAILED if lost else None,
        sentence="" if lost else _sentence(local, indices), tables=tables, main=main,
        drawings=drawings, picture=f"{method}_fit" if method else "local_heatmap", doubts=doubts,
        sections=[Section("Over flexion", drawings=over_flexion),
                  Section("Sweeps", tables=[swept_table(sweeps)], printed=True),
                  Section("One parameter at a time", [prose("swept")], drawings=every_sweep)],
        document=document,
    )


def sensitivity_doubts(
    local: LocalSensitivity, sweeps: Sweeps, found: MotionIndices | None = None
) -> list[str]:
    """Doubts on the results; dislocation is one at the nominal values only, not over a sweep."""
    doubts = []
    # Derivatives and sweeps share their poses; either may have lost one.
    status = np.maximum(local.status, sweeps.status)
    for outcome in tuple(Status)[1:]:
        angles = [f"{angle:g}" for angle in local.flexion_deg[status == outcome]]
        if angles:
            doubts.append(f"the knee itself at {listed(angles)} degrees: {outcome.sentence}")
    if found is not None and found.left_out_deg:
        angles = [f"{angle:g}" for angle in found.left_out_deg]
        doubts.append(f"global indices without the poses at {listed(angles)} degrees")
    if found is not None and found.indices.doubtful:
        doubts.append(f"global indices: {found.indices.treatment}")
    return doubts


def _ranked(local: LocalSensitivity) -> tuple[np.ndarray, np.ndarray]:
    """Effect of each parameter on each coordinate against the largest of all, `(5, p)`, and the
    parameters by its mean over the coordinates, the largest first."""
    size = np.abs(local.largest()[0])
    shares = size / np.maximum(size.max(axis=1, keepdims=True), 1e-300)
    return shares, np.argsort(-shares.mean(axis=0), kind="stable")


def _sentence(local: LocalSensitivity, found: MotionIndices | None) -> str:
    (slopes, rows), shares, order = local.largest(), *_ranked(local)
    said = []
    for i in order[:2]:
        share = shares[:, i]
        # Of coordinates on which it has the largest effect of all, the one that changes most.
        c = int(np.where(share > 0.99 * share.max(), np.abs(slopes[:, i]), 0.0).argmax())
        coordinate = COORDINATES[FREE_COORDINATES[c]]
        size = f"{coordinate.label.lower()} {slopes[c, i]:+.2f} {coordinate.unit}"
        at = local.flexion_deg[rows[c, i]]
        said.append(f"{local.names[i]} ({size} at {at:g} degrees of flexion)")
    sentence = f"The knee moves most with {', then with '.join(said)}, for {_STEP[local.scale]}."
    if found is not None:
        share = next(iter(found.indices.measures.values()))[found.row("")]
        if np.isfinite(share).any():
            name = found.indices.names[int(np.nanargmax(share))]
            sentence += f" {name} decides the fit to the measured motion most."
    return sentence


def _ranked_table(local: LocalSensitivity) -> Table:
    """Parameters by their effect: of one step on each coordinate, with the flexion where it is."""
    (slopes, rows), order = local.largest(), _ranked(local)[1][:_MOST_ROWS]
    most, hidden = np.abs(slopes).argmax(axis=1), len(local.names) - len(order)
    columns: dict[Any, Any] = {
        "parameter": [local.names[i] for i in order],
        Column("step", words=False):
            [f"{trimmed(local.widths[i], 3)} {local.units[i]}".strip() for i in order],
    }  # fmt: skip
    for name in SHOWN:
        c, head = FREE_COORDINATES.index(name), f"{HEADS[name]}, {COORDINATES[name].unit}"
        columns[Column(name, head, words=False)] = [
            f"{slopes[c, i]:+.2f} at {local.flexion_deg[rows[c, i]]:3.0f}"
            + ("*" if most[c] == i else " ")
            for i in order
        ]
    note = prose("sensitivity.ranked", step=_STEP[local.scale])
    note += f" {hidden} more in local_sensitivity.csv." if hidden else ""
    return Table.of(columns, "Effect of each parameter, the largest first", note, spare=("step",))


def swept_table(sweeps: Sweeps) -> Table:
    """Parameters over whose sweep some poses are not sound: how far it is, and how many poses."""
    rows: list[list[Any]] = []
    at_fault = [one for one in sweeps.sweeps if (~one.sound | (one.status > 0)).any()]
    for one in at_fault[:_MOST_ROWS]:
        # Values about the knee's own at which every pose is sound.
        at, sound_over = int(np.argmin(np.abs(one.values - one.own))), "none"
        for ends in runs(np.flatnonzero(np.all(one.sound, axis=1))):
            if ends[0] <= at <= ends[1]:
                sound_over = " to ".join(number(one.values[k], 3) for k in ends)
        rows.append([one.name, sound_over, *(int(x.sum()) for x in figures.faults_of(one))])
    poses = sum(one.status.size for one in sweeps.sweeps)
    count = f"{len(sweeps.sweeps)} parameter{'s' * (len(sweeps.sweeps) > 1)}, {poses} poses"
    hidden = len(at_fault) - len(rows)
    heads = ("outside", "fibres", "unphysiol.", "unstable", "no balance")
    return Table(
        [Column("parameter", words=True), Column("sound_over", words=True),
         *(Column(head, show=lambda count: str(count or NONE)) for head in heads)],
        rows,
        f"Sweeps: {count}" + ("; poses at fault:" if rows else ", all of them sound"),
        f"{hidden} more in sweeps.csv." if hidden else "",
    )


def _index_table(found: MotionIndices) -> Table:
    """Global indices of the objective, the largest first, with their confidence intervals."""
    indices, row = found.indices, found.row("")
    main, other = list(indices.measures)[:2]
    half = indices.half_widths[main]
    of_errors = [(one.coordinate, np.nan_to_num(indices.measures[main][k]))
                 for k, one in enumerate(found.outputs)
                 if one.coordinate and one.flexion_deg is None]  # fmt: skip
    rows = []
    order = np.argsort(-np.nan_to_num(indices.measures[main][row]), kind="stable")
    for i in order[:_MOST_ROWS]:
        best = [name for name, values in of_errors if values.any() and values.argmax() == i]
        names = [HEADS[name] for name in SHOWN if name in best]
        limits = f"{number(indices.lower[i], 3)} to {number(indices.upper[i], 3)}"
        shown = [indices.measures[main][row, i], half[row, i], indices.measures[other][row, i]]
        decides = "all errors" if len(names) == len(SHOWN) else ", ".join(names)
        rows.append([indices.names[i], limits, *shown, decides])
    return Table(
        ["parameter", "range", Column(main, show="3"), Column("half_width", show="2"),
         Column(other, show="3"), "largest_for"],
        rows,
        prose("sensitivity.indices", method=indices.method.capitalize(), runs=indices.runs,
              percent=100 * indices.confidence),
        f"{indices.treatment}." if indices.treatment else "",
    )  # fmt: skip
