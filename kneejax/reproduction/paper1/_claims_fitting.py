"""Claims of paper 1 about maps of the objective and calibration (its sections 3.1, 3.3, 3.4)."""

from __future__ import annotations

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import ParameterMap
from kneejax.reproduction._claims import CANNOT_BE_JUDGED, Claim, judged
from kneejax.reproduction.paper1._study import Paper1Study, acting, which


def valleys(found: Paper1Study) -> Claim:
    """Claim 1.9: valleys of the objective lie along stiffness."""
    tilts, lengths = {}, {}
    for name, one in found.own.items():
        tilts[name], lengths[name] = valley(one)
    straight = {n: tilts[n] < 15.0 and lengths[n] > 3.0 for n in tilts}
    return Claim(
        "1.9",
        "Minimum valleys stretch along stiffness, parallel to its axis: stiffness and reference "
        "strain of a ligament are hardly coupled.",
        "For each ligament, of the lowest tenth of grid points (in units of the ranges) the long "
        "axis lies within 15 degrees of the stiffness axis and is more than three times the other.",
        "stretched in stiffness direction, mostly parallel to an axis (3.3)",
        ", ".join(f"{n} {tilts[n]:.0f} degrees, {lengths[n]:.1f} times" for n in tilts),
        judged(all(straight.values())),
        ""
        if all(straight.values())
        else "a valley of low stiffness bends towards high strains: "
        "a soft ligament needs more strain for the same tension. " + which(*straight.items()),
    )


def valley(one: ParameterMap) -> tuple[float, float]:
    """Tilt of the lowest tenth of a map against its x axis, degrees, and its length over width."""
    values = np.where(one.drawn, one.objective, np.inf)
    level = np.quantile(values[np.isfinite(values)], 0.1)
    rows, columns = np.nonzero(values <= level)
    points = np.column_stack([columns / (one.x.size - 1), rows / (one.y.size - 1)])
    size, axes = np.linalg.eigh(np.cov(points.T))
    along = np.abs(axes[:, 1])
    return float(np.degrees(np.arctan2(along[1], along[0]))), float(np.sqrt(size[1] / size[0]))


def pcl_before_acl(found: Paper1Study) -> Claim:
    """Claim 1.10: the partial objectives feel the PCL more than the ACL."""
    one = found.cruciates
    partial = np.where(one.drawn, one.partial_objectives, np.nan)
    spans = [np.nanmedian(np.ptp(partial, axis=axis), axis=-1) for axis in (-1, -2)]
    acl, pcl = spans if one.names[0].startswith("ACL") else spans[::-1]
    ratios = dict(zip(FREE_COORDINATES, pcl / acl, strict=True))
    return Claim(
        "1.10",
        "PCL stiffness acts much more on the partial objectives than ACL stiffness.",
        "On each of the five, the median range along PCL stiffness is more than twice that along "
        "ACL stiffness (300 to 10000 N).",
        "much higher (3.3, Figure 13)",
        ", ".join(f"{c.replace('_', ' ')} {r:.1f} times" for c, r in ratios.items()),
        judged(min(ratios.values()) > 2.0),
        which(*((c.replace("_", " "), r > 2.0) for c, r in ratios.items()))
        + acting(found, "ACL", min(ratios.values()) > 2.0),
    )


def not_alone(found: Paper1Study) -> Claim:
    """Claim 1.11: no single parameter reaches the measured motion."""
    rows = np.searchsorted(found.sweeps.flexion_deg, found.measured[:, 0])
    best = {}
    for one in found.sweeps.sweeps:
        table = np.where(one.sound[..., None], one.table, np.nan)[:, rows]
        squares = ((table - found.measured[:, 1:]) ** 2).sum(axis=1) @ found.weights
        best[one.name] = float(np.nanmin(squares))
    together = min(fit.objective for fit in found.calibration.fits)
    lowest = min(best, key=best.__getitem__)
    return Claim(
        "1.11",
        "The stiffness of no ligament alone, and the slack length of no ligament alone, reaches "
        "the measured motion.",
        "The lowest objective of every sweep is more than ten times that of the calibration of "
        "all eight parameters.",
        "congruence cannot be achieved (3.1, 3.2)",
        f"lowest alone: {best[lowest]:.4g} by {lowest}; all together {together:.4g}",
        judged(best[lowest] > 10.0 * together),
    )


def procedures(found: Paper1Study) -> Claim:
    """Claim 1.12: procedures I and II need fewer evaluations than III and end where it does."""
    fits = {fit.procedure: fit for fit in found.calibration.fits}
    count = {p: fits[p].evaluations["residual"] for p in ("I", "II", "III")}
    fewer = max(count["I"], count["II"]) < count["III"]
    values = {p: np.array([e.value for e in fits[p].estimates]) for p in fits}
    widths = np.array([e.upper - e.lower for e in fits["III"].estimates])
    apart = {p: float(np.max(np.abs(values[p] - values["III"]) / widths)) for p in ("I", "II")}
    near = max(apart.values()) < 0.1
    objectives = ", ".join(f"{p} {fits[p].objective:.4g}" for p in ("I", "II", "III"))
    return Claim(
        "1.12",
        "Two-step procedures need fewer evaluations than the single step; I, II and III end near "
        "the same parameters.",
        "Evaluations of I and of II, each gone through once, are below those of III; no parameter "
        "of I or II is farther from III than a tenth of its bounds' width.",
        "167, 159 and 233 model calls; the same values (Table 2, 3.4)",
        f"evaluations I {count['I']}, II {count['II']}, III {count['III']}; farthest parameter "
        f"I {apart['I']:.0%}, II {apart['II']:.0%} of its width; objectives {objectives}",
        judged(fewer and near),
        which(("fewer evaluations", fewer), ("same parameters", near))
        + (
            "; with exact Jacobians all eight at once cost no more, and a two-step search that "
            "stops after one cycle stops on the way"
            if not (fewer and near)
            else ""
        ),
    )


def table_2(found: Paper1Study) -> Claim:
    """Claim 1.13: how many steps and evaluations a search takes; cannot be judged."""
    count = {f.procedure: f.evaluations["residual"] for f in found.calibration.fits}
    return Claim(
        "1.13",
        "Numbers of pattern search steps and of model calls.",
        "None: another search, on other data.",
        "53/167, 52/159, 84/233 (Table 2)",
        "evaluations with exact Jacobian: "
        + ", ".join(f"{p} {count[p]}" for p in ("I", "II", "III")),
        CANNOT_BE_JUDGED,
        "pattern search takes no derivatives, and its measured motion was not published",
    )


def table_3(found: Paper1Study) -> Claim:
    """Claim 1.14: the parameters that were identified; cannot be judged."""
    fit = next(f for f in found.calibration.fits if f.procedure == "III")
    truth = found.calibration.truth
    answer = [e for e in found.calibration.fit.estimates if e.name in truth]
    inside = sum(not (truth[e.name] < e.low or truth[e.name] > e.high) for e in answer)
    return Claim(
        "1.14",
        "Identified stiffnesses and reference strains.",
        "None for the cadaver's motion, which was not published.",
        "k 5876, 2814, 8904, 7048 N; strains 0.037, -0.047, 0.023, 0.039 (Table 3)",
        "; ".join(f"{e.name} {e.value:.4g}" for e in fit.estimates)
        + f"; {inside} of {len(answer)} 95 % limits hold what made the data",
        CANNOT_BE_JUDGED,
        "the bundled study makes a motion with the printed values and recovers them: that tests "
        "the method, not the paper",
    )
