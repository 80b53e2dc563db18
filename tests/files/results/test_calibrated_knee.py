"""The knee of a calibration: from its result.json, and as a knee file of its own."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.files import (
    InputProblem,
    bundled_path,
    load_knee_file,
    read_calibrated,
    write_calibrated_knee,
)
from kneejax.parameters import MEANING, UnknownParameter, fibres_summed

FOUND = {
    "ACL.reference_strain": 0.05, "ACL.femoral_attachment.anterior": -3.0, "PCL.stiffness": 5000.0,
    "medial.youngs_modulus": 7.0, "medial.tibial_surface.superior": -20.0,
}  # fmt: skip


def result(folder, knee="four_ligament", **changes):
    document = {
        "title": "Specimen 7",
        "parameters": {name: {"value": value} for name, value in FOUND.items()},
        "frame_offset": {"lateral": {"value": 3.0}},
        "settings": {
            "knee": str(knee), "path": "specimen7.yaml",
            "overrides": {"MCL.stiffness": 2000.0}, "start": {"LCL.stiffness": 1500.0},
        },
    }  # fmt: skip
    path = folder / "result.json"
    path.write_text(json.dumps(document | changes))
    return path


def expected():
    knee = kj.load_knee("four_ligament")
    knee = knee.replace({"MCL.stiffness": 2000.0, "LCL.stiffness": 1500.0})
    return kj.select(knee, tuple(FOUND)).apply(knee, jnp.array([*FOUND.values()]))


def test_the_file_and_the_result_are_the_knee_that_was_found(tmp_path):
    """Of a strain and a point that are found together, the strain holds where the point is."""
    path = result(tmp_path)
    write_calibrated_knee(path, tmp_path / "knee.yaml")
    for place in (path, tmp_path / "knee.yaml"):
        read = load_knee_file(place)
        for one, two in zip(jax.tree.leaves(read.knee), jax.tree.leaves(expected()), strict=True):
            np.testing.assert_allclose(one, two, rtol=1e-12, atol=0.0)
        assert read.knee.name == "four_ligament calibrated"
        said = read.sources
        assert said["ligaments.PCL.stiffness_N"] == "calibration: Specimen 7 (specimen7.yaml)"
        assert said["ligaments.MCL.stiffness_N"].startswith("set by the study: Specimen 7")
        assert said["ligaments.ACL.stiffness_N"] == "paper 1, Table 1"
    text = (tmp_path / "knee.yaml").read_text()
    assert text.startswith("# The knee that a calibration found: Specimen 7")
    assert "Comments of the file that it was made of are lost" in text and "lateral 3" in text


def test_a_calibrated_knee_may_be_calibrated_again(tmp_path):
    path = result(tmp_path)
    (tmp_path / "again").mkdir()
    again = result(tmp_path / "again", path, parameters={"ACL.stiffness": {"value": 4000.0}})
    read = load_knee_file(again)
    assert read.knee.name == "four_ligament calibrated"
    assert float(read.knee.ligaments.stiffness[0]) == 4000.0
    assert read.document["ligaments"]["PCL"]["stiffness_N"] == 5000.0


def test_the_knee_that_was_calibrated_is_not_overwritten(tmp_path):
    knee = tmp_path / "knee.yaml"
    text = bundled_path("knees", "four_ligament").read_text()
    knee.write_text(text)
    with pytest.raises(InputProblem, match="another file than the knee that is calibrated"):
        write_calibrated_knee(result(tmp_path, knee), knee)
    assert knee.read_text() == text


def test_what_a_result_may_not_say_is_named(tmp_path):
    path = result(tmp_path, frame_offset={"latral": {"value": 3.0}})
    with pytest.raises(InputProblem, match="frame_offset: latral: .*did you mean lateral"):
        read_calibrated(path)
    path = result(tmp_path, parameters={"ACL.stifness": {"value": 3.0}})
    with pytest.raises(UnknownParameter, match=r"result.json: unknown parameter 'ACL\.stifness'"):
        kj.load_knee(path)
    with pytest.raises(InputProblem, match="parameters.ACL.stiffness.value"):
        kj.load_knee(result(tmp_path, parameters={"ACL.stiffness": {"value": None}}))


def test_a_knee_that_was_calibrated_with_its_patella_has_the_numbers_of_it(tmp_path):
    found = {"PTc.slack_length": 47.0, "vasint.tension": 30.0, "ACL.stiffness": 4000.0}
    document = {
        "parameters": {name: {"value": value} for name, value in found.items()},
        "settings": {"knee": "four_ligament", "patella": True, "overrides": {}, "start": {}},
    }
    path = result(tmp_path, **document)
    write_calibrated_knee(path, tmp_path / "knee.yaml")
    for place in (path, tmp_path / "knee.yaml"):
        knee = kj.load_knee(place, patella=True)
        assert kj.select(knee, tuple(found)).read(knee).tolist() == list(found.values())
        two = kj.load_knee(place)
        assert two.bodies == ("tibia",) and float(two.ligaments.stiffness[0]) == 4000.0


@pytest.mark.parametrize("marked", [False, True])
def test_an_older_result_has_means_of_fibres_which_become_sums(marked, tmp_path):
    """Of values that were found, of those that the study set, and of their errors."""
    knee = kj.load_knee("lenhart2015_reduced")
    values = {"ACL.stiffness": 4000.0, "MCL.slack_length": 75.0, "LCL.stiffness": 2000.0}
    settings = {"knee": "lenhart2015_reduced", "overrides": {"MCL.stiffness": 2100.0}, "start": {}}
    found = {n: {"value": x, "standard_error": 10.0} for n, x in values.items()}
    path = result(tmp_path, parameters=found, settings=settings, **MEANING if marked else {})
    read = read_calibrated(path).of_structures(knee)
    times = {} if marked else {"ACL.stiffness": 2.0, "MCL.stiffness": 3.0}
    expected = values | {"MCL.stiffness": 2100.0}
    assert read.values == {n: x * times.get(n, 1.0) for n, x in expected.items()}
    assert read.standard_error == {n: 10.0 * times.get(n, 1.0) for n in values}
    assert read.of_structures(knee) is read
    calibrated = kj.load_knee(path)
    names = [*read.values]
    assert [fibres_summed(knee, name) for name in names] == [3, 2, 1, 1]
    np.testing.assert_allclose(
        kj.select(calibrated, names).read(calibrated), [*read.values.values()], rtol=1e-12
    )


def test_a_result_whose_stiffness_is_of_something_else_is_refused(tmp_path):
    with pytest.raises(InputProblem, match="stiffness_of: fibre: expected one of structure"):
        read_calibrated(result(tmp_path, stiffness_of="fibre"))
