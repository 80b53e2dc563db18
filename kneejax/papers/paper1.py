"""Paper 1: sweeps, maps and two-step identification of stiffness and reference strain.

Its section 3, on a knee of four lines. Coordinates are those of the paper's Eq 1, the femur in the
tibia.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from functools import partial

import numpy as np

from kneejax.files import InputProblem, load_knee
from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import (
    Calibration,
    ParameterMap,
    Sweep,
    Sweeps,
    in_convention,
    sensitivity_maps,
    sweep,
)
from kneejax.papers.claims import Claim, Finding, Stages, answered, in_words, judged, silent, which
from kneejax.papers.patella_on_path import on_path
from kneejax.report.look import Answer, Table
from kneejax.studies import calibrate, read_study

#: The paper's protocol, a knee of four lines that moves as measured knees do, and its ligaments.
STUDY, KNEE, LIGAMENTS = "paper1", "four_ligament_fitted", ("ACL", "PCL", "MCL", "LCL")
#: The paper's coordinates: position and rotation of the femur in the tibia.
CONVENTION = "femur-in-tibia"
_GRID, _VALUES = (61, 61), 37
#: `--patella`, the default first: on what the weight pulls, in words.
_PATELLAS = {
    "on-path": "The 2 kg pull on a patella that rides on its path, as in the paper.",
    "balanced": "The 2 kg pull on a patella that is in balance in its groove, as a third bone.",
    "none": "A line of constant tension stands for the patella on which 2 kg pull.",
}
#: Displacements as the paper names them.
_DISPLACEMENTS = {"lateral": "medial-lateral", "anterior": "anterior-posterior",
                  "superior": "distal-proximal"}  # fmt: skip
_ROTATIONS = ("adduction", "internal_rotation")
#: Parts of the largest effect that count as none and as almost none.
NONE, _ALMOST = 0.1, 0.2
#: What a unit of each coordinate counts in mm by the paper's weights: a degree as much as 2.8 mm.
_UNITS = np.array([np.sqrt(8.0) if c in _ROTATIONS else 1.0 for c in FREE_COORDINATES])
#: Table 2: procedure or its step -> steps of the pattern search, model calls (Simpack).
TABLE_2 = {
    "I": (53, 167), "I.1": (31, 98), "I.2": (22, 69),
    "II": (52, 159), "II.1": (22, 65), "II.2": (30, 94), "III": (84, 233),
}  # fmt: skip
#: Where motion stays physiological, by claim 1.8: ligament -> reference strains.
_PHYSIOLOGICAL = {"PCL": (-0.2, -0.05), "MCL": (0.0, 0.1), "LCL": (-0.05, 0.2)}


@dataclasses.dataclass(frozen=True)
class Paper1Study:
    """What the claims are judged by."""

    sweeps: Sweeps  # of each stiffness and reference strain from Table 1, in its coordinates
    measured: np.ndarray  # the motion to be reached, `(n, 6)`, likewise
    weights: np.ndarray  # of the objective, `(5,)`
    cruciates: ParameterMap  # objective over the stiffnesses of ACL and PCL
    own: dict[str, ParameterMap]  # ligament -> objective over its stiffness (x) and strain (y)
    calibration: Calibration  # by the procedures I, II and III, each gone through once

    def effect(self, name: str, coordinate: str) -> np.ndarray:
        """Effect of one parameter on one coordinate, `(flexions,)`, degrees or mm."""
        return effect(self.sweeps[name])[:, FREE_COORDINATES.index(coordinate)]

    def means(self, name: str, coordinates: Iterable[str] = _DISPLACEMENTS) -> dict[str, float]:
        """Mean effect of a parameter on each displacement, mm, or on other coordinates."""
        return {c: float(np.nanmean(self.effect(name, c))) for c in coordinates}

    def outside(self, name: str, where: np.ndarray, *coordinates: str) -> float:
        """Mean effect at some flexions by the largest at the others; the largest of coordinates."""
        effects = [self.effect(name, c) for c in coordinates]
        return max(float(np.nanmean(x[where]) / np.nanmax(x[~where])) for x in effects)


def reproduce(
    stages: Stages = silent, knee: str | None = None, patella: str | None = None
) -> Answer:
    """Sweep, map and calibrate, and judge the claims."""
    from kneejax.report import map_figure, message, sweep_figure

    name, patella = knee or KNEE, patella or next(iter(_PATELLAS))
    start = load_knee(name)
    if set(start.ligaments.names) != set(LIGAMENTS):
        given = f"{name} with {len(start.ligaments.names)} ligaments"
        raise InputProblem("--knee", "knee", given, f"those of paper 1: {', '.join(LIGAMENTS)}")
    if patella != "none":
        whole = load_knee(name, patella=True)
        start = whole if patella == "balanced" else on_path(start, whole)
    names = [f"{name}.{q}" for q in ("stiffness", "reference_strain") for name in LIGAMENTS]
    study = read_study(STUDY).replace(knee=start, parameters=names)
    calibration = calibrate(study)
    start, measured = study.knee_at_start, calibration.measured
    flexion = measured[:, 0]
    with stages("sweeps") as show:
        shown = partial(show, "sweeps")
        swept = sweep(start, study.parameters, flexion, count=_VALUES, progress=shown)
    pairs = [(f"{name}.stiffness", f"{name}.reference_strain") for name in LIGAMENTS]
    with stages("maps") as show:
        *own, cruciates = sensitivity_maps(
            start, measured, [*pairs, ("ACL.stiffness", "PCL.stiffness")], grid=_GRID,
            bounds=study.bounds, weights=study.first_weights, convention=CONVENTION,
            progress=partial(show, "maps"),
        )  # fmt: skip

    def seen(one):
        table = in_convention(one.table, swept.flexion_deg, CONVENTION)
        return dataclasses.replace(one, table=table)

    swept = seen(dataclasses.replace(swept, sweeps=tuple(map(seen, swept.sweeps))))
    measured = np.c_[flexion, in_convention(measured[:, 1:], flexion, CONVENTION)]
    maps = dict(zip(LIGAMENTS, own, strict=True))
    found = Paper1Study(swept, measured, study.first_weights, cruciates, maps, calibration)
    doubts = [f"Procedure {x.procedure}: {message(x)}." for x in calibration.fits if not x.success]
    if (swept.status > 0).any():
        doubts.insert(0, "The knee's own motion is not balanced, stable and on fitted surfaces.")
    caption = "As Figure {} of the paper: {} over its range, the others by Table 1."
    figures = {
        name.replace(".", "-"): (sweep_figure(swept, name, measured), caption.format(k, name))
        for k, name in enumerate((one.name for one in swept.sweeps), 3)
    }
    drawn = {"PCL": maps["PCL"], "LCL": maps["LCL"], "ACL-PCL": cruciates}
    figures |= {f"map-{name}": map_figure(one) for name, one in drawn.items()}
    settings = {"study": STUDY, "knee": study.knee.name, "patella": patella, "grid": [*_GRID],
                "values_of_a_sweep": _VALUES}  # fmt: skip
    noise = study.synthetic.noise_mm if study.synthetic else 0.0
    words = {"knee": study.knee.name, "patella": _PATELLAS[patella], "noise": noise}
    columns = "procedure", "evaluations", "published_search_steps", "published_model_calls"
    counts = [
        [name, fit.evaluations["residual" if name == fit.procedure else name], *published]
        for fit in calibration.fits
        for name, published in TABLE_2.items()
        if name.split(".")[0] == fit.procedure
    ]
    tables = {"evaluations": Table(columns, counts)}
    return answered(1, claims(found), figures, tables, settings, doubts, words)


def effect(sweep: Sweep, least: float = -np.inf) -> np.ndarray:
    """Range of each coordinate over the sound values of a sweep, `(flexions, 5)`, degrees, mm.

    Values below the `least` do not count.
    """
    counted = sweep.sound & (sweep.values >= least)[:, None]
    known = counted[..., None] & np.isfinite(sweep.table)
    low = np.where(known, sweep.table, np.inf).min(axis=0)
    high = np.where(known, sweep.table, -np.inf).max(axis=0)
    return np.where(known.any(axis=0), high - low, np.nan)


def claims(found: Paper1Study) -> tuple[Claim, ...]:
    """Judge the claims of sections 3.1 to 3.4."""
    findings = _stiffness(found) | _reference_strain(found) | _maps(found) | _procedures(found)
    return judged(1, findings)


def _stiffness(found: Paper1Study) -> dict[str, Finding]:
    """Claims 1.1 to 1.5, section 3.1."""
    flexion = found.sweeps.flexion_deg
    means = {name: found.means(f"{name}.stiffness") for name in LIGAMENTS}
    beyond = found.outside("ACL.stiffness", flexion > 40.0, "anterior")
    most = _largest(means["ACL"]) == "anterior"
    before = found.outside("PCL.stiffness", flexion < 60.0, "anterior", "lateral")
    least = {name: _largest(one, -1.0) == "superior" for name, one in means.items()}
    turns = {name: (*found.means(f"{name}.stiffness", _ROTATIONS).values(),) for name in LIGAMENTS}
    lateral = all(_largest(means[name]) == "lateral" for name in ("MCL", "LCL"))
    collateral = np.minimum(turns["MCL"], turns["LCL"])
    rotations = bool((collateral > np.maximum(turns["ACL"], turns["PCL"])).all())
    shown = in_words(turns, "{} {:.2f}/{:.2f} degrees", "; ")
    effects = {name: _displacements(one) for name, one in means.items()}
    # Mean effect on displacements of stiffness above 4000 N, as a share of the whole sweep's.
    columns, late = [FREE_COORDINATES.index(c) for c in _DISPLACEMENTS], {}
    for name in LIGAMENTS:
        one = found.sweeps[f"{name}.stiffness"]
        part, whole = (np.nanmean(effect(one, x)[:, columns]) for x in (4000.0, -np.inf))
        late[name] = float(part / whole)
    return {
        "1.1": Finding({"up to 40 degrees": beyond < NONE, "most on anterior-posterior": most},
                       f"{beyond:.1%} above 40 degrees; {effects['ACL']}",
                       "" if beyond < NONE else _acting(found)),
        "1.2": Finding({"from 60 degrees": before < NONE, "displacements": least["PCL"]},
                       f"below 60 degrees {before:.1%} at most; {effects['PCL']}"),
        "1.3": Finding(
            {"medial-lateral": lateral, "rotations": rotations},
            f"MCL: {effects['MCL']}; LCL: {effects['LCL']}; adduction/internal rotation: {shown}",
        ),
        "1.4": Finding(least, in_words(effects, "{}: {}", "; ")),
        "1.5": Finding({name: share < _ALMOST for name, share in late.items()},
                       in_words(late, "{} {:.0%}")),
    }


def _reference_strain(found: Paper1Study) -> dict[str, Finding]:
    """Claims 1.6 to 1.8, section 3.2."""
    flexion, acl = found.sweeps.flexion_deg, "ACL.reference_strain"

    def size(name: str) -> float:
        """Root mean square effect on all coordinates, mm, a degree counting as in the objective."""
        squares = np.nansum((effect(found.sweeps[name]) * _UNITS) ** 2, axis=1)
        return float(np.sqrt(np.nanmean(squares)))

    sizes = {name: (size(f"{name}.reference_strain"), size(f"{name}.stiffness"))
             for name in LIGAMENTS}  # fmt: skip
    weakest = {}
    for c in ("lateral", "anterior", *_ROTATIONS):
        own = found.effect(acl, c)
        weakest[c] = float(np.nanmin(own) / np.nanmax(own))
    means, low = found.means(acl), _largest(weakest, -1.0)
    below = found.outside("PCL.reference_strain", flexion < 40.0, "anterior", "lateral")
    inside, outside, parts = [], [], []
    for name, limits in _PHYSIOLOGICAL.items():
        one = found.sweeps[f"{name}.reference_strain"]
        sound = np.asarray(one.sound.all(axis=1))
        within = (one.values >= limits[0] - 1e-9) & (one.values <= limits[1] + 1e-9)
        lost = (~sound[~within]).mean()
        inside.append(bool(sound[within].all()))
        outside.append(bool(lost > 0.5) if (~within).any() else True)
        kept = one.values[sound]
        span = f"{kept.min():.3f} to {kept.max():.3f}" if kept.size else "nowhere"
        parts.append(f"{name} sound {span}, {lost:.0%} unsound outside")
    return {
        "1.6": Finding(all(strain > stiffness for strain, stiffness in sizes.values()),
                       in_words(sizes, "{} {:.1f} against {:.1f} mm")),
        "1.7": Finding(
            {"ACL over the whole range": weakest[low] > NONE,
             "distal-proximal": _largest(means, -1.0) == "superior", "PCL late": below < _ALMOST},
            f"ACL weakest at {weakest[low]:.0%} of the largest ({low.replace('_', ' ')}); "
            f"{_displacements(means)}; PCL below 40 degrees {below:.0%} at most",
        ),
        "1.8": Finding(all(inside) and all(outside),
                       "; ".join(parts), "" if all(outside) else None),
    }  # fmt: skip


def valley(one: ParameterMap) -> tuple[float, float]:
    """Tilt of the lowest tenth of a map against its x axis, degrees, and its length over width."""
    values = np.where(one.drawn, one.objective, np.inf)
    level = np.quantile(values[np.isfinite(values)], 0.1)
    rows, columns = np.nonzero(values <= level)
    points = np.column_stack([columns / (one.x.size - 1), rows / (one.y.size - 1)])
    size, axes = np.linalg.eigh(np.cov(points.T))
    along = np.abs(axes[:, 1])
    return float(np.degrees(np.arctan2(along[1], along[0]))), float(np.sqrt(size[1] / size[0]))


def _maps(found: Paper1Study) -> dict[str, Finding]:
    """Claims 1.9 to 1.11, sections 3.1 to 3.3."""
    valleys = {name: valley(one) for name, one in found.own.items()}
    straight = {name: tilt < 15.0 and length > 3.0 for name, (tilt, length) in valleys.items()}
    one = found.cruciates
    partial_objectives = np.where(one.drawn, one.partial_objectives, np.nan)
    spans = [np.nanmedian(np.ptp(partial_objectives, axis=axis), axis=-1) for axis in (-1, -2)]
    acl, pcl = spans if one.names[0].startswith("ACL") else spans[::-1]
    names = [c.replace("_", " ") for c in FREE_COORDINATES]
    ratios = dict(zip(names, pcl / acl, strict=True))
    more = {name: ratio > 2.0 for name, ratio in ratios.items()}
    rows, best = np.searchsorted(found.sweeps.flexion_deg, found.measured[:, 0]), {}
    for each in found.sweeps.sweeps:
        table = np.where(each.sound[..., None], each.table, np.nan)[:, rows]
        squares = ((table - found.measured[:, 1:]) ** 2).sum(axis=1) @ found.weights
        best[each.name] = float(np.nanmin(squares))
    together = min(fit.objective for fit in found.calibration.fits)
    lowest = _largest(best, -1.0)
    return {
        "1.9": Finding(all(straight.values()),
                       in_words(valleys, "{} {:.0f} degrees, {:.1f} times"),
                       numbers={"parts": which(straight)}),
        "1.10": Finding(more,
                        in_words(ratios, "{} {:.1f} times"),
                        "" if all(more.values()) else _acting(found)),
        "1.11": Finding(
            best[lowest] > 10.0 * together,
            f"lowest alone: {best[lowest]:.4g} by {lowest}; all together {together:.4g}",
        ),
    }  # fmt: skip


def _procedures(found: Paper1Study) -> dict[str, Finding]:
    """Claims 1.12 to 1.14, section 3.4 and Tables 2 and 3."""
    fits = {fit.procedure: fit for fit in found.calibration.fits}
    count = {p: fits[p].evaluations["residual"] for p in ("I", "II", "III")}
    fewer = max(count["I"], count["II"]) < count["III"]
    values = {p: np.array([e.value for e in fits[p].estimates]) for p in fits}
    widths = np.array([e.upper - e.lower for e in fits["III"].estimates])
    apart = {p: float(np.max(np.abs(values[p] - values["III"]) / widths)) for p in ("I", "II")}
    near = max(apart.values()) < 0.1
    counts = in_words(count, "{} {}")
    objectives = in_words({p: fits[p].objective for p in count}, "{} {:.4g}")
    truth = found.calibration.truth
    answer = [e for e in found.calibration.fit.estimates if e.name in truth]
    covered = sum(not (truth[e.name] < e.low or truth[e.name] > e.high) for e in answer)
    return {
        "1.12": Finding(
            {"fewer evaluations": fewer, "same parameters": near},
            f"evaluations {counts}; farthest parameter I {apart['I']:.0%}, II {apart['II']:.0%} of "
            f"its width; objectives {objectives}",
            "" if fewer and near else "; with exact Jacobians all eight at once cost no more, and "
            "a two-step search that stops after one cycle stops on the way",
        ),
        "1.13": Finding(None, f"evaluations with exact Jacobian: {counts}"),
        "1.14": Finding(
            None,
            in_words({e.name: e.value for e in fits["III"].estimates}, "{} {:.4g}", "; ")
            + f"; {covered} of {len(answer)} 95 % limits hold what made the data",
        ),
    }  # fmt: skip


def _largest(numbers: Mapping[str, float], sign: float = 1.0) -> str:
    """Name of the largest number, of the smallest with a negative sign."""
    return max(numbers, key=lambda name: sign * numbers[name])


def _displacements(means: Mapping[str, float]) -> str:
    return in_words({_DISPLACEMENTS[c]: value for c, value in means.items()}, "{} {:.2f} mm")


def _acting(found: Paper1Study) -> str:
    """At how many flexions the stiffness of this knee's ACL matters."""
    own = found.effect("ACL.stiffness", "anterior")
    part = float(np.mean(own > NONE * np.nanmax(own)))
    return f"; the ACL of this knee, a single line, holds it at {part:.0%} of all flexions"
