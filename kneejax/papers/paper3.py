"""Paper 3: drawer and torsion of twelve bundles (its sections 5.1 and 5.2), and the raised leg over
its rigid patella (sections 6 and 7)."""

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from kneejax.experiments import Shank, lab_tests, laxity, load_curves, mechanics_of
from kneejax.files import bundled_measurements, load_knee
from kneejax.files.tables import tables as csv_tables
from kneejax.geometry import BODIES, COLUMNS, PATELLA
from kneejax.mechanics import Knee
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent
from kneejax.papers.rigid_patella import RigidLeg, rigid_leg, rigid_patella_of
from kneejax.report.look import BLACK, BLUE, GREY, VERMILLION, WIDTH, Answer, Table, styled
from kneejax.report.panels import draw_named, flexion_axis, grid, legend_above, panel_grid
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
#: Flexions of the raised leg, degrees.
LEG_DEG = np.arange(0.0, 91.0, 5.0)
#: Of the person whose leg it is: the paper prints neither mass nor length of its leg.
BODY_KG, HEIGHT_M = 75.0, 1.75
#: Part by which a constant may vary; what is left of a force that is none; part of the largest
#: force that counts as a sum of zero.
STEADY, NONE, ZERO = 0.2, 0.05, 1e-6
#: A knee may give way under the torque, and is judged by that.
_ANSWERS = (Status.BALANCED, Status.OVERSTRETCHED, Status.GIVES_WAY)


@dataclasses.dataclass(frozen=True)
class LaxityStudy:
    """Drawer by displacement and torsion by torque, by which the claims are judged."""

    drawer_deg: np.ndarray  # flexions of the drawer, `(n,)`
    moved_mm: np.ndarray  # anterior displacement from the neutral pose, in order, `(m,)`
    force_N: np.ndarray  # that holds the tibia there, `(n, m)`; NaN where no balance was found
    tension: dict[str, np.ndarray]  # ligament or group -> its tension there, N, `(n, m)`
    torsion_deg: np.ndarray  # flexions of the torsion, `(k,)`
    internal_deg: np.ndarray  # under the full internal torque, `(k,)`; NaN where the knee gives way
    external_deg: np.ndarray  # under the full external one, negative, `(k,)`
    held_Nm: np.ndarray  # largest torques held, external (negative) and internal, `(k, 2)`
    torque_Nm: float  # the full torque
    status: dict[float, Status]  # flexion -> the worst of the drawer and of the torsion there

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
    """Make the tests, raise the leg, and judge the claims."""
    names = ["flexion_deg", "drawer_mm", "internal_Nm"]
    read = csv_tables.Table.read(bundled_measurements()[CONDITIONS].path, names)
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
    # A row a pose; empty where the quadriceps does not pull.
    leg = {
        "flexion_deg": raised.flexion_deg, "quadriceps_N": raised.quadriceps_N,
        "tendon_N": raised.tendon_N, ("medial_facet_N", "lateral_facet_N"): raised.contact_N,
        "patellofemoral_N": raised.patellofemoral_N, "arm_mm": raised.arm_mm,
        tuple(COLUMNS[1:]): raised.tibia.to_table()[:, 1:],
        tuple(x.column for x in BODIES[PATELLA].values()): raised.patella,
        **{f"{name}_N": x for name, x in raised.tension.items()},
        **{f"{name}_anterior_N": x for name, x in raised.shear.items()},
    }  # fmt: skip
    tables = {"drawer": Table.of({name: x.ravel() for name, x in drawn.items()}),
              "torsion": Table.of(turned), "raised_leg": Table.of(leg)}  # fmt: skip
    doubts = [
        f"{flexion:g} degrees: {status.word} ({status.sentence})."
        for flexion, status in sorted(found.status.items())
        if status not in _ANSWERS
    ] + raised.doubts
    figures = {"drawer": drawer_figure(found), "torsion": torsion_figure(found),
               "raised_leg": raised_leg_figure(raised)}  # fmt: skip
    settings = {"knee": KNEE, "conditions": CONDITIONS, "torque_Nm": found.torque_Nm}
    words = {"knee": KNEE, "body_kg": BODY_KG, "height_m": HEIGHT_M}
    return answered(3, claims(found, raised), figures, tables, settings, doubts, words)


def laxity_study(
    knee: Knee, drawer_deg: np.ndarray, displacement_mm: float, torque_Nm: float
) -> LaxityStudy:
    """Draw the tibia each way at flexions, and turn it each way."""
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


def raise_leg(knee: Knee, with_patella: Knee) -> RigidLeg:
    """Raise the leg of a person of 75 kg and 1.75 m."""
    alone, patella = dataclasses.replace(knee, lines=()), rigid_patella_of(with_patella)
    shank = Shank.of_person(BODY_KG, HEIGHT_M)
    return rigid_leg(alone, patella, with_patella.other_bones[PATELLA], LEG_DEG, shank)


def claims(found: LaxityStudy, raised: RigidLeg) -> tuple[Claim, ...]:
    """Judge the claims of paper 3."""
    findings = _drawer(found) | _torsion(found)
    findings |= _forces(raised) | _patella(raised) | _tibia(raised)
    return judged(3, findings, torque_Nm=found.torque_Nm)


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
                       in_words(sorted(span.items()), "{:g} degrees {:.0f} N"),
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
    shown = in_words(zip(found.torsion_deg, total, strict=True), "{:g}: {}")
    turned = f"total, degrees: {shown}"
    reasons = []
    if not known.all():
        held = zip(found.torsion_deg[~known], map(tuple, found.held_Nm[~known]), strict=True)
        each = in_words(held, "{:g} degrees {:.1f} to {:.1f}")
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


def _every_third(found: RigidLeg, values: np.ndarray, form: str) -> str:
    shown = [format(y, form) if on else "none" for y, on in zip(values, found.held, strict=True)]
    return in_words(zip(found.flexion_deg[::3], shown[::3], strict=True), "{:g}: {}")


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
            "" if steady else None, {"falls_by": falls_by},
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
                       in_words(zip(knee[::3], patella[::3], strict=True), "{:g}: {:.0f}"),
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
def drawer_figure(found: LaxityStudy) -> "Figure":
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
def torsion_figure(found: LaxityStudy) -> "Figure":
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


@styled
def raised_leg_figure(found: RigidLeg) -> "Figure":
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
