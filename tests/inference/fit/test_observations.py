"""Measured tests as data of a fit: read along the loads' axes, counted as laboratories count."""

import dataclasses

import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import CLINICAL, FREE_COORDINATES
from kneejax.inference.fit import Observations, Problem, fit_lanes
from kneejax.inference.fit._observed import _read, _read_all
from kneejax.parameters import UnsuitableData
from kneejax.statics import LoadCases

pytestmark = pytest.mark.usefixtures("optimised_code")

NAMES = ["ACL.stiffness", "ACL.reference_strain", "PCL.reference_strain", "MCL.reference_strain"]
NOISE = np.full(5, 0.1)
ANTERIOR = FREE_COORDINATES.index("anterior")


@pytest.fixture(scope="module")
def curves(knee):
    angles = [20.0, 60.0]
    tests = [
        test
        for name, size in (("drawer", {"force_N": 60.0}), ("varus-valgus", {"moment_Nm": 4.0}))
        for test in kj.lab_tests(name, angles, both=True, steps=2, **size)
    ]
    return kj.load_curves(knee, tests)


@pytest.fixture(scope="module")
def passive(knee):
    return np.asarray(kj.passive_flexion(knee, [0.0, 45.0]).to_table())


@pytest.fixture(scope="module")
def problem(knee, curves, passive):
    tests = [kj.MeasuredTest.of(one) for one in curves]
    return Problem.of(knee, kj.select(knee, NAMES), passive, NOISE**-2.0, tests=tests)


def recorded(one, counted_from, shift=0.0):
    """A drawer as a robot records it: whole poses at every step, zero load included."""
    table = np.asarray(one.to_table("grood-suntay"))
    path, flexion = np.asarray(one.test.path), np.asarray(one.test.flexion_deg)
    return kj.MeasuredTest(
        one.test.name,
        np.repeat(flexion, len(path)),
        {"anterior_N": np.tile(60.0 * path, len(flexion))},
        table.reshape(-1, 6)[:, 1:] + shift,
        counted_from,
    )


def test_a_knee_shows_no_residual_against_its_own_curves(knee, problem):
    start = np.asarray(problem.selection.read(knee))
    residual, _ = problem.residual(problem.begin(start[None]))
    assert np.abs(residual).max() < 1e-5


@pytest.mark.parametrize(
    ("counted_from", "shift"),
    [
        ("absolute", 0.0),
        ("least_load", 3.0),
        ("opposite", -2.0),
        ("offset", 5.0),
        ("offset_each_flexion", 5.0),
    ],
)
def test_whatever_a_robot_counts_from_its_own_knee_fits(knee, curves, passive, counted_from, shift):
    test = recorded(curves[0], counted_from, shift)
    chosen = kj.select(knee, NAMES)
    problem = Problem.of(knee, chosen, passive, NOISE**-2.0, tests=[test])
    found = problem.begin(np.asarray(chosen.read(knee))[None])
    residual, slope = problem.residual(found)
    assert np.abs(residual).max() < 1e-4
    assert np.abs(slope).max() > 1.0
    # A pose in another frame is another pose.
    if shift:
        other = dataclasses.replace(test, counted_from="absolute")
        moved = Problem.of(knee, chosen, passive, NOISE**-2.0, tests=[other])
        assert np.abs(moved.residual(found)[0]).max() > 10.0 * abs(shift) - 1.0


@pytest.mark.long
@pytest.mark.parametrize(
    "counted_from", ["unloaded", "least_load", "opposite", "offset", "offset_each_flexion"]
)
def test_residuals_have_exact_derivatives(knee, curves, passive, counted_from, central_difference):
    if counted_from == "unloaded":
        tests = [kj.MeasuredTest.of(one) for one in curves]
    else:
        tests = [recorded(curves[0], counted_from)]
    chosen = kj.select(knee, NAMES)
    problem = Problem.of(knee, chosen, passive, NOISE**-2.0, ("lateral",), tests=tests)
    start = np.r_[np.asarray(chosen.read(knee)), 0.5]
    begin = problem.begin(start[None])
    size = np.abs(start)
    _, slope = problem.residual(begin)

    def residual(x):
        return problem.residual(problem.balance((x * size)[None], begin))[0]

    assert slope * size == pytest.approx(
        central_difference(residual, start / size, 1e-4), rel=1e-6, abs=1e-4
    )


def test_offsets_between_frames_are_of_poses_alone(knee, curves, passive):
    chosen = kj.select(knee, NAMES)
    test = recorded(curves[0], "absolute")
    problem = Problem.of(knee, chosen, passive, NOISE**-2.0, ("lateral",), tests=[test])
    start = np.asarray(chosen.read(knee))
    still, moved = (problem.error(problem.begin(np.r_[start, x][None])) for x in (0.0, 0.7))
    assert (moved - still)[4, :2] == pytest.approx([0.7, 0.7])
    assert np.abs((moved - still)[:, 2:]).max() < 1e-9


