"""A meniscus's mesh as a contact with a ring: known radii, height and horns come back."""

import numpy as np
import pytest

from kneejax.files import InputProblem, load_knee_file, meniscus_of_mesh, mirror_document
from kneejax.files.knee.document import mirror_part
from kneejax.files.knee.surfaces import build_surface
from kneejax.geometry import Pose
from tests.files.meshes import meshed_meniscus as made
from tests.files.meshes.meshed_knee import joined, mirrored, written

RIGHT = load_knee_file("average_knee").document
KNEES = {"right": RIGHT, "left": mirror_document(RIGHT)}


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """`(side, compartment)` -> what was read of its wedge."""
    folder = tmp_path_factory.mktemp("menisci")
    return {
        (side, name): meniscus_of_mesh(
            written(folder / f"{side}_{name}.stl", made.wedge(document, name)), document, name
        )
        for side, document in KNEES.items() for name in made.HORNS
    }  # fmt: skip


def of_right(contact, side):
    return contact if side == "right" else mirror_part(contact)


@pytest.mark.parametrize("side", KNEES)
@pytest.mark.parametrize("name", made.HORNS)
def test_a_wedge_comes_back_with_its_outline_section_horns_and_height(found, side, name):
    meniscus = found[side, name]
    assert meniscus.name == f"{name}_meniscus" and meniscus.doubts == ()
    assert meniscus.fit.quality.rms < 0.05
    contact = of_right(meniscus.contact, side)
    ring, surface = contact["ring"], contact["tibial_surface"]
    assert ring["cross_section_mm2"] == pytest.approx(made.AREA, rel=5e-3)
    np.testing.assert_allclose(meniscus.area_mm2, made.AREA, rtol=0.01)
    np.testing.assert_allclose(meniscus.height_mm, made.HEIGHT, atol=0.03)
    np.testing.assert_allclose(ring["horns_deg"], made.HORNS[name], atol=0.1)
    np.testing.assert_allclose(ring["middle_mm"], made.MIDDLE[name], atol=0.02)
    away = np.hypot(*(np.array(surface["outline_mm"]) - made.MIDDLE[name]).T)
    np.testing.assert_allclose(np.split(away, 2), [[made.OUTER] * 24, [made.INNER] * 24], atol=0.02)
    # The upper surface: the plateau, and above it the wedge.
    cartilage = build_surface(RIGHT["contacts"][name]["tibial_surface"])
    turn = np.deg2rad(np.linspace(*made.HORNS[name], 9)[1:-1])[:, None]
    away = np.array([8.0, 10.0, 12.0])
    x, z = (m + away * f(turn) for m, f in zip(made.MIDDLE[name], (np.cos, np.sin), strict=True))
    high = made.EDGE + (made.HEIGHT - made.EDGE) * (away - made.INNER) / (made.OUTER - made.INNER)
    level = np.asarray(cartilage.point(x, z)[1]) + high
    np.testing.assert_allclose(build_surface(surface).point(x, z)[1], level, atol=0.06)
    thick = 0.5 * (made.EDGE + made.HEIGHT)
    assert contact["layer_thickness_mm"] == pytest.approx(6.0 + thick, abs=0.02)


@pytest.mark.parametrize("name", made.HORNS)
def test_mirrored_meshes_give_the_mirrored_contact(found, name):
    right, left = (of_right(found[side, name].contact, side) for side in KNEES)
    for part in ("ring", "tibial_surface"):
        for field, value in right[part].items():
            if not isinstance(value, str):
                np.testing.assert_allclose(left[part][field], value, atol=2e-3, err_msg=field)
    assert right["femoral_surface"] == left["femoral_surface"]


@pytest.mark.parametrize("ending", ["vtp", "ply"])
def test_formats_and_units_give_the_same(found, ending, tmp_path):
    points, faces = made.wedge(RIGHT, "medial")
    if ending == "vtp":
        pv = pytest.importorskip("pyvista")
        path = tmp_path / "meniscus.vtp"
        pv.PolyData(1e-3 * points, np.c_[np.full(len(faces), 3), faces]).save(path)
    else:
        path = written(tmp_path / "meniscus.ply", (points, faces), 1e-3)
    ring, expected = (x.contact["ring"] for x in (
        meniscus_of_mesh(path, RIGHT), found["right", "medial"]))  # fmt: skip
    for field, value in expected.items():
        np.testing.assert_allclose(ring[field], value, atol=2e-3)


