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
from kneejax.reproduction._claims import Claim, judged
from kneejax.reproduction.paper1._claims_fitting import (
    not_alone,
    pcl_before_acl,
    procedures,
    table_2,
    table_3,
    valleys,
)
from kneejax.reproduction.paper1._study import (
    LIGAMENTS,
    NONE,
    Paper1Study,
    acting,
    effect,
    effect_of,
    which,
)

#: Displacements as the paper names them.
_DISPLACEMENTS = {
    "lateral": "medial-lateral",
    "anterior": "anterior-posterior",
    "superior": "distal-proximal",
}
_ROTATIONS = ("adduction", "internal_rotation")
#: Part of the largest effect that counts as almost none.
_ALMOST = 0.2
#: Weights of the paper: a degree counts as much as 2.8 mm.
_MM_PER_DEGREE = np.sqrt(8.0)
#: Where motion stays physiological, by claim 1.8: ligament -> reference strains.
_PHYSIOLOGICAL = {"PCL": (-0.2, -0.05), "MCL": (0.0, 0.1), "LCL": (-0.05, 0.2)}


def paper1_claims(found: Paper1Study) -> tuple[Claim, ...]:
    """Judge the claims of paper 1.

    Args:
        found: sweeps, maps and calibrations of a knee with its four ligaments.

    Returns:
        One claim per statement of its sections 3.1 to 3.4, in that order.
    """
    claims: tuple[Callable[[Paper1Study], Claim], ...] = (
        _acl_stiffness, _pcl_stiffness, _collateral_stiffness, _superior_least, _saturation,
        _strain_before_stiffness, _cruciate_strains, _unphysiological, valleys, pcl_before_acl,
        not_alone, procedures, table_2, table_3,
    )  # fmt: skip
    return tuple(claim(found) for claim in claims)


def _mean(found: Paper1Study, name: str, coordinate: str) -> float:
    return float(np.nanmean(effect_of(found, name, coordinate)))


def _displacements(found: Paper1Study, name: str) -> dict[str, float]:
    return {c: _mean(found, name, c) for c in _DISPLACEMENTS}


def _outside(found: Paper1Study, name: str, coordinate: str, where: np.ndarray) -> float:
    """Mean effect at some flexions, relative to the largest at the others."""
    own = effect_of(found, name, coordinate)
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
        judged(beyond < NONE and most),
        which(("up to 40 degrees", beyond < NONE), ("most on anterior-posterior", most))
        + acting(found, "ACL", beyond < NONE),
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
        judged(max(shares.values()) < NONE and least),
        which(("from 60 degrees", max(shares.values()) < NONE), ("displacements", least)),
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
        which(("medial-lateral", lateral), ("rotations", rotations)),
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
        which(*least.items()),
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
        which(*((name, share < _ALMOST) for name, share in shares.items())),
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
        own = effect_of(found, name, c)
        weakest[c] = float(np.nanmin(own) / np.nanmax(own))
    means = _displacements(found, name)
    whole = min(weakest.values()) > NONE
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
        which(("ACL over the whole range", whole), ("distal-proximal", least), ("PCL late", late)),
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
