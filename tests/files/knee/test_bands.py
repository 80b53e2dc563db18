"""Bands of a knee file: read as fibres, of either side, with parameters of their own."""

import copy
import dataclasses
from pathlib import Path

import jax
import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.files import InputProblem, load_knee_file, mirror_document, read_knee, write_knee
from kneejax.parameters import UnknownParameter, default_bounds
from tests.files.knee.knee_documents import changed, write

TURNS = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
BAND = {
    "femoral_area": {"centre_mm": [-3.0, 0.5, 5.0], "half_axes_mm": [[0.0, 6.0, 1.0], [4.0, 0, 0]]},
    "tibial_area": {
        "outline_mm": [[14.0 + 8 * np.cos(t), -25.0, -1.0 + 5 * np.sin(t)] for t in TURNS]
    },
    "youngs_modulus_MPa": 120.0,
    "area_mm2": 40.0,
    "prestretch": [1.0, 1.04],
    "law": "neo_hookean",
    "transition_width": 0.001,
    "fibres": 6,
    "source": "made up",
}


@pytest.fixture
def document():
    """four_ligament with a band for its ACL."""
    document = copy.deepcopy(load_knee_file("four_ligament").document)
    del document["ligaments"]["ACL"]
    document.pop("adaptations", None)
    return document | {"bands": {"ACL": copy.deepcopy(BAND)}}


def test_a_band_is_read_as_a_group_of_fibres(tmp_path, document):
    read = read_knee(write(tmp_path / "knee.yaml", document))
    fibres, (group,) = read.knee.ligaments, read.knee.groups
    assert group == ("ACL", tuple(f"ACL{k}" for k in range(1, 7)))
    own = np.array([name in group[1] for name in fibres.names])
    assert fibres.area[own].sum() == pytest.approx(40.0)
    assert fibres.stiffness[own].sum() == pytest.approx(4800.0)
    assert np.all(np.array(fibres.laws)[own] == "neo_hookean")
    strain = np.asarray(read.knee.reference_strain())[own]
    assert strain.mean() == pytest.approx(0.02) and np.ptp(strain) > 0.02
    assert read.sources["ligaments.ACL1"] == "band ACL: made up"
    # What was read can be written, and read again.
    write_knee(read.document, tmp_path / "again.yaml")
    again = read_knee(tmp_path / "again.yaml").knee
    for a, b in zip(jax.tree.leaves(read.knee), jax.tree.leaves(again), strict=True):
        np.testing.assert_array_equal(a, b)


def test_a_left_band_is_the_mirror_image(tmp_path, document):
    """Also where the reference pose, by which areas are paired, is turned."""
    document["reference_pose"] |= {"adduction_deg": 10.0, "internal_rotation_deg": 25.0}
    right = read_knee(write(tmp_path / "right.yaml", document)).knee
    left = read_knee(write(tmp_path / "left.yaml", mirror_document(document))).knee
    for a, b in zip(jax.tree.leaves(right), jax.tree.leaves(left), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)


@pytest.mark.parametrize("half", ["anterior", "medial"])
def test_half_of_an_area_is_that_of_the_same_side_of_either_knee(tmp_path, document, half):
    """The half towards which it lies, with its mean and its spread, and half the fibres' width."""
    document["bands"]["ACL"]["tibial_area"]["half"] = half
    right = read_knee(write(tmp_path / "right.yaml", document)).knee
    left = read_knee(write(tmp_path / "left.yaml", mirror_document(document))).knee
    for a, b in zip(jax.tree.leaves(right), jax.tree.leaves(left), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9)
    del document["bands"]["ACL"]["tibial_area"]["half"]
    whole = read_knee(write(tmp_path / "whole.yaml", document)).knee
    column, sign = {"anterior": (0, 1.0), "medial": (2, -1.0)}[half]
    own = [name.startswith("ACL") for name in whole.ligaments.names]
    ends = [np.asarray(k.ligaments.tibial_attachment)[own, column] for k in (whole, right)]
    assert sign * (ends[1].mean() - ends[0].mean()) > 0.2 * np.ptp(ends[0])
    assert 0.4 < np.ptp(ends[1]) / np.ptp(ends[0]) < 0.7
    ends = [np.asarray(k.ligaments.femoral_attachment)[own] for k in (whole, right)]
    np.testing.assert_array_equal(*ends)


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (["tibial_area", "half"], "front", "half: front: expected"),
        (["youngs_modulus_MPa"], 120e6, "youngs_modulus_MPa: 120000000.0: expected between"),
        (["prestretch"], 3.0, "prestretch: 3.0: expected between 0.1 and 1.5"),
        (["prestretch"], [1.0, 1.1, 1.2], "prestretch"),
        (["law"], "hookean", "law: hookean: expected"),
        (["transition_strain"], 0.06, "only with that"),
        (["fibres"], 0, "fibres: 0: expected"),
        (["area"], 40.0, "did you mean area_mm2?"),
        (["wrap"], "bone", "the file has no section wraps"),
        (["femoral_area", "half_axes_mm"], [[0.0, 6.0, 1.0]], "two half diameters"),
        (["tibial_area", "centre_mm"], [0.0, 0.0, 0.0], "centre_mm and half_axes_mm, or outline"),
        (["tibial_area", "outline_mm"], [[0.0, 0.0, z] for z in range(5)], "on a line"),
    ],
)
def test_mistakes_in_a_band_are_named(tmp_path, document, place, value, words):
    path = write(tmp_path / "knee.yaml", changed(document, ["bands", "ACL", *place], value))
    with pytest.raises(InputProblem) as caught:
        read_knee(path)
    assert str(caught.value).startswith(f"{path}: bands.ACL") and words in str(caught.value)


