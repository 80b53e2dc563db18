"""Menisci that give way, in knee files: read, mirrored, named, restated, refused."""

import copy

import jax
import numpy as np
import pytest

import kneejax as kj
from kneejax.files import InputProblem, load_knee_file, mirror_document, read_knee, restated
from tests.files.knee.knee_documents import changed, write

RING = {
    "youngs_modulus_MPa": 120.0, "cross_section_mm2": 30.0, "horn_stiffness_N_per_mm": 180.0,
    "coronary_stiffness_N_per_mm": 20.0, "middle_mm": [0.0, 0.5], "horns_deg": [-221.0, 41.0],
    "sections": 8,
}  # fmt: skip
PLACE = ["contacts", "medial_meniscus", "ring"]


@pytest.fixture(scope="module")
def document():
    """The average knee with a medial meniscus that moves."""
    document = copy.deepcopy(load_knee_file("average_knee").document)
    document["contacts"]["medial_meniscus"]["ring"] = copy.deepcopy(RING)
    return document


def test_a_ring_is_read_of_either_side_with_its_parameters(tmp_path, document):
    right = read_knee(write(tmp_path / "right.yaml", document)).knee
    left = read_knee(write(tmp_path / "left.yaml", mirror_document(document))).knee
    for a, b in zip(jax.tree.leaves(right), jax.tree.leaves(left), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    ring = right.contacts[right.contact_names.index("medial_meniscus")].ring
    assert ring.sections == 8 and float(ring.horns[1]) == pytest.approx(np.deg2rad(41.0))
    names = [f"medial_meniscus.{x}" for x in
             ("hoop_modulus", "cross_section", "horn_stiffness", "coronary_stiffness")]  # fmt: skip
    selection = kj.select(right, names)
    assert selection.read(right).tolist() == [120.0, 30.0, 180.0, 20.0]
    assert [selection.unit(k) for k in range(4)] == ["MPa", "mm²", "N/mm", "N/mm"]
    softer = right.replace({"medial_meniscus.horn_stiffness": 60.0})
    again = restated(document, softer, "a test")["contacts"]["medial_meniscus"]
    assert again["ring"] == RING | {"horn_stiffness_N_per_mm": 60.0}
    assert again["source"]["ring"] == "a test"


@pytest.mark.parametrize(
    ("field", "value", "words"),
    [
        ("horns_deg", [0.0, 5.0], "the second larger by 10 degrees at least, less than 360"),
        ("horn_stiffness_N_per_mm", -1.0, "expected between 0.001 and 1,000,000 N/mm"),
        ("sections", 1, "sections: 1: expected"),
        ("horns_deg", [-180.0, 41.0], "all of outline_mm lies, seen from middle_mm; it reaches 39"),
        ("middle_mm", [0.0, 0.0, 0.0], "middle_mm"),
        ("coronary_stiffness_N_per_mm", None, "missing"),
    ],
)
def test_mistakes_in_a_ring_are_named(tmp_path, document, field, value, words):
    wrong = changed(copy.deepcopy(document), [*PLACE, field], value)
    with pytest.raises(InputProblem) as caught:
        read_knee(write(tmp_path / "knee.yaml", wrong))
    assert ".".join(PLACE) in str(caught.value) and words in str(caught.value)


def test_a_patch_has_no_ring(tmp_path):
    document = copy.deepcopy(load_knee_file("four_ligament").document)
    document["contacts"]["medial"]["ring"] = RING
    with pytest.raises(InputProblem, match="no ring unless form is quadrature"):
        read_knee(write(tmp_path / "knee.yaml", document))


def test_a_ring_without_an_outline_is_refused(tmp_path, document):
    wrong = copy.deepcopy(document)
    del wrong["contacts"]["medial_meniscus"]["tibial_surface"]["outline_mm"]
    expected = "tibial_surface: plateau: expected a plateau with outline_mm, that of the meniscus"
    with pytest.raises(InputProblem, match=expected):
        read_knee(write(tmp_path / "knee.yaml", wrong))
