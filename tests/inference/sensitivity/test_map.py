"""Maps of the objective: each grid point is a calibration's objective, wherever it stands."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.files import Checkpoints
from kneejax.inference import Condition, in_convention, profiles, sensitivity_map, sensitivity_maps
from kneejax.inference.fit import Observations, balances_of, fit_lanes
from kneejax.papers.paper1 import valley
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.statics import LoadCases, balance_many, balance_with_slopes

pytestmark = pytest.mark.usefixtures("optimised_code")

PAIR = ("PCL.stiffness", "PCL.reference_strain")
FLEXION = np.array([0.0, 25.0, 70.0, 120.0])
WEIGHTS = np.array([8.0, 8.0, 1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def measured(knee):
    """The motion of a knee whose PCL is softer and tighter."""
    true = knee.replace({"PCL.stiffness": 2814.0, "PCL.reference_strain": -0.047})
    return np.asarray(kj.passive_flexion(true, FLEXION).to_table())


class CutOff(Checkpoints):
    """Kept on disk, and stopped after some parts."""

    def __init__(self, folder, most):
        super().__init__(folder, {"study": "a test"}, b"data")
        self.left = most

    def save(self, name, arrays):
        if not self.left:
            raise KeyboardInterrupt
        self.left -= 1
        super().save(name, arrays)


@pytest.fixture(scope="module")
def found(knee, measured):
    return sensitivity_map(knee, measured, PAIR, grid=(9, 7))


def test_grid_points_are_objectives_of_their_knees(knee, measured, found):
    assert found.objective.shape == (7, 9)
    np.testing.assert_allclose([found.x[0], found.x[-1]], [300.0, 10000.0])
    np.testing.assert_allclose([found.y[0], found.y[-1]], [-0.2, 0.2])
    chosen = kj.select(knee, PAIR)
    rows = [(0, 0), (3, 4), (2, 8)]
    values = np.array([[found.x[column], found.y[row]] for row, column in rows])
    alone = balance_many(knee, chosen.apply, values, LoadCases.at(FLEXION))
    squares = ((alone.table - measured[:, 1:]) ** 2).sum(axis=1)
    for k, (row, column) in enumerate(rows):
        np.testing.assert_allclose(found.partial_objectives[:, row, column], squares[k], rtol=1e-6)
        np.testing.assert_allclose(found.objective[row, column], WEIGHTS @ squares[k], rtol=1e-6)


def test_the_minimum_is_where_the_data_come_from(found):
    x, y, lowest = found.minimum
    assert abs(y - -0.047) < 0.07
    assert lowest < 0.05 * found.start_objective
    assert found.start == (pytest.approx(3860.0), pytest.approx(-0.1))
    assert found.left_out == 0


def test_what_means_nothing_is_not_drawn(knee, measured):
    """Collateral ligaments from far too slack to far too tight."""
    pair = ("MCL.reference_strain", "LCL.reference_strain")
    found = sensitivity_map(knee, measured, pair, grid=(5, 5))
    bad = found.condition >= Condition.UNPHYSIOLOGICAL
    assert bad.any() and not bad.all()
    np.testing.assert_array_equal(found.drawn, ~bad)
    np.testing.assert_array_equal(found.lost > 0, found.condition == Condition.NO_BALANCE)
    np.testing.assert_array_equal(np.isnan(found.objective), found.lost > 0)
    assert found.minimum[2] == found.objective[~bad].min()


def test_a_map_goes_on_where_it_was_stopped(knee, measured, monkeypatch, tmp_path):
    """Blocks of four rows; the second run loads the first block and computes the others."""
    from kneejax.inference.sensitivity import _map

    monkeypatch.setattr(_map, "_BLOCK", 1)
    monkeypatch.setattr(_map, "_FEWEST_ROWS", 4)
    complete = sensitivity_map(knee, measured, PAIR, grid=(5, 12))
    with pytest.raises(KeyboardInterrupt):
        sensitivity_map(knee, measured, PAIR, grid=(5, 12), store=CutOff(tmp_path, 1))
    store = CutOff(tmp_path, 2)
    resumed = sensitivity_map(knee, measured, PAIR, grid=(5, 12), store=store)
    assert store.resumed == 1 and store.left == 0
    for name in ("objective", "partial_objectives", "condition", "lost"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(complete, name))


def test_free_offsets_forgive_constant_differences(knee, measured):
    shifted = measured + np.array([0.0, 0.0, 5.0, -3.0, 0.0, 0.0])
    options = {"grid": (3, 3), "offsets": ("internal_rotation", "anterior")}
    plain = sensitivity_map(knee, measured, PAIR, **options)
    moved = sensitivity_map(knee, shifted, PAIR, **options)
    np.testing.assert_allclose(moved.objective, plain.objective, rtol=1e-9)


def test_the_papers_coordinates_are_the_femur_in_the_tibia(knee, measured):
    table = measured[:, 1:]
    pose = kj.Pose.from_table(measured)
    seen = in_convention(table, FLEXION, "femur-in-tibia")
    back = np.stack(pose.placement.turn_back(tuple(-x for x in pose.placement.translation)))
    np.testing.assert_allclose(seen[:, 2:], back.T, atol=1e-9)
    assert in_convention(table, FLEXION, "femoral") is table


def test_several_maps_share_a_call(knee, measured, found):
    seen = []
    both = sensitivity_maps(
        knee, measured, [PAIR, ("ACL.stiffness", "PCL.stiffness")], grid=(3, 3),
        progress=lambda done, total: seen.append((done, total)),
    )  # fmt: skip
    assert [one.names for one in both] == [PAIR, ("ACL.stiffness", "PCL.stiffness")]
    assert seen[-1] == (2 * 9 * 4, 2 * 9 * 4)


def test_a_map_elsewhere_is_that_of_the_knee_there(knee, measured):
    at = {"PCL.stiffness": 3000.0, "PCL.reference_strain": -0.06, "ACL.stiffness": 5500.0}
    there = sensitivity_map(knee, measured, PAIR, grid=(3, 3), at=at)
    moved = sensitivity_map(knee.replace(at), measured, PAIR, grid=(3, 3))
    assert there.start == (3000.0, -0.06) == pytest.approx(moved.start)
    assert there.start_objective == pytest.approx(moved.start_objective, rel=1e-6)
    np.testing.assert_array_equal(there.condition, moved.condition)
    np.testing.assert_allclose(there.objective, moved.objective, rtol=1e-6)


def test_a_pose_that_is_lost_there_still_counts(knee, measured):
    at = {"PCL.stiffness": 1e6, "PCL.reference_strain": 0.2, "ACL.stiffness": 1e6}
    there = sensitivity_map(knee, measured, PAIR, grid=(3, 3), at=at)
    assert np.isnan(there.start_objective) and there.left_out == 0


def test_a_data_set_has_coordinates_units_and_flags(found):
    pytest.importorskip("xarray")
    made = found.to_dataset({"study": "a test"})
    assert dict(made.sizes) == {"PCL.stiffness": 9, "PCL.reference_strain": 7}
    assert made["PCL.stiffness"].attrs["units"] == "N"
    assert made["internal_rotation"].attrs["units"] == "degree2"
    assert made["condition"].attrs["flag_meanings"].split()[4] == "no_balance"
    assert made.attrs["study"] == "a test"
    np.testing.assert_array_equal(made["objective"], found.objective)


def test_profiles_follow_the_valley_of_the_map(knee, measured):
    """With two free parameters the profile of one is the map's minimum over the other."""
    chosen, noise = kj.select(knee, PAIR), np.array([0.5, 0.5, 0.5, 0.5, 0.5])
    lower, upper = np.array([1500.0, -0.07]), np.array([5000.0, -0.02])
    data = Observations(LoadCases.at(FLEXION), measured[:, 1:], noise)
    start = np.array([[2900.0, -0.05]])
    near = balance_with_slopes(knee, chosen.apply, start, data.load_cases)
    balance = balances_of(knee, chosen, data)
    fit = fit_lanes(balance, data, near, start, lower[None], upper[None])
    np.testing.assert_allclose(fit.values[0], [2814.0, -0.047], rtol=1e-4)
    stiffness = profiles(knee, chosen, data, fit.slopes, lower, upper, 3.84)[0]
    rows = np.argsort(np.abs(stiffness.values - 2814.0))[3:6]
    bounds = {
        "PCL.stiffness": (float(stiffness.values[rows].min()), float(stiffness.values[rows].max())),
        "PCL.reference_strain": (-0.07, -0.02),
    }
    fine = sensitivity_map(
        knee, measured, PAIR, grid=(2, 101), bounds=bounds, weights=1.0 / noise**2
    )
    for row in (rows[np.argmin(stiffness.values[rows])], rows[np.argmax(stiffness.values[rows])]):
        column = int(np.argmin(np.abs(fine.x - stiffness.values[row])))
        valley_floor = fine.objective[:, column].min()
        step = fine.y[1] - fine.y[0]
        bend = np.diff(fine.objective[:, column], 2).max() / step**2
        # Between grid points the valley is deeper by at most an eighth of bend x step^2.
        assert 0.0 <= valley_floor - fit.chi2[0] - stiffness.rise[row] <= bend * step**2 / 8 + 1e-6


