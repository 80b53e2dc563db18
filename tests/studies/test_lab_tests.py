"""Tests under load in a study: their tables, what they are counted from, what is refused."""

import re

import numpy as np
import pytest

import kneejax as kj
from kneejax.files import (
    InputProblem,
    bundled_bands,
    bundled_laxity_sources,
    read_lab_table,
    write_poses,
)
from kneejax.geometry import CLINICAL, FREE_COORDINATES, convert_table
from kneejax.inference.fit import observations
from kneejax.parameters import UnsuitableData
from kneejax.studies import Identify, Sensitivity, check
from kneejax.studies._lab_tests import StudyTest, published_laxity
from tests.studies.tables import study, table

ANTERIOR = FREE_COORDINATES.index("anterior")


def test_a_study_may_be_of_tests_alone(tmp_path):
    table(tmp_path)
    read = study(tmp_path)
    (test,) = read.tests
    assert test.driven_by == "anterior_N"
    assert test.coordinates == ("anterior",)
    assert test.observed[:, ANTERIOR].tolist() == [2.5, 4.0, 3.0]
    assert read.settings()["tests"][0]["file"] == str(tmp_path / "drawer.csv")


def test_what_acts_throughout_is_called_loads_as_in_a_study(tmp_path):
    """`constant`, its older name, is read, and no message knows it."""
    table(tmp_path)
    drawer = {"name": "drawer", "file": "drawer.csv"}
    pressed = {"compression_N": 50.0, "lateral_N": 4.0}
    for name in ("loads", "constant"):
        one, left = study(
            tmp_path,
            [drawer | {name: pressed}, drawer | {"name": "left", "mirror": True, name: pressed}],
        ).tests
        assert one.constant == pressed
        assert left.constant == {"compression_N": 50.0, "lateral_N": -4.0}
        with pytest.raises(InputProblem, match=r"tests\[0\].loads.axial_N"):
            study(tmp_path, [drawer | {name: {"axial_N": 50.0}}])
    with pytest.raises(InputProblem, match=r"tests\[0\].constant.*one of .*loads"):
        study(tmp_path, [drawer | {"loads": pressed, "constant": pressed}])


def test_forces_may_follow_the_tibias_own_axes(tmp_path):
    table(tmp_path)
    strapped = {"name": "device", "file": "drawer.csv", "axes": "tibia"}
    assert study(tmp_path, [strapped]).tests[0].axes == "tibia"
    with pytest.raises(InputProblem, match=r"tests\[0\].axes.*tibial.*grood_suntay"):
        study(tmp_path, [strapped | {"axes": "tibial"}])


def test_what_simulate_writes_is_read(tmp_path):
    poses = np.array([[30.0, 1.0, 4.0, 2.0, -28.0, 0.5], [30.0, 2.0, 5.0, 3.0, -28.5, 0.6]])
    write_poses(tmp_path / "poses.csv", poses)
    header = ("flexion_deg", "adduction_deg", "internal_rotation_deg", "anterior_mm",
              "superior_mm", "lateral_mm", "anterior_force_N")  # fmt: skip
    table(tmp_path, header=header, rows=np.column_stack([poses, [0.0, 90.0]]).tolist())
    read = read_lab_table(tmp_path / "drawer.csv", convention="femoral")
    assert read.loads["anterior_N"].tolist() == [0.0, 90.0]
    # Rows of one flexion are grouped by it, to the last digit.
    assert read.flexion_deg.tolist() == [30.0, 30.0]
    assert read.observed == pytest.approx(convert_table(poses, "femoral", CLINICAL)[:, 1:])


def test_a_published_laxity_is_used_by_its_name(tmp_path):
    item = {"name": "robot", "file": "robot_anterior_90N", "flexion_deg": [20, 30], "sd_mm": 2.4}
    (test,) = study(tmp_path, [item], noise_mm=0.5).tests
    assert test.observed[:, ANTERIOR].tolist() == [5.9, 6.0]
    assert test.loads["anterior_N"].tolist() == [90.0, 90.0]


