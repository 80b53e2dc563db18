"""A planned reconstruction as an answer: where to place the graft, how tight, how exact."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from kneejax.report import plan_figures, plan_tables
from kneejax.report.look.page import Answer, Drawing, Section, Verdict, paragraphs, prose
from kneejax.report.look.tables import json_safe, number
from kneejax.statics import Status

if TYPE_CHECKING:
    from kneejax.planning import PlanResult


def plan_answer(result: PlanResult) -> Answer:
    """Where and how tight to place a graft, what the knee does then, and how exact it must be.

    Args:
        result: of a plan.

    Returns:
        The answer; its tables are plan, octagon, curves and, where one was asked for, front.
    """
    plan, surgery, doubts = result.plan, result.plan.surgery, plan_doubts(result)
    whole, octagon = plan_tables.knees_table(result), plan_tables.octagon_table(result)
    tables = {"plan": whole, "octagon": octagon, "curves": plan_tables.curves_table(result)}
    chosen = [c.name for x in surgery.plan.bundles for c in plan_tables.choice_columns(surgery, x)]
    does = [c.name for c in whole.columns if c.shown and c.name not in chosen]
    tried = [name for name, *_ in plan_tables.variants(result)]
    corners = [name for name in tried if name.startswith("octagon")]
    reconstructed = [name for name in tried if name not in corners]
    where = plan_tables.part_of(whole, reconstructed, ["knee", *chosen], "Where and how tight",
                  "From the middles of the footprints.")  # fmt: skip
    every = [*plan_tables.BEFORE, *reconstructed]
    knees = plan_tables.part_of(whole, every, does, "What the knee does",
                  prose("plan.knees", force=f"{surgery.protocol.force_N:g}"))  # fmt: skip
    exact = plan_tables.exactness_table(result)
    eight = plan_tables.part_of(whole, corners, does, "Eight places on the tibia")
    drawings = {
        f"map_{one.bone}": Drawing(plan_figures.tunnel_map_figure, result, one,
                                   more=prose(f"plan.{one.bone}"))
        for one in result.maps
    }
    places = list(drawings)
    if result.has_front:
        drawings["front"] = Drawing(plan_figures.front_figure, result)
    drawings["strains"] = Drawing(plan_figures.strain_figure, result)
    drawings["tension"] = Drawing(plan_figures.tension_figure, result)
    first = places[0] if places else "strains"
    sections = [Section("How exact must a tunnel be?", tables=[exact], opened=True, printed=True),
                Section("How the optimum was found", [*_limits(result), *_of_search(result)],
                        printed=True)]  # fmt: skip
    if places[1:]:
        sections.append(Section("The other tunnel", drawings=places[1:]))
    if result.front is not None:
        tables["front"] = plan_tables.front_table(result)
    if result.has_front:
        title, said = "What must be given up for what", [prose("plan.criteria")]
        tradeoff = plan_tables.tradeoff_table(result)
        sections.append(Section(title, said, [tradeoff], ["front"], printed=True))
    if result.intervals is not None:
        intervals = plan_tables.interval_table(result)
        sections.append(Section("How well it is known", tables=[intervals], printed=True))
    sections += [
        Section("The tension", drawings=["tension"]),
        Section(
            "Eight places on the tibia", _octagon(result), [octagon, eight],
            ["strains"] if first != "strains" else [],
        ),
        Section("What was assumed", [*_assumptions(result), prose("plan.note")]),
    ]  # fmt: skip
    facts = [("Knee", plan.own.name), ("Graft", plan.graft.name.replace("_", " "))]
    intact = surgery.laxity(surgery.before)[0]
    for k, angle in enumerate(surgery.protocol.lachman_deg):
        both = f"{number(result.best.laxity_mm[0, k], 2)} ({number(intact[k], 2)})"
        facts.append((f"Laxity at {angle:g} deg, mm (intact)", both))
    facts.append(("Largest graft force, N", number(result.best.peak_N[0], 3)))
    sentence, asked = _sentence(result), _asked(result)
    failed = plan_failed(result)
    return Answer(
        title=plan.title, asked=f"{asked} {prose('plan.note')}",
        verdict=Verdict.FAILED if not Status(int(result.best.status[0])).converged else
        Verdict.DOUBTFUL if doubts or failed else Verdict.GOOD,
        sentence=sentence, tables=tables, main=[where, knees], drawings=drawings, picture=first,
        doubts=doubts, facts=facts, sections=sections, exit_status=int(failed),
    )  # fmt: skip


def _sentence(result: PlanResult) -> str:
    """Where and how tight."""
    surgery, several = result.plan.surgery, len(result.plan.surgery.plan.bundles) > 1
    each = result.best.choices[0].reshape(len(surgery.plan.bundles), -1)
    said = []
    for name, choice in zip(surgery.plan.bundles, each, strict=True):
        ends = ((surgery.tibia, choice[:2]), (surgery.femur, choice[2:4]))
        places = [
            f"{footprint.bone} " + ", ".join(
                f"{abs(x):.1f} mm {plan_tables.towards(axis, x)}"
                for axis, x in zip(footprint.names, place, strict=True)
            )
            for footprint, place in ends
        ]  # fmt: skip
        said.append(f"{name}: " * several + f"{'; '.join(places)}; {choice[4]:.0f} N")
    kept = "as planned"
    if result.optimum is not None:
        kept = "all limits kept" if result.optimum.feasible else "not all limits can be kept"
    what = "Optimum" if result.optimum is not None else "Planned"
    return f"{what}: {'. '.join(said)} at {surgery.fixation_deg:g} degrees ({kept})."


def _of_search(result: PlanResult) -> list[str]:
    if (found := result.optimum) is None:
        return []
    ends = ", ".join(number(x, 3) for x in np.sort(found.ends))
    return [
        f"{found.evaluations} evaluations from {len(found.starts)} starts; the least strain "
        f"distances found from the starts that were followed: {ends}."
    ]


def _asked(result: PlanResult) -> str:
    """What is done, in a sentence."""
    plan, surgery = result.plan, result.plan.surgery
    bundles = len(surgery.plan.bundles)
    return prose(
        "plan.asked", knee=plan.own.name, ligament=plan.ligament,
        graft=plan.graft.name.replace("_", " "), flexion=f"{surgery.fixation_deg:g}",
        how="one bundle" if bundles == 1 else f"{bundles} bundles",
        stiffness=f"{sum(surgery.plan.stiffness_N) / 1000:.3g}",
        tension=", ".join(f"{x:g}" for x in plan.base[4::5]),
    )  # fmt: skip


def _limits(result: PlanResult) -> list[str]:
    """Among which choices the optimum was sought."""
    limits = result.plan.surgery.limits
    if result.optimum is None:
        return ["No optimum was asked for."]
    numbers = {"graft": limits.graft_N, "band": limits.band_mm, "least": limits.tension_N[0],
               "most": limits.tension_N[1]}  # fmt: skip
    shown = {name: f"{x:g}" for name, x in numbers.items()}
    return [prose("plan.limits", free=", ".join(result.plan.free), **shown)]


def _octagon(result: PlanResult) -> list[str]:
    """Where the corners are, and which is best."""
    total, best = result.octagon.total, ""
    if np.isfinite(total).any():
        order = [int(k) + 1 for k in np.argsort(total) if np.isfinite(total[k])]
        best = f" Nearest to the intact knee is {order[0]}, farthest {order[-1]}."
    return [prose("plan.octagon", apothem=f"{result.plan.octagon_mm:g}") + best]


def _assumptions(result: PlanResult) -> list[str]:
    """What was assumed, a paragraph each."""
    surgery, graft = result.plan.surgery, result.plan.graft
    feet, extension = (surgery.tibia, surgery.femur), surgery.protocol.extension_deg
    meshes = [one.bone for one in feet if one.surface is not None]
    place = f"on the mesh of {' and '.join(meshes)}" if meshes else prose("plan.plane")
    axes = [f"{a:g} and {b:g} mm" for a, b in (x.semi_axes_mm for x in feet)]
    pairs = zip(surgery.plan.bundles, surgery.replaced, strict=True)
    return paragraphs("plan.assumed", graft=graft.says, stiffness=f"{graft.stiffness_N_per_mm:g}",
                      failure=f"{graft.failure_N:g}", source=graft.source, place=place,
                      tibia=axes[0], femur=axes[1], count=len(extension), first=f"{extension[0]:g}",
                      last=f"{extension[-1]:g}", window=surgery.window, knee=result.plan.own.name,
                      pairs="; ".join(f"{name} for {', '.join(own)}" for name, own in pairs))


def plan_doubts(result: PlanResult) -> list[str]:
    """What a reader must know before the numbers; empty where nothing is wrong."""
    surgery, said = result.plan.surgery, []
    for row, name in enumerate(plan_tables.BEFORE):
        lost = np.unique(surgery.protocol.flexion_deg[~surgery.before.converged[row]])
        if len(lost):
            said.append(
                f"The {name} knee does not hold the load, or has no balance, at "
                f"{', '.join(f'{x:g}' for x in lost)} degrees: its laxity there is not known."
            )
    for name, found, row in plan_tables.variants(result):
        status = Status(int(found.status[row]))
        if status is not Status.BALANCED and not name.startswith("octagon"):
            said.append(f"Of the {'plan' if name == 'planned' else name}: {status.sentence}.")
    if result.optimum is not None and not result.optimum.feasible:
        said.append(
            "No choice was found that keeps all limits; the optimum is the one that misses them "
            f"least, by {result.optimum.missed:.0%} of the worst."
        )
    if result.front is not None and not result.has_front:
        said.append("No choice was found that keeps all limits: there is no front.")
    lost = [str(k + 1) for k, total in enumerate(result.octagon.total) if not np.isfinite(total)]
    if lost:
        said.append(f"No motion was found with the graft at corner {', '.join(lost)} of the "
                    "octagon.")  # fmt: skip
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
        "knees": plan_tables.knees_table(result).records(), "doubts": plan_doubts(result),
        "tolerances": [
            _fields(one, bone="bone", bundle="bundle", lachman_deg="lachman_deg",
                    direction="direction", by_derivative_mm="expected_mm", found_mm="found_mm",
                    checked_mm="checked_mm", laxity_mm_per_mm="slope")
            for one in result.tolerances
        ],
        "maps": [{"bone": one.bone, "points": [len(one.first), len(one.second)], "least": one.least}
                 for one in result.maps],
        "settings": plan.said, "seconds": result.seconds, "versions": versions,
    }  # fmt: skip
    if (own := result.intervals) is not None:
        knees = {}
        for row, knee in enumerate(own.knees):
            knees[knee] = {"limits_kept_in": own.kept[row]}
            for k, name in enumerate(own.quantities):
                knees[knee] |= {name: own.limits[row, k]}
            for k, name in enumerate(own.quantities):
                knees[knee] |= {f"{name}_known_in": own.known[row, k]}
        parts = [0.025, 0.5, 0.975]
        document["intervals"] = {"draws": own.draws, "parts": parts, "held": list(plan.held),
                                 "knees": knees}  # fmt: skip
    if result.has_front and (front := result.front) is not None:
        document["front"] = {"criteria": list(front.names), "points": len(front.criteria),
                             "evaluations": front.evaluations, "least": front.criteria.min(axis=0),
                             "compromise": front.criteria[front.compromise]}  # fmt: skip
    if optimum is not None:
        document["optimum"] = {"free": list(plan.free)} | _fields(
            optimum, feasible="feasible", missed="missed", evaluations="evaluations",
            starts="starts", start_distances="start_totals", followed="followed", ends="ends",
        )  # fmt: skip
    return json_safe(document)


def _fields(one: Any, **names: str) -> dict[str, Any]:
    return {said: getattr(one, name) for said, name in names.items()}