def test_a_band_may_not_be_called_as_a_ligament_is(tmp_path, document):
    document["bands"]["MCL"] = document["bands"].pop("ACL")
    with pytest.raises(InputProblem, match="bands: MCL: expected a band whose name"):
        read_knee(write(tmp_path / "knee.yaml", document))


def test_material_and_prestretch_are_parameters_of_bands_alone(tmp_path, document):
    knee = read_knee(write(tmp_path / "knee.yaml", document)).knee
    names = ["ACL.youngs_modulus", "ACL.area", "ACL.prestretch"]
    np.testing.assert_allclose(kj.select(knee, names).read(knee), [120.0, 40.0, 1.02])
    other = knee.replace({"ACL.area": 20.0, "ACL.prestretch": 1.05})
    found = kj.select(other, [*names, "ACL.stiffness"][1:]).read(other)
    np.testing.assert_allclose(found, [20.0, 1.05, 2400.0])
    lower, upper = default_bounds(knee, kj.select(knee, names))
    np.testing.assert_allclose([*lower, *upper], [60.0, 20.0, 0.8, 240.0, 80.0, 1.2])
    stiff = knee.replace({"ACL.youngs_modulus": 240.0})
    np.testing.assert_allclose(
        stiff.ligaments.stiffness[-6:], 2.0 * knee.ligaments.stiffness[-6:], rtol=1e-13
    )
    for name in ("PCL.youngs_modulus", "PCL.prestretch"):
        with pytest.raises(UnknownParameter):
            kj.select(knee, [name])
    with pytest.raises(UnknownParameter, match="are one number"):
        kj.select(knee, ["ACL.youngs_modulus", "ACL.stiffness"])
    with pytest.raises(UnknownParameter, match="give one number"):
        knee.replace({"ACL.prestretch": 1.0, "ACL.slack_length": 30.0})


def test_a_poses_slopes_by_material_area_and_prestretch_are_differences(
    hinged_knee, central_difference
):
    fibres = dataclasses.replace(
        hinged_knee.ligaments, area=np.full(8, 30.0), laws=("neo_hookean",) * 8
    )
    groups = (("band", ("ACL", "cage4", "cage6")),)
    pulled = kj.load_of(anterior_N=20.0, varus_Nm=0.5)
    knee = dataclasses.replace(hinged_knee, ligaments=fibres, groups=groups, loads=(pulled,))
    names = ["band.youngs_modulus", "band.prestretch", "PCL.area"]
    selection = kj.select(knee, names)
    at = np.asarray(selection.read(knee))

    def pose(values):
        motion = kj.passive_flexion(selection.apply(knee, values), np.array([20.0]))
        return np.asarray(motion.to_table())[0, 1:]

    step = np.array([1.0, 1e-3, 0.3])
    slope = central_difference(lambda x: pose(at + step * x), np.zeros(3), 0.5) / step
    found = kj.local_sensitivity(knee, names, [20.0]).derivative[0]
    assert np.abs(found).max(axis=0).min() > 1e-4  # each of them moves the tibia
    np.testing.assert_allclose(found, slope, rtol=1e-6, atol=1e-8)


def test_the_example_of_the_page_on_bands_is_read(tmp_path, document):
    page = (Path(__file__).parents[3] / "docs" / "bands.md").read_text(encoding="utf-8")
    document["bands"] = yaml.safe_load(page.split("```yaml\n")[1].split("```")[0])["bands"]
    knee = read_knee(write(tmp_path / "knee.yaml", document)).knee
    assert len(dict(knee.groups)["ACL"]) == 24
    assert float(kj.select(knee, ["ACL.prestretch"]).read(knee)[0]) == pytest.approx(1.02)
