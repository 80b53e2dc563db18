"""How often do 95 % intervals hold the truth? Paper 1's twin experiment, many draws of noise.

    python benchmarks/coverage.py --draws 200 --out coverage.json
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import jax
import numpy as np

jax.config.update("jax_enable_x64", True)

import kneejax as kj  # noqa: E402
from kneejax.files import bundled_path, read_study  # noqa: E402
from kneejax.inference import synthetic_motion, versions  # noqa: E402


def main() -> None:
    """Fit every draw, count how often each truth lies within 1.96 standard errors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--noise", type=float, default=0.1, help="mm and degrees")
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args()
    study = read_study(bundled_path("studies", "paper1"))
    knee = kj.load_knee(study.knee)
    truth = dict(study.synthetic.parameters)
    clean = synthetic_motion(knee, truth, study.synthetic.flexion_deg, study.parameters)
    scores, evaluations = [], []
    for draw in range(arguments.draws):
        noise = np.random.default_rng(draw).standard_normal((len(clean), 5))
        measured = clean + arguments.noise * np.column_stack([np.zeros(len(clean)), noise])
        # An estimate that stops on a bound has no error bar: the bounds are out of the way.
        wide = {"stiffness": (300.0, 30000.0)}
        fit = kj.calibrate(knee, measured, study.parameters, bounds=wide, procedures=("III",)).fit
        scores.append([(e.value - truth[e.name]) / e.standard_error for e in fit.estimates])
        evaluations.append(fit.evaluations["residual"])
    names = [e.name for e in fit.estimates]
    scores = np.array(scores)
    inside = np.abs(scores) < 1.96
    for name, column, score in zip(names, inside.T, scores.T, strict=True):
        print(f"{name:22} {column.mean():6.1%}   mean z {np.nanmean(score):6.2f}")
    print(f"all {inside.mean():.1%}, median evaluations {np.median(evaluations):.0f}")
    if arguments.out:
        answer = {
            "draws": arguments.draws,
            "coverage": dict(zip(names, inside.mean(axis=0).tolist(), strict=True)),
            "overall": float(inside.mean()),
            "versions": versions(),
        }
        arguments.out.write_text(json.dumps(answer, indent=1))


if __name__ == "__main__":
    main()