@pytest.mark.parametrize(
    ("header", "said"),
    [
        (("flexion_deg", "anterior_N", "anterior"), "no coordinate"),
        (("flexion_deg", "load", "anterior_mm"), "expected a column that is used"),
        (("flexion_deg", "x", "anterior_mm"), "no load"),
        (("angle", "anterior_N", "anterior_mm"), "flexion_deg: missing"),
    ],
)
def test_a_table_without_what_a_test_needs_is_refused(tmp_path, header, said):
    table(tmp_path, header=header)
    with pytest.raises(InputProblem, match=said):
        study(tmp_path)


def test_moments_in_n_mm_are_suspected(tmp_path):
    table(tmp_path, header=("flexion_deg", "varus_Nm", "adduction_deg"),
          rows=[(30.0, 300.0, 2.0)])  # fmt: skip
    with pytest.raises(InputProblem, match=r"N mm are suspected \(0.001 \* varus_Nm\)"):
        study(tmp_path)


def test_loads_of_no_cell_are_refused(tmp_path):
    (tmp_path / "drawer.csv").write_text("flexion_deg,anterior_N,anterior_mm\n30,,2\n")
    with pytest.raises(InputProblem, match=r"row 1 .*, anterior_N: .*expected a number"):
        study(tmp_path)


@pytest.mark.parametrize(
    ("item", "said"),
    [
        ({"counted_from": "zero"}, "counted_from: zero: expected one of unloaded"),
        ({"counted_from": "least_load"}, "row 1: anterior_N 45 is the least load"),
        ({"counted_from": "opposite"}, "expected a row under the opposite load"),
        ({"sd_mm": 0.4}, r"tests\[0\].sd_mm: 0.4: expected noise_mm of the study too"),
        ({"coordinates": ["lateral"]}, "coordinates that the table has; not lateral"),
        ({"coordinates": ["anteriorr"]}, "expected one of adduction, .*anterior"),
        ({"flexion_deg": [45]}, "of the flexions that were measured, 30, 60; not 45"),
        ({"file": "robot_anterior_90"}, "a CSV table, or a published test"),
        ({"at_deg": 200}, "at_deg: 200"),
        ({"cuts": "ACL"}, "no such field.*did you mean cut"),
    ],
)
def test_what_a_test_cannot_be_is_refused(tmp_path, item, said):
    table(tmp_path)
    with pytest.raises(InputProblem, match=said):
        study(tmp_path, [{"name": "drawer", "file": "drawer.csv"} | item])


def test_two_tests_have_two_names(tmp_path):
    table(tmp_path)
    twice = [{"name": "drawer", "file": "drawer.csv"}] * 2
    with pytest.raises(InputProblem, match=r"tests\[1\].name: drawer: expected every name once"):
        study(tmp_path, twice)


def test_fewer_data_than_parameters_are_refused_before_anything_moves(tmp_path):
    table(tmp_path)
    few = study(tmp_path, parameters=["*.stiffness"])
    with pytest.raises(UnsuitableData, match="3 measured numbers for 4 unknowns"):
        check(few, Identify())


@pytest.mark.parametrize(
    ("question", "said"),
    [
        (Sensitivity(), "a study without tests: sensitivities are of passive motion so far"),
        (Identify(posterior=True), "a study without tests: the posterior is of passive motion"),
    ],
)
def test_what_takes_no_tests_yet_says_so(tmp_path, question, said):
    table(tmp_path)
    with pytest.raises(InputProblem, match=said):
        check(study(tmp_path, noise_mm=0.5, noise_deg=0.5), question)


