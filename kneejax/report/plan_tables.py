"""Tables of a plan: every knee, the octagon, strain curves, the front, intervals, exactness."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report.look.tables import NONE, Column, Table, number
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.planning import Outcome, PlanResult, Surgery

BEFORE = ("intact", "deficient")
_OPPOSITE = {"anterior": "posterior", "medial": "lateral", "proximal": "distal"}


def variants(result: PlanResult) -> Iterator[tuple[str, Outcome, int]]:
    """Name, outcome and row of every reconstruction that a plan tried: plan, optimum, octagon."""
    yield "planned", result.planned, 0
    if result.optimum is not None:
        yield "optimum", result.optimum.outcome, 0
    for corner in range(len(result.octagon.choices)):
        yield f"octagon {corner + 1}", result.octagon, corner


def choice_columns(surgery: Surgery, bundle: str) -> list[Column]:
    """A bundle's five choices; its name stands in the headings where there are several."""
    named = f"{bundle} " * (len(surgery.plan.bundles) > 1)
    places = [Column(f"{bundle}_{foot.bone}_{axis}_mm", f"{named}{foot.bone} {axis}, mm", ".1f")
              for foot in (surgery.tibia, surgery.femur) for axis in foot.names]  # fmt: skip
    return [*places, Column(f"{bundle}_tension_N", f"{named}tension, N", ".1f")]


def knees_table(result: PlanResult) -> Table:
    """Choices and what they do: the intact and the deficient knee, then every reconstruction."""
    surgery, before = result.plan.surgery, result.plan.surgery.before
    bundles, others = surgery.plan.bundles, len(surgery.ligaments)
    named = {"deficient": f"without {result.plan.ligament}"}
    columns = [Column("knee", show=lambda name: named.get(name, name), words=True)]
    for name in bundles:
        columns += choice_columns(surgery, name)
        columns.append(Column(f"{name}_slack_length_mm", shown=False))
        own = f"{name} " * (len(bundles) > 1)
        columns.append(Column(f"{name}_length_change_mm", f"{own}length change, mm", "3"))
    for angle in surgery.protocol.lachman_deg:
        columns.append(Column(f"laxity_{angle:g}_deg_mm", f"laxity {angle:g} deg, mm", "3"))
    columns.append(Column("graft_peak_N", "graft peak, N", "3"))
    columns += [Column(f"strain_distance_{name}", shown=False) for name in surgery.ligaments]
    columns.append(Column("strain_distance", show="3"))
    columns.append(Column("status", show=lambda word: word.replace("_", " "), words=True))
    rows: list[list[Any]] = []
    for row, (name, laxity) in enumerate(zip(BEFORE, surgery.laxity(before), strict=True)):
        status = Status(int(before.status[row].max())).word
        blank = [np.nan] * (7 * len(bundles))
        rows.append([name, *blank, *laxity, *[np.nan] * (2 + others), status])
    for name, found, row in variants(result):
        each = found.choices[row].reshape(len(bundles), -1)
        own = [x for k in range(len(bundles))
               for x in (*each[k], found.slack_mm[row, k], found.isometry_mm[row, k])]  # fmt: skip
        rows.append(
            [name, *own, *found.laxity_mm[row], found.peak_N[row], *found.distance[row],
             found.total[row], Status(int(found.status[row])).word]
        )  # fmt: skip
    return Table(columns, rows)


def part_of(
    whole: Table, knees: Sequence[str], names: Sequence[str], title: str = "", note: str = ""
) -> Table:
    """Some rows and columns of the table of all knees."""
    columns = [dataclasses.replace(one, shown=one.name in names) for one in whole.columns]
    rows = [row for row in whole.rows if row[0] in knees]
    return Table(columns, rows, title, note)


def octagon_table(result: PlanResult) -> Table:
    """Paper 2's Table 4: position, strain distance of each ligament, and of all."""
    found, names = result.octagon, (*result.plan.surgery.ligaments, "total")
    columns = [Column("position"), *(Column(name, show="3") for name in names)]
    rows = [[k + 1, *found.distance[k], found.total[k]] for k in range(len(found.choices))]
    return Table(columns, rows, "Strain distance by place")


def curves_table(result: PlanResult) -> Table:
    """Strain and tension of every ligament through extension, in every knee."""
    surgery = result.plan.surgery
    motion, plan = surgery.protocol.motion, surgery.plan
    knees = [(name, surgery.before, row) for row, name in enumerate(BEFORE)]
    knees += [(name, found.followed, row) for name, found, row in variants(result)]
    absent = {"intact": plan.bundles, "deficient": (*plan.torn, *plan.bundles)}
    rows = [
        [name, angle, ligament, strain, tension]
        for name, followed, row in knees
        for k, ligament in enumerate(plan.knee.ligaments.names)
        if ligament not in absent.get(name, plan.torn)
        for angle, strain, tension in zip(
            surgery.protocol.extension_deg, followed.strain[row, motion, k],
            followed.tension_N[row, motion, k], strict=True,
        )
    ]  # fmt: skip
    header = ("knee", "flexion_deg", "ligament", "strain", "tension_N")
    return Table([Column(name) for name in header], rows)


