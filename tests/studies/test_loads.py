"""Studies whose poses were measured under loads."""

import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.geometry import COLUMNS
from kneejax.mechanics import load_of
from kneejax.parameters import Assumption

FLEXION = [20.0, 20.0, 20.0, 60.0, 60.0, 60.0]
SIZES = [0.0, 60.0, -60.0] * 2
POSES = np.column_stack([FLEXION, np.zeros((6, 5))])
FREE = ["PCL.stiffness"]


def study(knee, **fields):
    return kj.Study(title="Drawer", knee=knee, parameters=FREE, **fields)


@pytest.fixture(scope="module")
def drawer(knee):
    """A made drawer test, and what a calibration of one stiffness makes of it."""
    truth = {"PCL.stiffness": 6000.0}
    made = kj.Synthetic(parameters=truth, flexion_deg=np.array(FLEXION))
    asked = study(
        knee, synthetic=made, loads={"anterior_N": SIZES}, procedures=["III"], noise_mm=0.1,
        noise_deg=0.1, weights={"mm": 1.0, "deg": 1.0},
    )  # fmt: skip
    return truth, asked, kj.calibrate(asked)


@pytest.mark.long
def test_a_drawer_test_leads_back_to_the_ligament_that_made_it(drawer, knee):
    truth, asked, fit = drawer
    (estimate,) = fit.fit.estimates
    assert estimate.value == pytest.approx(truth["PCL.stiffness"], rel=1e-5)
    moved = kj.passive_flexion(knee.replace(truth), FLEXION, asked.acting)
    np.testing.assert_allclose(fit.measured, moved.to_table(), atol=1e-6)
    # The same flexion without and with the load are different poses.
    assert np.ptp(fit.measured[:3, 3]) > 1.0


def test_the_error_bar_is_that_of_the_load_cases(drawer, knee):
    """One parameter, small noise: its variance is one over the sum of squared slopes."""
    truth, asked, fit = drawer
    value = truth["PCL.stiffness"]

    def poses(factor):
        there = knee.replace({"PCL.stiffness": factor * value})
        return np.asarray(kj.passive_flexion(there, FLEXION, asked.acting).to_table())

    slope = (poses(1.001) - poses(0.999))[:, 1:] / (0.002 * value)
    expected = 0.1 / np.sqrt((slope**2).sum())
    assert fit.fit.estimates[0].standard_error == pytest.approx(expected, rel=1e-3)


def test_a_table_may_say_which_loads_acted(tmp_path, knee):
    rows = [",".join(map(str, [*row, size])) for row, size in zip(POSES, SIZES, strict=True)]
    header = ",".join([*kj.geometry.COLUMNS, "anterior_N"])
    (tmp_path / "drawer.csv").write_text("\n".join([header, *rows]) + "\n")
    text = "title: Drawer\nknee: four_ligament\nparameters: [PCL.stiffness]\n"
    text += "measured: {file: drawer.csv, source: made up%s}\n"
    path = tmp_path / "drawer.yaml"
    path.write_text(text % "")
    assert kj.read_study(path).loads == {"anterior_N": SIZES}
    # Limits of flexion leave loads out with their poses.
    path.write_text(text % "" + "flexion_deg: [30, 90]\n")
    assert kj.read_study(path).loads == {"anterior_N": SIZES[3:]}
    path.write_text(text % "" + "loads: {varus_Nm: 5}\n")
    with pytest.raises(kj.InputProblem, match="no loads beside those of the measured table"):
        kj.read_study(path)


@pytest.mark.parametrize(
    ("loads", "says"),
    [
        ({"anterior": [1.0]}, "anterior_N"),
        ({"anterior_N": [1.0, 2.0]}, "one for all poses, or 6, one for each"),
        ({"varus_Nm": [5000.0]}, "N mm are suspected"),
        ({"anterior_N": "much"}, "anterior_N"),
    ],
)
def test_loads_that_mean_nothing_are_refused(knee, loads, says):
    with pytest.raises(kj.InputProblem, match=says):
        study(knee, measured=POSES, loads=loads)


def test_a_question_of_passive_motion_refuses_loads(knee):
    """Maps are made at a study's own load cases; sensitivities are of its passive motion."""
    under_load = study(knee, measured=POSES, loads={"anterior_N": 50.0})
    with pytest.raises(kj.InputProblem, match="passive motion"):
        kj.sensitivity(under_load)


def test_load_columns_by_other_names_are_not_passed_over(tmp_path):
    from kneejax.files import read_loads

    path = tmp_path / "poses.csv"
    path.write_text("flexion_deg,internal_rotation_Nmm\n0,5000\n")
    with pytest.raises(kj.InputProblem, match="internal_Nm"):
        read_loads(path)


def test_a_load_on_one_axis_is_the_named_load(knee):
    asked = study(knee, measured=POSES, loads={"anterior_N": SIZES})
    (load,) = asked.acting
    np.testing.assert_allclose(load.force, load_of(anterior_N=np.array(SIZES)).force)


def test_loads_of_other_names_beside_poses_are_mapped_or_said_to_be_unused(tmp_path):
    from kneejax.files import read_loads

    path = tmp_path / "poses.csv"
    path.write_text("flexion_deg,Posterior Force [kN],varus_moment_Nm,Muscle tension\n0,0.02,3,4\n")
    said = (
        r"Posterior Force \[kN\] is not used, but would be by columns: "
        r"\{anterior_N: -1000 \* Posterior Force \[kN\]\}; Muscle tension is not used"
    )
    with pytest.warns(Assumption, match=said):
        assert read_loads(path) == {"varus_Nm": [3.0]}
    with pytest.warns(Assumption, match="by their headers: Muscle tension is not used"):
        mapped = read_loads(path, {"anterior_N": "-1000 * Posterior Force [kN]"})
    assert mapped == {"anterior_N": [-20.0], "varus_Nm": [3.0]}


def test_a_measured_table_may_map_its_loads(tmp_path):
    names = dict(zip(COLUMNS, "abcdef", strict=True)) | {"anterior_N": "-g"}
    (tmp_path / "poses.csv").write_text("a,b,c,d,e,f,g\n0,1,2,3,4,5,-60\n30,1,2,3,4,5,-70\n")
    measured = {"file": "poses.csv", "source": "a trial", "columns": names}
    document = {"title": "x", "knee": "four_ligament", "parameters": ["ACL.stiffness"],
                "measured": measured}  # fmt: skip
    (tmp_path / "study.yaml").write_text(yaml.safe_dump(document))
    read = kj.read_study(tmp_path / "study.yaml")
    assert read.loads["anterior_N"] == [60.0, 70.0]
