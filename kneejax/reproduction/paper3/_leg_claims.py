"""Paper 3's claims on the raised leg (its sections 6 and 7), each with a criterion that can fail.

Criteria follow the words of the paper; they were written when the numbers had been seen, and none
was chosen by them.
"""

from __future__ import annotations

import numpy as np

from kneejax.reproduction._claims import Claim, judged
from kneejax.reproduction.paper3._leg_study import RaisedLeg

#: Part by which a constant may vary; what is left of a force that is none.
STEADY, NONE = 0.2, 0.05
#: Largest of the forces that counts as a sum of zero; tension of a ligament that bears load, N.
ZERO, BEARS_N = 1e-6, 1.0
#: Why a patella of another person's knee need not do as the paper's.
_OTHER = (
    "groove, facets, attachments and the length of the tendon are another person's than the "
    "paper's, which prints none of them"
)


def leg_claims(found: RaisedLeg) -> tuple[Claim, ...]:
    """Judge the claims of paper 3 on the raised leg.

    Args:
        found: a leg held over a rigid patella.

    Returns:
        One claim a statement.
    """
    return (
        _pull(found), _tendon(found), _contact(found), _patella(found), _arm(found),
        _ligaments(found), _tibia(found), _shear(found),
    )  # fmt: skip


def _at(found: RaisedLeg, values: np.ndarray, flexion: float) -> float:
    return float(values[int(np.argmin(np.abs(found.leg.flexion_deg - flexion)))])


def _between(found: RaisedLeg, values: np.ndarray, low: float, high: float) -> np.ndarray:
    x = found.leg.flexion_deg
    return values[(x >= low) & (x <= high)]


def _curve(found: RaisedLeg, values: np.ndarray, form: str) -> str:
    rows = zip(found.leg.flexion_deg[::3], values[::3], found.held[::3], strict=True)
    return ", ".join(f"{x:g}: {y:{form}}" if on else f"{x:g}: none" for x, y, on in rows)


def _pull(found: RaisedLeg) -> Claim:
    pull = np.maximum(found.leg.quadriceps_N, 0.0)
    middle = _between(found, pull, 20.0, 60.0)
    steady = middle.max() / middle.min() - 1.0
    gone = _at(found, pull, 90.0) < NONE * middle.mean()
    holds = bool(steady < STEADY and gone and pull.argmax() == 0)
    why = [] if steady < STEADY else [
        f"from 20 to 60 degrees it falls by {1.0 - middle.min() / middle.max():.0%}, with "
        "the moment of the leg, which halves there; the arm does not fall along with it. " + _OTHER
    ]  # fmt: skip
    return Claim(
        "3.6",
        "The quadriceps force that holds the leg is largest at full extension, about constant from "
        "20 to 60 degrees and none at 90.",
        f"Largest at 0 degrees; between 20 and 60 degrees largest over least below {1 + STEADY:g}; "
        f"at 90 degrees below {NONE:.0%} of that.",
        "280 N at full extension; relatively constant from 20 to 60; decreases to zero at 90 (6.1, "
        "Figure 12)",
        "N at degrees: " + _curve(found, pull, ".0f"),
        judged(holds),
        "; ".join(why),
    )


def _tendon(found: RaisedLeg) -> Claim:
    leg = found.leg
    ratio = np.where(found.held, leg.tendon_N / leg.quadriceps_N, np.nan)
    peak = float(leg.flexion_deg[np.nanargmax(ratio)])
    start, falls = _at(found, ratio, 0.0), np.diff(ratio[leg.flexion_deg >= 30.0])
    falls = bool((falls[np.isfinite(falls)] < 0.0).all())
    holds = start > 1.0 and 10.0 <= peak <= 30.0 and falls
    return Claim(
        "3.7",
        "Tendon over quadriceps force is above 1 at full extension, largest near 20 degrees and "
        "falls beyond 30.",
        "Above 1 at 0 degrees; its largest value between 10 and 30; falling at every step from 30.",
        "begins above unity, increases slightly to about 20 degrees, then decreases (7.1, Fig. 16)",
        _curve(found, ratio, ".2f"),
        judged(holds),
        "" if holds else f"largest at {peak:g} degrees, {start:.2f} at 0; {_OTHER}",
    )


def _contact(found: RaisedLeg) -> Claim:
    leg = found.leg
    ratio = np.where(found.held, leg.patellofemoral_N / leg.quadriceps_N, np.nan)
    last = float(ratio[np.flatnonzero(found.held)[-1]])
    grows = bool((np.diff(ratio[found.held]) > 0.0).all())
    holds = 0.4 <= ratio[0] <= 0.6 and 1.0 <= last <= 1.2 and grows
    return Claim(
        "3.8",
        "Patellofemoral contact over quadriceps force grows from 0.5 at full extension to slightly "
        "above 1.0 at 90 degrees.",
        "Between 0.4 and 0.6 at 0 degrees, between 1.0 and 1.2 at the last flexion at which the "
        "quadriceps pulls, growing at every step.",
        "around 0.5 to slightly higher than 1.0 (7.1, Figure 17)",
        _curve(found, ratio, ".2f"),
        judged(holds),
        "" if holds else _OTHER,
    )