def test_a_test_on_a_cut_knee_reads_the_published_laxity_of_such_knees(tmp_path):
    item = {"name": "cut", "file": "robot_anterior_90N", "flexion_deg": [20], "cut": ["ACL"],
            }  # fmt: skip
    (test,) = study(tmp_path, [item]).tests
    assert (test.cut, test.observed[:, ANTERIOR].tolist()) == (("ACL",), [13.2])
    # The table says what it counts from, as an assumption that a study may change.
    assert test.counted_from == "intact"
    (test,) = study(tmp_path, [item | {"counted_from": "unloaded"}]).tests
    assert test.counted_from == "unloaded"


def test_forces_strains_and_weights_are_read_from_columns(tmp_path):
    header = ("flexion_deg", "anterior_N", "Cell 1", "MCL.strain", "medial.contact_N", "weight")
    table(tmp_path, header=header, rows=[(30.0, 90.0, 0.05, 0.01, 200.0, 1.0),
                                         (60.0, 90.0, 0.04, np.nan, 150.0, 0.0)])  # fmt: skip
    item = {"name": "drawer", "file": "drawer.csv", "columns": {"ACL.tension_N": "1000 * Cell 1"},
            "sd_N": 3.0, "sd_strain": 0.002}  # fmt: skip
    (test,) = study(tmp_path, [item], noise_mm=0.1, noise_deg=0.1).tests
    assert test.readings["ACL.tension_N"].tolist() == [50.0, 40.0]
    assert np.isnan(test.readings["MCL.strain"]).tolist() == [False, True]
    assert test.weight.tolist() == [1.0, 0.0]
    assert test.coordinates == ()


def test_weights_grow_with_the_load(tmp_path):
    table(tmp_path)
    (test,) = study(tmp_path, [{"name": "d", "file": "drawer.csv", "weight": "by_load"}]).tests
    assert test.weight.tolist() == [0.5, 1.0, 1.0]


READ = ("flexion_deg", "anterior_N", "ACL.tension_N")


@pytest.mark.parametrize(
    ("header", "item", "fields", "said"),
    [
        (READ, {}, {"noise_mm": 0.1, "noise_deg": 0.1}, r"tests\[0\].sd_N: not stated"),
        (READ, {"sd_N": 2.0}, {}, "noise_mm of the study too"),
        (READ, {"sd_N": -2.0}, {}, "between"),
        ((*READ[:2], "ACLL.tension_N"), {"sd_N": 2.0}, {"noise_mm": 0.1, "noise_deg": 0.1},
         "did you mean 'ACL'"),
        ((*READ[:2], "anterior_mm"), {"cut": ["ACK"]}, {}, "did you mean 'ACL'"),
        # The ligament before how well it was measured: with it the rest may be right.
        ((*READ[:2], "anterior_mm"), {"cut": "ALC", "sd_mm": 1.0}, {}, r"tests\[0\]: .* 'ALC'"),
        ((*READ[:2], "anterior_mm"), {"counted_from": "intact"}, {}, "expected cut too"),
        ((*READ[:2], "weight", "anterior_mm"), {"weight": "by_load"}, {}, "has a column weight"),
        ((*READ[:2], "anterior_mm"), {"weight": "by_lod"}, {}, "did you mean by_load"),
    ],
)  # fmt: skip
def test_readings_cuts_and_weights_that_mean_nothing_are_refused(
    tmp_path, header, item, fields, said
):
    table(tmp_path, header=header, rows=[(30.0, 90.0, *(0.5,) * (len(header) - 2))])
    with pytest.raises((InputProblem, UnsuitableData, ValueError), match=said):
        study(tmp_path, [{"name": "drawer", "file": "drawer.csv"} | item], **fields)


