"""Sobol and Morris indices against closed forms, by the path that knees take too."""

import sys

import numpy as np
import pytest

from kneejax.experiments import passive_flexion
from kneejax.inference import global_indices, motion_indices
from kneejax.parameters import UnknownParameter, UnsuitableData

pytest.importorskip("SALib")

NAMES = ("a", "b", "c")
CUBE = ([-np.pi] * 3, [np.pi] * 3)
WEIGHTS = np.array([2.0, -3.0, 0.5])


def ishigami(x):
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def closed_form():
    """First and total order indices (Ishigami and Homma 1990, a = 7, b = 0.1)."""
    a, b = 7.0, 0.1
    alone = np.array([0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8, 0.0])
    both = b**2 * np.pi**8 * (1 / 18 - 1 / 50)
    total = alone + both * np.array([1, 0, 1])
    return alone / (alone.sum() + both), total / (alone.sum() + both)


def test_the_closed_forms_themselves():
    first, total = closed_form()
    np.testing.assert_allclose(first, [0.3139, 0.4424, 0.0], atol=5e-5)
    np.testing.assert_allclose(total, [0.5576, 0.4424, 0.2437], atol=5e-5)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_sobol_indices_of_ishigamis_function(seed):
    """Within the 95 % intervals, which at 4,096 points are narrower than 0.05."""
    found = global_indices(ishigami, NAMES, *CUBE, samples=4096, seed=seed)
    for measure, exact in zip(("first_order", "total_order"), closed_form(), strict=True):
        half = found.half_widths[measure][0]
        assert half.max() < 0.05
        assert (np.abs(found.measures[measure][0] - exact) < half).all()
    assert (found.runs, found.failed, found.left_out) == (4096 * 5, 0, 0)
    assert found.treatment == "" and not found.doubtful


def test_intervals_shrink_with_the_root_of_the_samples(slope_on_log_axes):
    sizes = [256, 1024, 4096]
    found = [global_indices(ishigami, NAMES, *CUBE, samples=n) for n in sizes]
    widths = [one.half_widths["total_order"].mean() for one in found]
    assert slope_on_log_axes(sizes, widths) == pytest.approx(-0.5, abs=0.1)


def test_of_a_sum_each_part_has_its_share():
    lower, upper = np.array([-1.0, 0.0, 5.0]), np.array([1.0, 4.0, 6.0])
    variance = (WEIGHTS * (upper - lower)) ** 2
    found = global_indices(lambda x: x @ WEIGHTS, NAMES, lower, upper, samples=1024)
    for measure in ("first_order", "total_order"):
        error = np.abs(found.measures[measure][0] - variance / variance.sum())
        assert (error < found.half_widths[measure][0]).all()


def test_morris_effects_of_a_line_are_exact():
    lower, upper = np.array([-1.0, 0.0, 5.0]), np.array([1.0, 4.0, 6.0])
    found = global_indices(
        lambda x: x @ WEIGHTS, NAMES, lower, upper, method="morris", samples=8
    )  # fmt: skip
    effects = WEIGHTS * (upper - lower)
    np.testing.assert_allclose(found.measures["mu"][0], effects, rtol=1e-13)
    np.testing.assert_allclose(found.measures["mu_star"][0], np.abs(effects), rtol=1e-13)
    np.testing.assert_allclose(found.measures["sigma"][0], 0.0, atol=1e-13)
    np.testing.assert_allclose(found.half_widths["mu_star"][0], 0.0, atol=1e-13)
    assert found.runs == 8 * 4


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_a_seed_decides_everything_and_zero_is_one(method):
    def indices(seed):
        found = global_indices(ishigami, NAMES, *CUBE, method=method, samples=32, seed=seed)
        return np.concatenate([*found.measures.values(), *found.half_widths.values()])

    # SALib takes a seed of 0 for none.
    np.testing.assert_array_equal(indices(0), indices(0))
    assert (indices(0) != indices(1)).any()


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_failed_runs_take_their_block_with_them_and_no_other(method):
    """A model that fails in a corner has the indices of the blocks that never go there."""
    seen = []

    def fails(x):
        seen.append(x)
        corner = (x > 0.7 * np.pi).all(axis=1)
        return np.where(corner, np.nan, ishigami(x))

    samples = 256
    found = global_indices(fails, NAMES, *CUBE, method=method, samples=samples)
    lost = (seen[0] > 0.7 * np.pi).all(axis=1)
    blocks = lost.reshape(samples, -1).any(axis=1)
    assert (found.failed, found.left_out) == (lost.sum(), blocks.sum())
    assert 0 < found.left_out <= 0.1 * samples and not found.doubtful
    assert f"{found.failed} of {found.runs} runs failed" in found.treatment
    assert "left out whole" in found.treatment
    main = next(iter(found.measures))
    whole = global_indices(ishigami, NAMES, *CUBE, method=method, samples=samples)
    assert np.isfinite(found.measures[main]).all()
    apart = np.abs(found.measures[main] - whole.measures[main])
    assert (apart < 2 * whole.half_widths[main]).all()


def test_many_failures_are_doubtful_and_all_leave_nothing():
    def mostly(x):
        return np.where(x[:, 0] > 2.0, np.nan, ishigami(x))

    found = global_indices(mostly, NAMES, *CUBE, samples=256)
    assert found.doubtful and found.treatment.endswith("narrow the ranges for a fair picture")
    found = global_indices(lambda x: np.full(len(x), np.nan), NAMES, *CUBE, samples=64)
    assert found.left_out == 64 and "too few are left" in found.treatment
    assert np.isnan(found.measures["total_order"]).all()


