"""A plan's numbers as tables, and what is doubtful about them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look import json_safe
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.planning import AclPlan, Front, Outcome, PlanResult, Surgery

#: Stands on every page and in every report of a plan.
NOT_FOR_PATIENTS = (
    "A computation on a model, for research and teaching. Nothing here supports a decision about "
    "a patient."
)
_KNEES = ("intact", "deficient")


def variants(result: PlanResult) -> Iterator[tuple[str, Outcome, int]]:
    """Name, outcome and row of every reconstruction that a plan tried: plan, optimum, octagon."""
    yield "planned", result.planned, 0
    if result.optimum is not None:
        yield "optimum", result.optimum.outcome, 0
    for corner in range(len(result.octagon.choices)):
        yield f"octagon {corner + 1}", result.octagon, corner


def plan_columns(plan: AclPlan) -> list[str]:
    """Columns of plan.csv."""
    surgery = plan.surgery
    columns = ["knee"]
    for name in surgery.plan.bundles:
        columns += choice_columns(surgery, name)
        columns += [f"{name}_slack_length_mm", f"{name}_length_change_mm"]
    columns += [f"laxity_{angle:g}_deg_mm" for angle in surgery.protocol.lachman_deg]
    return [*columns, "graft_peak_N", *(f"strain_distance_{x}" for x in surgery.ligaments),
            "strain_distance", "status"]  # fmt: skip


def choice_columns(surgery: Surgery, bundle: str) -> list[str]:
    """Columns of a bundle's five choices."""
    places = [
        f"{bundle}_{footprint.bone}_{axis}_mm"
        for footprint in (surgery.tibia, surgery.femur)
        for axis in footprint.names
    ]
    return [*places, f"{bundle}_tension_N"]


def front_columns(plan: AclPlan) -> list[str]:
    """Columns of front.csv: criteria, then choices."""
    surgery = plan.surgery
    tests = [f"laxity_{angle:g}_deg_mm" for angle in surgery.protocol.lachman_deg]
    choices = [x for name in surgery.plan.bundles for x in choice_columns(surgery, name)]
    return [*tests, "graft_peak_N", "strain_distance", *choices, "compromise"]


def front_rows(front: Front) -> list[list[Any]]:
    """Rows of front.csv, by strain distance; the compromise is marked."""
    return [
        [*criteria, *choices, int(row == front.compromise)]
        for row, (criteria, choices) in enumerate(
            zip(front.criteria, front.outcome.choices, strict=True)
        )
    ]


def plan_rows(result: PlanResult) -> list[list[Any]]:
    """Rows of plan.csv: the intact and the deficient knee, then every reconstruction."""
    surgery, before = result.plan.surgery, result.plan.surgery.before
    bundles, others = len(surgery.plan.bundles), len(surgery.ligaments)
    laxity = surgery.laxity(before)
    rows = []
    for row, name in enumerate(_KNEES):
        status = Status(int(before.status[row].max()))
        blank: list[Any] = [np.nan] * (7 * bundles)
        rows.append([name, *blank, *laxity[row], *[np.nan] * (2 + others), status.word])
    for name, found, row in variants(result):
        each = found.choices[row].reshape(bundles, -1)
        own = [
            x
            for k in range(bundles)
            for x in (*each[k], found.slack_mm[row, k], found.isometry_mm[row, k])
        ]
        rows.append(
            [name, *own, *found.laxity_mm[row], found.peak_N[row], *found.distance[row],
             found.total[row], Status(int(found.status[row])).word]
        )  # fmt: skip
    return rows


def octagon_rows(result: PlanResult) -> list[list[float]]:
    """Paper 2's Table 4: position, strain distance of each ligament, and of all."""
    found = result.octagon
    return [
        [k + 1, *found.distance[k], found.total[k]] for k in range(len(found.choices))
    ]


def curve_rows(result: PlanResult) -> Iterator[list[Any]]:
    """Rows of curves.csv: knee, flexion, ligament, strain, tension."""
    surgery = result.plan.surgery
    motion, plan = surgery.protocol.motion, surgery.plan
    angles, names = surgery.protocol.extension_deg, plan.knee.ligaments.names
    knees = [(name, surgery.before, row) for row, name in enumerate(_KNEES)]
    knees += [(name, found.followed, row) for name, found, row in variants(result)]
    for name, followed, row in knees:
        gone = {"intact": plan.bundles, "deficient": (*plan.torn, *plan.bundles)}.get(
            name, plan.torn
        )
        for k, ligament in enumerate(names):
            if ligament not in gone:
                both = zip(angles, followed.strain[row, motion, k],
                           followed.tension_N[row, motion, k], strict=True)  # fmt: skip
                yield from ([name, angle, ligament, strain, pull] for angle, strain, pull in both)