def test_a_tension_of_a_line_acts_and_one_of_a_ligament_was_read(tmp_path):
    header = ("flexion_deg", "anterior_N", "anterior_mm", "patellar_tendon.tension_N")
    table(tmp_path, header=header, rows=[(30.0, 0.0, 1.0, 200.0), (60.0, 0.0, 2.0, 300.0)])
    (test,) = study(tmp_path).tests
    assert test.tensions["patellar_tendon"].tolist() == [200.0, 300.0]
    assert not test.readings
    table(tmp_path, header=header, rows=[(30.0, 0.0, 1.0, 200.0), (60.0, 0.0, 2.0, np.nan)])
    with pytest.raises(InputProblem, match="row 2: empty: expected a tension in every row"):
        study(tmp_path)


def test_a_published_range_is_counted_between_opposite_loads(tmp_path):
    item = {"name": "drawer", "file": "markolf1978_drawer", "load": {"anterior_N": 100}}
    (test,) = study(tmp_path, [item]).tests
    assert test.counted_from == "opposite"
    assert test.loads["anterior_N"].tolist() == [100.0] * 3 + [-100.0] * 3
    # What is fitted is the range itself.
    cases = observations(np.zeros((0, 6)), np.ones(5), tests=[test])
    assert cases.target[:3, ANTERIOR].tolist() == [3.7, 5.5, 4.8]
    assert np.isnan(cases.target[3:]).all()


def test_published_torsion_has_both_senses(tmp_path):
    item = {"name": "turn", "file": "komzak2013_torsion", "load": {"internal_Nm": 5}}
    (test,) = study(tmp_path, [item]).tests
    assert test.loads["internal_Nm"].tolist() == [5.0, -5.0]
    assert test.observed[:, 1].tolist() == [12.1, -10.1]


def test_published_coupled_motion_is_counted_from_extension(tmp_path):
    (test,) = study(tmp_path, [{"name": "walker", "file": "walker1988"}]).tests
    assert test.counted_from == "extension" and not test.loads
    at_90 = int(np.flatnonzero(test.flexion_deg == 90.0)[0])
    # Adduction, internal rotation; the tibia goes where the femur comes from; lateral unknown.
    assert test.observed[at_90, :4].tolist() == [0.65, 14.88, 7.66, 1.75]
    cases = observations(np.zeros((0, 6)), np.ones(5), tests=[test])
    assert np.asarray(cases.neutral).tolist() == [0] * 13 and np.nanmax(abs(cases.target[0])) == 0.0
    assert cases.group.tolist() == [0] * 13
    assert cases.target[at_90, 1] == 14.88


def test_published_forces_of_the_collateral_structures_are_readings(tmp_path):
    item = {"name": "forces", "file": "kanamori2000", "sd_N": 10, "ignore": ["PFL.tension_N"]}
    (test,) = study(tmp_path, [item], noise_mm=1.0, noise_deg=1.0).tests
    assert test.loads["anterior_N"].tolist() == [134.0] * 5 and np.isnan(test.observed).all()
    assert {name: sizes.tolist() for name, sizes in test.readings.items()} == {
        "MCL.tension_N": [10.0] * 5, "LCL.tension_N": [10.0] * 5,
    }  # fmt: skip


def test_published_mean_poses_are_off_by_unknown_constants(tmp_path):
    (test,) = study(tmp_path, [{"name": "lunge", "file": "paper5_eos"}]).tests
    assert test.counted_from == "offset"
    # As printed: the floating axis is at a right angle to the others, so AP is the component.
    assert test.observed[:, ANTERIOR].tolist() == [-3.39, 0.61, 4.81, 6.88, 10.58]


def test_a_motion_is_fitted_by_its_changes_from_extension(tmp_path):
    knee = kj.load_knee("four_ligament")
    own = np.asarray(kj.passive_flexion(knee, [0.0, 30.0, 60.0]).to_table(CLINICAL))
    write_poses_of(tmp_path, own + [0.0, 1.0, -2.0, 3.0, 0.0, 0.0])
    item = {"name": "motion", "file": "motion.csv", "counted_from": "extension"}
    (test,) = study(tmp_path, [item]).tests
    cases = observations(np.zeros((0, 6)), np.ones(5), tests=[test])
    assert cases.target[1:] == pytest.approx(own[1:, 1:] - own[0, 1:], abs=1e-9)


