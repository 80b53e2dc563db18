"""A planned reconstruction as an answer: where to place the graft, how tight, how exact."""

__all__ = ["plan_answer"]

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from kneejax.planning import Outcome, PlanResult, Surgery
from kneejax.report import plan_figures
from kneejax.report.look.page import Answer, Drawing, Section, Verdict, paragraphs, prose
from kneejax.report.look.tables import NONE, Column, Table, json_safe, number
from kneejax.statics import Status

BEFORE = ("intact", "deficient")
_OPPOSITE = {"anterior": "posterior", "medial": "lateral", "proximal": "distal"}


def plan_answer(result: PlanResult) -> Answer:
    """Where and how tight to place a graft, what the knee does then, and how exact it must be.

    Args:
        result: of a plan.

    Returns:
        The answer; its tables are plan, octagon, curves and, where one was asked for, front.
    """
    plan, surgery, doubts = result.plan, result.plan.surgery, plan_doubts(result)
    graft, found = plan.graft.name.replace("_", " "), result.optimum
    whole, corner = knees_table(result), result.octagon
    octagon = Table.of({
        "position": range(1, len(corner.choices) + 1),
        tuple(Column(name, show="3") for name in (*surgery.ligaments, "total")):
            np.column_stack([corner.distance, corner.total]),
    }, "Strain distance by place")  # fmt: skip
    tables = {"plan": whole, "octagon": octagon, "curves": curves_table(result)}
    chosen = [c.name for x in surgery.plan.bundles for c in choice_columns(surgery, x)]
    does = [c.name for c in whole.columns if c.shown and c.name not in chosen]
    reconstructed = ["planned", *["optimum"] * (found is not None)]
    where = part_of(whole, reconstructed, ["knee", *chosen], "Where and how tight",
                    "From the middles of the footprints.")  # fmt: skip
    knees = part_of(whole, [*BEFORE, *reconstructed], does, "What the knee does",
                    prose("plan.knees", force=surgery.protocol.force_N))  # fmt: skip
    corners = [f"octagon {k + 1}" for k in range(len(corner.choices))]
    eight = part_of(whole, corners, does, "Eight places on the tibia")
    maps = {f"map_{one.bone}": Drawing(plan_figures.tunnel_map_figure, result, one,
                                       more=prose(f"plan.{one.bone}")) for one in result.maps}
    front = {"front": Drawing(plan_figures.front_figure, result)} if result.has_front else {}
    drawings = {**maps, **front, "strains": Drawing(plan_figures.strain_figure, result),
                "tension": Drawing(plan_figures.tension_figure, result)}  # fmt: skip
    first, *others = *maps, "strains"
    sought = ["No optimum was asked for."]
    if found is not None:
        ends = ", ".join(number(x, 3) for x in np.sort(found.ends))
        sought = paragraphs("plan.sought", free=", ".join(plan.free), limits=surgery.limits,
                            ends=ends, evaluations=found.evaluations, starts=len(found.starts))
    tradeoff: list[Table] = []
    if result.front is not None:
        tables["front"], tradeoff = front_tables(result)
    places_words = prose("plan.octagon", apothem=plan.octagon_mm)
    if np.isfinite(corner.total).any():
        order = [int(k) + 1 for k in np.argsort(corner.total) if np.isfinite(corner.total[k])]
        places_words += f" Nearest to the intact knee is {order[0]}, farthest {order[-1]}."
    sections = [
        Section("How exact must a tunnel be?", tables=[exactness_table(result)], opened=True,
                printed=True),
        Section("How the optimum was found", sought, printed=True),
        Section("The other tunnel", drawings=[name for name in others if name in maps]),
        *[Section("What must be given up for what", [prose("plan.criteria")], tradeoff, [name],
                  printed=True) for name in front],
        Section("How well it is known", tables=interval_tables(result), printed=True),
        Section("The tension", drawings=["tension"]),
        Section("Eight places on the tibia", [places_words], [octagon, eight],
                ["strains"] * (first != "strains")),
        Section("What was assumed", [*_assumptions(result), prose("plan.note")]),
    ]  # fmt: skip
    laxities = zip(surgery.protocol.lachman_deg, result.best.laxity_mm[0],
                   surgery.laxity(surgery.before)[0], strict=True)  # fmt: skip
    facts = [("Knee", plan.own.name), ("Graft", graft),
             *((f"Laxity at {angle:g} deg, mm (intact)", f"{number(own, 2)} ({number(intact, 2)})")
               for angle, own, intact in laxities),
             ("Largest graft force, N", number(result.best.peak_N[0], 3))]  # fmt: skip
    bundles = len(surgery.plan.bundles)
    asked = prose("plan.asked", plan=plan, graft=graft,
                  how="one bundle" if bundles == 1 else f"{bundles} bundles",
                  stiffness=sum(surgery.plan.stiffness_N) / 1000,
                  tension=", ".join(f"{x:g}" for x in plan.base[4::5]))  # fmt: skip
    failed = plan_failed(result)
    return Answer(title=plan.title, asked=f"{asked} {prose('plan.note')}",
                  verdict=Verdict.FAILED if not Status(int(result.best.status[0])).converged else
                  Verdict.DOUBTFUL if doubts or failed else Verdict.GOOD,
                  sentence=_sentence(result), tables=tables, main=[where, knees], drawings=drawings,
                  picture=first, doubts=doubts, facts=facts, sections=sections,
                  exit_status=int(failed))  # fmt: skip