def test_a_mesh_in_the_femur_s_frame_and_the_two_sides_of_one_give_the_same(found, tmp_path):
    pose = Pose.from_table([20.0, 2.0, -5.0, 4.0, -3.0, 1.0])
    points, faces = made.wedge(RIGHT, "lateral")
    there = np.stack([np.asarray(x) for x in pose.placement.apply(tuple(points.T))], axis=1)
    whole = written(tmp_path / "whole.stl", (there, faces))
    sides = [written(tmp_path / f"{part}.stl", made.wedge(RIGHT, "lateral", parts=(part,)))
             for part in ("upper", "lower")]  # fmt: skip
    expected = found["right", "lateral"].contact["ring"]
    for ring in (meniscus_of_mesh(whole, RIGHT, pose=pose).contact["ring"],
                 meniscus_of_mesh(sides, RIGHT).contact["ring"]):  # fmt: skip
        for field, value in expected.items():
            np.testing.assert_allclose(ring[field], value, atol=0.02, rtol=2e-3)


def test_numbers_that_are_given_stand_in_the_contact_with_their_sources(found):
    contact = found["right", "medial"].contact
    assert contact["youngs_modulus_MPa"] == 20.0 and contact["poisson_ratio"] == 0.2
    assert [contact["ring"][x] for x in ("youngs_modulus_MPa", "horn_stiffness_N_per_mm")] == [
        120.0, 180.0]  # fmt: skip
    assert "Haut Donahue" in contact["source"]["ring"]
    assert contact["source"].keys() == {
        "youngs_modulus_MPa", "poisson_ratio", "onset_width_mm", "layer_thickness_mm", "ring"}


def moved(part, *by):
    return part[0] + np.array(by), part[1]


WRONG = {
    "upper side alone": (lambda w: made.wedge(RIGHT, "medial", parts=("upper",)), {},
                         "faces: a hole of .* expected holes of at most 10 mm"),
    "a closed ring": (lambda w: made.wedge(RIGHT, "medial", horns=(0.0, 360.0)), {},
                      "arc: closed all around its middle: expected an arc with two horns"),
    "two": (lambda w: joined(w, moved(w, 0.0, 30.0, 0.0)), {}, "pieces: 2 of them: expected one"),
    "metres": (lambda w: (1e-3 * w[0], w[1]), {"unit": "mm"},
               "width: 0.02.* mm: expected a meniscus 15 to 80 mm wide; is the unit right?"),
    "a left knee's": (lambda w: mirrored(moved(w, 0.0, 0.0, 32.3)), {},
                      "arc: open medially: expected a medial meniscus, open towards the middle"),
    "the other plateau": (lambda w: made.wedge(RIGHT, "lateral"), {},
                          "mm beside its middle: expected a mesh over the medial plateau"),
    "another frame": (lambda w: moved(w, 0.0, 9.0, 0.0), {},
                      r"place: \+8.6 mm above the medial plateau: expected within 5 mm"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_what_is_no_meniscus_of_this_plateau_is_refused(what, tmp_path):
    change, options, sentence = WRONG[what]
    path = written(tmp_path / "mesh.ply", change(made.wedge(RIGHT, "medial")))
    with pytest.raises(InputProblem, match=f"mesh.ply: .*{sentence}"):
        meniscus_of_mesh(path, RIGHT, "medial", **options)


def test_a_knee_without_the_compartment_is_refused(tmp_path):
    path = written(tmp_path / "mesh.ply", made.wedge(RIGHT, "medial"))
    bare = RIGHT | {"contacts": {"insert": RIGHT["contacts"]["medial"]}}
    with pytest.raises(InputProblem, match="contacts: insert: expected a contact medial"):
        meniscus_of_mesh(path, bare, "medial")


def test_what_may_be_wrong_is_doubted(tmp_path):
    high = moved(made.wedge(RIGHT, "medial"), 0.0, 2.5, 0.0)
    (doubt,) = meniscus_of_mesh(written(tmp_path / "high.ply", high), RIGHT).doubts
    assert doubt.startswith("high.ply: the lower side lies +2.") and "medial plateau" in doubt
    rough = made.wedge(RIGHT, "medial", fine=0.3)
    doubts = meniscus_of_mesh(written(tmp_path / "rough.ply", rough), RIGHT).doubts
    assert any("coarse" in doubt for doubt in doubts)
    points, faces = made.wedge(RIGHT, "medial")
    holed = points, np.delete(faces, [2000, 2001], axis=0)
    (doubt,) = meniscus_of_mesh(written(tmp_path / "holed.ply", holed), RIGHT).doubts
    assert "a hole of" in doubt and "the fit bridges it" in doubt