def test_where_the_robots_zero_lies_does_not_matter(problem, knee):
    # A constant in the measured neutral changes both poses alike, so only differences count.
    cases = problem.cases
    start = np.asarray(problem.selection.read(knee))
    begin = problem.begin(start[None])
    moved = dataclasses.replace(begin, q=begin.q + [0.0, 0.0, 0.0, 0.0, 0.7])
    apart = (cases.residual(moved)[0] - cases.residual(begin)[0]).reshape(-1, 5)
    assert np.abs(apart[2:]).max() < 1e-9
    assert apart[:2, 4] == pytest.approx(np.full(2, 7.0))


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("counted_from", ["least_load", "offset_each_flexion"])
def test_differences_are_as_likely_as_the_noise_of_all_readings_makes_them(
    knee, curves, passive, counted_from, weighted
):
    """By the covariance of what is compared: readings counted from one share its error."""
    test = recorded(curves[0], counted_from)
    rng = np.random.default_rng(0)
    weight = rng.uniform(0.5, 4.0, len(test.flexion_deg)) if weighted else None
    sd = NOISE[0] / np.sqrt(np.ones(len(test.flexion_deg)) if weight is None else weight)
    off = sd[:, None] * rng.normal(size=test.observed.shape)
    noisy = dataclasses.replace(test, observed=test.observed + off, weight=weight)
    chosen = kj.select(knee, NAMES)
    problem = Problem.of(knee, chosen, passive, NOISE**-2.0, tests=[noisy])
    residual, _ = problem.residual(problem.begin(np.asarray(chosen.read(knee))[None]))
    found = np.sum(residual.reshape(-1, 5) ** 2, axis=0)
    expected = np.zeros(5)
    for flexion in np.unique(test.flexion_deg):
        rows = np.flatnonzero(test.flexion_deg == flexion)
        neutral = rows[test.loads["anterior_N"][rows] == 0.0][0]
        take = np.eye(len(test.flexion_deg))[rows[rows != neutral]]
        take[:, neutral] -= 1.0
        shared = take @ np.diag(sd**2) @ take.T
        apart = take @ off
        expected += np.einsum("ij,ij->j", apart, np.linalg.solve(shared, apart))
    assert found == pytest.approx(expected, rel=1e-4)


def test_a_twin_without_noise_comes_back(knee, problem):
    truth = np.asarray(problem.selection.read(knee))
    start = truth * 1.1
    wide = 0.5 * np.abs(truth)
    fits = fit_lanes(
        problem.balance, problem.cases, problem.begin(start[None]), start[None],
        (truth - wide)[None], (truth + wide)[None], far=True,
    )  # fmt: skip
    assert fits.values[0] == pytest.approx(truth, rel=1e-4)


def test_only_what_was_observed_is_counted(problem, curves):
    # Two poses of five numbers; one number a step, without the three steps of no load.
    steps = sum(len(one.test.flexion_deg) * (len(one.test.path) - 3) for one in curves)
    assert problem.cases.seen.sum() == 10 + steps
    assert problem.cases.taken.tolist() == [0] * 5


@pytest.mark.parametrize(("counted_from", "each"), [("offset", 1), ("offset_each_flexion", 2)])
def test_constants_that_are_taken_out_are_counted(knee, curves, passive, counted_from, each):
    tests = [recorded(curves[0], counted_from), kj.MeasuredTest.of(curves[1])]
    problem = Problem.of(knee, kj.select(knee, NAMES), passive, NOISE**-2.0, tests=tests)
    assert problem.cases.taken.tolist() == [each] * 5


def test_a_test_weighs_by_its_own_noise(knee, curves, passive):
    (one, *_) = curves
    chosen = kj.select(knee, NAMES)
    values = 1.05 * np.asarray(chosen.read(knee))
    residuals = []
    for sd in (None, 0.3):
        tests = [kj.MeasuredTest.of(one, sd_mm=sd)]
        problem = Problem.of(knee, chosen, passive, NOISE**-2.0, tests=tests, known=NOISE)
        residuals.append(problem.residual(problem.begin(values[None]))[0].reshape(-1, 5))
    usual, vague = residuals
    assert vague[2:, ANTERIOR] == pytest.approx(usual[2:, ANTERIOR] / 3.0)
    assert vague[:2] == pytest.approx(usual[:2])


def test_a_test_with_noise_of_its_own_needs_that_of_the_poses(knee, curves, passive):
    tests = [kj.MeasuredTest.of(curves[0], sd_mm=0.3)]
    with pytest.raises(UnsuitableData, match="drawer: sd_mm 0.3, but noise_mm is not stated"):
        Problem.of(
            knee, kj.select(knee, NAMES), passive, np.ones(5), tests=tests,
            known=np.full(5, np.nan),
        )  # fmt: skip