def _sentence(result: PlanResult) -> str:
    surgery, several = result.plan.surgery, len(result.plan.surgery.plan.bundles) > 1
    each = result.best.choices[0].reshape(len(surgery.plan.bundles), -1)
    said = []
    for name, choice in zip(surgery.plan.bundles, each, strict=True):
        ends = ((surgery.tibia, choice[:2]), (surgery.femur, choice[2:4]))
        places = [
            f"{footprint.bone} " + ", ".join(
                f"{abs(x):.1f} mm {towards(axis, x)}"
                for axis, x in zip(footprint.names, place, strict=True)
            )
            for footprint, place in ends
        ]  # fmt: skip
        said.append(f"{name}: " * several + f"{'; '.join(places)}; {choice[4]:.0f} N")
    what, kept = "Planned", "as planned"
    if result.optimum is not None:
        what = "Optimum"
        kept = "all limits kept" if result.optimum.feasible else "not all limits can be kept"
    return f"{what}: {'. '.join(said)} at {surgery.fixation_deg:g} degrees ({kept})."


def _assumptions(result: PlanResult) -> list[str]:
    surgery, feet = result.plan.surgery, (result.plan.surgery.tibia, result.plan.surgery.femur)
    extension, meshes = surgery.protocol.extension_deg, [x for x in feet if x.surface is not None]
    place = f"on the mesh of {' and '.join(x.bone for x in meshes)}"
    place = place if meshes else prose("plan.plane")
    axes = [f"{a:g} and {b:g} mm" for a, b in (x.semi_axes_mm for x in feet)]
    pairs = zip(surgery.plan.bundles, surgery.replaced, strict=True)
    return paragraphs("plan.assumed", graft=result.plan.graft, place=place, axes=axes,
                      count=len(extension), first=extension[0], last=extension[-1],
                      window=surgery.window, knee=result.plan.own.name,
                      pairs="; ".join(f"{name} for {', '.join(own)}" for name, own in pairs))


def plan_doubts(result: PlanResult) -> list[str]:
    """What a reader must know before the numbers; empty where nothing is wrong."""
    surgery, said = result.plan.surgery, []
    for row, name in enumerate(BEFORE):
        lost = np.unique(surgery.protocol.flexion_deg[~surgery.before.converged[row]])
        if len(lost):
            said.append(prose("plan.lost", name=name, at=", ".join(f"{x:g}" for x in lost)))
    for name, found, row in variants(result):
        status = Status(int(found.status[row]))
        if status is not Status.BALANCED and not name.startswith("octagon"):
            said.append(f"Of the {'plan' if name == 'planned' else name}: {status.sentence}.")
    if result.optimum is not None and not result.optimum.feasible:
        said.append(prose("plan.missed", missed=result.optimum.missed))
    if result.front is not None and not result.has_front:
        said.append("No choice was found that keeps all limits: there is no front.")
    if len(lost := 1 + np.flatnonzero(~np.isfinite(result.octagon.total))):
        said.append(f"No motion was found with the graft at corner {', '.join(map(str, lost))} of "
                    "the octagon.")  # fmt: skip
    return said


