"""What paper 1's specimen must have been like: four lines whose cruciates are asked to be unloaded.

    python benchmarks/unloaded_cruciates.py --knee-out FOLDER/knee.yaml
    kneejax reproduce 1 --knee FOLDER/knee.yaml

The study `four_ligament_fitted` with one thing more: in passive flexion the ACL carries nothing
from 50 degrees on and the PCL nothing up to 50, give or take 1 N (paper 1's claims 1.1 and 1.2).
What that costs in motion and laxity, and what the ligaments carry with it and without.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import yaml
from _protocol import RESULTS, finish

import kneejax as kj
from kneejax.files import bundled_path
from kneejax.geometry import State
from kneejax.inference.fit import Observations, Problem, balances_of, fit_lanes
from kneejax.parameters import stated_bounds
from kneejax.statics import balance_with_slopes

kj.configure()
STUDY, ACL, PCL = "four_ligament_fitted", 0, 1
CARRIES_N, APART_DEG = 1.0, 50.0


@dataclasses.dataclass(frozen=True)
class Unloaded:
    """Load cases whose passive poses ask for tensions of zero, too."""

    cases: Observations
    tensions: Callable

    def take(self, rows) -> Unloaded:
        """The same of some fits."""
        return dataclasses.replace(self, cases=self.cases.take(rows))

    def residual(self, found):
        """Those of the cases, then tensions; and by the values."""
        residual, slope = self.cases.residual(found)
        passive = np.flatnonzero(self.cases.posed)
        own = found.values, found.q[:, passive], found.jacobian[:, passive]
        carried, by_values = self.tensions(*(jnp.asarray(x) for x in own))
        return np.hstack([residual, carried]), np.concatenate([slope, by_values], axis=1)


def asked_tensions(knee, selection, flexion):
    """Values, poses and their slopes -> tensions that are to vanish, in units of their spread."""
    chosen = [(ACL, k) for k in np.flatnonzero(flexion >= APART_DEG)]
    chosen += [(PCL, k) for k in np.flatnonzero(flexion <= APART_DEG)]
    angles = jnp.deg2rad(flexion)

    def tensions(values, q):
        ligaments = selection.apply(knee, values).ligaments
        every = jax.vmap(lambda a, pose: ligaments.tension(State.of({"flexion": a}, pose)))
        found = every(angles, q)
        return jnp.stack([found[k, line] / CARRIES_N for line, k in chosen])

    def with_slopes(values, q, slope):
        def moved(x):
            return tensions(x, q + jnp.einsum("kfp,p->kf", slope, x - values))

        return moved(values), jax.jacfwd(moved)(values)

    return jax.jit(jax.vmap(with_slopes))


def fitted(study, unloaded: bool, starts: int):
    """The best of several starts: the knee, and the objective without tensions."""
    knee, selection = study.knee_at_start, study.selection
    noise_mm, noise_deg = study.noise
    spread = np.array([noise_deg, noise_deg, noise_mm, noise_mm, noise_mm])
    weights = np.where(study.scatter.counted, spread**-2.0, 0.0)
    problem = Problem.of(
        knee, selection, study.measured, weights, study.frame_offset, study.acting, study.tests,
        spread,
    )  # fmt: skip
    lower, upper = stated_bounds(knee, selection, study.bounds)
    own = np.asarray(selection.read(knee))
    problem = problem.with_prior(np.r_[own, np.zeros(len(study.frame_offset))], study.prior)
    prior = tuple(part[: len(own)] for part in problem.cases.prior or ())
    cases = dataclasses.replace(problem.cases, offsets=problem.offsets, prior=prior)
    rng = np.random.default_rng(0)
    begin = np.vstack([own, own + prior[1] * rng.standard_normal((starts - 1, len(own)))])
    width = 1e-3 * (upper - lower)
    begin = np.clip(begin, lower + width, upper - width)
    data = cases
    if unloaded:
        data = Unloaded(cases, asked_tensions(knee, selection, study.flexion_deg))
    known = balance_with_slopes(knee, selection.apply, begin, cases.load_cases)
    box = (np.tile(bound, (starts, 1)) for bound in (lower, upper))
    balance = balances_of(knee, selection, cases.load_cases)
    found = fit_lanes(balance, data, known, begin, *box, most=80, far=True)
    best = int(np.argmin(found.chi2))
    residual, _ = cases.take(np.arange(1)).residual(found.slopes.take([best]))
    return selection.apply(knee, jnp.asarray(found.values[best])), float(residual[0] @ residual[0])


def write(knee, path: Path) -> None:
    """The bundled knee's file with these attachments."""
    document = yaml.safe_load(bundled_path("knees", "four_ligament").read_text())
    document["name"] = "unloaded_cruciates"
    for row, name in enumerate(knee.ligaments.names):
        for end in ("femoral", "tibial"):
            point = np.asarray(getattr(knee.ligaments, f"{end}_attachment"))[row]
            document["ligaments"][name][f"{end}_attachment_mm"] = np.round(point, 3).tolist()
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(yaml.safe_dump(document, sort_keys=False))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=RESULTS / "unloaded_cruciates.json")
    parser.add_argument("--knee-out", type=Path, help="where the knee is written to")
    parser.add_argument("--starts", type=int, default=8)
    options = parser.parse_args()
    study, rows = kj.read_study(STUDY), {}
    for said, unloaded in (("fitted", False), ("unloaded", True)):
        knee, objective = fitted(study, unloaded, options.starts)
        motion = kj.passive_flexion(knee, study.flexion_deg)
        turned = np.asarray(motion.to_table("grood-suntay"))[:, 2]
        published = np.asarray(study.measured)[:, 2]
        off = (turned - turned[0]) - (published - published[0])
        rows |= {
            f"{said}, objective without tensions": objective,
            f"{said}, rotation, rms error, degrees": float(np.sqrt(np.mean(off**2))),
        }
        for name in ("ACL", "PCL", "MCL", "LCL"):
            carried = np.asarray(motion.tension(name))
            rows[f"{said}, {name}, N"] = " ".join(f"{x:.0f}" for x in carried)
        if unloaded and options.knee_out:
            write(knee, options.knee_out)
    finish(options.out, "Four lines whose cruciates are asked to be unloaded", rows)


if __name__ == "__main__":
    main()
