"""Recorded movements in other units, of other bodies, with columns that are missing."""

import numpy as np
import pytest

from kneejax.files import InputProblem
from tests.files.opensim.test_activity import ANGLE, FORCE, MODEL, TIME, read, storage, written


def changed(path, old, new):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def scaled(path, factors):
    """A table with some columns times a number."""
    lines = path.read_text().splitlines()
    begin = lines.index("endheader") + 1
    names = lines[begin].split("\t")
    by = [factors.get(name, 1.0) for name in names]
    cells = [row.split() for row in lines[begin + 1 :]]
    rows = ["\t".join(repr(float(x) * k) for x, k in zip(row, by, strict=True)) for row in cells]
    path.write_text("\n".join([*lines[: begin + 1], *rows]) + "\n")


STANDING = """<WeldJoint name="foot_r"><socket_parent_frame>/ground</socket_parent_frame>
<socket_child_frame>/bodyset/tibia_r</socket_child_frame></WeldJoint>
<PinJoint name="knee_r"><socket_parent_frame>/bodyset/tibia_r</socket_parent_frame>
<socket_child_frame>/bodyset/femur_r</socket_child_frame>
<coordinates><Coordinate name="knee_angle_r"/></coordinates></PinJoint>
<PinJoint name="hip_r"><socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
<socket_child_frame>/bodyset/pelvis</socket_child_frame>
<coordinates><Coordinate name="hip_r"/></coordinates></PinJoint>
"""


@pytest.mark.parametrize("named", [{"femur": "femur_r", "tibia": "tibia_r"}, {}])
def test_a_leg_that_stands_on_its_foot_is_what_is_below_the_knee(named, tmp_path, knee):
    """The tibia carries the femur, and with it the body: that is not the leg below the knee."""
    folder = written(tmp_path)
    model = (folder / "swing.osim").read_text()
    begin, end = model.index("<WeldJoint"), model.index("</objects></JointSet>")
    model = model[:begin] + STANDING + model[end:]
    model = model.replace("</objects>\n<JointSet>", "</objects></BodySet>\n<JointSet>")
    pelvis = '<Body name="pelvis"><mass>40</mass></Body>\n</objects></BodySet>'
    (folder / "swing.osim").write_text(model.replace("</objects></BodySet>", pelvis, 1))
    scaled(folder / "angles.mot", {"knee_angle_r": -1.0})
    record = read(folder, knee, **named)
    assert np.allclose(record.pose[:, 0], np.rad2deg(-ANGLE), atol=1e-9)
    assert record.mass_kg == 4.0
    assert np.allclose(record.ground_N, FORCE)
    assert np.allclose(record.acting["inertia"], 0.0, atol=1e-9)
    # The hip, which the table leaves out, is above the knee and places nothing below it.
    assert record.doubts == ()


def test_files_may_have_other_names_than_the_model(tmp_path, knee):
    folder = written(tmp_path)
    swing = read(folder, knee)
    changed(folder / "angles.mot", "knee_angle_r", "knee_flexion_r")
    changed(folder / "pulls.sto", "hams_r", "hamstrings_r")
    changed(folder / "floor.xml", "tibia_r", "shank_r")
    with pytest.raises(InputProblem, match="[(]--called knee_angle_r=knee_flexion_r[)]"):
        read(folder, knee)
    called = {"knee_angle_r": "knee_flexion_r", "hams_r": "hamstrings_r"}
    with pytest.raises(InputProblem, match="applied_to_body: shank_r: expected a body"):
        read(folder, knee, called=called)
    record = read(folder, knee, called=called | {"tibia_r": "shank_r"})
    np.testing.assert_array_equal(record.pose, swing.pose)
    for name, acting in swing.acting.items():
        np.testing.assert_array_equal(record.acting[name], acting)
    with pytest.raises(InputProblem, match="--called: name: knee_angel_r.*mean knee_angle_r"):
        read(folder, knee, called={"knee_angel_r": "knee_flexion_r"})


def test_without_external_loads_none_act(tmp_path, knee):
    record = read(written(tmp_path), knee, files=("angles.mot", "pulls.sto"))
    assert not record.ground_N.any() and not record.acting["ground"].any()
    assert "No external loads were given: none act on the leg." in record.notes


@pytest.mark.parametrize(
    ("file", "factors", "said"),
    [
        ("pulls.sto", {"hams_r": 0.01}, "nothing above 1.5 .*N; activations are suspected"),
        ("pulls.sto", {"hams_r": -1.0}, "hams_r: -100: expected muscle forces, N, 0 or more"),
        ("pulls.sto", {"hams_r": 1e4}, "hams_r: 1e[+]06: expected muscle forces, 0, or between"),
        ("floor.mot", {f"ground_force_r_p{x}": 1e3 for x in "xyz"}, "away; mm are suspected"),
        ("angles.mot", {"knee_angle_r": 1 / 57.3}, "radians are suspected"),
    ],
)
def test_numbers_in_other_units_are_refused(file, factors, said, tmp_path, knee):
    folder = written(tmp_path)
    scaled(folder / file, factors)
    with pytest.raises(InputProblem, match=said) as problem:
        read(folder, knee)
    assert "\n" not in str(problem.value)


