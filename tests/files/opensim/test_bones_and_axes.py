"""Which bones a model's knee has, in which axes, and where its coordinates put them."""

import itertools

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import SMALLEST_MODEL, InputProblem, export_osim, import_osim, write_knee
from kneejax.files.opensim.joints import moved
from kneejax.files.opensim.model import read_model
from tests.files.opensim.test_nothing_is_dropped import (
    CONSTRAINTS,
    FORCES,
    JOINTS,
    MODEL,
    read,
    text_of,
)

ROTATIONS = [
    np.array(matrix) for order in itertools.permutations(np.eye(3, dtype=int).tolist())
    for signs in itertools.product((1, -1), repeat=3)
    if np.linalg.det(matrix := np.array(order) * np.array(signs)[:, None]) > 0
]  # fmt: skip
AXES = {
    "rotation1": ("flex", (0, 0, -1)), "rotation2": ("add", (1, 0, 0)),
    "rotation3": ("rot", (0, 1, 0)), "translation1": ("ant", (1, 0, 0)),
}  # fmt: skip
FIBRES = {
    "ACL": ((-1, 3, 3), (16, -21, -3)), "MCL": ((3, 10, -40), (12, -66, -16)),
    "LCL": ((-1, 4, 36), (-13, -51, 45)),
}  # fmt: skip


AS_THEY_SHOULD_BE = np.eye(3)


def whole_knee(turn=AS_THEY_SHOULD_BE, bodies=("femur_r", "tibia_r"), flexion=0.5, adduction=0.05):
    """A right knee of four coordinates, its axes turned, from the first body to the second."""

    def vector(x):
        return " ".join(repr(float(value) + 0.0) for value in turn @ np.array(x, float))

    coordinates, axes, forces = "", "", ""
    for axis, (name, direction) in AXES.items():
        value = {"flex": flexion, "add": adduction, "ant": 0.004}.get(name, 0.0)
        coordinates += f'<Coordinate name="knee_{name}_r"><default_value>{value}</default_value>'
        coordinates += "<range>-0.2 2</range></Coordinate>"
        axes += f'<TransformAxis name="{axis}"><coordinates>knee_{name}_r</coordinates>'
        axes += f"<axis>{vector(direction)}</axis></TransformAxis>"
    for name, ends in FIBRES.items():
        slack = np.linalg.norm(np.subtract(*ends)) / 1000
        points = "".join(
            f'<PathPoint name="{body}"><socket_parent_frame>/bodyset/{body}</socket_parent_frame>'
            f"<location>{vector(np.array(end) / 1000)}</location></PathPoint>"
            for body, end in zip(("femur_r", "tibia_r"), ends, strict=True)
        )
        forces += (
            f'<Blankevoort1991Ligament name="{name}"><GeometryPath><PathPointSet><objects>{points}'
            "</objects></PathPointSet></GeometryPath><linear_stiffness>2000</linear_stiffness>"
            f"<slack_length>{slack}</slack_length></Blankevoort1991Ligament>"
        )
    start, end = (SMALLEST_MODEL.index(x) for x in ("      <PinJoint", JOINTS))
    first, last = (SMALLEST_MODEL.index(x) for x in ("      <Blankevoort", FORCES))
    return (
        SMALLEST_MODEL[:start] + '<CustomJoint name="knee_r">'
        f"<socket_parent_frame>/bodyset/{bodies[0]}</socket_parent_frame>"
        f"<socket_child_frame>/bodyset/{bodies[1]}</socket_child_frame>"
        f"<coordinates>{coordinates}</coordinates><SpatialTransform>{axes}</SpatialTransform>"
        "</CustomJoint>" + SMALLEST_MODEL[end:first] + forces + "\n" + SMALLEST_MODEL[last:]
    )  # fmt: skip


def test_axes_of_every_order_and_sense_are_turned():
    wanted = read(whole_knee()).document
    assert wanted["reference_pose"]["flexion_deg"] == pytest.approx(np.rad2deg(0.5))
    for turn in ROTATIONS:
        found = read(whole_knee(turn))
        assert found.doubts == ()
        assert found.knee.turned == (not np.array_equal(turn, np.eye(3)))
        for column, value in list(wanted["reference_pose"].items())[:6]:
            assert found.document["reference_pose"][column] == pytest.approx(value, abs=1e-9)
        assert found.document["ligaments"] == wanted["ligaments"]


def test_axes_that_no_second_thing_confirms_are_refused_and_a_wrong_side_doubted():
    odd = whole_knee(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])).replace('"MCL"', '"inner"')
    with pytest.raises(InputProblem, match="axes: flexion about -?X.*X anterior, Y superior"):
        read(odd)
    (doubt,) = read(whole_knee().replace("_r", ""), side="l").doubts
    assert "Z is to the left: is the side right?" in doubt


def test_numbers_go_back_into_turned_axes(tmp_path):
    model, file = tmp_path / "model.osim", tmp_path / "knee.yaml"
    model.write_text(whole_knee(np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])))
    document = import_osim(model, side="r").document
    write_knee(document, file)
    assert export_osim(file, model).data == model.read_bytes()
    graft = document["ligaments"].pop("ACL") | {"tibial_attachment_mm": [15.5, -21.0, -2.0]}
    document["ligaments"] |= {"graft": graft}
    document["ligaments"]["LCL"]["femoral_attachment_mm"] = [0.0, 5.25, 37.0]
    write_knee(document, file)
    again = import_osim(model, side="r", data=export_osim(file, model, replace=True).data)
    for name, entry in document["ligaments"].items():
        for field in ("femoral_attachment_mm", "tibial_attachment_mm"):
            assert again.document["ligaments"][name][field] == entry[field]