def plan_doubts(result: PlanResult) -> list[str]:
    """What a reader must know before the numbers, one sentence each; empty where nothing is
    wrong."""
    surgery, said = result.plan.surgery, []
    before = surgery.before
    for row, name in enumerate(_KNEES):
        lost = np.unique(surgery.protocol.flexion_deg[~before.converged[row]])
        if len(lost):
            said.append(
                f"The {name} knee does not hold the load, or has no balance, at "
                f"{_angles(lost)} degrees: its laxity there is not known."
            )
    wanted = [("plan", result.planned, 0)]
    if result.optimum is not None:
        wanted.append(("optimum", result.optimum.outcome, 0))
    for name, found, row in wanted:
        status = Status(int(found.status[row]))
        if status is not Status.BALANCED:
            said.append(f"Of the {name}: {status.sentence}.")
    if result.optimum is not None and not result.optimum.feasible:
        said.append(
            "No choice was found that keeps all limits; the optimum is the one that misses them "
            f"least, by {result.optimum.missed:.0%} of the worst."
        )
    if result.front is not None and not result.has_front:
        said.append("No choice was found that keeps all limits: there is no front.")
    lost = [k + 1 for k, total in enumerate(result.octagon.total) if not np.isfinite(total)]
    if lost:
        corners = ", ".join(str(k) for k in lost)
        said.append(f"No motion was found with the graft at corner {corners} of the octagon.")
    return said


def plan_failed(result: PlanResult) -> bool:
    """Whether the command ends with status 1: a knee that was asked for has no balance, or the
    optimum misses a limit."""
    wanted = [result.planned] if result.optimum is None else [result.planned, result.best]
    lost = any(not Status(int(one.status[0])).converged for one in wanted)
    none = result.front is not None and not result.has_front
    return lost or none or (result.optimum is not None and not result.optimum.feasible)


def plan_document(result: PlanResult, versions: dict[str, str]) -> dict[str, Any]:
    """What plan.json holds."""
    plan, optimum = result.plan, result.optimum
    surgery = plan.surgery
    columns = plan_columns(plan)
    rows = [dict(zip(columns, row, strict=True)) for row in plan_rows(result)]
    document: dict[str, Any] = {
        "title": plan.title,
        "note": NOT_FOR_PATIENTS,
        "knee": plan.own.name,
        "ligament": plan.ligament,
        "torn": list(surgery.plan.torn),
        "graft": {
            "type": plan.graft.name,
            "source": plan.graft.source,
            "bundles": list(surgery.plan.bundles),
            "stiffness_N": sum(surgery.plan.stiffness_N),
            "failure_N": sum(surgery.plan.failure_N),
        },
        "fixation_deg": surgery.fixation_deg,
        "force_N": surgery.protocol.force_N,
        "window": surgery.window,
        "limits": {
            "graft_N": surgery.limits.graft_N,
            "laxity_band_mm": surgery.limits.band_mm,
            "tension_N": surgery.limits.tension_N,
        },
        "knees": rows,
        "doubts": plan_doubts(result),
        "tolerances": [
            {
                "bone": one.bone, "bundle": one.bundle, "lachman_deg": one.lachman_deg,
                "direction": one.direction, "by_derivative_mm": one.expected_mm,
                "found_mm": one.found_mm, "checked_mm": one.checked_mm,
                "laxity_mm_per_mm": one.slope,
            }
            for one in result.tolerances
        ],
        "maps": [
            {
                "bone": one.bone,
                "points": [len(one.first), len(one.second)],
                "least": one.least,
            }
            for one in result.maps
        ],
        "settings": plan.said,
        "seconds": result.seconds,
        "versions": versions,
    }  # fmt: skip
    if result.intervals is not None:
        own = result.intervals
        document["intervals"] = {
            "draws": own.draws,
            "parts": [0.025, 0.5, 0.975],
            "held": list(plan.held),
            "knees": {
                knee: {
                    "limits_kept_in": own.kept[row],
                    **{name: own.limits[row, k] for k, name in enumerate(own.quantities)},
                    **{f"{name}_known_in": own.known[row, k]
                       for k, name in enumerate(own.quantities)},
                }
                for row, knee in enumerate(own.knees)
            },
        }  # fmt: skip
    if result.has_front:
        assert result.front is not None
        document["front"] = {
            "criteria": list(result.front.names),
            "points": len(result.front.criteria),
            "evaluations": result.front.evaluations,
            "least": result.front.criteria.min(axis=0),
            "compromise": result.front.criteria[result.front.compromise],
        }
    if optimum is not None:
        document["optimum"] = {
            "free": list(plan.free),
            "feasible": optimum.feasible,
            "missed": optimum.missed,
            "evaluations": optimum.evaluations,
            "starts": optimum.starts,
            "start_distances": optimum.start_totals,
            "followed": optimum.followed,
            "ends": optimum.ends,
        }
    return json_safe(document)


def _angles(values: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{x:g}" for x in values)