@pytest.mark.parametrize(
    ("factors", "said"),
    [
        ({f"ground_force_r_v{x}": 1e-3 for x in "xyz"}, "kN or body weights are suspected"),
        ({f"ground_force_r_v{x}": 1e3 for x in "xyz"}, "more than a person presses with"),
        ({f"ground_torque_r_{x}": 1e3 for x in "xyz"}, "N mm are suspected"),
        ({"ground_force_r_px": -9.0}, "another foot's plate"),
    ],
)
def test_what_no_ground_does_to_a_foot_is_doubted(factors, said, tmp_path, knee):
    folder = written(tmp_path)
    scaled(folder / "floor.mot", factors)
    (doubt,) = read(folder, knee).doubts
    assert said in doubt


@pytest.mark.parametrize(("scale", "said"), [(1e3, "times in ms"), (1e-2, "degrees/s")])
def test_times_in_other_units_are_doubted(scale, said, tmp_path, knee):
    folder = written(tmp_path)
    for name in ("angles.mot", "pulls.sto", "floor.mot"):
        scaled(folder / name, {"time": 100.0 * scale if scale > 1.0 else scale})
    assert any(said in doubt for doubt in read(folder, knee).doubts)


def test_a_translation_of_the_knee_in_mm_is_refused(tmp_path, knee):
    folder = written(tmp_path)
    changed(folder / "swing.osim", "PinJoint name", "PlanarJoint name")
    changed(folder / "swing.osim", "</PinJoint>", "</PlanarJoint>")
    more = '<Coordinate name="knee_angle_r"/><Coordinate name="tx"/><Coordinate name="ty"/>'
    changed(folder / "swing.osim", '<Coordinate name="knee_angle_r"/>', more)
    columns = {"time": TIME, "knee_angle_r": np.rad2deg(ANGLE), "tx": 4.0 + 0 * TIME}
    storage(folder / "angles.mot", columns, "yes")
    with pytest.raises(InputProblem, match=r"tx: 4: expected a translation .* mm are suspected"):
        read(folder, knee)


def test_a_coordinate_that_a_table_leaves_out_follows_others_or_is_named(tmp_path, knee):
    """A hip that follows the knee, at once or as a prescribed function; else it is a doubt."""
    folder = written(tmp_path)
    hip = MODEL[MODEL.index("<WeldJoint") : MODEL.index("<PinJoint")]
    own = '<coordinates><Coordinate name="hip_r">FOLLOWS</Coordinate></coordinates></PinJoint>'
    turning = hip.replace("WeldJoint", "PinJoint").replace("</PinJoint>", own)
    original = (folder / "swing.osim").read_text()
    (folder / "swing.osim").write_text(original.replace(hip, turning.replace("FOLLOWS", "")))
    (doubt,) = read(folder, knee).doubts
    assert "angles.mot: no column of hip_r" in doubt
    # A movement in one plane has one angle of a hip.
    ball = turning.replace("PinJoint", "UniversalJoint")
    ball = ball.replace("</coordinates>", '<Coordinate name="hip_add_r"/></coordinates>')
    (folder / "swing.osim").write_text(original.replace(hip, ball.replace("FOLLOWS", "")))
    columns = {"time": TIME, "knee_angle_r": np.rad2deg(ANGLE), "hip_r": np.rad2deg(-2.0 * ANGLE)}
    storage(folder / "plane.mot", columns, "yes")
    plane = read(folder, knee, files=("plane.mot", "pulls.sto", "floor.xml"))
    assert not any("no column of" in doubt for doubt in plane.doubts)
    assert any("columns: hip_add_r." in note for note in plane.notes)
    (folder / "swing.osim").write_text(original.replace(hip, turning.replace("FOLLOWS", "")))
    storage(folder / "given.mot", columns, "yes")
    expected = read(folder, knee, files=("given.mot", "pulls.sto", "floor.xml"))
    slope = "<LinearFunction><coefficients>-2 0</coefficients></LinearFunction>"
    coupled = (
        '<ConstraintSet><objects><CoordinateCouplerConstraint name="c">'
        f"<coupled_coordinates_function>{slope}</coupled_coordinates_function>"
        "<independent_coordinate_names>knee_angle_r</independent_coordinate_names>"
        "<dependent_coordinate_name>hip_r</dependent_coordinate_name>"
        "</CoordinateCouplerConstraint></objects></ConstraintSet></Model>"
    )
    changed(folder / "swing.osim", "</Model>", coupled)
    found = read(folder, knee)
    assert found.doubts == ()
    for name, values in expected.acting.items():
        assert np.allclose(found.acting[name], values, atol=1e-6), name
    constant = "<prescribed>true</prescribed><prescribed_function><Constant><value>0.3</value>"
    constant += "</Constant></prescribed_function>"
    (folder / "swing.osim").write_text(original.replace(hip, turning.replace("FOLLOWS", constant)))
    storage(folder / "given.mot", columns | {"hip_r": np.rad2deg(0.3) + 0 * TIME}, "yes")
    expected = read(folder, knee, files=("given.mot", "pulls.sto", "floor.xml"))
    assert np.allclose(read(folder, knee).acting["weight"], expected.acting["weight"], atol=1e-6)