def plan_failed(result: PlanResult) -> bool:
    """Whether a knee that was asked for has no balance, or the optimum misses a limit."""
    wanted = [result.planned] if result.optimum is None else [result.planned, result.best]
    lost = any(not Status(int(one.status[0])).converged for one in wanted)
    missed = result.optimum is not None and not result.optimum.feasible
    return lost or missed or (result.front is not None and not result.has_front)


def plan_document(result: PlanResult, versions: dict[str, str]) -> dict[str, Any]:
    """What plan.json holds."""
    plan, surgery, optimum = result.plan, result.plan.surgery, result.optimum
    document: dict[str, Any] = {
        "title": plan.title, "note": prose("plan.note"), "knee": plan.own.name,
        "ligament": plan.ligament, "torn": list(surgery.plan.torn),
        "graft": {"type": plan.graft.name, "source": plan.graft.source,
                  "bundles": list(surgery.plan.bundles),
                  "stiffness_N": sum(surgery.plan.stiffness_N),
                  "failure_N": sum(surgery.plan.failure_N)},
        "fixation_deg": surgery.fixation_deg, "force_N": surgery.protocol.force_N,
        "window": surgery.window,
        "limits": {"graft_N": surgery.limits.graft_N, "laxity_band_mm": surgery.limits.band_mm,
                   "tension_N": surgery.limits.tension_N},
        "knees": knees_table(result).records(), "doubts": plan_doubts(result),
        "tolerances": [
            {"bone": one.bone, "bundle": one.bundle, "lachman_deg": one.lachman_deg,
             "direction": one.direction, "by_derivative_mm": one.expected_mm,
             "found_mm": one.found_mm, "checked_mm": one.checked_mm, "laxity_mm_per_mm": one.slope}
            for one in result.tolerances
        ],
        "maps": [{"bone": one.bone, "points": [len(one.first), len(one.second)], "least": one.least}
                 for one in result.maps],
        "settings": plan.said, "seconds": result.seconds, "versions": versions,
    }  # fmt: skip
    if (own := result.intervals) is not None:
        counts, knees = [f"{name}_known_in" for name in own.quantities], {}
        of_knees = zip(own.knees, own.kept, own.limits, own.known, strict=True)
        for knee, kept, limits, known in of_knees:
            knees[knee] = {"limits_kept_in": kept, **dict(zip(own.quantities, limits, strict=True)),
                           **dict(zip(counts, known, strict=True))}  # fmt: skip
        document["intervals"] = {"draws": own.draws, "parts": [0.025, 0.5, 0.975],
                                 "held": list(plan.held), "knees": knees}  # fmt: skip
    if result.has_front and (front := result.front) is not None:
        document["front"] = {"criteria": list(front.names), "points": len(front.criteria),
                             "evaluations": front.evaluations, "least": front.criteria.min(axis=0),
                             "compromise": front.criteria[front.compromise]}  # fmt: skip
    if optimum is not None:
        document["optimum"] = {"free": list(plan.free), "feasible": optimum.feasible,
                               "missed": optimum.missed, "evaluations": optimum.evaluations,
                               "starts": optimum.starts, "start_distances": optimum.start_totals,
                               "followed": optimum.followed, "ends": optimum.ends}  # fmt: skip
    return json_safe(document)


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
    columns = [Column("knee", show=lambda name: named.get(name, name))]
    for name in bundles:
        own = f"{name} " * (len(bundles) > 1)
        columns += [*choice_columns(surgery, name), Column(f"{name}_slack_length_mm", shown=False),
                    Column(f"{name}_length_change_mm", f"{own}length change, mm", "3")]
    columns += [*(Column(f"laxity_{x:g}_deg_mm", f"laxity {x:g} deg, mm", "3")
                  for x in surgery.protocol.lachman_deg),
                Column("graft_peak_N", "graft peak, N", "3"),
                *(Column(f"strain_distance_{name}", shown=False) for name in surgery.ligaments),
                Column("strain_distance", show="3"),
                Column("status", show=lambda word: word.replace("_", " "))]  # fmt: skip
    rows: list[list[Any]] = [
        [name, *[np.nan] * (7 * len(bundles)), *laxity, *[np.nan] * (2 + others),
         Status(int(status.max())).word]
        for name, status, laxity in zip(BEFORE, before.status, surgery.laxity(before), strict=True)
    ]  # fmt: skip
    for name, found, row in variants(result):
        each = found.choices[row].reshape(len(bundles), -1)
        own = [x for k in range(len(bundles))
               for x in (*each[k], found.slack_mm[row, k], found.isometry_mm[row, k])]  # fmt: skip
        rows.append([name, *own, *found.laxity_mm[row], found.peak_N[row], *found.distance[row],
                     found.total[row], Status(int(found.status[row])).word])  # fmt: skip
    return Table(columns, rows)


