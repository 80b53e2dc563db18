"""Paper 3's claims on drawer and torsion (its sections 5.1 and 5.2), each with a criterion that can
fail.

Criteria were written before this study was run, but after the laxity of the ten bundles of paper 2
under 90 N and 3 N m had been seen. Figures 10 and 11 were drawn, not printed: what counts is what
the text says of them.
"""

from __future__ import annotations

import numpy as np

from kneejax.reproduction._claims import CANNOT_BE_JUDGED, Claim, judged
from kneejax.reproduction.paper3._leg_claims import leg_claims
from kneejax.reproduction.paper3._leg_study import RaisedLeg
from kneejax.reproduction.paper3._study import Paper3Study

EXTREME_DEG, MIDDLE_DEG = (0.0, 90.0), (20.0, 30.0)
#: Region near the neutral position, mm; part of the end's stiffness that counts as small there.
NEAR_MM, SMALL = 1.5, 0.5
#: Tension of a ligament that bears load, N; part of all values of drawer that is nearly all.
BEARS_N, NEARLY_ALL = 1.0, 0.8


def paper3_claims(found: Paper3Study, raised: RaisedLeg) -> tuple[Claim, ...]:
    """Judge the claims of paper 3.

    Args:
        found: drawer and torsion of a knee with its twelve bundles.
        raised: the leg that its quadriceps holds.

    Returns:
        One claim a statement, then those that cannot be judged.
    """
    return (
        _stiffer(found), _lax_region(found), _cruciates(found), _torsion_least(found),
        _torsion_grows(found), *leg_claims(raised), *_not_judged(),
    )  # fmt: skip


def _stiffer(found: Paper3Study) -> Claim:
    span = {x: float(np.ptp(found.at(x)[[0, -1]])) for x in (*EXTREME_DEG, *MIDDLE_DEG)}
    low, high = max(span[x] for x in MIDDLE_DEG), min(span[x] for x in EXTREME_DEG)
    holds = bool(high > low)
    short = [x for x in EXTREME_DEG if not span[x] > low]
    where = " and ".join(f"{x:g}" for x in short)
    return Claim(
        "3.1",
        "In anterior-posterior drawer the knee is stiffer at 0 and 90 degrees than at 20 and 30.",
        "The force between 5 mm backwards and 5 mm forwards is larger at 0 and at 90 degrees than "
        "at 20 and at 30.",
        "stiffness is lower at 20 and 30 degrees than at the extremes (5.1, Figure 10)",
        ", ".join(f"{x:g} degrees {span[x]:.0f} N" for x in sorted(span)),
        judged(holds),
        "" if holds else f"not at {where} degrees: the attachments are another person's than the "
        "paper's, whose lengths over flexion decide where a cruciate is taut",
    )  # fmt: skip


def _lax_region(found: Paper3Study) -> Claim:
    parts = {x: _start_over_end(found, x) for x in MIDDLE_DEG}
    holds = all(part < SMALL for part in parts.values())
    return Claim(
        "3.2",
        "At 20 and 30 degrees there is a small region around the neutral position in which all "
        "ligament forces remain small.",
        f"Within {NEAR_MM:g} mm of it the mean stiffness is below {SMALL:.0%} of that in the last "
        f"{NEAR_MM:g} mm both ways.",
        "relatively lax at these angles (5.1)",
        ", ".join(f"{x:g} degrees {part:.0%}" for x, part in parts.items()),
        judged(holds),
        "" if holds else f"in the neutral position the cruciates pull already ({_neutral(found)}), "
        "against each other, so that the tibia cannot move without stretching one of them",
    )  # fmt: skip


def _neutral(found: Paper3Study) -> str:
    """Tensions of the cruciates in the neutral positions in question."""
    middle, parts = int(np.argmin(np.abs(found.moved_mm))), []
    for flexion in MIDDLE_DEG:
        row = int(np.argmin(np.abs(found.drawer_deg - flexion)))
        pulls = ", ".join(f"{n} {found.tension[n][row, middle]:.0f} N" for n in ("ACL", "PCL"))
        parts.append(f"{flexion:g} degrees {pulls}")
    return "; ".join(parts)


