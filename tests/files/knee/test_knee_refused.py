"""Knee files that are refused: each mistake in a line that says what was expected."""

import copy

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kneejax.files import InputProblem, read_knee
from kneejax.mechanics import RANGES
from tests.files.knee.knee_documents import changed, write

WRAP = {
    "kind": "sphere", "bone": "tibia", "center_mm": [0, 0, 0], "radius_mm": 9.0,
    "source": "assumed",
}  # fmt: skip


CYLINDER = {**WRAP, "kind": "cylinder", "length_mm": 60.0}


def refusal(path):
    with pytest.raises(InputProblem) as caught:
        read_knee(path)
    for line in str(caught.value).split("\n"):
        assert line.startswith(f"{path}: ") and "expected " in line
    return str(caught.value)


ACL, MEDIAL = ["ligaments", "ACL"], ["contacts", "medial"]
CONDYLE, PLATEAU = [*MEDIAL, "femoral_surface"], [*MEDIAL, "tibial_surface"]


def test_two_parts_have_two_names(tmp_path, knee_document):
    """Tables of forces would have two rows of one name."""
    document = copy.deepcopy(knee_document)
    document = changed(document, ["contacts", "ACL"], document["contacts"]["medial"])
    said = refusal(write(tmp_path / "knee.yaml", document))
    assert "contacts: ACL: expected a name that no other part of the knee has" in said


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        ([*ACL, "stiffness_N"], None, "missing"),
        ([*ACL, "source"], None, "missing"),
        ([*ACL, "stifness_N"], 3.0, "did you mean stiffness_N?"),
        (["ligamentss"], {}, "did you mean ligaments?"),
        (["side"], "rihgt", "did you mean right?"),
        (["kneejax"], 2, "version"),
        ([*ACL, "stiffness_N"], -4500, "-4500"),
        ([*ACL, "stiffness_N"], 0, "between 0.001 and 10,000,000 N"),
        ([*ACL, "stiffness_N"], "4500 N", "a number"),
        ([*ACL, "stiffness_N"], True, "a number"),
        ([*ACL, "stiffness_N"], float("nan"), "finite"),
        ([*ACL, "stiffness_N"], 10**400, "finite"),
        ([*ACL, "reference_strain"], None, "exactly one of"),
        ([*ACL, "slack_length_mm"], 30.0, "exactly one of"),
        ([*ACL, "reference_strain"], -1.0, "between -0.9 and 0.5"),
        ([*ACL, "reference_strain"], 3.0, "percent"),
        ([*ACL, "transition_strain"], 0.0, "between 0.0001 and 0.5"),
        ([*ACL, "transition_width"], 0.0, "between 1e-07 and 0.5"),
        ([*ACL, "failure_strain"], 0.0, "between 0.001 and 1"),
        ([*ACL, "failure_strain"], 15.0, "percent"),
        ([*ACL, "failure_strian"], 0.15, "did you mean failure_strain?"),
        ([*ACL, "femoral_attachment_mm"], [1.0, 2.0], "3 numbers"),
        ([*ACL, "femoral_attachment_mm"], [1.0, 2.0, "x"], "femoral_attachment_mm[2]"),
        ([*ACL, "femoral_attachment_mm"], [900.0, 2.0, 0.0], "between 1 and 700 mm"),
        ([*ACL, "source"], {"stiffness_N": "paper"}, "missing"),
        (["ligaments", "PCL", "slack_length_mm"], 0, "between 1 and 700 mm"),
        (["ligaments", "PCL", "slack_length_mm"], 0.0365, "metres"),
        (["ligaments", "MCL", "reference_force_N"], 0, "between 1e-06 and 100,000 N"),
        (["ligaments", "a.b"], {}, "a name of letters"),
        (["ligaments"], [], "a mapping from a name"),
        (["wraps"], {"W": {"kind": "torus"}}, "one of sphere"),
        (["wraps"], {"W": {**WRAP, "radius_mm": 0.0}}, "between 1 and 1000 mm"),
        (["wraps"], {"W": {**WRAP, "bone": "pelvis"}}, "one of femur, tibia"),
        (["wraps"], {"W": {**WRAP, "side": "+x"}}, "no such field"),
        (["wraps"], {"W": {**CYLINDER, "side": "front"}}, "one of +x, -x, +y, -y"),
        (["ligaments", "ACL", "wrap"], "W", "no section wraps"),
        (["ligaments", "ACL", "via_points"], [{"bone": "fibula", "point_mm": [0, 0, 0]}], "femur"),
        (["ligaments", "ACL", "damping_N_s"], -1, "0, or between 1e-09 and 100,000 N s"),
        (["groups"], {"ACL": ["MCL"]}, "not a ligament's"),
        (["groups"], {"cruciates": ["ACL", "PLC"]}, "did you mean PCL"),
        ([*MEDIAL, "layer_variation_mm"], [[0.0]], "no layer_variation_mm unless"),
        ([*MEDIAL, "poisson_ratio"], 0.5, "between 0 and 0.4999"),
        ([*MEDIAL, "youngs_modulus_MPa"], 5e6, "Pa"),
        ([*MEDIAL, "layer_thickness_mm"], 0.006, "metres"),
        ([*MEDIAL, "law"], "lg", "did you mean log?"),
        ([*MEDIAL, "points"], [24, 24], "unless form is quadrature"),
        ([*MEDIAL, "source"], None, "missing"),
        ([*CONDYLE, "angle_deg"], [170, 10], "lower and a larger upper"),
        ([*CONDYLE, "angle_deg"], [0.2, 3.0], "radians"),
        ([*CONDYLE, "width_mm"], [-0.034, -0.012], "metres"),
        ([*CONDYLE, "coefficients_mm"], [[22.0, 1.0], [3.0]], "equal length"),
        ([*CONDYLE, "coefficients_mm"], [[5.0, 1.0], [9.0, 0.0]], "between 0.001 and 1000 mm"),
        ([*CONDYLE, "coefficients_mm"], [[0.022]], "metres"),
        ([*CONDYLE, "coefficients_mm"], [[1e5]], "between -10,000 and 10,000 mm"),
        ([*CONDYLE, "coefficients_mm"], [[5000]], "a radius between 1 and 1000 mm all over"),
        ([*CONDYLE, "source"], None, "missing"),
        ([*CONDYLE, "radius_mm"], 3.0, "no such field"),
        ([*CONDYLE, "kind"], "sphere", "no such field"),
        ([*PLATEAU, "lateral_mm"], [3.0, 3.0], "lower and a larger upper"),
        (["lines", "patellar_tendon", "origin_mm"], [1.0, 2.0, 3.0], "3 numbers"),
        ([*CONDYLE, "radius_mm"], [9.0, 9.0, 9.0], "no such field"),
        (["contacts", "lateral", "points"], [10**9, 24], "from 2 to 1000"),
        (["lines", "patellar_tendon", "tension_N"], 1e30, "between 1e-06 and 100,000 N"),
        (["lines", "patellar_tendon", "tension_N"], 1e-300, "between 1e-06 and 100,000 N"),
        (["loads", "weight", "force_N"], [0, 1e30, 0], "between -100,000 and 100,000 N"),
        (["loads", "weight", "moment_Nmm"], [1e30, 0, 0], "between -1,000,000 and 1,000,000 N mm"),
        ([*MEDIAL, "youngs_modulus_MPa"], 1e-300, "between 0.001 and 100,000 MPa"),
        ([*MEDIAL, "onset_width_mm"], 1e-300, "between 1e-06 and 5 mm"),
        (["loads", "weight", "axes"], "tibea", "did you mean tibia?"),
        (["loads", "weight", "point_mm"], None, "missing"),
        (["adaptations"], [{"field": "x"}], "missing"),
        (["reference_pose", "flexion_deg"], 400, "between -30 and 180 degrees"),
    ],
)
def test_a_bad_field_is_refused(tmp_path, place, value, words, knee_document):
    line = refusal(write(tmp_path / "k.yaml", changed(knee_document, place, value)))
    assert words in line
    assert place[0].split(".")[0] in line