def test_a_tibia_that_carries_the_femur_is_still_the_tibia(tmp_path, capsys):
    model = tmp_path / "model.osim"
    # The femur in the tibia turns the other way.
    upwards = whole_knee(bodies=("tibia_r", "femur_r"), flexion=-0.35, adduction=0.0)
    model.write_text(upwards.replace("<range>-0.2 2", "<range>-2 0.2"))
    command = ["import", "osim", str(model), "--side", "r", "--out", str(tmp_path / "out")]
    assert main(command) == 0
    assert "femur_r taken as the femur, tibia_r as the tibia" in capsys.readouterr().out
    said = import_osim(model, side="r", femur="femur_r", tibia="tibia_r")
    found = import_osim(model, side="r").document | {"notes": said.document["notes"]}
    assert said.document == found and said.doubts == ()
    assert said.document["reference_pose"]["flexion_deg"] == pytest.approx(np.rad2deg(0.35))
    assert said.document["ligaments"]["MCL"]["femoral_attachment_mm"] == [3.0, 10.0, -40.0]
    swapped = [*command, "--femur", "tibia_r", "--tibia", "femur_r"]
    assert main(swapped) == 1
    assert "have --femur and --tibia changed places?" in capsys.readouterr().out
    nameless = model.read_text().replace("femur_r", "one").replace("tibia_r", "two")
    assert "-Y points upwards: have femur and tibia changed" in "".join(read(nameless).doubts)


# ---- coordinates and functions ----

COUPLED = (
    '<ConstraintSet><objects><CoordinateCouplerConstraint name="cc"><coupled_coordinates_function>'
    "<LinearFunction><coefficients>0.5 0.01</coefficients></LinearFunction>"
    "</coupled_coordinates_function>"
    "<independent_coordinate_names>knee_flex_r</independent_coordinate_names>"
    "<dependent_coordinate_name>knee_rot_r</dependent_coordinate_name>"
    "<scale_factor>2</scale_factor></CoordinateCouplerConstraint></objects></ConstraintSet>"
)


def test_prescribed_coupled_and_usual_values_are_what_opensim_takes():
    """OpenSim 4.6: knee_flex 0.7, knee_add 0.3, knee_rot (0.5 0.7 + 0.01) 2 = 0.72."""
    prescribed = (
        "<prescribed>true</prescribed><prescribed_function><Constant><value>0.7</value></Constant>"
        "</prescribed_function>"
    )
    model = text_of(
        ('knee_flex_r"><default_value>0.5</default_value>', f'knee_flex_r">{prescribed}'),
        ('knee_add_r"><default_value>0.05</default_value>', 'knee_add_r">'),
        (MODEL, '<defaults><Coordinate name="default"><default_value>0.3</default_value>'
         f"</Coordinate></defaults>{MODEL}"),
        (CONSTRAINTS, COUPLED + CONSTRAINTS),
        base=whole_knee(),
    )  # fmt: skip
    found = read(model)
    rotation = [[0.7005, 0.6154, 0.3612], [-0.3353, 0.7307, -0.5947], [-0.6299, 0.2955, 0.7182]]
    np.testing.assert_allclose(found.knee.in_femur["tibia"].turn, rotation, atol=1e-4)
    assert any("knee_flex_r is prescribed" in doubt for doubt in found.doubts)
    assert any("cc drives knee_rot_r" in doubt for doubt in found.doubts)


def test_a_coordinate_that_a_table_leaves_out_follows_those_that_it_is_coupled_to(tmp_path):
    path = tmp_path / "model.osim"
    path.write_text(text_of((CONSTRAINTS, COUPLED + CONSTRAINTS), base=whole_knee()))
    flexion = np.array([0.0, 0.7])
    values = moved(read_model(path), {"knee_flex_r": flexion}).values
    np.testing.assert_allclose(values["knee_rot_r"], 2 * (0.5 * flexion + 0.01), atol=1e-15)
    said = moved(read_model(path), {"knee_flex_r": flexion, "knee_rot_r": 0 * flexion}).values
    assert not said["knee_rot_r"].any()


def test_splines_and_waves_are_those_of_opensim_and_unknown_functions_are_refused():
    """GCVSpline of order 3 and Sine, evaluated by OpenSim 4.6, inside and outside of the points."""
    points = "<x>0 0.3 0.7 1.3 1.8 2.0 2.4</x><y>0 0.02 0.03 0.01 -0.02 -0.01 0.05</y>"
    spline = f"<GCVSpline><half_order>3</half_order>{points}</GCVSpline>"
    axis = "<coordinates>knee_ant_r</coordinates><axis>1.0 0.0 0.0</axis>"
    old = ('knee_ant_r"><default_value>0.004</default_value>', f"{axis}")
    for function, at, value in (
        (spline, 0.5, 0.02691166), (spline, 1.55, -0.01088578), (spline, -0.3, -0.03267512),
        (spline, 2.8, 0.15624141),
        ("<Sine><amplitude>0.02</amplitude><omega>3</omega><phase>0.4</phase></Sine>", 0.5,
         0.02 * np.sin(1.9)),
    ):  # fmt: skip
        model = text_of(
            (old[0], f'knee_ant_r"><default_value>{at}</default_value>'),
            (axis, axis + function), base=whole_knee(flexion=0.0),
        )  # fmt: skip
        anterior = read(model).document["reference_pose"]["anterior_mm"]
        assert anterior == pytest.approx(1e3 * value, rel=1e-6)
    unknown = text_of((axis, f"{axis}<Wavelet name='function'/>"), base=whole_knee())
    with pytest.raises(InputProblem, match="Wavelet.*function of knee_r: Wavelet: expected one of"):
        read(unknown)