def write_poses_of(folder, rows):
    header = ("flexion_deg", "adduction_deg", "internal_rotation_deg", "anterior_mm",
              "superior_mm", "lateral_mm")  # fmt: skip
    table(folder, "motion.csv", header, rows.tolist())


@pytest.mark.parametrize(
    ("item", "said"),
    [
        ({"file": "komzak2013_torsion"}, "load: {internal_Nm: ...} beside it, since the load of"),
        ({"file": "komzak2013_torsion", "load": {"anterior_N": 5}}, "one of internal_Nm"),
        ({"file": "komzak2013_torsion", "load": {"internal_Nm": 0}}, "the size of the load"),
        ({"file": "robot_anterior_90N", "load": {"anterior_N": 50}}, "was measured under anteri"),
        ({"file": "markolf1984_drawer"}, "a difference that cutting makes"),
        ({"file": "markolf1978_drawer", "load": {"anterior_N": 99}, "counted_from": "offset"},
         "is of ranges between opposite loads"),
        ({"file": "walker1988", "counted_from": "offset"}, "walker1988 says it itself"),
        ({"file": "walker1988", "at_deg": 30}, "walker1988 comes with the package"),
        ({"file": "walker198"}, "did you mean walker1988"),
        ({"file": "paper3_conditions"}, "or a published test"),
        ({"load": {"anterior_N": 5}}, "no load of a published table"),
        ({"file": "robot_anterior_90N", "cut": "PCL"}, "with ACL or nothing cut, as it was"),
    ],
)  # fmt: skip
def test_what_a_published_table_cannot_be_is_refused(tmp_path, item, said):
    table(tmp_path)
    with pytest.raises(InputProblem, match=re.escape(said)) as caught:
        study(tmp_path, [{"name": "drawer", "file": "drawer.csv"} | item])
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "said"),
    [("walker1988", "walker1988 is a table under tests"),
     ("paper3_conditions", "paper3_conditions is conditions alone")],
)  # fmt: skip
def test_no_measured_motion_is_made_of_changes_or_conditions(tmp_path, name, said):
    with pytest.raises(InputProblem, match=said):
        study(tmp_path, [{"name": "robot", "file": "robot_anterior_90N"}],
              measured={"file": name, "source": "a paper"})  # fmt: skip


def test_a_motion_without_loads_has_each_flexion_once():
    rows = np.zeros((2, 5))
    with pytest.raises(ValueError, match="30 degrees 2 times; expected each once"):
        kj.MeasuredTest("motion", [30.0, 30.0], {}, rows, counted_from="extension")
    with pytest.raises(ValueError, match="loads: none"):
        kj.MeasuredTest("motion", [30.0, 60.0], {}, rows)


def test_every_published_table_is_read_and_cites():
    for band in bundled_bands():
        assert len(band.flexion_deg) == len(band.mean) == len(band.sd)
        assert (np.sign(band.mean) == (-1.0 if band.end == "negative" else 1.0)).all()
        assert band.source
    unknown = {band.name for band in bundled_bands() if np.isnan(band.size)}
    sources = bundled_laxity_sources()
    assert {name for name in sources if "not known" in sources[name]} == unknown


def test_a_published_laxity_of_cut_knees_is_read_by_what_was_cut():
    bands = bundled_bands(name="robot_anterior_90N")
    said = StudyTest(name="robot", file="robot_anterior_90N", cut="ACL")
    table, counted_from = published_laxity(said, bands)
    assert counted_from == "intact"
    assert table.observed[2, ANTERIOR] == 13.2
    with pytest.raises(InputProblem, match="robot_anterior_90N with ACL or nothing cut"):
        published_laxity(said.replace(cut=["PCL"]), bands)
