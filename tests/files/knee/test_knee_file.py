import copy
import pickle

import jax
import numpy as np
import pytest
import yaml

from kneejax.files import (
    InputProblem,
    bundled_knees,
    bundled_path,
    format_knee,
    load_knee,
    load_knee_file,
    mirror_document,
    read_knee,
    restated,
    write_knee,
)
from kneejax.geometry import Pose, State
from kneejax.mechanics import AXES, ligament_law
from tests.files.knee.knee_documents import changed, write

WRAP = {
    "kind": "sphere", "bone": "tibia", "center_mm": [0, 0, 0], "radius_mm": 9.0,
    "source": "assumed",
}  # fmt: skip


def test_round_trip(tmp_path, knee_document):
    document = knee_document
    path = write(tmp_path / "small.yaml", document)
    found = read_knee(path)
    assert found.document == document
    assert format_knee(found.document) == format_knee(document)
    assert found.knee.name == "small" and found.knee.side == "right"
    assert found.knee.contact_names == ("medial", "lateral")
    assert found.knee.ligaments.names == ("ACL", "PCL", "MCL")
    assert found.sources["ligaments.ACL"] == "paper, Table 1"
    assert found.sources["ligaments.PCL.slack_length_mm"] == "1e-3"
    assert found.sources["contacts.medial.tibial_surface"] == "fitted"
    assert found.document["adaptations"][0]["to"] == 4500


def test_text_is_plain_yaml_too(tmp_path, knee_document):
    document = knee_document
    assert yaml.safe_load(format_knee(document)).keys() == document.keys()
    assert "    femoral_attachment_mm: [-8.0, -2.0, 6.5]\n" in format_knee(document)


def test_writing_orders_fields_and_keeps_digits(tmp_path, knee_document):
    document = knee_document
    ligament = document["ligaments"]["ACL"]
    shuffled = dict(reversed(document.items()))
    shuffled["ligaments"] = dict(document["ligaments"], ACL=dict(reversed(ligament.items())))
    assert format_knee(shuffled) == format_knee(document)
    ligament["femoral_attachment_mm"] = np.array([-1 / 3, 1e-7, 6.5])
    path = tmp_path / "made" / "small.yaml"
    write_knee(document, path)
    point = read_knee(path).knee.ligaments.femoral_attachment[0]
    np.testing.assert_array_equal(point, [-1 / 3, 1e-7, 6.5])
    assert [p.name for p in path.parent.iterdir()] == ["small.yaml"]


def test_a_faulty_document_is_not_written(tmp_path, knee_document):
    path = tmp_path / "small.yaml"
    with pytest.raises(InputProblem, match="ligaments.ACL.stiffness_N"):
        write_knee(changed(knee_document, ["ligaments", "ACL", "stiffness_N"], -1), path)
    assert not path.exists()


def test_a_knee_may_lack_ligaments_or_contacts_but_not_both(tmp_path, knee_document):
    bare = changed(copy.deepcopy(knee_document), ["ligaments"], {})
    assert read_knee(write(tmp_path / "bare.yaml", bare)).knee.ligaments.names == ()
    loose = changed(copy.deepcopy(knee_document), ["contacts"], {})
    assert read_knee(write(tmp_path / "loose.yaml", loose)).knee.contacts == ()
    with pytest.raises(InputProblem, match="or contacts"):
        read_knee(write(tmp_path / "k.yaml", changed(bare, ["contacts"], {})))


