"""How often do printed 95 % intervals of a calibration hold the truth, and how many are printed?

    python benchmarks/coverage.py [--draws 200] [--seed 0] [--designs twin "twelve poses" ...]

A motion, or a Lachman test without the ACL (paper 2, 4.2), is made with known parameters and noise
is drawn; each draw is calibrated from the knee's own values, as procedure III does, and its
intervals are those that `kneejax calibrate` prints: two limits, or one. All draws of a design are
fitted at once. A parameter that is not determined has no interval; its share is stated. With a
prior each draw has values of its own, drawn from it, and intervals must not be wider than the
prior's; an estimate outside its limits is counted. Of a test under load it is asked first which
parameters are identifiable at all: those with an interval when the curve itself, without noise in
it, is calibrated with the noise stated. Their intervals are counted by themselves.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import time
from pathlib import Path

import numpy as np
from _protocol import ANGLES, RESULTS, TRUTH, finish, load

import kneejax as kj
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.inference import Observations, balances_of, fit_lanes
from kneejax.inference.fit import Noise, observations
from kneejax.inference.fit._problem import add_offsets, best_offsets, with_offsets
from kneejax.inference.intervals._estimate import IntervalKind, estimate
from kneejax.inference.intervals._profiles import named
from kneejax.parameters import stated
from kneejax.statics import LoadCases

NAMES = ("*.stiffness", "*.reference_strain")
MRI = Path(__file__).parents[2] / (
    "shared/data/lenhart2015/measured/dynamic_mri_passive_knee_kinematics.csv"
)
COLLATERALS = ("aMCL", "iMCL", "pMCL", "aDMCL", "pDMCL", "LCL")
#: Added to the collaterals' strains for paper 2's patient, whose knee 100 N move by 8.0 mm
#: (`kneejax reproduce 2`).
PRESTRAIN = 0.125


@dataclasses.dataclass(frozen=True)
class Design:
    """What is measured, how well, within which bounds, and whether the noise is stated.

    Attributes:
        flexion_deg: of the poses.
        noise: standard deviation, mm and degrees alike.
        stiffness: bounds, N.
        strain: bounds of reference strains.
        stated: whether the study states the noise.
        offsets: constants between frames that are free.
        knee: whose parameters they are.
        names: of the parameters.
        added: to the reference strain of every bundle of `COLLATERALS`, from where calibrations
            begin; bounds of strains move with it.
        true: what the values there are changed by, up and down in turns; None for `TRUTH`.
        cut: what a Lachman test had cut; a passive motion without.
        prior: name or wildcard -> standard deviation of a prior around the knee's own value.
        laxity: whether drawer, torsion and varus-valgus were measured too.
    """

    flexion_deg: np.ndarray
    noise: float
    stiffness: tuple[float, float] = (300.0, 10000.0)
    strain: tuple[float, float] = (-0.2, 0.2)
    stated: bool = True
    offsets: tuple[str, ...] = ()
    knee: str = "four_ligament"
    names: tuple[str, ...] = NAMES
    added: float = 0.0
    true: float | None = None
    cut: tuple[str, ...] = ()
    prior: dict[str, float] = dataclasses.field(default_factory=dict)
    laxity: bool = False

    @property
    def at_once(self) -> int:
        """Draws that are fitted at once: bounds memory. More are faster: all wait for the
        slowest."""
        return 50 if self.laxity else 200

    @property
    def scatter(self) -> Noise:
        """The noise, as far as the study states it."""
        return Noise.of(self.noise, self.noise) if self.stated else Noise.of()

    def begin(self) -> kj.Knee:
        """The knee from whose values calibrations begin."""
        knee = load(self.knee)
        if not self.added:
            return knee
        strains = kj.select(knee, [f"{name}.reference_strain" for name in COLLATERALS])
        return strains.apply(knee, strains.read(knee) + self.added)

    def cases(self, knee: kj.Knee) -> Observations:
        """What is observed; its numbers are those of the knee without parameters of its own."""
        noise = self.scatter.first
        if self.laxity:
            tests = [
                dataclasses.replace(test, path=tuple(np.linspace(-1.0, 1.0, 11)))
                for name in ("drawer", "torsion", "varus-valgus")
                for test in kj.lab_tests(name, (0.0, 30.0, 60.0, 90.0))
            ]
            measured = [kj.MeasuredTest.of(one) for one in kj.load_curves(knee, tests)]
            passive = np.asarray(kj.passive_flexion(knee, self.flexion_deg).to_table())
            return observations(passive, noise, tests=measured)
        if not self.cut:
            load_cases = LoadCases.at(self.flexion_deg)
            return Observations(load_cases, np.zeros((len(load_cases), 5)), noise, self.offsets)
        (test,) = kj.lab_tests("lachman", self.flexion_deg, steps=11)
        (curves,) = kj.load_curves(kj.cut(knee, self.cut), test)
        measured = kj.MeasuredTest.of(curves, cut=self.cut, counted_from="unloaded")
        return observations(np.zeros((0, 6)), noise, tests=[measured])


def designs() -> dict[str, Design]:
    """Designs by name; that of the MRI only where its table is."""
    twelve = np.linspace(0.0, 110.0, 12)
    found = {
        "twin": Design(ANGLES, 0.1),
        "twin, noise estimated": Design(ANGLES, 0.1, stated=False),
        "twin, wide bounds": Design(ANGLES, 0.1, (100.0, 30000.0), (-0.4, 0.4)),
        "twin, narrow bounds": Design(ANGLES, 0.1, (2000.0, 9500.0), (-0.11, 0.08)),
        "twelve poses": Design(twelve, 0.2),
        "twelve poses, noise estimated": Design(twelve, 0.2, stated=False),
        "twelve poses, wide bounds": Design(twelve, 0.2, (100.0, 30000.0), (-0.4, 0.4)),
    }
    strains = tuple(f"{name}.reference_strain" for name in COLLATERALS)
    whole = ("MCL.reference_strain", "LCL.reference_strain")
    printed = Design(
        np.array([20.0]), 0.2, knee="ten_bundle", names=strains, true=0.01, cut=("aACL", "pACL")
    )
    found["priors on half"] = dataclasses.replace(
        found["twelve poses"], prior={"*.stiffness": 600.0}
    )
    found["laxity twin"] = Design(np.arange(0.0, 91.0, 15.0), 0.1, true=0.01, laxity=True)
    found["every fibre of an imported knee"] = dataclasses.replace(
        found["laxity twin"], knee="lenhart2015_reduced", stiffness=(300.0, 60000.0)
    )
    found["groups of an imported knee"] = dataclasses.replace(
        found["every fibre of an imported knee"],
        names=tuple(
            f"{name}.{quantity}"
            for quantity in ("stiffness", "reference_strain")
            for name in ("ACL", "PCL", "MCL", "LCL")
        ),
    )
    found["Lachman, ACL cut"] = printed
    # With the printed strains the knee is dislocated from half of the load on, and moves by 18 mm.
    patient = dataclasses.replace(printed, added=PRESTRAIN)
    found["Lachman of 8 mm, ACL cut"] = patient
    found["Lachman of 8 mm, MCL and LCL"] = dataclasses.replace(patient, names=whole)
    if MRI.exists():
        flexion = np.genfromtxt(MRI, delimiter=",", names=True)["knee_flex_deg"]
        # Every third of the 60 frames: what is not determined is slow to follow.
        found["MRI angles"] = Design(flexion[::3], 1.0, offsets=FREE_COORDINATES)
    return found


def intervals(knee, design: Design, draws: int, seed: int | None):
    """Fit all draws; for each its answer and how sure it is, and the names of the values. Without
    a seed there is no noise."""
    chosen, cases = kj.select(knee, design.names), design.cases(knee)
    start = np.asarray(chosen.read(knee))
    size = np.where(np.abs(start) > 1.0, 10.0 * np.abs(start), 1.0)
    truth = start + (design.true or 0.0) * size * (-1.0) ** np.arange(len(start))
    if design.true is None:
        truth = np.array([TRUTH[name] for name in chosen.names])
    strain = tuple(design.added + bound for bound in design.strain)
    bounds = [design.stiffness if ".stiffness" in name else strain for name in chosen.names]
    generator = np.random.default_rng(seed or 0)
    if design.prior:
        said = stated(chosen, design.prior, "prior")
        sd = np.array([np.inf if one is None else one for one in said])
        drawn = start + np.where(np.isinf(sd), 0.0, sd) * generator.standard_normal(
            (draws, len(sd))
        )
        truth = np.where(np.isinf(sd), truth, np.clip(drawn, *np.array(bounds).T))
        cases = dataclasses.replace(cases, prior=(start, sd))
    truth = np.broadcast_to(truth, (draws, len(start)))
    balance, made = balances_of(knee, chosen, cases), np.unique(truth, axis=0)
    exact, begin = balance(made), balance(start[None])
    lost = ~(begin.converged.all(axis=0) & exact.converged.all(axis=0))
    if lost.any():
        cases = dataclasses.replace(cases, used=~lost)
    row = np.array([np.flatnonzero((made == one).all(axis=1))[0] for one in truth])
    errors = np.zeros((draws, len(cases.load_cases), 5))
    if seed is not None:
        errors = generator.standard_normal(errors.shape)
    seen = np.where(cases.seen, 0.0, np.nan)
    target = cases.observed(exact)[0][row] + seen + design.noise * cases.spread * errors
    answers, found = [], []
    for first in range(0, draws, design.at_once):
        lot = target[first : first + design.at_once]
        some = _some(knee, chosen, design, cases, lot, begin, bounds)
        answers += list(some[0])
        found += some[1]
    values = dict(zip(chosen.names, truth.T, strict=True))
    return answers, found, values | {name: np.zeros(draws) for name in design.offsets}


def _some(knee, chosen, design: Design, cases, target, begin, bounds):
    count, offsets = len(target), design.offsets
    lower, upper = np.array(bounds).T
    tiles = [np.tile(x, (count, 1)) for x in (begin.values[0], lower, upper)]
    data = dataclasses.replace(cases, target=target)
    balance = balances_of(knee, chosen, data)
    fits = fit_lanes(balance, data, begin.take(np.zeros(count, int)), *tiles, most=200, far=True)
    shift = [best_offsets(data.take([k]), fits.slopes.take([k])) for k in range(count)]
    shifts = np.reshape(shift, (count, len(offsets)))
    answers = add_offsets(fits.slopes, shifts, offsets, data.posed)
    wide = np.full(len(offsets), 10.0)
    units = {c: n.rsplit("_", 1)[1] for c, n in zip(FREE_COORDINATES, COLUMNS[1:], strict=True)}
    sure = estimate(
        with_offsets(balances_of(knee, chosen, data), offsets, data.posed),
        dataclasses.replace(data, offsets=()),
        answers,
        design.scatter,
        np.r_[lower, -wide],
        np.r_[upper, wide],
        named(chosen) + [(name, units[name]) for name in offsets],
    )
    return np.array([one.best.values[0] for one in sure]), sure


def identifiable(knee, design: Design) -> tuple[str, ...]:
    """Parameters that have an interval where there is no noise in what was measured."""
    _, (found,), truth = intervals(knee, design, 1, None)
    told = (one.kind.has_limits for one in found.intervals)
    return tuple(itertools.compress(truth, told))


def coverage(answers, found, truth, asked: tuple[str, ...] = (), prior: float = np.inf):
    """Shares of kinds, and how often what is printed holds the truth; of those asked for by
    themselves too.

    Args:
        answers: values of each draw, `(draws, p)`.
        found: how sure each is.
        truth: name -> value in each draw, `(draws,)`.
        asked: names.
        prior: standard deviation of a prior of each value, `(p,)`.
    """
    true = np.array(list(truth.values())).T
    kinds = np.array([[one.kind.value for one in sure.intervals] for sure in found])
    low, high = (
        np.array([[getattr(one, field) for one in sure.intervals] for sure in found])
        for field in ("low", "high")
    )
    holds = ~((true < low) | (true > high))
    printed = np.isfinite(low) | np.isfinite(high)
    rows: dict[str, object] = {
        "printed": float(printed.mean()),
        "holds": _share(holds, printed),
        "wider than the prior": float((high - low > 2.0 * 1.96 * 1.0001 * prior).mean()),
    }
    for kind in IntervalKind:
        chosen = kinds == kind.value
        rows[f"share {kind.value}"] = float(chosen.mean())
        if kind.has_limits:
            rows[f"holds {kind.value}"] = _share(holds, chosen)
    for k, name in enumerate(truth):
        rows[f"holds {name}"] = _share(holds[:, k], printed[:, k])
        rows[f"printed {name}"] = float(printed[:, k].mean())
    if asked:
        own = np.isin(list(truth), asked)
        rows["identifiable"] = ", ".join(asked)
        rows["printed identifiable"] = float(printed[:, own].mean())
        rows["holds identifiable"] = _share(holds[:, own], printed[:, own])
        every = np.all(holds | ~printed, axis=1, where=own)
        rows["all identifiable held or not determined"] = float(every.mean())
    beside = (np.array(answers) < low) | (np.array(answers) > high)
    return rows | {"answer_outside_its_limits": float(beside.mean())}


def _share(holds: np.ndarray, chosen: np.ndarray) -> float:
    return float(holds[chosen].mean()) if chosen.any() else float("nan")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=RESULTS / "coverage.json")
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    known = designs()
    parser.add_argument("--designs", nargs="+", choices=list(known), default=list(known))
    options = parser.parse_args()
    rows = {}
    for name in options.designs:
        begun = time.perf_counter()
        design = known[name]
        knee = design.begin()
        asked = identifiable(knee, design) if design.cut else ()
        believed = np.full(len(kj.select(knee, design.names)) + len(design.offsets), np.inf)
        if design.prior:
            said = stated(kj.select(knee, design.names), design.prior, "prior")
            believed[: len(said)] = [np.inf if one is None else one for one in said]
        found = intervals(knee, design, options.draws, options.seed)
        found = coverage(*found, asked, believed)
        seconds = time.perf_counter() - begun
        rows |= {f"{name}: {key}": value for key, value in found.items()}
        rows |= {f"{name}: draws": options.draws, f"{name}: seconds": seconds}
        finish(options.out, "How often printed 95 % intervals hold the truth", rows)


if __name__ == "__main__":
    main()