def front_table(result: PlanResult) -> Table:
    """Criteria and choices of a front by strain distance; the compromise is marked."""
    front, surgery = result.front, result.plan.surgery
    assert front is not None
    tests = [Column(f"laxity_{angle:g}_deg_mm") for angle in surgery.protocol.lachman_deg]
    columns = [*tests, Column("graft_peak_N"), Column("strain_distance")]
    columns = [dataclasses.replace(one, show="3") for one in columns]
    columns += [one for name in surgery.plan.bundles for one in choice_columns(surgery, name)]
    pairs = zip(front.criteria, front.outcome.choices, strict=True)
    rows = [[*criteria, *choices, int(k == front.compromise)]
            for k, (criteria, choices) in enumerate(pairs)]  # fmt: skip
    return Table([*columns, Column("compromise")], rows)


def tradeoff_table(result: PlanResult) -> Table:
    """The ends of the front and its compromise."""
    front, every = result.front, front_table(result)
    assert front is not None
    count = front.criteria.shape[1]
    names = [one.heading.rpartition(",")[0] or one.heading for one in every.columns[:count]]
    ends = [*zip(names, np.argmin(front.criteria, axis=0), strict=True)]
    rows = [[name, *every.rows[k][:-1]] for name, k in (*ends, ("compromise", front.compromise))]
    note = (
        f"Of {len(front.criteria)} choices within the limits, of which none is better than another "
        f"in everything ({front.evaluations} knees were tried): those best in one criterion, and "
        "the one nearest to the best of all, each counted in parts of its extent. Lengths in mm "
        "from the middles of the footprints."
    )
    columns = [Column("best_in", words=True), *every.columns[:-1]]
    return Table(columns, rows, "Best choices by criterion", note)


def interval_table(result: PlanResult) -> Table:
    """Medians with 95 % intervals over the knees that a calibration leaves possible."""
    own, surgery = result.intervals, result.plan.surgery
    assert own is not None
    names = [f"laxity {angle:g} deg, mm" for angle in surgery.protocol.lachman_deg]
    names += ["graft peak, N", "strain distance"]
    rows = []
    for row, name in enumerate(own.knees):
        cells = []
        for (low, middle, high), known in zip(own.limits[row], own.known[row], strict=True):
            few = f" in {known}" if 0 < known < own.draws else ""
            limits = f"{number(middle, 3)} ({number(low, 3)} to {number(high, 3)}){few}"
            cells.append(limits if known else NONE)
        kept = own.kept[row]
        rows.append([name, *cells, f"{kept:.0%}" if np.isfinite(kept) else NONE])
    note = (
        f"Median (95 % interval) of the same surgery on {own.draws} knees that the calibration "
        "leaves possible, drawn from the normal distribution of its parameters with their "
        "correlation; limits of laxity are those of each knee's own intact state."
    )
    if result.plan.held:
        note += (
            f" The data do not determine {', '.join(result.plan.held)}: no draw changes them, and "
            "these intervals are too narrow."
        )
    columns = [Column("knee", words=True), *map(Column, names), Column("limits_kept_in")]
    return Table(columns, rows, "Over the knees that the calibration leaves possible", note)


def exactness_table(result: PlanResult) -> Table:
    """How far each tunnel may be off."""
    band, rows = result.plan.surgery.limits.band_mm, []
    for one in result.tolerances:
        names = result.plan.surgery.footprint(one.bone).names
        way = " and ".join(towards(name, part)
                           for name, part in zip(names, one.direction, strict=True)
                           if abs(part) > 0.3)  # fmt: skip
        known = np.isfinite(one.found_mm)
        far = f"{one.found_mm:.1f}" if known else f"above {one.checked_mm:.1f}"
        rows.append([one.bone, one.bundle, way, far, one.expected_mm, one.lachman_deg, one.slope])
    what = "optimum" if result.optimum is not None else "plan"
    return Table(
        [Column("tunnel", words=True), Column("bundle", words=True), Column("towards", words=True),
         Column("off_by_mm", "off by, mm"), Column("by_derivative_mm", show=".1f"),
         Column("laxity_at_deg", show="g"), Column("laxity_per_mm", "laxity a mm, mm", ".2f")],
        rows,
        f"How exact must a tunnel be? Distance from the {what} at which laxity leaves its band "
        f"first ({band:g} mm about that of the intact knee)",
    )  # fmt: skip


def towards(name: str, part: float) -> str:
    """The direction in words: a name, or its opposite where the part along it is negative."""
    return name if part >= 0 else _OPPOSITE[name]