def test_a_surface_may_wait_for_its_contact(tmp_path, knee_document):
    """Kept, mirrored with the rest, and no part of the mechanics."""
    document = copy.deepcopy(knee_document)
    surface = copy.deepcopy(document["contacts"]["medial"]["tibial_surface"])
    document["surfaces"] = {"patella": surface}
    found = read_knee(write(tmp_path / "k.yaml", document))
    assert found.document == document and list(found.surfaces) == ["patella"]
    assert found.sources["surfaces.patella"] == "fitted"
    assert len(jax.tree.leaves(found.knee)) == len(
        jax.tree.leaves(read_knee(write(tmp_path / "without.yaml", knee_document)).knee)
    )
    twin = mirror_document(document)
    assert twin["surfaces"] == {"patella": twin["contacts"]["medial"]["tibial_surface"]}
    write_knee(twin, tmp_path / "left.yaml")
    left = read_knee(tmp_path / "left.yaml").surfaces["patella"]
    for a, b in zip(
        jax.tree.leaves(left), jax.tree.leaves(found.surfaces["patella"]), strict=True
    ):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)
    faulty = changed(copy.deepcopy(document), ["surfaces", "patella", "kind"], "plato")
    with pytest.raises(InputProblem, match=r"surfaces\.patella\.kind.*did you mean plateau"):
        read_knee(write(tmp_path / "faulty.yaml", faulty))
    document["surfaces"]["patela"] = document["surfaces"].pop("patella")
    with pytest.raises(InputProblem, match="patella"):
        read_knee(write(tmp_path / "slip.yaml", document))


def test_slack_lengths(tmp_path, knee_document):
    knee = read_knee(write(tmp_path / "k.yaml", knee_document)).knee
    lengths, strain = knee.reference_length(), knee.reference_strain()
    np.testing.assert_allclose(strain[0], 0.03, rtol=1e-12)
    np.testing.assert_allclose(knee.ligaments.slack_length[1], 36.5)
    force = knee.ligaments.tension(knee.at_reference)
    np.testing.assert_allclose(force[2], 20.0, rtol=1e-9)
    assert 10 < float(lengths.min()) and float(lengths.max()) < 100
    exact = ligament_law.exact_tension(strain[2], 2750.0, 0.06)
    assert abs(exact - 20.0) <= ligament_law.largest_tension_error(2750.0, 0.06, 0.001)


