"""One parameter at a time: sweeps, and the exact slopes that they must have."""

import numpy as np
import pytest

from kneejax.inference import local_sensitivity, sweep
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.statics import LoadCases, Status, converged

pytestmark = pytest.mark.usefixtures("optimised_code")

NAMES = ("*.stiffness", "*.reference_strain")
FLEXION = np.array([0.0, 25.0, 70.0, 120.0])
ANTERIOR = 2


@pytest.fixture(scope="module")
def local(knee):
    return local_sensitivity(knee, NAMES, FLEXION)


@pytest.fixture(scope="module")
def sweeps(knee):
    return sweep(knee, NAMES, FLEXION, count=9)


def test_exact_slopes_are_those_of_fine_sweeps(knee, local):
    """Fourth-order differences of neighbouring balances against the implicit derivative."""
    step = 3e-3 * local.widths
    values = {
        name: value + h * np.array([-2.0, -1.0, 1.0, 2.0])
        for name, value, h in zip(local.names, local.values, step, strict=True)
    }
    fine = sweep(knee, values, FLEXION).sweeps
    for i, one in enumerate(fine):
        far, near = one.table[3] - one.table[0], one.table[2] - one.table[1]
        numeric = (8.0 * near - far) / (12.0 * step[i])
        exact = local.derivative[:, :, i]
        largest = np.abs(exact).max(axis=0)
        np.testing.assert_array_less(np.abs(numeric - exact) / largest, 1e-6)


def test_the_knees_own_value_gives_the_knees_own_motion(knee, local, sweeps):
    np.testing.assert_allclose(sweeps.table, local.table, atol=1e-6)
    np.testing.assert_array_equal(sweeps.status, Status.BALANCED)
    pairs = zip(local.names, local.values, local.widths, strict=True)
    asked = {name: [value, value + width] for name, value, width in pairs}
    for one in sweep(knee, asked, FLEXION).sweeps:
        np.testing.assert_allclose(one.table[0], local.table, atol=1e-6)


def test_a_ligament_that_is_slack_moves_nothing(local, sweeps):
    """The PCL is slack near extension: only the tail of its smooth law is left of it."""
    reach = np.ptp(sweeps["PCL.stiffness"].table, axis=0)
    assert reach[:2].max() < 1e-3 * reach[3].max()
    slopes = np.abs(local.scaled[:, :, local.names.index("PCL.stiffness")])
    assert slopes[:2].max() < 1e-3 * slopes[3].max()


def test_a_tighter_acl_holds_the_tibia_back(sweeps):
    acl = sweeps["ACL.reference_strain"]
    assert (np.diff(acl.table[:, :2, ANTERIOR], axis=0) < 0).all()


def test_reference_strains_act_more_than_stiffnesses(sweeps):
    """Paper 1, claim 1.6, for every ligament, over its own ranges."""
    for ligament in ("ACL", "PCL", "MCL", "LCL"):
        reach = [
            np.nanmax(np.ptp(sweeps[f"{ligament}.{quantity}"].table, axis=0))
            for quantity in ("stiffness", "reference_strain")
        ]
        assert reach[0] < reach[1]


def test_usual_ranges_are_those_of_paper_1(sweeps):
    assert sweeps["ACL.stiffness"].values[[0, -1]].tolist() == [300.0, 9300.0]
    assert sweeps["MCL.reference_strain"].values[[0, -1]].tolist() == [-0.2, 0.2]
    assert (sweeps["MCL.reference_strain"].unit, sweeps["ACL.stiffness"].unit) == ("", "N")


def test_a_pose_that_nothing_balances_says_so_and_harms_no_other(knee, sweeps):
    """Bent the wrong way by 60 degrees the surfaces end; without an MCL the motion ends 2 degrees
    before extension, where the tangent stiffness becomes singular."""
    found = sweep(knee, NAMES, np.r_[-60.0, FLEXION], count=9)
    for one, whole in zip(found.sweeps, sweeps.sweeps, strict=True):
        assert (one.status[:, 0] == Status.NOT_CONVERGED).all()
        assert np.isnan(one.table[:, 0]).all() and not one.sound[:, 0].any()
        np.testing.assert_array_equal(one.status[:, 1:], whole.status)
        np.testing.assert_allclose(one.table[:, 1:], whole.table, atol=1e-6)
    loose = sweeps["MCL.reference_strain"]
    assert (converged(loose.status[:, 0]) == (loose.values > -0.01)).all()
    assert converged(loose.status[:, 1:]).all()


