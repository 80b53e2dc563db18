"""What a plan says in sentences that do not depend on its numbers, or hardly."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from kneejax.planning import PlanResult


#: Stands on every page and in every report of a plan.
NOT_FOR_PATIENTS = (
    "A computation on a model, for research and teaching. Nothing here supports a decision about "
    "a patient."
)
OF_KNEES = (
    "Planned: the tunnels and the tension of the plan file. Optimum: the choices with the smallest "
    "strain distance within the limits. Octagon 1 to 8: as planned, with the tibial tunnel in a "
    "corner of an octagon about the middle of the footprint. Laxity: how far {force:g} N draw the "
    "tibia forward. Graft peak: the largest force of any bundle, through extension and under the "
    "tests. Length change: between the tunnels, through extension; an isometric graft has none. "
    "Strain distance: how far the strain curves of all ligaments are from the intact knee's; 0 is "
    "a perfect reconstruction."
)
OF_CRITERIA = (
    "Laxity, graft force and strains pull in different directions: a choice that improves one "
    "worsens another."
)
CAPTIONS = {
    "strains": "Strain of every ligament from bent to straight. Dashed: the intact knee. Thin "
    "lines: the graft's tibial end in the eight corners of the octagon, everything else as "
    "planned. A reconstruction is the better, the nearer its curves are to the dashed ones.",
    "front": "Every choice of the front, each panel two criteria, the colour a third. Further to "
    "the left and lower is better. The diamond is the compromise, the cross the plan, the star "
    "the optimum of strain distance alone.",
    "tension": "What the tension at fixation does, tunnels as planned. A tighter graft lets the "
    "tibia forward less and carries more; dashed are the intact knee, and the largest force that "
    "the plan allows.",
}
OF_MAP = (
    "What happens if the tunnel on the {bone} begins elsewhere, everything else as planned. "
    "{view} Hatched: a limit of the plan is missed; grey: the knee has no balance, or gives way "
    "under the test. The ellipse is the usual size of the footprint, dots in the first panel are "
    "the ends of the knee's own fibres. The star is the optimum, where all choices were free "
    "together: it need not lie at the best place of a map, which keeps all but two of them."
)
#: Whether the bone is the tibia -> how a map shows it.
VIEWS = {
    True: "The right knee from above, its front at the top, medial on the left.",
    False: "The lateral wall of a right knee's notch from its medial side, front on the left.",
}


def said_of_plan(result: PlanResult) -> str:
    """What is done, in a sentence."""
    plan, surgery = result.plan, result.plan.surgery
    bundles = len(surgery.plan.bundles)
    tension = ", ".join(f"{x:g}" for x in plan.base[4::5])
    how = "one bundle" if bundles == 1 else f"{bundles} bundles"
    return (
        f"{plan.own.name}: {plan.ligament} replaced by a {plan.graft.name.replace('_', ' ')} graft "
        f"({how}, {sum(surgery.plan.stiffness_N) / 1000:.3g} kN per unit strain), fixed at "
        f"{surgery.fixation_deg:g} degrees under {tension} N. Where should it be placed, and how "
        "tight?"
    )


def said_of_limits(result: PlanResult) -> list[str]:
    """Among which choices the optimum was sought."""
    limits = result.plan.surgery.limits
    if result.optimum is None:
        return ["No optimum was asked for."]
    return [
        "The choices whose strain curves are nearest to the intact knee's, among those that keep "
        f"the tunnels inside the footprints, the graft below {limits.graft_N:g} N, the laxity "
        f"within {limits.band_mm:g} mm of the intact knee's and the tension between "
        f"{limits.tension_N[0]:g} and {limits.tension_N[1]:g} N. Free were: "
        f"{', '.join(result.plan.free)}."
    ]


def said_of_octagon(result: PlanResult) -> list[str]:
    """Where the corners are, and which is best."""
    total, best = result.octagon.total, ""
    if np.isfinite(total).any():
        order = [int(k) + 1 for k in np.argsort(total) if np.isfinite(total[k])]
        best = f" Nearest to the intact knee is {order[0]}, farthest {order[-1]}."
    return [
        f"The graft's tibial end in the corners of an octagon, {result.plan.octagon_mm:g} mm from "
        "the middle of the footprint to its sides: distance of each ligament's strain curve from "
        "the intact knee's, in the layout of paper 2's Table 4. Corner 1 lies in front and "
        f"medially; the numbers run by way of the lateral side.{best}"
    ]


def assumptions(result: PlanResult) -> list[str]:
    """What was assumed, a paragraph each."""
    plan, surgery = result.plan, result.plan.surgery
    protocol, graft = surgery.protocol, result.plan.graft
    meshes = [one.bone for one in (surgery.tibia, surgery.femur) if one.surface is not None]
    place = "in a plane through the middle of the knee's own footprint: no mesh of the bones was "
    place = f"on the mesh of {' and '.join(meshes)}." if meshes else f"{place}given."
    axes = [f"{a:g} and {b:g} mm" for a, b in (x.semi_axes_mm for x in (surgery.tibia,
                                                                       surgery.femur))]  # fmt: skip
    pairs = zip(surgery.plan.bundles, surgery.replaced, strict=True)
    return [
        "The knee is passive: no muscles but those that the knee file has, no menisci but what the "
        "fitted surfaces stand for, slow motion.",
        "A graft is one straight fibre a bundle, from aperture to aperture: it does not bend at "
        "the tunnel's edge, does not touch the notch, and its fixation does not yield.",
        f"Graft: {graft.says}; {graft.stiffness_N_per_mm:g} N/mm, which is taken for a free length "
        f"of 30 mm, and {graft.failure_N:g} N at failure ({graft.source}). It does not creep, and "
        "it does not change as it heals.",
        "Pretension is the graft's force in the knee that is balanced with it at the flexion of "
        "fixation, without any load on the tibia.",
        f"Tunnels begin {place}",
        f"The footprint's ellipses have semi-axes of {axes[0]} on the tibia and {axes[1]} on the "
        "femur (means of cadavers, Siebold et al. 2008, unless the plan says otherwise).",
        f"Strain curves at {len(protocol.extension_deg)} flexions from "
        f"{protocol.extension_deg[0]:g} to {protocol.extension_deg[-1]:g} degrees are aligned by "
        f"dynamic time warping within {surgery.window} places; the distance is the sum of absolute "
        "offsets. A graft's curve is compared with that of the fibres that it replaces: "
        + "; ".join(f"{name} for {', '.join(own)}" for name, own in pairs) + ".",
        f"All numbers belong to one model of one knee, {plan.own.name}. Numbers of another knee, "
        "or of other ligaments than those assumed here, may lead to another place.",
    ]  # fmt: skip