@pytest.mark.parametrize("as_file", [True, False])
def test_left_twin_gives_the_same_knee(tmp_path, as_file, knee_document):
    document = knee_document
    twin = mirror_document(document)
    assert twin["side"] == "left"
    assert mirror_document(twin) == document
    if as_file:
        write_knee(twin, tmp_path / "left.yaml")
    else:
        write(tmp_path / "left.yaml", twin)
    left = read_knee(tmp_path / "left.yaml").knee
    right = read_knee(write(tmp_path / "right.yaml", document)).knee
    assert (left.side, right.side) == ("left", "right")
    for a, b in zip(jax.tree.leaves(left), jax.tree.leaves(right), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("axes", AXES)
def test_mirror_is_a_reflection_of_space(tmp_path, knee_document, axes):
    """Build the left twin as if it were right: lengths, surfaces and wrenches are mirrored."""
    document = changed(knee_document, ["loads", "weight", "axes"], axes)
    twin = mirror_document(document) | {"side": "right"}
    pose = Pose.from_table([40.0, 3.0, -7.0, 2.0, -25.0, 4.0])
    mirrored_pose = Pose.from_table([40.0, -3.0, 7.0, 2.0, -25.0, -4.0])
    document["reference_pose"] |= {"adduction_deg": 0, "internal_rotation_deg": 0, "lateral_mm": 0}
    twin["reference_pose"] = document["reference_pose"]
    knee = read_knee(write(tmp_path / "a.yaml", document)).knee
    other = read_knee(write(tmp_path / "b.yaml", twin)).knee
    here, there = State({"tibia": pose}), State({"tibia": mirrored_pose})
    np.testing.assert_allclose(other.ligaments.length(there), knee.ligaments.length(here))
    for contact, reflected in zip(knee.contacts, other.contacts, strict=True):
        for part in ("femoral", "tibial"):
            surface, image = getattr(contact, part), getattr(reflected, part)
            (a0, a1), (b0, b1) = surface.bounds()
            for s, t in ((0.2, 0.3), (0.7, 0.9)):
                a, b = a0 + s * (a1 - a0), b0 + t * (b1 - b0)
                point = np.array(surface.frame.placement.apply(surface.point(a, b)))
                found = np.array(image.frame.placement.apply(image.point(a, -b)))
                np.testing.assert_allclose(found, point * [1, 1, -1], atol=1e-12)
    np.testing.assert_allclose(other.lines[0].energy(there), knee.lines[0].energy(here))
    wrench = knee.loads[0].wrench(pose.placement)
    image = other.loads[0].wrench(mirrored_pose.placement)
    np.testing.assert_allclose(
        np.array(image.force), np.array(wrench.force) * [1, 1, -1], atol=1e-9
    )
    np.testing.assert_allclose(
        np.array(image.moment), np.array(wrench.moment) * [-1, -1, 1], atol=1e-9
    )


def test_yaml_scalars_mean_what_they_look_like(tmp_path, knee_document):
    text = format_knee(knee_document)
    text = text.replace("name: small", "name: no").replace("0.001", "1e-3")
    path = tmp_path / "k.yaml"
    path.write_text("\ufeff" + text, encoding="utf-8")
    knee = read_knee(path).knee
    assert knee.name == "no"
    np.testing.assert_array_equal(knee.ligaments.transition_width, 0.001)


def test_texts_that_look_like_numbers_come_back(tmp_path, knee_document):
    for text in ("1e-3", "10:50:5", "true", "~", "a: b", "1.0", "# x", "two\nlines"):
        document = changed(knee_document, ["notes"], text)
        found = read_knee(write(tmp_path / "k.yaml", document)).document
        assert found["notes"] == text


def test_load_by_name_and_by_path(tmp_path, monkeypatch, knee_document):
    path = write(tmp_path / "mine.yaml", knee_document)
    assert load_knee(path).name == load_knee_file(str(path)).knee.name == "small"
    with pytest.raises(InputProblem, match="a bundled knee"):
        load_knee("no_such_knee")
    with pytest.raises(InputProblem, match="did you mean knees?"):
        bundled_path("knee", "x")
    with pytest.raises(InputProblem, match="knees: no_such_knee: expected one of"):
        bundled_path("knees", "no_such_knee")
    monkeypatch.setattr("kneejax.files._bundled._data_folder", lambda: tmp_path)
    (tmp_path / "knees").mkdir()
    write(tmp_path / "knees" / "small.yaml", knee_document)
    assert list(bundled_knees()) == ["small"]
    assert load_knee("small").name == "small"
    assert bundled_path("knees", "small.yaml") == bundled_path("knees", "small")
    with pytest.raises(InputProblem, match=r"did you mean small\?"):
        load_knee("smal")


def test_every_bundled_knee_can_be_read():
    for path in bundled_knees().values():
        found = read_knee(path)
        assert copy.deepcopy(found.document) == found.document


def test_a_problem_is_one_line_and_can_be_pickled():
    problem = InputProblem("k.yaml", "a.b", "x\ny" + 100 * "z", "one of p, q", ["xyz", "x y"])
    assert str(problem).startswith("k.yaml: a.b: x y")
    assert len(str(problem)) < 160 and "\n" not in str(problem)
    assert str(pickle.loads(pickle.dumps(problem))) == str(problem)


def test_the_damping_of_a_fibre_is_a_number_of_the_knee(tmp_path, knee_document):
    document = copy.deepcopy(knee_document)
    document["ligaments"]["ACL"]["damping_N_s"] = 0.003
    write_knee(document, tmp_path / "knee.yaml")
    knee = read_knee(tmp_path / "knee.yaml").knee
    damping = dict(zip(knee.ligaments.names, knee.ligaments.damping.tolist(), strict=True))
    assert damping.pop("ACL") == 0.003 and set(damping.values()) == {0.0}
    changed = knee.replace({"ACL.damping": 0.01})
    assert restated(document, changed, "a test")["ligaments"]["ACL"]["damping_N_s"] == 0.01


def test_a_failure_strain_is_kept_and_has_a_published_default(tmp_path, knee_document):
    document = copy.deepcopy(knee_document)
    document["ligaments"]["ACL"]["failure_strain"] = 0.21
    write_knee(document, tmp_path / "knee.yaml")
    read = read_knee(tmp_path / "knee.yaml")
    assert read.document["ligaments"]["ACL"]["failure_strain"] == 0.21
    strains = dict(zip(read.knee.ligaments.names, read.knee.ligaments.failure_strain, strict=True))
    usual = {"PCL": 0.18, "MCL": 0.17}
    assert strains["ACL"] == 0.21
    assert {name: float(strains[name]) for name in usual if name in strains} == usual
