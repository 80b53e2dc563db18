"""The report of a plan: one page that a surgeon can read."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import TIBIA
from kneejax.report.look import (
    json_safe,
    number,
    page,
    picture,
    save_and_inline,
    section,
    table,
    warnings_box,
    write_whole,
)
from kneejax.report.planning._figures import strain_figure, tension_figure
from kneejax.report.planning._front import front_figure
from kneejax.report.planning._maps import tunnel_map_figure
from kneejax.report.planning._tables import NOT_FOR_PATIENTS, octagon_rows, plan_doubts
from kneejax.report.planning._text import (
    front_table,
    interval_rows,
    knee_rows,
    said_of_optimum,
    said_of_plan,
    said_of_tolerances,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.planning import PlanResult

_STYLE = """
.never { border: 2px solid #9c2f12; border-radius: 4px; padding: .6rem .9rem; margin: 1rem 0;
  font-weight: 600; }
td.least { font-weight: 700; }
"""
_CAPTIONS = {
    "strains": (
        "Strain of every ligament from bent to straight. Dashed: the intact knee. Thin lines: the "
        "graft's tibial end in the eight corners of the octagon, everything else as planned. A "
        "reconstruction is the better, the nearer its curves are to the dashed ones."
    ),
    "front": (
        "Every choice of the front, each panel two criteria, the colour a third. Further to the "
        "left and lower is better. The diamond is the compromise, the cross the plan, the star the "
        "optimum of strain distance alone."
    ),
    "tension": (
        "What the tension at fixation does, tunnels as planned. A tighter graft lets the tibia "
        "forward less and is pulled harder; dashed are the intact knee, and the largest force "
        "that the plan allows."
    ),
}
_OF_MAP = (
    "What happens if the tunnel on the {bone} begins elsewhere, everything else as planned. "
    "{view} Hatched: a limit of the plan is missed; grey: the knee has no balance, or gives way "
    "under the test. The ellipse is the usual size of the footprint, dots in the first panel are "
    "the ends of the knee's own fibres. The star is the optimum, where all choices were free "
    "together: it need not lie at the best place of a map, which keeps all but two of them."
)
_VIEWS = {
    True: "The right knee from above, its front at the top, medial on the left.",
    False: "The lateral wall of a right knee's notch from its medial side, front on the left.",
}


def write_plan_report(
    result: PlanResult,
    versions: Mapping[str, str],
    folder: str | os.PathLike[str],
    *,
    svg: bool = False,
) -> list[Path]:
    """Write the report of a plan with its figures.

    Args:
        result: what to report.
        versions: package -> version.
        folder: where; made if needed. Files of the same names are replaced.
        svg: whether figures are saved as SVG as well; the page holds them in any case.

    Returns:
        `report.html`, which needs no other file, then `figures/NAME.png`.
    """
    folder, paths, pictures = Path(folder), [], {}
    for name, figure in _figures(result).items():
        written, pictures[name] = save_and_inline(figure, folder / "figures", name, svg=svg)
        paths += written
    whole = _page(result, pictures, versions)
    return [write_whole(folder / "report.html", whole.encode()), *paths]


def _figures(result: PlanResult) -> dict[str, Figure]:
    maps = {f"map_{one.bone}": tunnel_map_figure(result, one) for one in result.maps}
    front = {"front": front_figure(result)} if result.has_front else {}
    return {**maps, **front, "strains": strain_figure(result), "tension": tension_figure(result)}


def _page(result: PlanResult, pictures: Mapping[str, str], versions: Mapping[str, str]) -> str:
    sections = [
        _head(result),
        section("What the knee does", _knees(result)),
        _optimum(result, pictures),
        _front(result, pictures),
        _intervals(result),
        section("The tension", picture(pictures["tension"], _CAPTIONS["tension"])),
        section("Eight places on the tibia", _octagon(result, pictures)),
        section("What was assumed", _assumed(result)),
        section("How to run it again", _again(result, versions)),
        f'<p class="never">{escape(NOT_FOR_PATIENTS)}</p>\n',
    ]
    return page(result.plan.title, sections, _STYLE)


def _head(result: PlanResult) -> str:
    plan, best = result.plan, result.best
    boxes = [("Knee", plan.own.name), ("Graft", plan.graft.name.replace("_", " "))]
    intact = plan.surgery.laxity(plan.surgery.before)[0]
    for k, angle in enumerate(plan.surgery.protocol.lachman_deg):
        both = f"{number(best.laxity_mm[0, k], 2)} ({number(intact[k], 2)})"
        boxes.append((f"Laxity at {angle:g}°, mm (intact)", both))
    boxes.append(("Largest graft force, N", number(best.peak_N[0], 3)))
    facts = "".join(f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in boxes)
    listed = warnings_box("Before you read on", plan_doubts(result))
    which = "the optimum" if result.optimum is not None else "the plan"
    return (
        f"<header>\n<h1>{escape(plan.title)}</h1>\n"
        f'<p class="under">Plan of a reconstruction; the numbers are those of {which}</p>\n'
        f"<dl>{facts}</dl>\n</header>\n"
        f'<p class="never">{escape(NOT_FOR_PATIENTS)}</p>\n{listed}'
        f"<p>{escape(said_of_plan(result))}.</p>\n"
    )


def _knees(result: PlanResult) -> str:
    surgery = result.plan.surgery
    tests = [f"Laxity {angle:g}°, mm" for angle in surgery.protocol.lachman_deg]
    header = ["Knee", *tests, "Graft force, N", "Length change, mm", "Strain distance", "Status"]
    words = (
        f"<p>Laxity: how far {surgery.protocol.force_N:g} N draw the tibia forward. Graft force: "
        "the largest of any bundle, through extension and under the tests. Length change: between "
        "the tunnels, through extension; an isometric graft has none. Strain distance: how far the "
        "strain curves of all ligaments are from the intact knee's.</p>\n"
    )
    return words + table(header, knee_rows(result), (0, len(header) - 1))


def _optimum(result: PlanResult, pictures: Mapping[str, str]) -> str:
    plan, surgery = result.plan, result.plan.surgery
    text = ""
    if result.optimum is not None:
        limits = surgery.limits
        text += (
            f"<p>The choices whose strain curves are nearest to the intact knee's, among those "
            f"that keep the tunnels inside the footprints, the graft below {limits.graft_N:g} N, "
            f"the laxity within {limits.band_mm:g} mm of the intact knee's and the tension between "
            f"{limits.tension_N[0]:g} and {limits.tension_N[1]:g} N. Free were: "
            f"{escape(', '.join(plan.free))}.</p>\n"
        )
        text += "".join(f"<p>{escape(_sentence(one))}</p>\n" for one in said_of_optimum(result))
    items = "".join(f"<li>{escape(one)}</li>\n" for one in said_of_tolerances(result))
    what = "optimum" if result.optimum is not None else "plan"
    text += (
        f"<h3>How exact must a tunnel be?</h3>\n<p>Of the {what}, in the direction in which the "
        f"laxity leaves its band first:</p>\n<ul>\n{items}</ul>\n"
    )
    for one in result.maps:
        caption = _OF_MAP.format(bone=one.bone, view=_VIEWS[one.bone == TIBIA])
        text += picture(pictures[f"map_{one.bone}"], caption)
    return section("Where to place the graft", text)


def _front(result: PlanResult, pictures: Mapping[str, str]) -> str:
    if result.front is None or not result.has_front:
        return ""
    header, *rows = front_table(result)
    words = (
        "<p>Laxity, graft force and strains pull in different directions. Of these "
        f"{len(result.front.criteria)} choices, all within the limits, none is better than another "
        f"in everything ({result.front.evaluations} knees were tried). Those that are best in one "
        "criterion, and the one nearest to the best of all, each counted in parts of its extent; "
        "lengths in mm from the middles of the footprints, forces in N:</p>\n"
    )
    drawn = picture(pictures["front"], _CAPTIONS["front"])
    return section("What must be given up for what", words + table(header, rows) + drawn)


def _intervals(result: PlanResult) -> str:
    if result.intervals is None:
        return ""
    header, *rows = interval_rows(result)
    held = ""
    if result.plan.held:
        names = ", ".join(result.plan.held)
        held = f" The data do not determine {names}: no draw changes them, and limits are too near."
    words = (
        f"<p>The same surgery on {result.intervals.draws} knees that the calibration leaves "
        "possible: drawn from the normal distribution of its parameters, with their correlation. "
        "Lengths in mm, forces in N; the limits of laxity are those of each knee's own intact "
        f"state.{escape(held)}</p>\n"
    )
    return section("How well it is known", words + table(header, rows))


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:] + "."


def _octagon(result: PlanResult, pictures: Mapping[str, str]) -> str:
    plan = result.plan
    header = ["Position", *plan.surgery.ligaments, "Total"]
    rows = [[f"{row[0]:.0f}", *(number(x, 3) for x in row[1:])] for row in octagon_rows(result)]
    total = result.octagon.total
    best = ""
    if np.isfinite(total).any():
        order = [int(k) + 1 for k in np.argsort(total) if np.isfinite(total[k])]
        best = f" Nearest to the intact knee is {order[0]}, farthest {order[-1]}."
    words = (
        f"<p>The graft's tibial end in the corners of an octagon, {plan.octagon_mm:g} mm from the "
        "middle of the footprint to its sides: distance of each ligament's strain curve from the "
        "intact knee's, in the layout of paper 2's Table 4. Corner 1 lies in front and medially; "
        f"the numbers run by way of the lateral side.{best}</p>\n"
    )
    return words + table(header, rows) + picture(pictures["strains"], _CAPTIONS["strains"])


def _assumed(result: PlanResult) -> str:
    plan, surgery = result.plan, result.plan.surgery
    protocol = surgery.protocol
    meshes = [one.bone for one in (surgery.tibia, surgery.femur) if one.surface is not None]
    place = (
        f"Tunnels begin on the mesh of {' and '.join(meshes)}."
        if meshes
        else "Tunnels begin in a plane through the middle of the knee's own footprint: no mesh of "
        "the bones was given."
    )
    items = [
        "The knee is passive: no muscles but those that the knee file has, no menisci but what the "
        "fitted surfaces stand for, slow motion.",
        "A graft is one straight fibre a bundle, from aperture to aperture: it does not bend at "
        "the tunnel's edge, does not touch the notch, and its fixation does not yield.",
        f"Graft: {plan.graft.says}; {plan.graft.stiffness_N_per_mm:g} N/mm, which is taken for a "
        f"free length of 30 mm, and {plan.graft.failure_N:g} N at failure ({plan.graft.source}). "
        "It does not creep, and it does not change as it heals.",
        "Pretension is the graft's force in the knee that is balanced with it at the flexion of "
        "fixation, without any load on the tibia.",
        place,
        f"The footprint's ellipses have semi-axes of {_mm(surgery.tibia.semi_axes_mm)} on the "
        f"tibia and {_mm(surgery.femur.semi_axes_mm)} on the femur (means of cadavers, Siebold et "
        "al. 2008, unless the plan says otherwise).",
        f"Strain curves at {len(protocol.extension_deg)} flexions from "
        f"{protocol.extension_deg[0]:g} to {protocol.extension_deg[-1]:g} degrees are aligned by "
        f"dynamic time warping within {surgery.window} places; the distance is the sum of absolute "
        "offsets. A graft's curve is held against that of the fibres that it replaces: "
        + "; ".join(
            f"{name} for {', '.join(own)}"
            for name, own in zip(surgery.plan.bundles, surgery.replaced, strict=True)
        )
        + ".",
        "All numbers belong to one model of one knee. Numbers of another knee, or of other "
        "ligaments than those assumed here, may lead to another place.",
    ]
    return "<ul>\n" + "".join(f"<li>{escape(one)}</li>\n" for one in items) + "</ul>\n"


def _mm(axes: tuple[float, float]) -> str:
    return f"{axes[0]:g} and {axes[1]:g} mm"


def _again(result: PlanResult, versions: Mapping[str, str]) -> str:
    settings = json.dumps(json_safe(result.plan.said), indent=1)
    listed = ", ".join(f"{name} {version}" for name, version in versions.items())
    seconds = ", ".join(f"{stage} {number(x, 2)} s" for stage, x in result.seconds.items())
    return (
        f"<p>kneejax plan acl with this plan:</p>\n<pre>{escape(settings)}</pre>\n"
        f"<p>{escape(listed)}. Time: {escape(seconds)}.</p>\n"
    )
