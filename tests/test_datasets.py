"""Every result as a dataset: named dimensions, and a unit for each number that has one."""

import dataclasses
import importlib
import pkgutil

import numpy as np
import pytest

import kneejax as kj
from kneejax.cohorts import CohortSummary
from kneejax.experiments import Branch, Curves, LabTest
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.joints import compare_motions
from kneejax.numerics import MissingPackage, Named
from kneejax.statics import Status
from tests.report import made_up
from tests.report.bayesian.test_posterior_report import made_up as made_up_posterior
from tests.report.identification.test_information_report import planned, told
from tests.report.sensitivity.test_map_figures import a_map
from tests.report.sensitivity.test_sensitivity_report import (
    made_up_indices,
    made_up_slopes,
    made_up_sweep,
)

pytest.importorskip("xarray")


def results():
    """Every class that offers a dataset."""
    for room in pkgutil.walk_packages(kj.__path__, "kneejax."):
        if room.name.split(".")[1] not in ("explorer", "__main__", "cli", "report"):
            importlib.import_module(room.name)
    below = [Named]
    for one in below:
        below += one.__subclasses__()
    return [one for one in below[1:] if one.__module__.startswith("kneejax.")]


def test_what_is_declared_is_an_attribute_of_the_result():
    every = results()
    assert len(every) > 20
    for one in every:
        known = {*(field.name for field in dataclasses.fields(one)), *dir(one)}
        for names in one.OVER.values():
            assert names.keys() <= known, one


@pytest.fixture(scope="module")
def knee():
    return kj.load_knee("four_ligament")


@pytest.fixture(scope="module")
def motion(knee):
    return kj.passive_flexion(knee, [0.0, 30.0], held={"anterior_mm": [0.0, 1.0]})


def test_a_motion_has_the_columns_of_its_table(motion):
    found = motion.to_dataset(study="a test")
    np.testing.assert_array_equal([found[name] for name in COLUMNS], motion.to_table().T)
    assert found.anterior_mm.units == "mm" and found.internal_rotation_deg.units == "deg"
    assert found.residual_moment.units == "N mm" and found.reaction_anterior_N.units == "N"
    assert found.status.values.tolist() == ["balanced"] * 2 and found.study == "a test"
    table = motion.to_dataframe()
    assert [*table.columns] == [*COLUMNS, "status", "reaction_anterior_N"]
    np.testing.assert_array_equal(table["reaction_anterior_N"], found.reaction_anterior_N)


def test_a_dimension_takes_names_that_the_result_does_not_know(knee, motion):
    found = kj.evaluate(knee, motion.pose).to_dataset(
        ligament=knee.ligaments.names, contact=knee.contact_names, source="us"
    )
    assert found.tension.sel(ligament="ACL").dims == ("pose",) and found.source == "us"
    assert found.contact_force.sel(axis="superior", contact="medial").units == "N"
    assert found.max_pressure.units == "MPa" and found.strain.units == "1"


def test_a_test_under_load_lies_over_flexion_and_steps(motion):
    held = dataclasses.replace(motion, load_cases=motion.load_cases)
    test = LabTest("drawer", {"anterior_N": 100.0}, "anterior", (30.0,), (0.0, 1.0, 0.0))
    curves = Curves(test, held, np.array([[0, 1]]), np.array([0.0, 1.0]), np.array([0, 1, 0]))
    found = curves.to_dataset()
    assert found.displacement.dims == ("flexion_deg", "step") and found.displacement.units == "mm"
    assert found.anterior_N.values.tolist() == [[0.0, 100.0, 0.0]]
    assert found.flexion_deg.values.tolist() == [30.0]


def test_rows_of_one_kind_are_joined_by_xarray():
    import xarray

    pose = np.arange(6.0)
    both = [Branch(0, pose, Status.BALANCED, by, 1.0, 2).to_dataset() for by in (True, False)]
    found = xarray.concat(both, "branch")
    assert found.apart_mm.dims == ("branch",) and found.status.values.tolist() == ["balanced"] * 2
    one = kj.Laxity("drawer", 30.0, "anterior", 9.0, 5.0, -4.0, 0.0, 20.0, 60.0, "mm",
                    90.0, -90.0, "own", Status.BALANCED).to_dataset()  # fmt: skip
    assert one.range.units == "mm" and float(one.flexion_deg) == 30.0


def test_a_calibration_has_its_parameters_motion_and_procedures():
    result = made_up.calibration()
    found = result.to_dataset()
    names = [one.name for one in result.fit.estimates]
    assert found.parameter.values.tolist() == names
    assert found.parameter_unit.values.tolist() == [one.unit for one in result.fit.estimates]
    assert found.value.sel(parameter=names[0])[0] == result.fit.estimates[0].value
    assert found.procedure.values.tolist() == [fit.procedure for fit in result.fits]
    assert found.fitted.sel(column="anterior_mm").shape == (len(result.fits), 25)
    assert found.ligament_force_N.sel(ligament="PCL").units == "N"
    assert found.rmse.sel(coordinate="lateral").coordinate_unit == "mm"


@pytest.mark.parametrize(
    ("made", "name", "over"),
    [
        (made_up_posterior, "draws", ("chain", "draw", "parameter")),
        (told, "eigenvectors", ("parameter", "combination")),
        (planned, "standard_errors", ("tests_made", "parameter")),
        (a_map, "objective", ("PCL.reference_strain", "PCL.stiffness")),
        (lambda: made_up_sweep().sweeps[0], "table", ("value", "load_case", "coordinate")),
        (lambda: made_up_slopes(["ACL.stiffness"]), "derivative",
         ("flexion_deg", "coordinate", "parameter")),
        (lambda: made_up_indices(["ACL.stiffness", "PCL.stiffness"]), "total_order",
         ("output", "parameter")),
        (lambda: compare_motions([0.0, 30.0, 60.0], np.arange(15.0).reshape(1, 3, 5),
                                 {"model": np.ones((1, 3, 5))}), "values",
         ("motion", "subject", "flexion_deg", "measure")),
        (lambda: CohortSummary("none", (), {}, {}, np.zeros((0, 0)), (), {}), "correlation",
         ("knee", "parameter", "other_parameter")),
    ],
)  # fmt: skip
def test_other_results_have_named_dimensions(made, name, over):
    one = made()
    found = one.to_dataset({"title": "a test"})
    assert found[name].dims == over and found.title == "a test"
    assert "coordinate" not in found.dims or found.coordinate.values.tolist() == [*FREE_COORDINATES]


def test_without_xarray_the_error_says_what_to_install(motion, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(MissingPackage, match=r"kneejax\[maps\]"):
        motion.to_dataset()
