"""Paper 3: drawer and torsion of twelve bundles (its sections 5.1 and 5.2), and the raised leg."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import lab_tests, laxity, load_curves, mechanics_of
from kneejax.files import bundled_measurements, load_knee
from kneejax.files.tables.tables import Table as TableFile
from kneejax.mechanics import Knee
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent
from kneejax.papers.paper3_leg import (
    BODY_KG,
    HEIGHT_M,
    OTHER,
    leg_findings,
    leg_table,
    raise_leg,
    raised_leg_figure,
)
from kneejax.papers.rigid_leg import RigidLeg
from kneejax.report.look import BLACK, BLUE, GREY, VERMILLION, WIDTH, Answer, Table, styled
from kneejax.report.panels import grid
from kneejax.statics import Status

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KNEE, CONDITIONS = "twelve_bundle", "paper3_conditions"
#: Flexions of its Figure 11; those of the drawer are given with the tests' sizes.
TORSION_DEG = (0.0, 10.0, 20.0, 30.0, 45.0, 60.0, 75.0, 90.0)
STEPS = 10
#: Flexions at which the knee is stiff, and at which it is lax.
EXTREME_DEG, MIDDLE_DEG = (0.0, 90.0), (20.0, 30.0)
#: Region near the neutral position, mm; part of the end's stiffness that counts as small there.
NEAR_MM, SMALL = 1.5, 0.5
#: Tension of a ligament that bears load, N; part of all values of drawer that is nearly all.
BEARS_N, NEARLY_ALL = 1.0, 0.8
#: A knee may give way under the torque, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY)


@dataclasses.dataclass(frozen=True)
class LaxityStudy:
    """Drawer by displacement and torsion by torque, by which the claims are judged.

    Attributes:
        drawer_deg: flexions of the drawer, `(n,)`.
        moved_mm: anterior displacement from the neutral pose, in order, `(m,)`.
        force_N: that holds the tibia there, `(n, m)`; NaN where no balance was found.
        tension: ligament or group -> its tension there, N, `(n, m)`.
        torsion_deg: flexions of the torsion, `(k,)`.
        internal_deg: rotation under the full internal torque, `(k,)`; NaN where the knee gives way.
        external_deg: under the full external one, negative, `(k,)`.
        held_Nm: largest torques that the knee holds, external (negative) and internal, `(k, 2)`.
        torque_Nm: the full torque.
        status: flexion -> the worst of the drawer and of the torsion there.
    """

    drawer_deg: np.ndarray
    moved_mm: np.ndarray
    force_N: np.ndarray
    tension: dict[str, np.ndarray]
    torsion_deg: np.ndarray
    internal_deg: np.ndarray
    external_deg: np.ndarray
    held_Nm: np.ndarray
    torque_Nm: float
    status: dict[float, Status]

    @property
    def total_deg(self) -> np.ndarray:
        """Rotation between the two torques, `(k,)`, degrees."""
        return self.internal_deg - self.external_deg

    def row(self, flexion_deg: float) -> int:
        """Of the drawer at a flexion."""
        return int(np.argmin(np.abs(self.drawer_deg - flexion_deg)))

    def stiffness_ratio(self, flexion_deg: float) -> float:
        """Mean slope of the drawer near the neutral position over that at its ends."""
        x, y = self.moved_mm, self.force_N[self.row(flexion_deg)]
        back, forth = np.interp([-NEAR_MM, NEAR_MM], x, y)
        low, high = np.interp([x[0] + NEAR_MM, x[-1] - NEAR_MM], x, y)
        return float((forth - back) / (y[-1] - high + low - y[0]))


def reproduce(stages: Stages = silent) -> Answer:
    """Make the tests, raise the leg, and judge the claims.

    Args:
        stages: shows progress.
    """
    names = ["flexion_deg", "drawer_mm", "internal_Nm"]
    read = TableFile.read(bundled_measurements()[CONDITIONS].path, names)
    places = [read.header.index(name) for name in names]
    conditions = [[float(cells[k]) for k in places] for _, cells in read.rows]
    flexion, (_, drawer_mm, torque_Nm) = np.array(conditions)[:, 0], conditions[0]
    with stages("drawer and torsion"):
        found = laxity_study(load_knee(KNEE), flexion, drawer_mm, torque_Nm)
    with stages("leg raise"):
        raised = raise_leg(load_knee(KNEE), load_knee(KNEE, patella=True))
    grid_deg, grid_mm = np.meshgrid(found.drawer_deg, found.moved_mm, indexing="ij")
    drawn = {"flexion_deg": grid_deg, "anterior_mm": grid_mm, "anterior_N": found.force_N}
    drawn |= {f"{name}_N": pulls for name, pulls in found.tension.items()}
    turned = {
        "flexion_deg": found.torsion_deg, "internal_deg": found.internal_deg,
        "external_deg": found.external_deg,
        ("held_external_Nm", "held_internal_Nm"): found.held_Nm,
    }  # fmt: skip
    tables = {"drawer": Table.of({name: x.ravel() for name, x in drawn.items()}),
              "torsion": Table.of(turned), "raised_leg": leg_table(raised)}  # fmt: skip
    doubts = [
        f"{flexion:g} degrees: {status.word} ({status.sentence})."
        for flexion, status in sorted(found.status.items())
        if status not in _ANSWERS
    ]
    figures = {"drawer": drawer_figure(found), "torsion": torsion_figure(found),
               "raised_leg": raised_leg_figure(raised)}  # fmt: skip
    settings = {"knee": KNEE, "conditions": CONDITIONS, "torque_Nm": found.torque_Nm}
    words = {"knee": KNEE, "body_kg": BODY_KG, "height_m": HEIGHT_M}
    doubts += raised.doubts
    return answered(3, claims(found, raised), figures, tables, settings, doubts, words)


def laxity_study(
    knee: Knee, drawer_deg: np.ndarray, displacement_mm: float, torque_Nm: float
) -> LaxityStudy:
    """Move and turn the tibia both ways.

    Args:
        knee: with the twelve bundles of Table 1 (`twelve_bundle`).
        drawer_deg: flexions of the drawer.
        displacement_mm: how far the tibia is moved each way.
        torque_Nm: how hard it is turned each way.
    """
    (drawer,) = lab_tests(
        "drawer", drawer_deg, displacement_mm=displacement_mm, both=True, steps=STEPS
    )
    (torsion,) = lab_tests("torsion", TORSION_DEG, moment_Nm=torque_Nm, both=True, steps=STEPS)
    (drawn,), (turned,) = load_curves(knee, [drawer]), load_curves(knee, [torsion])
    mechanics = mechanics_of(drawn)
    order = np.argsort(drawn.part)
    known = np.isfinite(np.asarray(drawn.displacement_by_load)[:, order])
    force = np.where(known, np.asarray(drawn.driving_load)[:, order], np.nan)
    each = np.asarray(mechanics.tension)[drawn.nodes[:, order]]
    each = np.where(known[..., None], each, np.nan)
    tension = {name: each[..., k] for k, name in enumerate(knee.ligaments.names)}
    for group, members in knee.groups:
        tension[group] = np.sum([tension[one] for one in members], axis=0)
    found = laxity(turned, turned.status(mechanics_of(turned)))
    status: dict[float, Status] = {}
    for row in (*laxity(drawn, drawn.status(mechanics)), *found):
        worst = max(int(row.status), int(status.get(row.flexion_deg, 0)))
        status[row.flexion_deg] = Status(worst)
    return LaxityStudy(
        np.asarray(drawer_deg, float), displacement_mm * np.sort(drawn.part), force, tension,
        np.array(TORSION_DEG), np.array([row.positive for row in found]),
        np.array([row.negative for row in found]),
        np.array([(row.held_negative, row.held_positive) for row in found]), torque_Nm, status,
    )  # fmt: skip


def claims(found: LaxityStudy, raised: RigidLeg) -> tuple[Claim, ...]:
    """Judge the claims of paper 3.

    Args:
        found: drawer and torsion of a knee with its twelve bundles.
        raised: the leg that its quadriceps holds.
    """
    findings = _drawer(found) | _torsion(found) | leg_findings(raised)
    return judged(3, findings, torque_Nm=found.torque_Nm, other=OTHER)


def _drawer(found: LaxityStudy) -> dict[str, Finding]:
    """Claims 3.1 to 3.3."""
    span = {
        x: float(np.ptp(found.force_N[found.row(x)][[0, -1]])) for x in (*EXTREME_DEG, *MIDDLE_DEG)
    }
    lax = max(span[x] for x in MIDDLE_DEG)
    soft = [x for x in EXTREME_DEG if not span[x] > lax]
    ratios = {x: found.stiffness_ratio(x) for x in MIDDLE_DEG}
    neutral = int(np.argmin(np.abs(found.moved_mm)))
    both = np.stack([found.tension[name] for name in ("ACL", "PCL")])
    pulls = {x: (*both[:, found.row(x), neutral],) for x in MIDDLE_DEG}
    shares = {x: float(np.mean((both[:, found.row(x)] > BEARS_N).any(axis=0))) for x in EXTREME_DEG}
    return {
        "3.1": Finding(not soft,
                       in_words(dict(sorted(span.items())), "{:g} degrees {:.0f} N"),
                       numbers={"where": " and ".join(f"{x:g}" for x in soft)}),
        "3.2": Finding(
            all(ratio < SMALL for ratio in ratios.values()),
            in_words(ratios, "{:g} degrees {:.0%}"),
            numbers={"pulls": in_words(pulls, "{:g} degrees ACL {:.0f} N, PCL {:.0f} N", "; ")},
        ),
        "3.3": Finding(min(shares.values()) >= NEARLY_ALL, in_words(shares, "{:g} degrees {:.0%}")),
    }  # fmt: skip


def _torsion(found: LaxityStudy) -> dict[str, Finding]:
    """Claims 3.4 and 3.5."""
    known = np.isfinite(found.total_deg)
    least = np.argmin(np.where(known, found.total_deg, np.inf)) == 0 and known[0]
    grows = bool((np.diff(found.total_deg[known]) > 0.0).all())
    total = [f"{y:.0f}" if np.isfinite(y) else "not held" for y in found.total_deg]
    shown = in_words(dict(zip(found.torsion_deg, total, strict=True)), "{:g}: {}")
    turned = f"total, degrees: {shown}"
    reasons = []
    if not known.all():
        held = zip(found.torsion_deg[~known], map(tuple, found.held_Nm[~known]), strict=True)
        each = in_words(dict(held), "{:g} degrees {:.1f} to {:.1f}")
        reasons.append(
            f"the knee gives way, N m: {each}. Nothing but twelve straight lines and flat plateaux "
            "resists torsion; the paper says that its own is larger than real knees' in flexion, "
            "since anterolateral and posterolateral structures are absent, and holds it there"
        )
    if not grows:
        reasons.append("it does not grow between all neighbouring flexions")
    return {
        "3.4": Finding(least, turned),
        "3.5": Finding(grows and known.all(), turned, "; ".join(reasons)),
    }


@styled
def drawer_figure(found: LaxityStudy) -> Figure:
    """Draw force over drawer at each flexion, as Figure 10 of paper 3 does."""
    figure, panels = grid(2, 2, 5.2, left=0.7, apart=(0.2, 0.4), sharex=True, sharey=True)
    for axes, flexion, letter in zip(panels.flat, found.drawer_deg, "abcd", strict=False):
        axes.axhline(0.0, color=GREY, linewidth=0.5)
        axes.axvline(0.0, color=GREY, linewidth=0.5)
        axes.plot(found.moved_mm, found.force_N[found.row(flexion)], color=BLACK)
        axes.set_title(f"({letter}) {flexion:g} degrees of flexion")
    for k in range(2):
        panels[1, k].set_xlabel("Anterior drawer from the neutral position, mm")
        panels[k, 0].set_ylabel("Anterior force, N")
    return figure


@styled
def torsion_figure(found: LaxityStudy) -> Figure:
    """Draw rotation over flexion, as Figure 11 does; a cross where the torque is not held."""
    figure, ((axes,),) = grid(1, 1, 3.6, width=0.75 * WIDTH, top=0.15, bottom=0.95)
    axes.axhline(0.0, color=GREY, linewidth=0.5)
    x, unheld = found.torsion_deg, "torque not held"
    for y, color, sense in (
        (found.internal_deg, BLUE, "internal"), (found.external_deg, VERMILLION, "external"),
    ):  # fmt: skip
        label = f"{sense} torque, {found.torque_Nm:g} N m"
        axes.plot(x, y, "o-", color=color, markersize=3, label=label)
        if (gone := ~np.isfinite(y)).any():
            axes.plot(x[gone], np.zeros(gone.sum()), "x", color=color, label=unheld)
    axes.plot(x, found.total_deg, "s--", color=BLACK, markersize=3, label="total")
    axes.set(xlabel="Flexion, deg", ylabel="Rotation from the neutral position, deg")
    handles, labels = axes.get_legend_handles_labels()
    named = dict(zip(labels, handles, strict=True))
    figure.legend([*named.values()], [*named], loc="lower center", ncol=2, fontsize=7)
    return figure