def _start_over_end(found: Paper3Study, flexion: float) -> float:
    """Mean slope near the neutral position over that in the last stretch each way."""
    x, y = found.moved_mm, found.at(flexion)
    near = [float(np.interp(side * NEAR_MM, x, y)) for side in (-1, 1)]
    far = [float(np.interp(side * (x[-1] - NEAR_MM), x, y)) for side in (-1, 1)]
    start = (near[1] - near[0]) / (2.0 * NEAR_MM)
    end = (y[-1] - far[1] + far[0] - y[0]) / (2.0 * NEAR_MM)
    return start / end


def _cruciates(found: Paper3Study) -> Claim:
    shares = {}
    for flexion in EXTREME_DEG:
        row = int(np.argmin(np.abs(found.drawer_deg - flexion)))
        bears = np.array([found.tension[name][row] > BEARS_N for name in ("ACL", "PCL")])
        shares[flexion] = float(np.mean(bears.any(axis=0)))
    holds = min(shares.values()) >= NEARLY_ALL
    return Claim(
        "3.3",
        "At 0 and 90 degrees the cruciates bear load for nearly all values of drawer.",
        f"At each, ACL or PCL is under more than {BEARS_N:g} N at {NEARLY_ALL:.0%} of all "
        "positions from 5 mm backwards to 5 mm forwards.",
        "the ACL and PCL bear load for nearly all values of drawer (5.1)",
        ", ".join(f"{x:g} degrees {share:.0%}" for x, share in shares.items()),
        judged(holds),
        "" if holds else "drawn backwards near extension the tibia hangs on the collaterals and "
        "the capsule: aPC begins 21 % slack and these attachments never stretch it by as much",
    )  # fmt: skip


def _torsion_least(found: Paper3Study) -> Claim:
    total = np.where(np.isfinite(found.total_deg), found.total_deg, np.inf)
    holds = bool(np.argmin(total) == 0 and np.isfinite(total[0]))
    return Claim(
        "3.4",
        "Torsional laxity is least in full extension.",
        f"Under {found.torque_Nm:g} N m both ways the tibia turns less at 0 degrees than at every "
        "other flexion; one at which it does not hold the torque counts as larger.",
        "minimum in this configuration (5.2, Figure 11)",
        _turned(found),
        judged(holds),
        ""
        if holds
        else "collaterals that are taut in extension are what resists torsion; with "
        "these attachments some stay taut in flexion",
    )


def _torsion_grows(found: Paper3Study) -> Claim:
    total = found.total_deg
    known = np.isfinite(total)
    grows = bool((np.diff(total[known]) > 0.0).all())
    lost = found.torsion_deg[~known]
    reason = []
    if lost.size:
        held = found.held_Nm[~known]
        each = ", ".join(
            f"{x:g} degrees {low:.1f} to {high:.1f}"
            for x, (low, high) in zip(lost, held, strict=True)
        )
        reason.append(
            f"the knee gives way, N m: {each}. Nothing but twelve straight lines and flat plateaux "
            "resists torsion; the paper says that its own is larger than real knees' in flexion, "
            "since anterolateral and posterolateral structures are absent, and holds it there"
        )
    if not grows:
        reason.append("it does not grow between all neighbouring flexions")
    return Claim(
        "3.5",
        "Torsional laxity grows with flexion from full extension to 90 degrees.",
        "The total rotation is larger at each flexion than at the one before, and the torque is "
        "held at all.",
        "continues to increase as flexion increases (5.2)",
        _turned(found),
        judged(grows and not lost.size),
        "; ".join(reason),
    )


def _turned(found: Paper3Study) -> str:
    rows = zip(found.torsion_deg, found.total_deg, strict=True)
    return "total, degrees: " + ", ".join(
        f"{x:g}: {y:.0f}" if np.isfinite(y) else f"{x:g}: not held" for x, y in rows
    )


def _not_judged() -> tuple[Claim, ...]:
    drawn = "the curves of cadavers (Markolf, Blankevoort and others) are drawn, not printed"
    rows = (
        ("3.14", "Drawer and torsion compare favourably with cadavers; torsion in flexion is "
         "larger than in real knees.", "Figures 10 and 11", drawn),
        ("3.15", "Quadriceps force of 280 N at full extension, and as measured on three cadavers; "
         "motions, patella and moment arm as theirs.", "6.1 to 6.3, Figures 12 to 15",
         "mass and length of the leg are not printed, nor the curves of the cadavers"),
    )  # fmt: skip
    return tuple(
        Claim(number, said, "None.", printed, "-", CANNOT_BE_JUDGED, reason)
        for number, said, printed, reason in rows
    )
