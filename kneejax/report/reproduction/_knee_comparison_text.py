"""Knees side by side as tables: on a screen, and as rows of files."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look import aligned, json_safe, wrapped
from kneejax.reproduction import LIMITS

if TYPE_CHECKING:
    from kneejax.reproduction import Claim, KneeComparison

#: Columns of outcomes.csv, pressures.csv, scores.csv, rotations.csv and reproduction.csv.
OUTCOME_COLUMNS = (
    "knee", "parameter", "change", "direction", "moment_reached_Nm", "ending", *LIMITS,
    "compared_at_Nm",
)  # fmt: skip
PRESSURE_COLUMNS = (
    "knee", "parameter", "change", "direction", "contact", "peak_MPa", "unchanged_peak_MPa",
    "anterior_mm", "superior_mm", "lateral_mm", "unchanged_anterior_mm", "unchanged_superior_mm",
    "unchanged_lateral_mm",
)  # fmt: skip
SCORE_COLUMNS = (
    "knee", "parameter", "outcome", "varus", "valgus", "varus_score", "valgus_score", "score",
)  # fmt: skip
ROTATION_COLUMNS = (
    "knee", "parameter", "change", "direction", "axial_N", "moment_Nm", "adduction_deg"
)  # fmt: skip
CLAIM_COLUMNS = ("number", "statement", "criterion", "printed", "ours", "verdict", "reason")


def outcome_rows(found: KneeComparison) -> Iterator[list[Any]]:
    """Rows of outcomes.csv: one per knee, change and direction."""
    for knee in found.knees:
        for one in knee.outcomes:
            values = [getattr(one, name) for name in LIMITS]
            yield [
                knee.name, one.change.parameter, one.change.label, one.direction,
                one.moment_reached_Nm, one.ending, *values, one.compared_at_Nm,
            ]  # fmt: skip


def pressure_rows(found: KneeComparison) -> Iterator[list[Any]]:
    """Rows of pressures.csv: one per knee, change, direction and contact."""
    for knee in found.knees:
        for one in knee.outcomes:
            for i, contact in enumerate(knee.contacts):
                yield [
                    knee.name, one.change.parameter, one.change.label, one.direction, contact,
                    one.peak_MPa[i], one.unchanged_peak_MPa[i], *one.center_mm[i],
                    *one.unchanged_center_mm[i],
                ]  # fmt: skip


def score_rows(found: KneeComparison) -> Iterator[list[Any]]:
    """Rows of scores.csv: one per knee, parameter and outcome; averages in the outcome's unit."""
    for knee in found.knees:
        for one in knee.influences:
            average, scores = (list(x.values()) for x in (one.average, one.scores))
            yield [knee.name, one.parameter, one.outcome, *average, *scores, one.score]


def rotation_rows(found: KneeComparison) -> Iterator[list[Any]]:
    """Rows of rotations.csv: one per knee, variant and step that it holds."""
    for knee in found.knees:
        names = [("", "unchanged"), *((c.parameter, c.label) for c in knee.changes)]
        for direction, run in knee.runs.items():
            for (parameter, label), held, angles in zip(
                names, run.held, run.adduction_deg, strict=True
            ):
                for step in np.flatnonzero(held):
                    load = run.ramp.axial_N[step], run.ramp.moment_Nm[step]
                    yield [knee.name, parameter, label, direction, *load, angles[step]]


def comparison_document(found: KneeComparison) -> dict[str, Any]:
    """What result.json of a comparison holds: settings, scores, doubts, versions."""
    return json_safe(
        {
            "knees": [knee.name for knee in found.knees],
            "settings": dataclasses.asdict(found.settings),
            "scores": {
                knee.name: {
                    name: {
                        one.outcome: one.score for one in knee.influences if one.parameter == name
                    }
                    for name in knee.parameters
                }
                for knee in found.knees
            },
            "unchanged": {
                knee.name: {
                    direction: {
                        "moment_reached_Nm": run.moment_reached_Nm[0],
                        "ending": run.ending[0],
                        "tension_N": knee.tension_N[direction],
                    }
                    for direction, run in knee.runs.items()
                }
                for knee in found.knees
            },
            "doubts": found.doubts,
            "seconds": {knee.name: knee.seconds for knee in found.knees},
            "versions": found.versions,
        }
    )


def comparison_summary(found: KneeComparison) -> str:
    """Say on a terminal what matters in which knee.

    Args:
        found: knees side by side.

    Returns:
        Lines of fewer than 100 columns, without a final line break.
    """
    settings, lines = found.settings, []
    lines += wrapped(
        f"{settings.body_weight_N / 2:.1f} N along the tibia, then {settings.full_Nm:g} N m of "
        "varus and of valgus at extension; one ligament changed at a time. Scores 0 to 3 of Rooks "
        "et al. 2022 (paper 4), Table 5, means of varus and valgus:"
    )
    for knee in found.knees:
        rows = [["", "convergence", "rotation", "pressure", "place of peak"]]
        for name in knee.parameters:
            own = [one for one in knee.influences if one.parameter == name]
            rows.append([name, *(_shown(one.score) for one in own)])
        lines += ["", f"{knee.name} ({knee.seconds:.0f} s)"]
        lines += [f"  {line}" for line in aligned(rows)]
    for doubt in found.doubts:
        lines += ["", *wrapped(doubt, "! ")]
    return "\n".join(lines)


def claims_summary(claims: tuple[Claim, ...]) -> str:
    """Say on a terminal what was reproduced: number, verdict, statement, and what was computed."""
    lines = []
    for claim in claims:
        first = f"{claim.number:<5} {claim.verdict:<16} "
        lines += wrapped(claim.statement, first)
        # Of what cannot be judged, the reason; else the numbers.
        lines += wrapped(claim.reason if claim.ours == "-" else claim.ours, " " * len(first))
    verdicts = [claim.verdict for claim in claims]
    counts = [f"{verdicts.count(word)} {word}" for word in dict.fromkeys(verdicts)]
    return "\n".join([*lines, "", ", ".join(counts)])


def _shown(score: float) -> str:
    return "-" if np.isnan(score) else f"{score:g}"