def part_of(
    whole: Table, knees: Sequence[str], names: Sequence[str], title: str = "", note: str = ""
) -> Table:
    """Some rows and columns of the table of all knees."""
    columns = [dataclasses.replace(one, shown=one.name in names) for one in whole.columns]
    rows = [row for row in whole.rows if row[0] in knees]
    return Table(columns, rows, title, note)


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
        for angle, strain, tension in zip(surgery.protocol.extension_deg,
                                          followed.strain[row, motion, k],
                                          followed.tension_N[row, motion, k], strict=True)
    ]  # fmt: skip
    return Table(("knee", "flexion_deg", "ligament", "strain", "tension_N"), rows)


def front_tables(result: PlanResult) -> tuple[Table, list[Table]]:
    """Criteria and choices of a front; and for people its ends and the compromise."""
    front, surgery = result.front, result.plan.surgery
    assert front is not None
    names = [f"laxity_{angle:g}_deg_mm" for angle in surgery.protocol.lachman_deg]
    criteria = [Column(name, show="3") for name in (*names, "graft_peak_N", "strain_distance")]
    choices = [one for name in surgery.plan.bundles for one in choice_columns(surgery, name)]
    cells = np.hstack([front.criteria, front.outcome.choices]).tolist()
    whole = Table([*criteria, *choices, Column("compromise")],
                  [[*row, int(k == front.compromise)] for k, row in enumerate(cells)])  # fmt: skip
    if not result.has_front:
        return whole, []
    ends = {one.heading.rpartition(",")[0] or one.heading: k
            for one, k in zip(criteria, np.argmin(front.criteria, axis=0), strict=True)}
    rows = [[name, *cells[k]] for name, k in (ends | {"compromise": front.compromise}).items()]
    note = prose("plan.front", count=len(front.criteria), tried=front.evaluations)
    return whole, [Table(["best_in", *criteria, *choices], rows, "Best choices by criterion", note)]


def interval_tables(result: PlanResult) -> list[Table]:
    """Medians with 95 % intervals over the knees that a calibration leaves possible, if known."""
    own, surgery = result.intervals, result.plan.surgery
    if own is None:
        return []
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
    note = prose("plan.intervals", draws=own.draws)
    if result.plan.held:
        note += " " + prose("plan.held", names=", ".join(result.plan.held))
    columns = ["knee", *(Column(name, words=False) for name in (*names, "limits_kept_in"))]
    return [Table(columns, rows, "Over the knees that the calibration leaves possible", note)]


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
        ["tunnel", "bundle", "towards", Column("off_by_mm", words=False),
         Column("by_derivative_mm", show=".1f"), Column("laxity_at_deg", show="g"),
         Column("laxity_per_mm", "laxity a mm, mm", ".2f")],
        rows,
        f"How exact must a tunnel be? Distance from the {what} at which laxity leaves its band "
        f"first ({band:g} mm about that of the intact knee)",
    )  # fmt: skip


def towards(name: str, part: float) -> str:
    """The direction in words: a name, or its opposite where the part along it is negative."""
    return name if part >= 0 else _OPPOSITE[name]
