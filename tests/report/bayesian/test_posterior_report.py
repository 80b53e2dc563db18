"""Figures and words of a posterior that is made up: nothing is sampled here."""

import dataclasses

import numpy as np
import pytest

from kneejax.inference import Posterior, Prior
from kneejax.report.identification import (
    posterior_doubts,
    posterior_drawings,
    posterior_section,
)
from kneejax.report.identification_figures import predictive_figure

NAMES = ("ACL.stiffness", "MCL.reference_strain", "LCL.femoral_attachment.superior",
         "offset.internal_rotation")  # fmt: skip


def made_up(divergences=2, truth=True):
    rng = np.random.default_rng(0)
    centre, deviation = np.array([5000.0, 0.02, 21.0, 0.3]), np.array([400.0, 0.002, 1.0, 0.1])
    correlation = np.eye(4) + 0.6 * (np.eye(4, k=1) + np.eye(4, k=-1))
    covariance = correlation * np.outer(deviation, deviation)
    draws = rng.multivariate_normal(centre, covariance, (4, 200))
    flexion = np.arange(0.0, 91.0, 10.0)
    shape = np.sin(np.deg2rad(flexion))[:, None] * np.array([2.0, -8.0, 3.0, 1.0, 0.5])
    motions = shape + 0.05 * rng.standard_normal((4, 50, 1, 5))
    levels = (0.025, 0.25, 0.5, 0.75, 0.975)
    bands = np.quantile(motions.reshape(-1, 10, 5), levels, axis=0).T
    wide = bands + 0.1 * np.array([-2.0, -0.7, 0.0, 0.7, 2.0])
    divergent = np.zeros((4, 200), bool)
    divergent[0, :divergences] = True
    return Posterior(
        names=NAMES,
        units=("N", "", "mm", "deg"),
        draws=draws,
        log_density=np.zeros((4, 200)),
        r_hat=np.array([1.001, 1.002, 1.0, 1.03]),
        effective_sample_size=np.array([700.0, 650.0, 800.0, 120.0]),
        tail_effective_sample_size=np.array([500.0, 450.0, 600.0, 90.0]),
        divergent=divergent,
        unbalanced=1 if divergences else 0,
        measured=np.column_stack([flexion, shape + 0.1 * rng.standard_normal(shape.shape)]),
        noise=np.full(5, 0.1),
        motions=motions,
        levels=levels,
        motion_quantiles=bands,
        predictive_quantiles=wide,
        priors=(
            Prior(NAMES[0], 4500.0, 1350.0, 300.0, 6000.0),
            Prior(NAMES[1], 0.03, 0.02, -0.2, 0.2),
            Prior(NAMES[2], 21.0, np.inf, 11.0, 31.0),
            Prior(NAMES[3], 0.0, 5.0, -10.0, 10.0),
        ),
        laplace_mean=centre,
        laplace_covariance=covariance,
        truth={"ACL.stiffness": 5300.0} if truth else {},
        acceptance=0.81,
        evaluations={"warmup": 100, "sampling": 1000, "equilibria": 11000},
        seconds={"total": 31.0, "compile": 12.0},
        versions={},
        settings={
            "chains": 4,
            "draws": 200,
            "warmup": 75,
            "seed": 0,
            "noise_mm": 0.1,
            "noise_deg": 0.1,
        },  # fmt: skip
    )


def test_the_summary_is_plain_and_narrow():
    text = posterior_section(made_up()).terminal()
    assert text.isascii() and max(map(len, text.splitlines())) < 100
    assert "4 chains of 200 draws" in text and "2 divergent" in text
    assert any("chains disagree about offset.int" in one for one in posterior_doubts(made_up()))
    row = next(line for line in text.splitlines() if line.startswith("ACL.stiffness"))
    assert row.split()[1] == "N" and row.split()[-2:] == ["1.001", "700"]


def test_rows_hold_what_the_columns_promise():
    found = made_up()
    (table,) = posterior_section(found).tables
    rows, (medians,) = table.records(), found.quantiles((0.5,)).T
    assert [row["name"] for row in rows] == list(NAMES)
    names = ["name", "unit", "mean", "sd", "quantile_025", "quantile_975", "laplace_sd", "r_hat",
             "effective_sample_size"]  # fmt: skip
    assert all([*row] == names for row in rows)
    for row, median in zip(rows, medians, strict=True):
        assert row["quantile_025"] < median < row["quantile_975"]
        assert row["quantile_025"] < row["mean"] < row["quantile_975"]
    assert rows[0]["laplace_sd"] == pytest.approx(400.0)


def posterior_figures(found):
    return {name: one.draw() for name, one in posterior_drawings(found).items()}


def words(figure):
    return {text.get_text() for legend in figure.legends for text in legend.get_texts()}


def test_figures_show_truth_bounds_and_divergences_where_there_are_any():
    figures = posterior_figures(made_up())
    assert set(figures) == {"posterior", "posterior_pairs", "predictive"}
    assert {"posterior", "prior", "truth", "outside the bounds"} <= words(figures["posterior"])
    assert {"divergent", "truth"} <= words(figures["posterior_pairs"])
    calm = posterior_figures(made_up(divergences=0, truth=False))
    assert not {"divergent", "truth"} & words(calm["posterior_pairs"])
    assert "truth" not in words(calm["posterior"])


def test_a_posterior_that_laplace_does_not_know_is_drawn_without_it():
    lost = dataclasses.replace(made_up(), laplace_covariance=np.full((4, 4), np.nan))
    figures = posterior_figures(lost)
    assert "normal approximation" not in words(figures["posterior"])
    assert "normal approximation, 95 %" not in words(figures["posterior_pairs"])
    assert max(map(len, posterior_section(lost).terminal().splitlines())) < 100


def test_the_motion_is_drawn_in_the_order_of_flexion():
    found = made_up()
    mixed = np.array([3, 1, 0, 2, 9, 4, 8, 5, 7, 6])
    shuffled = dataclasses.replace(
        found,
        measured=found.measured[mixed],
        motion_quantiles=found.motion_quantiles[:, mixed],
        predictive_quantiles=found.predictive_quantiles[:, mixed],
    )
    first, second = (predictive_figure(each).axes for each in (found, shuffled))
    for one, other in zip(first, second, strict=True):
        assert np.array_equal(one.lines[0].get_xydata(), other.lines[0].get_xydata())


def test_every_trouble_has_its_sentence():
    said = posterior_doubts(made_up())
    assert [sentence.split(":")[0][:40] for sentence in said] == [
        "1 of 800 trajectories ran into parameter",
        "1 of 800 trajectories diverged",
        "The chains disagree about offset.interna",
        "Fewer than 400 effective draws of offset",
    ]
    calm = dataclasses.replace(
        made_up(divergences=0), r_hat=np.ones(4), effective_sample_size=np.full(4, 500.0),
        tail_effective_sample_size=np.full(4, 500.0),
    )  # fmt: skip
    assert posterior_doubts(calm) == []
    narrow = Prior(NAMES[1], 0.02, 0.002, -0.2, 0.2)
    idle = dataclasses.replace(calm, priors=(calm.priors[0], narrow, *calm.priors[2:]))
    assert posterior_doubts(idle)[0].startswith("These data say little about MCL.reference_strain:")
    few = dataclasses.replace(calm, measured=np.zeros((0, 6)))
    assert posterior_doubts(few)[0].startswith("0 measured numbers for 4 parameters")
