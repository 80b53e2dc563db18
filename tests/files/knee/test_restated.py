"""A knee document with the numbers of a knee: read back, it is that knee."""

import copy

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.files import load_knee_file, mirror_document, restated
from kneejax.files.knee.file import build_knee
from kneejax.parameters import select

SPHERE = {
    "kind": "sphere", "bone": "femur", "center_mm": [0.0, -25.0, -42.0], "radius_mm": 3.0,
    "source": "assumed",
}  # fmt: skip


CYLINDER = {
    "kind": "cylinder", "bone": "femur", "center_mm": [0.0, -20.0, 42.0], "radius_mm": 2.0,
    "length_mm": 30.0, "side": "+x", "source": "assumed",
}  # fmt: skip


def everything(document):
    """The same with what a knee may have besides: via points, obstacles, an outline."""
    document = copy.deepcopy(document)
    points = [{"bone": "tibia", "point_mm": [1.0, -30.0, -46.0]}]
    document["wraps"] = {"knob": SPHERE, "rod": CYLINDER}
    document["ligaments"]["PCL"]["wrap"] = "rod"
    document["ligaments"]["MCL"] |= {"via_points": points, "wrap": "knob"}
    document["ligaments"]["ACL"]["via_points"] = [{"bone": "femur", "point_mm": [0.0, 1.0, 2.0]}]
    document["ligaments"]["ACL"]["source"] = "paper, Table 1"
    return document


def nudged(knee, rng):
    """Every number of a knee a little different, but for the reference pose and what is zero."""
    def nudge(x):
        return jnp.asarray(x) * (1.0 + 1e-3 * rng.uniform(-1.0, 1.0, np.shape(x)))

    still = lambda k: (k.reference_pose, k.other_bones)  # noqa: E731
    return eqx.tree_at(still, jax.tree.map(nudge, knee), still(knee))


def assert_same(knee, other):
    leaves, others = jax.tree.leaves(knee), jax.tree.leaves(other)
    for one, two in zip(leaves, others, strict=True):
        np.testing.assert_allclose(one, two, rtol=1e-12, atol=1e-300)


@pytest.mark.parametrize("side", ["right", "left"])
def test_every_number_of_a_knee_is_read_back(knee_document, side, rng):
    document = everything(knee_document)
    if side == "left":
        document = mirror_document(document)
    before = copy.deepcopy(document)
    read = build_knee(document, "knee.yaml")
    assert restated(document, read.knee, "nobody") == document
    knee = nudged(read.knee, rng)
    found = restated(document, knee, "our robot")
    again = build_knee(found, "again.yaml")
    assert_same(again.knee, knee)
    assert document == before and found["side"] == side
    assert again.sources["ligaments.ACL.stiffness_N"] == "our robot"
    assert again.sources["wraps.knob.radius_mm"] == "our robot"
    # A surface has one source, which keeps what it said and says what has changed.
    surface = again.sources["contacts.medial.tibial_surface"]
    assert surface.startswith("fitted; ") and surface.endswith("coefficients_mm: our robot")
    # Other numbers keep their source, and a strain stays a strain.
    one = restated(document, read.knee.replace({"ACL.stiffness": 4000.0}), "our robot")
    sources = build_knee(one, "one.yaml").sources
    assert sources["ligaments.ACL.stiffness_N"] == "our robot"
    assert sources["ligaments.ACL.reference_strain"] == "paper, Table 1"
    assert one["ligaments"]["MCL"] == document["ligaments"]["MCL"]


@pytest.mark.parametrize(
    "names",
    [
        ("*.stiffness", "*.reference_strain"),
        ("*.reference_strain", "ACL.femoral_attachment"),
        ("MCL.slack_length", "ACL.tibial_attachment.superior", "medial.youngs_modulus"),
        ("MCL.stiffness", "medial.tibial_surface.superior", "knob.radius", "MCL.transition_strain"),
    ],
)
def test_parameters_are_read_back(knee_document, names, rng):
    document = everything(knee_document)
    read = build_knee(document, "knee.yaml")
    names = tuple(name.replace("knob.", "MCL.") for name in names)
    chosen = select(read.knee, names)
    values = np.asarray(chosen.read(read.knee)) * (1.0 + 0.02 * rng.uniform(-1, 1, len(chosen)))
    knee = chosen.apply(read.knee, jnp.asarray(values))
    again = build_knee(restated(document, knee, "our robot"), "again.yaml").knee
    assert_same(again, knee)
    np.testing.assert_allclose(chosen.read(again), values, rtol=1e-12)


def test_a_force_becomes_a_length_and_a_strain_that_no_fibre_has_too(knee_document):
    read = build_knee(knee_document, "knee.yaml")
    assert restated(knee_document, read.knee, "x")["ligaments"]["MCL"]["reference_force_N"] == 20.0
    knee = read.knee.replace({"MCL.stiffness": 3000.0, "ACL.slack_length": 5.0})
    fibres = restated(knee_document, knee, "our robot")["ligaments"]
    assert "reference_force_N" not in fibres["MCL"] and fibres["MCL"]["slack_length_mm"] > 1.0
    assert fibres["ACL"]["slack_length_mm"] == 5.0 and "reference_strain" not in fibres["ACL"]
    assert_same(build_knee(restated(knee_document, knee, "x"), "knee.yaml").knee, knee)


def test_an_obstacle_that_two_courses_share_becomes_two(knee_document):
    document = everything(knee_document)
    document["ligaments"]["PCL"] |= {"wrap": "knob"}
    del document["wraps"]["rod"]
    read = build_knee(document, "knee.yaml")
    knee = read.knee.replace({"MCL.radius": 2.5})
    found = restated(document, knee, "our robot")
    radii = {name: wrap["radius_mm"] for name, wrap in found["wraps"].items()}
    assert sorted(radii.values()) == [2.5, 3.0] and len(radii) == 2
    assert found["ligaments"]["PCL"]["wrap"] != found["ligaments"]["MCL"]["wrap"]
    assert_same(build_knee(found, "knee.yaml").knee, knee)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["lenhart2015", "lenhart2015_reduced"])
def test_bundled_knees_are_read_back(name, rng):
    read = load_knee_file(name)
    knee = nudged(read.knee, rng)
    assert_same(build_knee(restated(read.document, knee, "us"), "knee.yaml").knee, knee)


def test_a_strain_is_one_along_via_points(knee_document):
    """Once it was taken along the straight line wherever no fibre went around something."""
    document = everything(knee_document)
    del document["ligaments"]["MCL"]["wrap"]
    strain = build_knee(document, "knee.yaml").knee.reference_strain()
    np.testing.assert_allclose(strain[0], 0.03, rtol=1e-12)


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("name", ["lenhart2015_reduced", "four_ligament"])
def test_every_number_of_a_knee_with_its_patella_is_read_back(name, side, rng):
    """Of the tendon around its ellipsoid, the groove, the heads of the quadriceps too."""
    document = load_knee_file(name).document
    if side == "left":
        document = mirror_document(document)
    before, read = copy.deepcopy(document), build_knee(document, "knee.yaml")
    assert restated(document, read.with_patella(), "nobody") == document
    knee = nudged(read.with_patella(), rng)
    found = restated(document, knee, "our robot")
    again = build_knee(found, "again.yaml")
    assert_same(again.with_patella(), knee)
    assert document == before and again.sources["patella.ligaments.PTc.stiffness_N"] == "our robot"
