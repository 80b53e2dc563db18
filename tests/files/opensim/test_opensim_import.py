"""OpenSim models of both schemas become knees, digit by digit; bad ones are refused in a line."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kneejax.files import (
    InputProblem,
    add_osim_contacts,
    format_import_report,
    import_osim,
    read_knee,
    write_knee,
)
from kneejax.files.opensim.contact import OsimMesh
from kneejax.files.opensim.exact import (
    METRES_TO_MM,
    Rigid,
    decimals,
    degrees,
    radians,
    read_decimal,
    shifted,
    write_decimal,
)
from kneejax.geometry import Pose
from kneejax.mechanics import cartilage_law

MODELS = Path(__file__).parent / "models"
LEFT, RIGHT = MODELS / "left_schema4.osim", MODELS / "right_schema3.osim"
DATA = Path(__file__).parents[3] / "../shared/data/lenhart2015"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="the shared data are not here")


@pytest.fixture
def changed(tmp_path):
    """A copy of a model with texts replaced, each of which must be there."""

    def change(model, *pairs):
        text = model.read_text(encoding="utf-8")
        for old, new in pairs:
            assert old in text
            text = text.replace(old, new)
        path = tmp_path / model.name
        path.write_text(text, encoding="utf-8")
        return path

    return change


# ---- numbers ----


@given(st.floats(-1e3, 1e3).filter(lambda x: x == 0 or abs(x) > 1e-9))
def test_every_millimetre_survives_the_way_to_metres_and_back(x):
    word = write_decimal(decimals(x, METRES_TO_MM))
    assert shifted(read_decimal(word), METRES_TO_MM) == x
    assert float(word) == pytest.approx(x / 1000, rel=1e-15)


@given(st.floats(-360, 360).filter(lambda x: x == 0 or abs(x) > 1e-6))
def test_every_degree_survives_the_way_to_radians_and_back(x):
    word = write_decimal(radians(x))
    assert degrees(read_decimal(word)) == x
    assert float(word) == pytest.approx(np.deg2rad(x), rel=1e-13)


@given(st.decimals(-1, 1, places=7))
def test_a_double_printed_with_17_digits_is_what_its_author_wrote(x):
    assert read_decimal(f"{float(x):.17g}") == x


# ---- both schemas ----


def test_schema_4_left_knee():
    read = import_osim(LEFT, side="l")
    document = read.document
    assert (document["side"], read.knee.femur, read.knee.tibia) == (
        "left", "condyles_left", "shank_left",
    )  # fmt: skip
    ligaments = document["ligaments"]
    assert list(ligaments) == ["cross1", "cross2", "inner_band", "outer", "capsule"]
    first = ligaments["cross1"]
    assert first["femoral_attachment_mm"] == [-7.0, 3.5, -5.5]
    assert first["tibial_attachment_mm"] == [12.3456789012345, -22.0, 1.0]
    assert (first["stiffness_N"], first["slack_length_mm"]) == (1234.5, 30.3)
    assert (first["transition_strain"], first["damping_N_s"]) == (0.04, 0.002)
    # From the tibia to a body welded to the femur; the rest from <defaults> and OpenSim.
    second = ligaments["cross2"]
    assert second["femoral_attachment_mm"] == [2.0, -3.0, -6.0]
    assert (second["transition_strain"], second["damping_N_s"]) == (0.05, 0.003)
    band = ligaments["inner_band"]
    assert band["via_points"] == [{"bone": "tibia", "point_mm": [4.0, -20.0, 41.0]}]
    assert band["wrap"] == "rim"
    rim = document["wraps"]["rim"]
    assert rim["semi_axes_mm"] == [30.0, 18.0, 12.0]
    assert rim["center_mm"] == [1.0, -34.0, 18.9]
    np.testing.assert_allclose(rim["rotation_deg"], np.rad2deg([-0.1, 0.2, 0.0]), rtol=1e-15)
    assert document["imported_from"]["ligaments"] == {"inner_band": "inner.band"}
    assert document["groups"] == {"cross": ["cross1", "cross2"]}
    assert set(read.knee.found.outside) == {"to.the.kneecap", "off"}
    assert "kneecap_left" in read.knee.found.outside["to.the.kneecap"]
    for name, word in (
        ("twice.around", "2 wrap objects"), ("through.the.ring", "WrapTorus"),
        ("one.side.only", "quadrant -x"), ("moving", "ConditionalPathPoint"),
        ("by.a.curve", "class Ligament"),
    ):  # fmt: skip
        assert word in read.knee.found.unsupported[name]
        assert any(name in doubt for doubt in read.doubts)


def test_schema_3_right_knee():
    document = import_osim(RIGHT, side="r").document
    assert list(document["ligaments"]) == ["Band1"]
    band = document["ligaments"]["Band1"]
    assert band["femoral_attachment_mm"] == [1.0, -405.0, -43.0]
    assert band["wrap"] == "Knauf"
    assert document["wraps"]["Knauf"]["radius_mm"] == 15.5
    assert document["reference_pose"]["flexion_deg"] == pytest.approx(np.rad2deg(0.25), abs=0.2)


@pytest.mark.slow
def test_an_imported_knee_is_one(tmp_path):
    document = import_osim(LEFT, side="l").document
    write_knee(document, tmp_path / "knee.yaml")
    again = read_knee(tmp_path / "knee.yaml")
    assert again.document == document
    assert again.knee.ligaments.names == tuple(document["ligaments"])


def _mirrored(text):
    """The right twin of the left fixture, as text: every vector through the sagittal plane."""
    import xml.etree.ElementTree as tree

    root = tree.fromstring(text)
    for element in root.iter():
        words = (element.text or "").split()
        if element.tag in ("location", "translation") and len(words) == 3:
            words[2] = words[2][1:] if words[2].startswith("-") else f"-{words[2]}"
            element.text = " ".join(words)
        if element.tag in ("orientation", "xyz_body_rotation") and len(words) == 3:
            words[:2] = [w[1:] if w.startswith("-") else f"-{w}" for w in words[:2]]
            element.text = " ".join(words)
        if element.tag == "TransformAxis" and element.get("name") in (
            "rotation2", "rotation3", "translation3",
        ):  # fmt: skip
            axis = element.find("axis")
            axis.text = " ".join(f"-{w}" if w != "0" else w for w in axis.text.split())
    return tree.tostring(root, encoding="unicode").replace("left", "right")


def test_a_left_model_gives_the_mirrored_knee_of_its_right_twin(tmp_path):
    twin = tmp_path / "twin.osim"
    twin.write_text(_mirrored(LEFT.read_text(encoding="utf-8")), encoding="utf-8")
    left, right = import_osim(LEFT, side="l").document, import_osim(twin, side="r").document
    for column, value in left["reference_pose"].items():
        if column != "source":
            assert right["reference_pose"][column] == pytest.approx(value, abs=1e-9)
    for name, entry in left["ligaments"].items():
        for field in ("femoral_attachment_mm", "tibial_attachment_mm"):
            other = np.array(right["ligaments"][name][field]) * [1, 1, -1]
            np.testing.assert_allclose(entry[field], other, atol=1e-9)
    for name, entry in left["wraps"].items():
        other = np.array(right["wraps"][name]["center_mm"]) * [1, 1, -1]
        np.testing.assert_allclose(entry["center_mm"], other, atol=1e-9)
        other = np.array(right["wraps"][name]["rotation_deg"]) * [-1, -1, 1]
        np.testing.assert_allclose(entry["rotation_deg"], other, atol=1e-9)


def test_a_coordinate_moved_by_hand_moves_the_reference_pose(changed):
    """A pin joint: flexion is minus its coordinate, the other coordinates stay."""
    pin = (
        '<PinJoint name="knee_left"><socket_parent_frame>/bodyset/condyles_left'
        "</socket_parent_frame><socket_child_frame>/bodyset/shank_left</socket_child_frame>"
        '<coordinates><Coordinate name="bend"><default_value>-0.5</default_value></Coordinate>'
        "</coordinates></PinJoint>"
    )
    text = LEFT.read_text(encoding="utf-8")
    start = text.index('<CustomJoint name="knee_left">')
    end = text.index("</CustomJoint>", start) + len("</CustomJoint>")
    pose = import_osim(changed(LEFT, (text[start:end], pin)), side="l").document["reference_pose"]
    assert pose["flexion_deg"] == pytest.approx(np.rad2deg(0.5), abs=1e-12)
    for column in ("adduction_deg", "internal_rotation_deg", "anterior_mm", "lateral_mm"):
        assert pose[column] == pytest.approx(0.0, abs=1e-12)


def test_bodies_can_be_said_and_the_frame_follows():
    found = import_osim(LEFT, side="l").document
    said = import_osim(LEFT, side="l", femur="thigh_left", tibia="shank_left").document
    shift = np.array([5.0, -391.0, 2.0])
    for name, entry in found["ligaments"].items():
        other = said["ligaments"][name]["femoral_attachment_mm"]
        np.testing.assert_allclose(other, entry["femoral_attachment_mm"] + shift, atol=1e-9)
    poses = [
        Pose.from_table([d["reference_pose"][c] for c in list(d["reference_pose"])[:6]])
        for d in (found, said)
    ]
    tibia = [np.array(p.placement.apply((1.0, 2.0, 3.0)), float) for p in poses]
    np.testing.assert_allclose(tibia[1], tibia[0] + shift * [1, 1, -1], atol=1e-9)


def test_the_report_says_what_was_read_and_what_was_not():
    report = format_import_report(import_osim(LEFT, side="l"))
    for words in (
        "condyles_left was taken as the femur", "splint_left does not move against the tibia",
        "knee_bend_left: default 10 degrees", "SimmSpline through 5 points", "WrapTorus",
        "to.the.kneecap", "kneecap_contact", "asleep", "E 8 MPa", "--geometry",
    ):  # fmt: skip
        assert words in report


# ---- contact ----


def test_two_layers_in_series_are_one_layer_of_the_same_pressure():
    contact = import_osim(LEFT, side="l").contacts[0]
    assert isinstance(contact.femur, OsimMesh)
    assert (contact.law, contact.layer.layer_thickness_mm) == ("linear", 5.5)
    depth, layers = 0.3, ((8.0, 0.40, 2.0), (5.0, 0.46, 3.5))
    moduli = [e * (1 - nu) / ((1 + nu) * (1 - 2 * nu)) for e, nu, _ in layers]
    pressure = depth / sum(h / k for k, (_, _, h) in zip(moduli, layers, strict=True))
    one = cartilage_law.confined_modulus(*contact.layer[:2])
    assert float(one) * depth / 5.5 == pytest.approx(pressure, rel=1e-12)


def test_a_lumped_contact_takes_the_means(changed):
    lumped = changed(LEFT, ("<use_lumped_contact_model>false", "<use_lumped_contact_model>true"))
    contact = import_osim(lumped, side="l").contacts[0]
    assert contact.layer[:2] == (6.5, 0.43)


def test_surfaces_are_fitted_to_meshes_where_the_model_puts_them(changed, tmp_path, monkeypatch):
    trimesh = pytest.importorskip("trimesh")
    from kneejax.files.meshes import importing as _mesh_import

    called = {}

    def record(femur, tibia, side, options):
        meshes = [trimesh.load_mesh(path).centroid for path in (femur, tibia)]
        called.update(vars(options), side=side, meshes=meshes)
        entry = {"source": {"youngs_modulus_MPa": "given"}}
        return _mesh_import.MeshImport({"medial": entry}, ("fitted",), {}, False)

    monkeypatch.setattr("kneejax.files.meshes.importing.import_meshes", record)
    for name in ("Thigh.STL", "shank.stl"):
        trimesh.creation.box((0.06, 0.02, 0.08)).export(tmp_path / name, file_type="stl")
    place = "<location>0.01 0.02 -0.03</location><scale_factors>1 1 1.5</scale_factors><mesh_file>G"
    model = changed(LEFT, (r"<mesh_file>Geometry\shank", place + r"eometry\shank"))
    read = import_osim(model, side="l")
    found = add_osim_contacts(read, tmp_path)
    np.testing.assert_allclose(called["meshes"], [[0, 0, 0], [0.01, 0.02, -0.03]], atol=1e-7)
    assert (called["side"], called["law"], called["layer_thickness_mm"]) == ("left", "linear", 5.5)
    assert called["youngs_modulus_MPa"] == read.contacts[0].layer.youngs_modulus_MPa
    np.testing.assert_allclose(called["reference_pose"].to_table(), read.knee.pose)
    assert "inside_contact" in found.document["contacts"]["medial"]["source"]["poisson_ratio"]
    assert read.document["contacts"] == {} and found.findings == ("fitted",)


# ---- bad input ----


@pytest.mark.parametrize(
    ("model", "side", "pairs", "words"),
    [
        (RIGHT, "r", [("Blankevoort1991Ligament", "Other")], ("ligaments", "none", "at least one")),
        (RIGHT, "r", [("Blankevoort1991Ligament", "Ligament")], ("2 of class Ligament",)),
        (RIGHT, "r", [("<body>Unterschenkel_r", "<body>Unterschenke_r")],
         ("PathPoint b2 (line", "Unterschenke_r", "did you mean Unterschenkel_r?")),
        (LEFT, "l", [("<socket_parent_frame>/bodyset/thigh_left<",
                      "<socket_parent_frame>/bodyset/thigh_lef<")],
         ("PathPoint c2a", "did you mean thigh_left?")),
        (RIGHT, "r", [("</ForceSet>", "</Forces>")], ("line ", "column ", "mismatched tag")),
        (RIGHT, "r", [("<radius>0.0155", "<radius>0")], ("WrapSphere Knauf", "radius", "above 0")),
        (LEFT, "l", [("<dimensions> 0.03 0.018", "<dimensions> 0.03 -0.018")], ("dimensions",)),
        (RIGHT, "r", [("<wrap_object>Knauf", "<wrap_object>Knaus")],
         ("Knaus", "Band1", "did you mean Knauf?")),
        (RIGHT, "r", [("0.001 -0.405 -0.043", "0.001 -0.405 -0.023")],
         ("Band1", "b1", "inside the sphere Knauf", "--inside straight", "--without Band1")),
        (RIGHT, "r", [("0.004 -0.055 -0.02", "0.004 0.02 -0.02")],
         ("b2", "at the reference pose")),
        (RIGHT, "l", [], ("--side: l", "knee_r", "--femur")),
        (RIGHT, "r", [('Version="30000"', 'Version="51000"')], ("Version: 51000", "schema 2, 3")),
        (RIGHT, "r", [(' Version="30000"', "")], ("Version: missing",)),
        (RIGHT, "r", [("OpenSimDocument", "Document")], ("an OpenSim model",)),
        (RIGHT, "r", [("<Model ", "<Tool "), ("</Model>", "</Tool>")], ("content: Tool",)),
        (RIGHT, "r", [("<length_units>meters", "<length_units>mm")], ("length_units: mm",)),
        (RIGHT, "r", [("<linear_stiffness>2500", "<linear_stiffness>2.5k")],
         ("linear_stiffness: 2.5k: expected a number",)),
        (RIGHT, "r", [("<slack_length>0.058", "<slack_length>0")], ("slack_length: 0", "> 0 m")),
        (RIGHT, "r", [("<slack_length>0.058</slack_length>", "")], ("OpenSim's default",)),
        (RIGHT, "r", [("0.004 -0.055 -0.02", "0.004 -0.055")], ("location", "3 numbers")),
        (RIGHT, "r", [("0.004 -0.055 -0.02", "0.004 -0.055 nan")], ("location", "3 numbers")),
        (RIGHT, "r", [("knee", "joint"), ("Oberschenkel", "one"), ("Unterschenkel", "two")],
         ("knee joint", "--femur BODY --tibia BODY", "ankle_r: two_r to Fuss_r")),
        (RIGHT, "r", [("0.004 -0.055 -0.02", "0.004 -0.9 -0.02")], ("700 mm", "apart")),
        (RIGHT, "r", [("<x>-2.1 -0.4 0.2</x>", "<x>-2.1 -0.4</x>")], ("2 values of x and 3 of y",)),
    ],
)  # fmt: skip
def test_a_bad_model_is_refused_in_one_line(model, side, pairs, words, changed):
    with pytest.raises(InputProblem) as refusal:
        import_osim(changed(model, *pairs), side=side)
    assert "\n" not in str(refusal.value)
    for word in words:
        assert word in str(refusal.value)


def test_two_knees_of_a_side_are_refused_with_both_named(changed):
    text = RIGHT.read_text(encoding="utf-8")
    start = text.index('<Body name="Unterschenkel_r">')
    end = text.index('<Body name="Fuss_r">')
    twin = text[start:end].replace("Unterschenkel_r", "Zweites_r").replace("knee_r", "knee_2_r")
    model = changed(RIGHT, ('<Body name="Fuss_r">', twin + '<Body name="Fuss_r">'))
    # The one that carries the foot is the knee.
    assert import_osim(model, side="r").knee.tibia == "Unterschenkel_r"
    footless = changed(model, ("<parent_body>Unterschenkel_r", "<parent_body>ground"))
    with pytest.raises(InputProblem, match=r"2 joints that may be .*knee_r: .*knee_2_r: "):
        import_osim(footless, side="r")
    said = import_osim(footless, side="r", femur="Oberschenkel_r", tibia="Unterschenkel_r")
    assert [joint.name for joint in said.knee.joints] == ["knee_r"]


def test_a_fibre_may_be_left_out_or_run_straight(changed):
    model = changed(LEFT, ("-0.01 0.018 -0.02<", "-0.01 0.008 -0.02<"))
    with pytest.raises(InputProblem, match="k1: .* mm inside the cylinder"):
        import_osim(model, side="l")
    without = import_osim(model, side="l", without=["cap*"])
    assert "capsule" not in without.document["ligaments"]
    assert "capsule" in format_import_report(without)
    straight = import_osim(model, side="l", inside="straight")
    assert "wrap" not in straight.document["ligaments"]["capsule"]
    assert any("capsule" in note for note in straight.knee.found.notes)
    with pytest.raises(InputProblem, match=r"--without: capsul: .*did you mean capsule\?"):
        import_osim(model, side="l", without=["capsul"])


def test_a_coupled_coordinate_is_a_doubt(changed):
    coupler = (
        '<ConstraintSet><objects><CoordinateCouplerConstraint name="coupler">'
        "<dependent_coordinate_name>knee_angle_r</dependent_coordinate_name>"
        "</CoordinateCouplerConstraint></objects></ConstraintSet>"
    )
    model = changed(RIGHT, ("<ForceSet>", coupler + "<ForceSet>"))
    assert any("coupler drives knee_angle_r" in x for x in import_osim(model, side="r").doubts)


def test_a_model_of_one_leg_need_not_name_its_side(changed):
    model = changed(RIGHT, ("_r", ""))
    left, right = (import_osim(model, side=side) for side in "lr")
    assert any("taken as left, as asked" in finding for finding in left.knee.found.findings)
    for row, sign in (("adduction_deg", -1), ("lateral_mm", -1), ("flexion_deg", 1)):
        poses = [read.document["reference_pose"][row] for read in (left, right)]
        assert poses[0] == pytest.approx(sign * poses[1], abs=1e-9)


def test_axes_that_are_not_anatomical_are_doubted(changed):
    model = changed(LEFT, ("-0.01 -0.4 0.003", "-0.4 -0.01 0.003"))
    assert any("ankle_left" in doubt for doubt in import_osim(model, side="l").doubts)
    assert not any("axes" in doubt for doubt in import_osim(LEFT, side="l").doubts)


# ---- other encodings ----


@pytest.mark.parametrize("encoding", ["utf-16", "iso-8859-1", "utf-8-sig"])
def test_other_encodings_give_the_same_knee(encoding, tmp_path):
    text = RIGHT.read_text(encoding="utf-8").replace("meadow", "Wiese")
    declared = "utf-8" if encoding == "utf-8-sig" else encoding
    text = text.replace('encoding="UTF-8"', f'encoding="{declared}"')
    path = tmp_path / RIGHT.name
    path.write_bytes(text.replace("\n", "\r\n").encode(encoding))
    ours, theirs = import_osim(path, side="r").document, import_osim(RIGHT, side="r").document
    assert ours["ligaments"] == theirs["ligaments"]


# ---- a published model ----


def test_motions_undo_each_other():
    turned = Rigid.of(*(decimals(np.array(x)) for x in ((0.1, 0, 2), (0.3, 0.3, 0.3))))
    point = decimals(np.array([0.5, -1, 0.25]))
    for motion in (turned, Rigid(shift=decimals(np.ones(3)))):
        for back in (motion.point_back(motion.point(point)),
                     motion.inverse().point(motion.point(point)),
                     motion.inverse().after(motion).point(point)):  # fmt: skip
            np.testing.assert_allclose(np.array(back, float), np.array(point, float), atol=1e-15)