def _patella(found: RaisedLeg) -> Claim:
    flexion = found.leg.patella[:, 0]
    last, knee = _at(found, flexion, 90.0), found.leg.flexion_deg
    lags = bool((np.diff(flexion) < np.diff(knee)).mean() >= 0.8)
    holds = lags and 60.0 <= last <= 70.0
    return Claim(
        "3.9",
        "Patellar flexion lags behind knee flexion and is about 65 degrees at 90.",
        "It grows by less than the knee's flexion in four of five steps, and is between 60 and 70 "
        "degrees at 90.",
        "peak values of patellar flexion are around 65 degrees (6.2, Figure 14)",
        ", ".join(f"{x:g}: {y:.0f}" for x, y in zip(knee[::3], flexion[::3], strict=True)),
        judged(holds),
        ""
        if holds
        else f"{last:.0f} degrees at 90, counted in this person's axes, in which the "
        f"patella of the record, passive, comes to 72; {_OTHER}",
    )


def _arm(found: RaisedLeg) -> Claim:
    arm = np.where(found.held, found.leg.arm_mm, np.nan)
    peak = int(np.nanargmax(arm))
    at, size = float(found.leg.flexion_deg[peak]), float(arm[peak])
    holds = 25.0 <= at <= 45.0 and 45.0 <= size <= 55.0
    return Claim(
        "3.10",
        "The moment arm of the extensor mechanism is bell-shaped over flexion, about 50 mm at its "
        "peak near 35 degrees.",
        "Its largest value between 45 and 55 mm lies between 25 and 45 degrees. Ours is that of "
        "virtual work; the paper's the distance of the tendon from the screw axis.",
        "peaks at about 35 degrees, around 50 mm, least at 90 (6.3, Figure 15; printed in cm)",
        "mm at degrees: " + _curve(found, found.leg.arm_mm, ".0f"),
        judged(holds),
        "" if holds else f"bell-shaped, but {size:.0f} mm at {at:g} degrees; {_OTHER}",
    )


def _ligaments(found: RaisedLeg) -> Claim:
    x, on = found.leg.flexion_deg, found.held
    acl, pcl = (found.tension[name] > BEARS_N for name in ("ACL", "PCL"))
    first = x[on & pcl].min() if (on & pcl).any() else np.inf
    holds = bool(acl[x <= 55.0].all() and 45.0 <= first <= 65.0)
    return Claim(
        "3.11",
        "In the leg raise the ACL is loaded from 0 to 60 degrees, the PCL from about 55 up.",
        f"ACL above {BEARS_N:g} N at every flexion up to 55 degrees; PCL for the first time "
        "between 45 and 65 degrees.",
        "ACL loaded near full extension and to 60, PCL begins at 55 (7.2, Figure 18)",
        f"ACL {_curve(found, found.tension['ACL'], '.0f')}; PCL "
        f"{_curve(found, found.tension['PCL'], '.0f')} N",
        judged(holds),
        ""
        if holds
        else f"attachments are another person's; its PCL begins to bear at {first:g} degrees",
    )


def _tibia(found: RaisedLeg) -> Claim:
    table = np.asarray(found.leg.tibia.to_table())
    moved = table - table[0]
    inwards, forwards = moved[found.held, 2].max(), moved[found.held, 3].max()
    varus = np.abs(moved[found.held, 1]).max()
    holds = bool(10.0 <= inwards <= 25.0 and 4.0 <= forwards <= 10.0 and varus < 5.0)
    return Claim(
        "3.12",
        "With flexion the tibia turns inwards by up to 20 degrees and moves forwards by about 7 "
        "mm; varus and valgus stay below 5 degrees.",
        "From where it is in extension: inwards at most by 10 to 25 degrees, forwards by 4 to 10 "
        "mm, varus and valgus below 5 degrees.",
        "as much as 20 degrees, around 7 mm, below 5 degrees (6.2, Figure 13)",
        f"inwards by {inwards:.0f} degrees, forwards by {forwards:.1f} mm, varus or valgus "
        f"{varus:.1f} degrees",
        judged(holds),
        ""
        if holds
        else "axes, attachments and articular surfaces are another person's; twelve "
        "straight bundles hold rotation loosely in flexion (3.5)",
    )


def _shear(found: RaisedLeg) -> Claim:
    total = np.abs(sum(found.shear.values()))
    size = max(np.abs(part).max() for part in found.shear.values())
    tendon = _at(found, found.shear["patellar tendon"], 0.0)
    holds = bool(total.max() < ZERO * size and tendon > 0.0)
    return Claim(
        "3.13",
        "Forces along the anterior axis of the tibia sum to zero; near extension the tendon pulls "
        "the tibia forwards.",
        f"Their sum is below {ZERO:g} of the largest; the tendon's part at 0 degrees is positive.",
        "adding all the curves together will give zero (7.3, Figure 19)",
        f"sum at most {total.max():.1e} N of {size:.0f} N; tendon {tendon:.0f} N at 0 degrees",
        judged(holds),
    )
