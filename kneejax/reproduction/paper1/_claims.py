"""Claims of paper 1's section 3 against a computed knee, each with a criterion that can fail.

Coordinates are those of the paper's Eq 1, the femur in the tibia. An effect is the range of a
coordinate over the values of a sweep, at one flexion; poses that are not balanced, not stable or
not physiological do not count. The paper's claims are read off figures: where it says "no
influence", less than a tenth of the largest effect is asked for here; where it says "most", the
largest mean over flexion.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import Calibration, ParameterMap, Sweep, Sweeps, in_convention
from kneejax.reproduction._claims import CANNOT_BE_JUDGED, Claim, judged

#: The paper's coordinates: position and rotation of the femur in the tibia.
CONVENTION = "femur-in-tibia"
LIGAMENTS = ("ACL", "PCL", "MCL", "LCL")
#: Displacements as the paper names them.
_DISPLACEMENTS = {
    "lateral": "medial-lateral",
    "anterior": "anterior-posterior",
    "superior": "distal-proximal",
}
_ROTATIONS = ("adduction", "internal_rotation")
#: Part of the largest effect that counts as none, and as almost none.
_NONE, _ALMOST = 0.1, 0.2
#: Weights of the paper: a degree counts as much as 2.8 mm.
_MM_PER_DEGREE = np.sqrt(8.0)
#: Where motion stays physiological, by claim 1.8: ligament -> reference strains.
_PHYSIOLOGICAL = {"PCL": (-0.2, -0.05), "MCL": (0.0, 0.1), "LCL": (-0.05, 0.2)}


@dataclasses.dataclass(frozen=True)
class Paper1Study:
    """What the claims are judged by.

    Attributes:
        sweeps: of every stiffness and reference strain, from the values of Table 1, in the
            paper's coordinates (`as_paper1_sees`).
        measured: the motion to be reached, `(n, 6)`, likewise.
        weights: of the objective, `(5,)`.
        cruciates: objective over the stiffnesses of ACL and PCL.
        own: ligament -> objective over its stiffness (x) and reference strain (y).
        calibration: by the procedures I, II and III, each gone through once.
    """

    sweeps: Sweeps
    measured: np.ndarray
    weights: np.ndarray
    cruciates: ParameterMap
    own: dict[str, ParameterMap]
    calibration: Calibration


def paper1_claims(found: Paper1Study) -> tuple[Claim, ...]:
    """Judge the claims of paper 1.

    Args:
        found: sweeps, maps and calibrations of a knee with its four ligaments.

    Returns:
        One claim per statement of its sections 3.1 to 3.4, in that order.
    """
    claims: tuple[Callable[[Paper1Study], Claim], ...] = (
        _acl_stiffness, _pcl_stiffness, _collateral_stiffness, _superior_least, _saturation,
        _strain_before_stiffness, _cruciate_strains, _unphysiological, _valleys, _pcl_before_acl,
        _not_alone, _procedures, _table_2, _table_3,
    )  # fmt: skip
    return tuple(claim(found) for claim in claims)


def as_paper1_sees(sweeps: Sweeps) -> Sweeps:
    """The same sweeps in the coordinates of the femur in the tibia (paper 1, Eq 1)."""
    flexion = sweeps.flexion_deg
    seen = [
        dataclasses.replace(one, table=in_convention(one.table, flexion, CONVENTION))
        for one in sweeps.sweeps
    ]
    own = in_convention(sweeps.table, flexion, CONVENTION)
    return dataclasses.replace(sweeps, table=own, sweeps=tuple(seen))


def effect(sweep: Sweep) -> np.ndarray:
    """Range of each coordinate over the sound values of a sweep, `(stations, 5)`, degrees, mm."""
    table = np.where(sweep.sound[..., None], sweep.table, np.nan)
    known = np.isfinite(table).any(axis=0)
    low = np.min(np.where(np.isfinite(table), table, np.inf), axis=0)
    high = np.max(np.where(np.isfinite(table), table, -np.inf), axis=0)
    return np.where(known, np.where(known, high, 0.0) - np.where(known, low, 0.0), np.nan)


def _effect(found: Paper1Study, name: str, coordinate: str) -> np.ndarray:
    return effect(found.sweeps[name])[:, FREE_COORDINATES.index(coordinate)]


def _mean(found: Paper1Study, name: str, coordinate: str) -> float:
    return float(np.nanmean(_effect(found, name, coordinate)))


def _displacements(found: Paper1Study, name: str) -> dict[str, float]:
    return {c: _mean(found, name, c) for c in _DISPLACEMENTS}


def _outside(found: Paper1Study, name: str, coordinate: str, where: np.ndarray) -> float:
    """Mean effect at some flexions, relative to the largest at the others."""
    own = _effect(found, name, coordinate)
    return float(np.nanmean(own[where]) / np.nanmax(own[~where]))


def _words(means: dict[str, float], unit: str = "mm") -> str:
    return ", ".join(
        f"{_DISPLACEMENTS.get(c, c.replace('_', ' '))} {v:.2f} {unit}" for c, v in means.items()
    )


def _acl_stiffness(found: Paper1Study) -> Claim:
    beyond = _outside(found, "ACL.stiffness", "anterior", found.sweeps.flexion_deg > 40.0)
    means = _displacements(found, "ACL.stiffness")
    most = max(means, key=means.__getitem__) == "anterior"
    return Claim(
        "1.1",
        "ACL stiffness acts from 0 to about 40 degrees, most on anterior-posterior displacement.",
        "Its mean effect on anterior-posterior displacement above 40 degrees is below a tenth of "
        "the largest one up to there; of the displacements that one has the largest mean effect.",
        "0 to about 40 degrees; biggest on anterior-posterior (3.1)",
        f"{beyond:.1%} above 40 degrees; {_words(means)}",
        judged(beyond < _NONE and most),
        _which(("up to 40 degrees", beyond < _NONE), ("most on anterior-posterior", most))
        + _acting(found, "ACL", beyond < _NONE),
    )


def _pcl_stiffness(found: Paper1Study) -> Claim:
    shares = {
        c: _outside(found, "PCL.stiffness", c, found.sweeps.flexion_deg < 60.0)
        for c in ("anterior", "lateral")
    }
    means = _displacements(found, "PCL.stiffness")
    least = min(means, key=means.__getitem__) == "superior"
    return Claim(
        "1.2",
        "PCL stiffness acts from about 60 degrees, most on anterior-posterior and medial-lateral "
        "displacement.",
        "Its mean effects on both below 60 degrees are below a tenth of the largest from there on; "
        "both have larger mean effects than distal-proximal displacement.",
        "starts at about 60 degrees (3.1)",
        f"below 60 degrees {max(shares.values()):.1%} at most; {_words(means)}",
        judged(max(shares.values()) < _NONE and least),
        _which(("from 60 degrees", max(shares.values()) < _NONE), ("displacements", least)),
    )


def _collateral_stiffness(found: Paper1Study) -> Claim:
    most = [_displacements(found, f"{name}.stiffness") for name in ("MCL", "LCL")]
    turns = {name: [_mean(found, f"{name}.stiffness", c) for c in _ROTATIONS] for name in LIGAMENTS}
    lateral = all(max(means, key=means.__getitem__) == "lateral" for means in most)
    cruciate = np.max([turns["ACL"], turns["PCL"]], axis=0)
    rotations = all((np.array(turns[name]) > cruciate).all() for name in ("MCL", "LCL"))
    shown = "; ".join(
        f"{name} {turns[name][0]:.2f}/{turns[name][1]:.2f} degrees" for name in LIGAMENTS
    )
    return Claim(
        "1.3",
        "MCL and LCL stiffness act most on medial-lateral displacement and on both rotations.",
        "Of the displacements medial-lateral has the largest mean effect for both; on adduction "
        "and on internal rotation both have larger mean effects than ACL and PCL stiffness.",
        "dominant on medial-lateral displacement and both Cardan angles (3.1)",
        f"MCL: {_words(most[0])}; LCL: {_words(most[1])}; adduction/internal rotation: {shown}",
        judged(lateral and rotations),
        _which(("medial-lateral", lateral), ("rotations", rotations)),
    )


def _superior_least(found: Paper1Study) -> Claim:
    means = {name: _displacements(found, f"{name}.stiffness") for name in LIGAMENTS}
    least = {name: min(m, key=m.__getitem__) == "superior" for name, m in means.items()}
    return Claim(
        "1.4",
        "Distal-proximal displacement is the least sensitive to every ligament's stiffness.",
        "For each of the four, it has the smallest mean effect of the displacements.",
        "lowest sensitivity in all figures (3.1)",
        "; ".join(f"{name}: {_words(m)}" for name, m in means.items()),
        judged(all(least.values())),
        _which(*least.items()),
    )


def _saturation(found: Paper1Study) -> Claim:
    shares = {}
    for name in LIGAMENTS:
        one = found.sweeps[f"{name}.stiffness"]
        high = one.values >= 4000.0
        above = dataclasses.replace(
            one,
            values=one.values[high],
            table=one.table[high],
            status=one.status[high],
            unphysiological=one.unphysiological[high],
        )
        columns = [FREE_COORDINATES.index(c) for c in _DISPLACEMENTS]
        part, whole = (np.nanmean(effect(x)[:, columns]) for x in (above, one))
        shares[name] = float(part / whole)
    return Claim(
        "1.5",
        "Above about 4000 N stiffness has almost no influence on displacements.",
        "For each ligament, the mean effect on the three displacements of values from 4000 to "
        "9300 N is below a fifth of that of the whole sweep from 300 N.",
        "significant up to about 4000 N only (3.1)",
        ", ".join(f"{name} {share:.0%}" for name, share in shares.items()),
        judged(max(shares.values()) < _ALMOST),
        _which(*((name, share < _ALMOST) for name, share in shares.items())),
    )


def _weight(found: Paper1Study, name: str) -> float:
    """Mean effect on all coordinates, mm, a degree counting as much as in the objective."""
    units = np.array([_MM_PER_DEGREE if c in _ROTATIONS else 1.0 for c in FREE_COORDINATES])
    return float(np.sqrt(np.nanmean(np.nansum((effect(found.sweeps[name]) * units) ** 2, axis=1))))


def _strain_before_stiffness(found: Paper1Study) -> Claim:
    pairs = {
        name: (_weight(found, f"{name}.reference_strain"), _weight(found, f"{name}.stiffness"))
        for name in LIGAMENTS
    }
    return Claim(
        "1.6",
        "Reference strain acts more than stiffness, for every ligament.",
        "For each, the root mean square effect over all coordinates (a degree counts 2.8 mm, as in "
        "the objective) of -0.2 to 0.2 is larger than that of 300 to 9300 N.",
        "more sensitive to the zero-load lengths of all ligaments (3.2)",
        ", ".join(f"{name} {a:.1f} against {b:.1f} mm" for name, (a, b) in pairs.items()),
        judged(all(a > b for a, b in pairs.values())),
    )


def _cruciate_strains(found: Paper1Study) -> Claim:
    name, flexion = "ACL.reference_strain", found.sweeps.flexion_deg
    weakest = {}
    for c in ("lateral", "anterior", *_ROTATIONS):
        own = _effect(found, name, c)
        weakest[c] = float(np.nanmin(own) / np.nanmax(own))
    means = _displacements(found, name)
    whole = min(weakest.values()) > _NONE
    least = min(means, key=means.__getitem__) == "superior"
    below = {
        c: _outside(found, "PCL.reference_strain", c, flexion < 40.0)
        for c in ("anterior", "lateral")
    }
    late = max(below.values()) < _ALMOST
    return Claim(
        "1.7",
        "ACL reference strain acts over the whole range, except on distal-proximal displacement; "
        "that of the PCL above 40 degrees.",
        "ACL: at every flexion its effect on each other coordinate is above a tenth of its "
        "largest, and distal-proximal has the smallest mean effect of the displacements. PCL: the "
        "mean effects on anterior-posterior and medial-lateral displacement below 40 degrees are "
        "below a fifth of the largest from there on.",
        "whole flexion range; significant above 40 degrees (3.2)",
        f"ACL weakest at {min(weakest.values()):.0%} of the largest "
        f"({min(weakest, key=weakest.__getitem__).replace('_', ' ')}); {_words(means)}; "
        f"PCL below 40 degrees {max(below.values()):.0%} at most",
        judged(whole and least and late),
        _which(("ACL over the whole range", whole), ("distal-proximal", least), ("PCL late", late)),
    )


def _unphysiological(found: Paper1Study) -> Claim:
    inside, outside, parts = [], [], []
    for name, (low, high) in _PHYSIOLOGICAL.items():
        one = found.sweeps[f"{name}.reference_strain"]
        sound = np.asarray(one.sound.all(axis=1))
        within = (one.values >= low - 1e-9) & (one.values <= high + 1e-9)
        inside.append(bool(sound[within].all()))
        outside.append(bool((~sound[~within]).mean() > 0.5) if (~within).any() else True)
        limits = one.values[sound]
        span = f"{limits.min():.3f} to {limits.max():.3f}" if limits.size else "nowhere"
        parts.append(f"{name} sound {span}, {(~sound[~within]).mean():.0%} unsound outside")
    return Claim(
        "1.8",
        "Outside reference strains of PCL -0.2 to -0.05, MCL 0.0 to 0.1 and LCL above -0.05 the "
        "motion turns unphysiological.",
        "Within each interval every pose is balanced, stable and within 10 degrees of adduction, "
        "20 of internal rotation and 15 mm of the knee's own motion; outside, more than half of "
        "the values have a pose that is not.",
        "small ranges (3.2)",
        "; ".join(parts),
        judged(all(inside) and all(outside)),
        "this knee keeps a reasonable motion over wider ranges" if not all(outside) else "",
    )


def _valleys(found: Paper1Study) -> Claim:
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
        "a soft ligament needs more strain for the same tension. " + _which(*straight.items()),
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


def _pcl_before_acl(found: Paper1Study) -> Claim:
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
        _which(*((c.replace("_", " "), r > 2.0) for c, r in ratios.items()))
        + _acting(found, "ACL", min(ratios.values()) > 2.0),
    )


def _not_alone(found: Paper1Study) -> Claim:
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


def _procedures(found: Paper1Study) -> Claim:
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
        _which(("fewer evaluations", fewer), ("same parameters", near))
        + (
            "; with exact Jacobians all eight at once cost no more, and a two-step search that "
            "stops after one cycle stops on the way"
            if not (fewer and near)
            else ""
        ),
    )


def _table_2(found: Paper1Study) -> Claim:
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


def _table_3(found: Paper1Study) -> Claim:
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


def _acting(found: Paper1Study, ligament: str, fine: bool) -> str:
    """At how many flexions a ligament's stiffness matters on this knee; empty if all is fine."""
    if fine:
        return ""
    own = _effect(found, f"{ligament}.stiffness", "anterior")
    part = float(np.mean(own > _NONE * np.nanmax(own)))
    return (
        f"; the {ligament} of this knee, a single line between mean attachments, holds it at "
        f"{part:.0%} of all flexions"
    )


def _which(*parts: tuple[str, bool]) -> str:
    """What holds and what does not; empty if all holds."""
    if all(holds for _, holds in parts):
        return ""
    missing = [name for name, holds in parts if not holds]
    holding = [name for name, holds in parts if holds]
    return f"not: {', '.join(missing)}" + (f"; holds: {', '.join(holding)}" if holding else "")