def test_a_tilted_valley_is_seen_as_tilted(found):
    import dataclasses

    x, y = np.linspace(0.0, 1.0, 41), np.linspace(0.0, 1.0, 41)
    across = (y[:, None] - 0.5) * np.cos(0.3) - (x - 0.5) * np.sin(0.3)
    along = (x - 0.5) * np.cos(0.3) + (y[:, None] - 0.5) * np.sin(0.3)
    bowl = dataclasses.replace(
        found, x=x, y=y, objective=25.0 * across**2 + along**2, condition=np.zeros((41, 41))
    )
    tilt, length = valley(bowl)
    assert tilt == pytest.approx(np.rad2deg(0.3), abs=2.0)
    assert length == pytest.approx(5.0, rel=0.25)


@pytest.mark.parametrize(
    ("pairs", "options", "error", "words"),
    [
        ([("PCL.stifness", "ACL.stiffness")], {}, UnknownParameter, "PCL.stiffness"),
        ([("PCL.stiffness", "PCL.stiffness")], {}, UnsuitableData, "two different"),
        ([("*.stiffness", "PCL.stiffness")], {}, UnknownParameter, "one per side"),
        ([("PCL.slack_length", "PCL.reference_strain")], {}, UnknownParameter, "one number"),
        ([PAIR], {"grid": (1, 5)}, UnsuitableData, "at least two"),
        ([PAIR], {"bounds": {"stiffness": (900.0, 300.0)}}, UnsuitableData, "lower below upper"),
        ([], {}, UnsuitableData, "name two"),
        ([PAIR], {"at": {"ACL.stifness": 1.0}}, UnknownParameter, "did you mean 'ACL.stiffness'"),
        ([PAIR], {"at": {"*.stiffness": 1.0}}, UnknownParameter, "many parameters"),
        ([PAIR], {"at": {"ACL.stiffness": np.nan}}, UnsuitableData, "nan is not finite"),
    ],
)
def test_mistakes_are_said(knee, measured, pairs, options, error, words):
    with pytest.raises(error, match=words):
        sensitivity_maps(knee, measured, pairs, **options)