def test_an_output_that_does_not_vary_has_no_indices_and_others_have():
    def model(x):
        return np.column_stack([np.full(len(x), 3.0), ishigami(x)])

    found = global_indices(model, NAMES, *CUBE, samples=64, outputs=("still", "moving"))
    assert np.isnan(found.measures["total_order"][0]).all()
    assert np.isfinite(found.measures["total_order"][1]).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"method": "fast"}, "unknown method 'fast': expected one of sobol, morris"),
        ({"samples": 100}, "100 points.*expected a power of two, such as 128"),
        ({"samples": 16}, "16 points.*expected at least 32"),
        ({"samples": 2, "method": "morris"}, "2 trajectories: expected at least 4"),
        ({"upper": [np.pi, -4.0, np.pi]}, "b: range -3.14.* to -4: expected lower below upper"),
    ],
)
def test_what_cannot_be_computed_is_refused(change, words):
    asked = {"lower": CUBE[0], "upper": CUBE[1], **change}
    with pytest.raises(UnsuitableData, match=words):
        global_indices(ishigami, NAMES, **asked)


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_without_salib_one_line_says_what_to_install(monkeypatch, method):
    monkeypatch.setitem(sys.modules, f"SALib.analyze.{method}", None)
    with pytest.raises(UnsuitableData, match=r"SALib.*pip install 'kneejax\[sensitivity\]'"):
        global_indices(ishigami, NAMES, *CUBE, method=method, samples=64)


# A knee, by two parameters of which one is slack near extension.
KNEE_NAMES = ("ACL.reference_strain", "PCL.stiffness")


@pytest.fixture(scope="module")
def measured(knee):
    return np.array(passive_flexion(knee, [0.0, 20.0]).to_table())


@pytest.fixture(scope="module")
def found(knee, measured):
    return motion_indices(knee, KNEE_NAMES, measured, samples=64)


def test_a_slack_ligament_explains_nothing_of_a_motion(found):
    indices = found.indices
    assert found.flexion_deg == pytest.approx((0.0, 20.0))
    for row, one in enumerate(found.outputs):
        total = indices.measures["total_order"][row]
        assert total[1] < 1e-3, one.name
        assert abs(total[0] - 1.0) < indices.half_widths["total_order"][row, 0], one.name
    assert found.row("anterior", found.flexion_deg[0]) == 4
    assert found.outputs[found.row("")].name == "objective"


def test_usual_ranges_have_the_deviation_of_the_prior(found, knee):
    widths = (found.indices.upper - found.indices.lower) / np.sqrt(12.0)
    np.testing.assert_allclose(widths, [0.02, 0.3 * 3860.0], rtol=1e-12)


def test_stated_ranges_and_bounds_count(knee, measured):
    found = motion_indices(
        knee,
        KNEE_NAMES,
        measured,
        bounds={"stiffness": (3500.0, 4000.0), "slack_length": (5.0, 200.0)},
        ranges={"ACL.reference_strain": (0.01, 0.02)},
        method="morris",
        samples=4,
    ).indices
    np.testing.assert_allclose(found.lower, [0.01, 3500.0])
    np.testing.assert_allclose(found.upper, [0.02, 4000.0])


def test_a_frame_that_is_off_changes_nothing_where_its_offset_is_free(knee, measured):
    shifted = measured + np.array([0, 0, 0, 1.5, 0, 0])
    both = [
        motion_indices(knee, KNEE_NAMES, table, offsets=("anterior",), method="morris", samples=4)
        for table in (measured, shifted)
    ]
    for measure in ("mu_star", "sigma"):
        values = [one.indices.measures[measure] for one in both]
        np.testing.assert_allclose(*values, rtol=1e-9, atol=1e-12)


def test_angles_where_the_knee_itself_fails_are_left_out_and_named(knee, measured):
    backwards = measured[:1] - [60.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    table = np.concatenate([backwards, measured])
    found = motion_indices(knee, KNEE_NAMES, table, method="morris", samples=4)
    assert found.left_out_deg == pytest.approx((-60.0,))
    assert found.flexion_deg == pytest.approx((0.0, 20.0))


@pytest.mark.parametrize(
    ("names", "options", "kind", "words"),
    [
        (["ACL.stiffness"], {}, UnsuitableData, "1 free number: .*at least two"),
        (["ACL.stifness", "PCL.stiffness"], {}, UnknownParameter, "did you mean 'ACL.stiffness'"),
        (KNEE_NAMES, {"samples": 20}, UnsuitableData, "at least 32"),
        (KNEE_NAMES, {"ranges": {"PCL.stifness": (1, 2)}}, UnknownParameter, "'PCL.stiffness'"),
        (KNEE_NAMES, {"ranges": {"stiffness": (2.0, 1.0)}}, UnsuitableData, "lower below upper"),
        (KNEE_NAMES, {"priors": {"stiffness": 0.0}}, UnsuitableData, "prior of width 0"),
    ],
)
def test_bad_requests_are_refused_before_anything_is_computed(
    knee, measured, names, options, kind, words
):
    with pytest.raises(kind, match=words):
        motion_indices(knee, names, measured, **options)