@pytest.mark.parametrize("surface", [
    {"kind": "sphere", "center_mm": [0, 0, 0], "radius_mm": 0, "source": "x"},
    {"kind": "sphere", "center_mm": [0, 0, 0], "radius_mm": 0.02, "source": "x"},
    {"kind": "ellipsoid", "center_mm": [0, 0, 0], "semi_axes_mm": [20, -1, 20], "source": "x"},
    {"kind": "plane", "origin_mm": [0, 0, 0], "half_extent_mm": [0, 1], "source": "x"},
    {"kind": "cone"}, "sphere", {},
])  # fmt: skip
def test_a_bad_surface_is_refused(tmp_path, surface, knee_document):
    path = write(tmp_path / "k.yaml", changed(knee_document, CONDYLE, surface))
    assert "contacts.medial.femoral_surface" in refusal(path)


def test_metres_are_suspected(tmp_path, knee_document):
    document = knee_document
    for ligament in document["ligaments"].values():
        for end in ("femoral_attachment_mm", "tibial_attachment_mm"):
            ligament[end] = [x / 1000 for x in ligament[end]]
    pose = document["reference_pose"]
    pose |= {name: pose[name] / 1000 for name in pose if name.endswith("_mm")}
    assert "metres are suspected" in refusal(write(tmp_path / "k.yaml", document))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b" \n\n", "empty"),
        (b"\x89PNG\x00\x01", "binary"),
        (b"name: \xff\xfe", "UTF-8"),
        (b"name: [1, 2\nside: right", "line 2"),
        (b"name: a\nname: b\n", "the key name twice"),
        (b"? [1, 2]\n: b\n", "well-formed YAML"),
        (b"!!python/object:os.system {}", "well-formed YAML"),
        (b"- 1\n- 2\n", "a mapping"),
        (b"just text", "a mapping"),
        (b"name: \x01", "well-formed YAML"),
        (b"a: " + b"[" * 3000, "well-formed YAML"),
    ],
)
def test_a_file_that_is_no_knee(tmp_path, content, words):
    path = tmp_path / "k.yaml"
    path.write_bytes(content)
    assert words in refusal(path)


def test_a_directory_and_a_missing_file(tmp_path, knee_document):
    assert "a folder" in refusal(tmp_path)
    write(tmp_path / "mine.yaml", knee_document)
    assert "did you mean mine.yaml?" in refusal(tmp_path / "mime.yaml")


@settings(
    max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(
    field=st.sampled_from(["stiffness_N", "reference_strain", "transition_strain"]),
    value=st.floats(allow_nan=False, allow_infinity=False),
)
def test_a_number_in_a_file_is_refused_if_and_only_if_no_knee_has_it(
    tmp_path, knee_document, field, value
):
    document = changed(copy.deepcopy(knee_document), [*ACL, field], value)
    path = write(tmp_path / "k.yaml", document)
    if RANGES[field].holds(value):
        read_knee(path)
    else:
        line = refusal(path)
        assert f"ligaments.ACL.{field}: " in line and str(RANGES[field]) in line