def test_what_is_read_in_the_packages_own_convention_is_what_was_found(knee, problem):
    start = np.asarray(problem.selection.read(knee))
    found = problem.begin(start[None])
    plain = Observations(LoadCases.at(np.zeros(len(found.q[0]))), np.zeros((1, 5)), NOISE)
    value, slope = plain.observed(found)
    assert value[0, 0, 0] == pytest.approx(np.rad2deg(found.q[0, 0, 0]))
    assert slope[0, 0, 2] == pytest.approx(found.jacobian[0, 0, 2])


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"observed": np.zeros((2, 4))}, r"observed: \(2, 4\); expected \(2, 5\)"),
        ({"loads": {}}, "loads: none; expected a load that is not zero"),
        ({"loads": {"anterior_force": [1.0, 2.0]}}, "loads: 'anterior_force'; expected of"),
        ({"counted_from": "zero"}, "counted_from: 'zero'; expected one of unloaded"),
        ({"counted_from": "least_load"}, "row 1: anterior_N 50 is the least load at 0 degrees"),
        ({"counted_from": "opposite"}, "row 1: anterior_N 50 at 0 degrees; expected a row under"),
        ({"observed": np.full((2, 5), np.nan)}, "observed: nothing"),
    ],
)
def test_a_test_that_cannot_be_read_is_refused(changes, said):
    given = {
        "name": "drawer", "flexion_deg": [0.0, 0.0], "loads": {"anterior_N": [50.0, 90.0]},
        "observed": np.ones((2, 5)),
    }  # fmt: skip
    with pytest.raises(ValueError, match=said):
        kj.MeasuredTest(**(given | changes))


def test_numbers_of_fits_share_what_reads_them():
    """Arms of profiles end one by one; a program for each number of fits took a second each."""
    shape, rng = (len(FREE_COORDINATES),), np.random.default_rng(3)
    flexion, q = np.deg2rad([10.0, 60.0]), 0.1 * rng.standard_normal((9, 2, *shape))
    whole = _read_all(flexion, q)
    programs = _read._cache_size()
    for fits in (8, 3, 1):
        for some, every in zip(_read_all(flexion, q[:fits]), whole, strict=True):
            np.testing.assert_array_equal(some, every[:fits])
    assert _read._cache_size() == programs


@pytest.mark.long
def test_a_device_strapped_to_the_shank_pushes_along_the_tibias_own_axes(knee):
    """Frames of cine-MRI: the force of a pad 350 mm down the shank, which swings at 0.5 Hz."""
    flexion = np.array([12.0, 25.0, 40.0, 30.0])
    force = 40.0 * np.sin(np.pi * np.array([0.1, 0.4, 0.7, 1.3]))
    nowhere, pad = np.zeros((4, 3)), np.tile([0.0, -350.0, 0.0], (4, 1))
    pushed = kj.Load(np.outer(force, [1.0, 0.0, 0.0]), nowhere, pad, axes="tibia")
    seen = np.asarray(kj.passive_flexion(knee, flexion, (pushed,)).to_table(CLINICAL))
    frames = kj.MeasuredTest("frames", flexion, {"anterior_N": force}, seen[:, 1:], "absolute",
                             point_mm=(0.0, -350.0, 0.0), axes="tibia")  # fmt: skip
    other = dataclasses.replace(frames, name="drawer", axes="grood_suntay")
    tests = [frames, other]
    problem = Problem.of(knee, kj.select(knee, NAMES), seen[:0], NOISE**-2.0, tests=tests)
    start = np.asarray(problem.selection.read(knee))[None]
    own, drawn = problem.residual(problem.begin(start))[0].reshape(2, 4, 5)
    assert np.abs(own).max() < 1e-5
    # The floating axis leaves the tibia's own by internal rotation.
    assert np.abs(drawn).max() > 0.5


def test_constants_that_leave_something_of_each_reading_are_taken():
    rows = np.full((4, 5), np.nan)
    rows[:, FREE_COORDINATES.index("anterior")] = -4.0, 5.8, 1.0, 2.0
    loads = {"anterior_N": np.array([-90.0, 90.0, 0.0, 9.0])}
    flexion = [30.0, 30.0, 60.0, 60.0]
    test = kj.MeasuredTest("drawer", flexion, loads, rows, counted_from="offset_each_flexion")
    assert test.groups.tolist() == [0, 0, 1, 1]
    with pytest.raises(ValueError, match="anterior under one load at 30 degrees"):
        kj.MeasuredTest(
            "drawer", [30.0, 40.0, 60.0, 60.0], loads, rows, counted_from="offset_each_flexion"
        )


def test_a_frame_offset_of_a_single_pose_is_refused():
    knee = kj.load_knee("four_ligament")
    with pytest.raises(UnsuitableData, match="frame_offset: lateral with 1 measured pose; expec"):
        kj.calibrate(kj.Study(
            title="one pose", knee=knee, measured=np.zeros((1, 6)), parameters=["ACL.stiffness"],
            frame_offset=["lateral"],
        ))  # fmt: skip
