"""Paper 3's raised leg over its rigid patella, and what is claimed of it (sections 6 and 7)."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import Shank
from kneejax.geometry import BODIES, COLUMNS, PATELLA
from kneejax.mechanics import Knee
from kneejax.papers.claims import Finding, in_words
from kneejax.papers.rigid_leg import RigidLeg, rigid_leg
from kneejax.papers.rigid_patella import rigid_patella_of
from kneejax.report.look import Table, styled
from kneejax.report.panels import draw_named, flexion_axis, legend_above, panel_grid

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Flexions, degrees.
LEG_DEG = np.arange(0.0, 91.0, 5.0)
#: Of the person whose leg it is: the paper prints neither mass nor length of its leg.
BODY_KG, HEIGHT_M = 75.0, 1.75
#: Part by which a constant may vary; what is left of a force that is none.
STEADY, NONE = 0.2, 0.05
#: Largest of the forces that counts as a sum of zero; tension of a ligament that bears load, N.
ZERO, BEARS_N = 1e-6, 1.0
#: Why a patella of another person's knee need not do as the paper's.
OTHER = (
    "groove, facets, attachments and the length of the tendon are another person's than the "
    "paper's, which prints none of them"
)


def raise_leg(knee: Knee, with_patella: Knee) -> RigidLeg:
    """Raise the leg of a person of 75 kg and 1.75 m.

    Args:
        knee: of two bones; a line that stands for the patella is left out.
        with_patella: the same with its patella, through whose surfaces those of paper 3 are laid.
    """
    alone, patella = dataclasses.replace(knee, lines=()), rigid_patella_of(with_patella)
    shank = Shank.of_person(BODY_KG, HEIGHT_M)
    return rigid_leg(alone, patella, with_patella.other_bones[PATELLA], LEG_DEG, shank)


def leg_table(leg: RigidLeg) -> Table:
    """A row a pose; empty where the quadriceps does not pull."""
    return Table.of({
        "flexion_deg": leg.flexion_deg, "quadriceps_N": leg.quadriceps_N, "tendon_N": leg.tendon_N,
        ("medial_facet_N", "lateral_facet_N"): leg.contact_N,
        "patellofemoral_N": leg.patellofemoral_N, "arm_mm": leg.arm_mm,
        tuple(COLUMNS[1:]): leg.tibia.to_table()[:, 1:],
        tuple(x.column for x in BODIES[PATELLA].values()): leg.patella,
        **{f"{name}_N": x for name, x in leg.tension.items()},
        **{f"{name}_anterior_N": x for name, x in leg.shear.items()},
    })  # fmt: skip


def leg_findings(found: RigidLeg) -> dict[str, Finding]:
    """Claims 3.6 to 3.13."""
    return _forces(found) | _patella(found) | _tibia(found)


def _every_third(found: RigidLeg, values: np.ndarray, form: str) -> str:
    shown = [format(y, form) if on else "none" for y, on in zip(values, found.held, strict=True)]
    return in_words(dict(zip(found.flexion_deg[::3], shown[::3], strict=True)), "{:g}: {}")


def _forces(found: RigidLeg) -> dict[str, Finding]:
    """Claims 3.6 to 3.8: quadriceps, and tendon and contact relative to it."""
    flexion = found.flexion_deg
    at_0, at_90 = (int(np.argmin(np.abs(flexion - x))) for x in (0.0, 90.0))
    pull = np.maximum(found.quadriceps_N, 0.0)
    middle = pull[(flexion >= 20.0) & (flexion <= 60.0)]
    steady = middle.max() / middle.min() - 1.0 < STEADY
    gone = pull[at_90] < NONE * middle.mean()
    falls_by = 1.0 - middle.min() / middle.max()
    tendon = found.where_held(found.tendon_N / found.quadriceps_N)
    peak, start = float(flexion[np.nanargmax(tendon)]), float(tendon[at_0])
    falls = np.diff(tendon[flexion >= 30.0])
    falls = (falls[np.isfinite(falls)] < 0.0).all()
    ratio = found.where_held(found.patellofemoral_N / found.quadriceps_N)
    last, grows = ratio[found.held][-1], (np.diff(ratio[found.held]) > 0.0).all()
    return {
        "3.6": Finding(
            steady and gone and pull.argmax() == 0,
            "N at degrees: " + _every_third(found, pull, ".0f"),
            "" if steady else f"from 20 to 60 degrees it falls by {falls_by:.0%}, with the moment "
            f"of the leg, which halves there; the arm does not fall along with it. {OTHER}",
        ),
        "3.7": Finding(start > 1.0 and 10.0 <= peak <= 30.0 and falls,
                       _every_third(found, tendon, ".2f"), numbers={"peak": peak, "start": start}),
        "3.8": Finding(0.4 <= ratio[0] <= 0.6 and 1.0 <= last <= 1.2 and grows,
                       _every_third(found, ratio, ".2f")),
    }  # fmt: skip


def _patella(found: RigidLeg) -> dict[str, Finding]:
    """Claims 3.9 and 3.10: flexion of the patella, moment arm."""
    knee, patella = found.flexion_deg, found.patella[:, 0]
    last = float(patella[int(np.argmin(np.abs(knee - 90.0)))])
    arm = found.where_held(found.arm_mm)
    at, size = float(knee[np.nanargmax(arm)]), float(np.nanmax(arm))
    return {
        "3.9": Finding((np.diff(patella) < np.diff(knee)).mean() >= 0.8 and 60.0 <= last <= 70.0,
                       in_words(dict(zip(knee[::3], patella[::3], strict=True)), "{:g}: {:.0f}"),
                       numbers={"last": last}),
        "3.10": Finding(25.0 <= at <= 45.0 and 45.0 <= size <= 55.0,
                        "mm at degrees: " + _every_third(found, found.arm_mm, ".0f"),
                        numbers={"size": size, "at": at}),
    }  # fmt: skip


def _tibia(found: RigidLeg) -> dict[str, Finding]:
    """Claims 3.11 to 3.13: cruciates, motion of the tibia, forces along its anterior axis."""
    flexion, on = found.flexion_deg, found.held
    acl, pcl = (found.tension[name] > BEARS_N for name in ("ACL", "PCL"))
    first = flexion[on & pcl].min() if (on & pcl).any() else np.inf
    curves = (_every_third(found, found.tension[name], ".0f") for name in ("ACL", "PCL"))
    table = np.asarray(found.tibia.to_table())
    moved = (table - table[0])[on]
    inwards, forwards, varus = moved[:, 2].max(), moved[:, 3].max(), np.abs(moved[:, 1]).max()
    total = np.abs(sum(found.shear.values())).max()
    size = max(np.abs(part).max() for part in found.shear.values())
    tendon = float(found.shear["patellar tendon"][int(np.argmin(np.abs(flexion)))])
    return {
        "3.11": Finding(acl[flexion <= 55.0].all() and 45.0 <= first <= 65.0,
                        "ACL {}; PCL {} N".format(*curves), numbers={"first": first}),
        "3.12": Finding(
            10.0 <= inwards <= 25.0 and 4.0 <= forwards <= 10.0 and varus < 5.0,
            f"inwards by {inwards:.0f} degrees, forwards by {forwards:.1f} mm, varus or valgus "
            f"{varus:.1f} degrees",
        ),
        "3.13": Finding(
            total < ZERO * size and tendon > 0.0,
            f"sum at most {total:.1e} N of {size:.0f} N; tendon {tendon:.0f} N at 0 degrees",
        ),
    }  # fmt: skip


@styled
def raised_leg_figure(found: RigidLeg) -> Figure:
    """Draw pull, ratios of forces, moment arm, patella, cruciates and the shear on the tibia.

    In the layout of the paper's Figures 12 to 19. Where the quadriceps would have to push nothing
    is drawn but the patella.
    """
    figure, panels = panel_grid(3, 2, 7.6, "")
    flexion, seen = found.flexion_deg, found.where_held
    ratios = {"patellar tendon": found.tendon_N, "patellofemoral contact": found.patellofemoral_N}
    shear = {name: seen(x) for name, x in found.shear.items()}
    # The six largest parts by themselves.
    largest = sorted(shear, key=lambda name: -np.nanmax(np.abs(shear[name])))[:6]
    parts = {name: shear[name] for name in largest}
    rest = [force for name, force in shear.items() if name not in largest]
    parts |= {"all others": sum(rest)} if rest else {}
    drawn = {
        "Quadriceps force, N": {"": seen(found.quadriceps_N)},
        "Force by quadriceps force": {k: seen(x / found.quadriceps_N) for k, x in ratios.items()},
        "Moment arm, mm": {"": seen(found.arm_mm)},
        "Patella, deg": dict(zip(("flexion", "rotation", "tilt"), found.patella.T, strict=False)),
        "Ligament force, N": {name: seen(found.tension[name]) for name in ("ACL", "PCL")},
        "Force on the tibia, forwards, N": parts | {"sum": sum(shear.values())},
    }
    for axes, (label, curves) in zip(panels, drawn.items(), strict=True):
        draw_named(axes, flexion, curves, label)
        flexion_axis(axes, flexion)
    for axes in panels[[0, 1, 2, 4]]:
        axes.set_ylim(bottom=0.0)
    panels[5].lines[-1].set(color="black", linestyle=":")
    legend_above(panels[5])
    return figure