def test_sweeps_of_unlike_length_run_together_and_change_nothing(knee, sweeps):
    # All parameters are chosen, so that this compiles nothing new.
    lines = {one.name: one.values for one in sweeps.sweeps}
    lines["LCL.stiffness"] = lines["LCL.stiffness"][[0, 4, 8]]
    lines["ACL.reference_strain"] = lines["ACL.reference_strain"][[3, 7]]
    together = sweep(knee, lines, LoadCases.at(FLEXION))
    assert together["LCL.stiffness"].table.shape == (3, 4, 5)
    for one in together.sweeps:
        whole = sweeps[one.name]
        rows = np.isin(whole.values, one.values)
        np.testing.assert_array_equal(one.status, whole.status[rows])
        np.testing.assert_allclose(one.table, whole.table[rows], atol=1e-6)


def test_angles_come_back_ascending_and_once(knee):
    found = sweep(knee, NAMES, [70.0, 0.0, 25.0, 120.0, 0.0], count=2)
    assert found.flexion_deg.tolist() == FLEXION.tolist()


@pytest.mark.parametrize(
    ("parameters", "kind", "words"),
    [
        (["ACL.stifness"], UnknownParameter, "did you mean 'ACL.stiffness'"),
        (["ACL.stiffness", "ACL.stiffness"], UnsuitableData, "ACL.stiffness is swept twice: name"),
        (["*.stiffness", "ACL.stiffness"], UnsuitableData, "twice .by .*stiffness and by ACL"),
        (["ACL.slack_length", "ACL.reference_strain"], UnknownParameter, "one number"),
        ([], UnsuitableData, "no parameter to sweep"),
        ({"ACL.stiffness": [4000.0]}, UnsuitableData, "sweep of 1 value: expected at least two"),
        ({"ACL.stiffness": [5000.0, 4000.0]}, UnsuitableData, "from 5000 to 4000.*ascending"),
        ({"ACL.stiffness": [4000.0, 4000.0]}, UnsuitableData, "from 4000 to 4000.*ascending"),
        ({"ACL.stiffness": [4000.0, np.nan]}, UnsuitableData, "not finite"),
    ],
)
def test_what_cannot_be_swept_is_refused(knee, parameters, kind, words):
    with pytest.raises(kind, match=words):
        sweep(knee, parameters, FLEXION)


def test_scaled_slopes_say_by_what(knee, local):
    percent = local_sensitivity(knee, NAMES, FLEXION, scale="percent")
    np.testing.assert_allclose(percent.derivative, local.derivative, rtol=1e-12)
    ratio = local.widths / percent.widths
    np.testing.assert_allclose(ratio, [30.0] * 4 + [2.0] * 4, rtol=1e-12)
    size, row = local.largest()
    assert np.abs(local.scaled).max() == pytest.approx(np.abs(size).max())
    k = local.names.index("LCL.reference_strain")
    assert size[1, k] == local.scaled[row[1, k], 1, k]


def test_a_pose_that_failed_has_no_slope_and_spoils_no_other(knee):
    # Bent backwards by 60 degrees the bones meet where nobody has fitted their surfaces.
    found = local_sensitivity(knee, NAMES, np.r_[-60.0, FLEXION])
    assert found.status[0] == Status.NOT_CONVERGED
    assert np.isnan(found.derivative[0]).all()
    assert np.isfinite(found.derivative[1:]).all()
    assert np.isfinite(found.largest()[0]).all()


def test_an_unknown_scale_is_refused(knee):
    with pytest.raises(UnsuitableData, match="unknown scale 'sigma': expected one of prior, per"):
        local_sensitivity(knee, NAMES, FLEXION, scale="sigma")
