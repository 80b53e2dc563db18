"""A plan on the terminal."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.report.look import NONE, aligned, number, wrapped
from kneejax.report.planning._tables import NOT_FOR_PATIENTS, plan_doubts, variants
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.planning import PlanResult


def plan_text(result: PlanResult) -> str:
    """What was found, in lines for a terminal."""
    plan, surgery = result.plan, result.plan.surgery
    tests = [f"laxity {angle:g} deg" for angle in surgery.protocol.lachman_deg]
    header = ["knee (mm, N)", *tests, "graft peak", "length change", "strain distance", "status"]
    lines = [plan.title, *wrapped(said_of_plan(result)), *aligned([header, *knee_rows(result)])]
    for one in (*said_of_optimum(result), *said_of_tolerances(result)):
        lines += wrapped(one)
    lines += aligned(front_table(result)) if result.has_front else []
    lines += aligned(interval_rows(result)) if result.intervals is not None else []
    for one in plan_doubts(result):
        lines += wrapped(one, "note: ")
    return "\n".join([*lines, *wrapped(NOT_FOR_PATIENTS)])


def knee_rows(result: PlanResult) -> list[list[str]]:
    """Laxities, graft force, length change, strain distance and status: the intact knee, that
    without the ligament, then every reconstruction."""
    surgery = result.plan.surgery
    before, status = surgery.laxity(surgery.before), surgery.before.status.max(axis=1)
    names = ("intact", f"without {result.plan.ligament}")
    rows = [
        [name, *(number(x, 3) for x in before[row]), NONE, NONE, NONE if row else "0",
         _word(status[row])]
        for row, name in enumerate(names)
    ]  # fmt: skip
    return rows + [
        [name, *(number(x, 3) for x in found.laxity_mm[row]), number(found.peak_N[row], 3),
         number(found.isometry_mm[row].max(), 2), number(found.total[row], 3),
         _word(found.status[row])]
        for name, found, row in variants(result)
    ]  # fmt: skip


def _word(status: int) -> str:
    return Status(int(status)).word.replace("_", " ")


def said_of_plan(result: PlanResult) -> str:
    """What is done, in a sentence."""
    plan, surgery = result.plan, result.plan.surgery
    bundles = len(surgery.plan.bundles)
    tension = ", ".join(f"{x:g}" for x in plan.base[4::5])
    how = "one bundle" if bundles == 1 else f"{bundles} bundles"
    return (
        f"{plan.own.name}: {plan.ligament} replaced by a {plan.graft.name.replace('_', ' ')} graft "
        f"({how}, {sum(surgery.plan.stiffness_N) / 1000:.3g} kN per unit strain), fixed at "
        f"{surgery.fixation_deg:g} degrees under {tension} N"
    )


def interval_rows(result: PlanResult) -> list[list[str]]:
    """Medians with 95 % intervals over the knees that a calibration leaves possible, a header
    first."""
    own = result.intervals
    assert own is not None
    tests = [f"laxity {angle:g} deg" for angle in result.plan.surgery.protocol.lachman_deg]
    header = [f"median (95 %) of {own.draws} draws", *tests, "graft peak", "strain distance",
              "limits kept in"]  # fmt: skip
    rows = []
    for row, name in enumerate(own.knees):
        cells = []
        for (low, middle, high), known in zip(own.limits[row], own.known[row], strict=True):
            few = f" in {known}" if 0 < known < own.draws else ""
            limits = f"{number(middle, 3)} ({number(low, 3)} to {number(high, 3)}){few}"
            cells.append(limits if known else NONE)
        kept = own.kept[row]
        rows.append([name, *cells, f"{kept:.0%}" if np.isfinite(kept) else NONE])
    return [header, *rows]


def said_of_optimum(result: PlanResult) -> list[str]:
    """Where the optimum is, in sentences; nothing where none was asked for."""
    optimum, surgery = result.optimum, result.plan.surgery
    if optimum is None:
        return []
    lines = []
    each = optimum.outcome.choices[0].reshape(len(surgery.plan.bundles), -1)
    for name, choice in zip(surgery.plan.bundles, each, strict=True):
        places = [
            f"{footprint.bone} {_place(footprint.names, choice[columns])}"
            for footprint, columns in (
                (surgery.tibia, slice(0, 2)), (surgery.femur, slice(2, 4)))
        ]  # fmt: skip
        lines.append(
            f"optimum, {name}: {'; '.join(places)}; {choice[4]:.0f} N, from the middles of the "
            "footprints"
        )
    kept = "all limits kept" if optimum.feasible else "not all limits can be kept"
    lines.append(
        f"{optimum.evaluations} evaluations from {len(optimum.starts)} starts, {kept}; the least "
        f"strain distances found from the starts that were followed: "
        + ", ".join(number(x, 3) for x in np.sort(optimum.ends))
    )
    return lines


def front_table(result: PlanResult) -> list[list[str]]:
    """The ends of the front and its compromise, a header first: criteria and choices."""
    front, surgery = result.front, result.plan.surgery
    assert front is not None
    tests = [f"laxity {angle:g} deg" for angle in surgery.protocol.lachman_deg]
    names = [*tests, "graft peak", "strain distance"]
    choices = [
        f"{footprint.bone} {axis}"
        for footprint in (surgery.tibia, surgery.femur)
        for axis in footprint.names
    ]
    each = [*choices, "tension"] * len(surgery.plan.bundles)
    header = [f"best in (of {len(front.criteria)})", *names, *each]
    wanted = [*zip(names, np.argmin(front.criteria, axis=0), strict=True)]
    return [header] + [
        [name, *(number(x, 3) for x in front.criteria[row]),
         *(number(x, 3) for x in front.outcome.choices[row])]
        for name, row in (*wanted, ("compromise", front.compromise))
    ]  # fmt: skip


def said_of_tolerances(result: PlanResult) -> list[str]:
    """How exact a tunnel must be, a sentence each."""
    band = result.plan.surgery.limits.band_mm
    lines = []
    for one in result.tolerances:
        footprint = result.plan.surgery.footprint(one.bone)
        way = " and ".join(
            f"{_towards(name, part)}" for name, part in zip(footprint.names, one.direction,
                                                            strict=True) if abs(part) > 0.3
        )  # fmt: skip
        if np.isfinite(one.found_mm):
            far = f"{one.found_mm:.1f} mm off"
        else:
            far = f"more than {one.checked_mm:.1f} mm off"
        lines.append(
            f"{one.bone}, {one.bundle}: {far} ({way}) before the laxity at {one.lachman_deg:g} "
            f"degrees leaves the band of {band:g} mm; {one.expected_mm:.1f} mm by the derivative, "
            f"{one.slope:.2f} mm of laxity a mm"
        )
    return lines


def _place(names: tuple[str, str], place: np.ndarray) -> str:
    return ", ".join(
        f"{abs(x):.1f} mm {_towards(name, x)}" for name, x in zip(names, place, strict=True)
    )


_OPPOSITE = {"anterior": "posterior", "medial": "lateral", "proximal": "distal"}


def _towards(name: str, part: float) -> str:
    return name if part >= 0 else _OPPOSITE[name]
