"""What acts on a knee in a model is read, refused or named; axes and bones are what they are."""

import itertools

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import (
    SMALLEST_MODEL,
    InputProblem,
    export_osim,
    format_import_report,
    import_osim,
    write_knee,
)
from kneejax.files.opensim._geometry import _mesh
from kneejax.files.opensim._model import read_model
from kneejax.files.opensim._movement import moved

FORCES, CONSTRAINTS, JOINTS, BODIES, MODEL = (
    "    </objects></ForceSet>", "  </Model>", "    </objects></JointSet>",
    '<Body name="tibia_r"/>', "    <length_units>",
)  # fmt: skip
BONES = (
    "<socket_frame1>/bodyset/femur_r</socket_frame1><socket_frame2>/bodyset/tibia_r</socket_frame2>"
)
PATH = (
    "<GeometryPath><PathPointSet><objects>"
    '<PathPoint name="a"><socket_parent_frame>/bodyset/{}</socket_parent_frame>'
    "<location>0 0.01 0</location></PathPoint>"
    '<PathPoint name="b"><socket_parent_frame>/bodyset/{}</socket_parent_frame>'
    "<location>0.02 -0.02 0</location></PathPoint>"
    "</objects></PathPointSet></GeometryPath>"
)
SPAN = PATH.format("femur_r", "tibia_r")
MENISCUS = (
    (BODIES, f'{BODIES}<Body name="meniscus_r"/>'),
    (JOINTS, '<FreeJoint name="meniscus_on_tibia"><socket_parent_frame>/bodyset/tibia_r'
     "</socket_parent_frame><socket_child_frame>/bodyset/meniscus_r</socket_child_frame>"
     '<coordinates><Coordinate name="men_tx_r"/></coordinates></FreeJoint>' + JOINTS),
)  # fmt: skip


def text_of(*pairs, base=SMALLEST_MODEL):
    for old, new in pairs:
        assert old in base
        base = base.replace(old, new, 1)
    return base


def with_force(force, *pairs):
    return text_of(*pairs, (FORCES, f"{force}\n{FORCES}"))


def read(text, side="r", **options):
    return import_osim("small.osim", side=side, data=text.encode(), **options)


# ---- forces and constraints of any class ----


@pytest.mark.parametrize(
    ("name", "force"),
    [
        ("PathSpring", SPAN + "<resting_length>0.029</resting_length><stiffness>1e5</stiffness>"),
        ("WISCO_Ligament", SPAN),
        ("Thelen2003Muscle", SPAN),
        ("ExpressionBasedBushingForce", BONES + "<Mx_expression>100*theta_x</Mx_expression>"),
        ("BushingForce", "<body_1>femur_r</body_1><body_2>tibia_r</body_2>"
         "<rotational_stiffness>0 0 9</rotational_stiffness>"),
        ("CoordinateLimitForce", "<coordinate>knee_angle_r</coordinate>"
         "<upper_stiffness>2</upper_stiffness><lower_stiffness>0</lower_stiffness>"),
        ("SpringGeneralizedForce",
         "<coordinate>knee_angle_r</coordinate><stiffness>3</stiffness>"),
        ("ExpressionBasedCoordinateForce",
         "<coordinate>knee_angle_r</coordinate><expression>-2*q</expression>"),
        ("PrescribedForce", "<socket_frame>/bodyset/tibia_r</socket_frame>"),
        ("ForceOfTheYear2031", "<socket_here>/jointset/knee_r/knee_angle_r</socket_here>"),
        ("HuntCrossleyForce", "<contact_parameters><objects><HuntCrossleyForce::ContactParameters>"
         "<geometry>ball bowl</geometry></HuntCrossleyForce::ContactParameters></objects>"
         "</contact_parameters>"),
        ("Millard2012EquilibriumMuscle", "<FunctionBasedPath><coordinate_paths>"
         "/jointset/knee_r/knee_angle_r</coordinate_paths></FunctionBasedPath>"),
    ],
)  # fmt: skip
def test_a_force_over_the_knee_that_is_not_read_is_counted_by_class_and_name(name, force):
    bowl = "".join(
        f'<ContactSphere name="{part}"><socket_frame>/bodyset/{body}</socket_frame></ContactSphere>'
        for part, body in (("ball", "femur_r"), ("bowl", "tibia_r"))
    )
    geometry = f"<ContactGeometrySet><objects>{bowl}</objects></ContactGeometrySet>"
    model = with_force(f'<{name} name="it">{force}</{name}>', (CONSTRAINTS, geometry + CONSTRAINTS))
    (doubt, *more) = read(model).doubts
    assert doubt.startswith(f"{name} (1): it, on ") and "left out" in doubt
    assert all("--without-patella" in one for one in more)
    report = format_import_report(read(model))
    assert doubt in report and "Nothing" not in report
    assert read(model, without=["it"]).doubts == ()
    inside = text_of((MODEL, f'<components><{name} name="it"><appliesForce>true</appliesForce>'
                      f"{force}</{name}></components>{MODEL}"),
                     (CONSTRAINTS, geometry + CONSTRAINTS))  # fmt: skip
    assert read(inside).doubts == read(model).doubts


@pytest.mark.parametrize("kind", ["WeldConstraint", "PointConstraint", "CoordinateCoupler"])
def test_so_is_a_constraint(kind):
    own = BONES + "<dependent_coordinate_name>knee_angle_r</dependent_coordinate_name>"
    held = f'<{kind} name="hold">{own}OFF</{kind}>'
    held = f"<ConstraintSet><objects>{held}</objects></ConstraintSet>"
    model = text_of((CONSTRAINTS, held + CONSTRAINTS))
    (doubt,) = read(model.replace("OFF", "")).doubts
    assert doubt.startswith(f"{kind} (1): hold")
    off = read(model.replace("OFF", "<isEnforced>false</isEnforced>"))
    assert off.doubts == () and "hold" in off.left_out[0] and "switched off" in off.left_out[0]


@pytest.mark.parametrize(
    ("force", "why"),
    [
        ("<PathSpring name='it'><appliesForce>false</appliesForce>{}</PathSpring>", "switched off"),
        ("<CoordinateActuator name='it'><coordinate>knee_angle_r</coordinate></CoordinateActuator>",
         "when it is driven"),
        ("<SpringGeneralizedForce name='it'><coordinate>knee_angle_r</coordinate>"
         "<stiffness>0.0e2</stiffness><viscosity>5</viscosity></SpringGeneralizedForce>",
         "in motion only"),
    ],
)  # fmt: skip
def test_what_exerts_nothing_at_rest_is_counted_and_no_doubt(force, why):
    found = read(with_force(force.format(SPAN)))
    assert found.doubts == ()
    (line,) = found.left_out
    assert "(1): it" in line and why in line and line in format_import_report(found)


def test_what_acts_elsewhere_is_not_missed():
    foot = (
        (BODIES, f'{BODIES}<Body name="foot_r"/>'),
        (JOINTS, '<PinJoint name="ankle_r"><socket_parent_frame>/bodyset/tibia_r'
         "</socket_parent_frame><socket_child_frame>/bodyset/foot_r</socket_child_frame>"
         '<coordinates><Coordinate name="ankle_angle_r"/></coordinates></PinJoint>' + JOINTS),
    )  # fmt: skip
    forces = (
        f"<PathSpring name='ankle'>{PATH.format('tibia_r', 'foot_r')}</PathSpring>"
        "<SpringGeneralizedForce name='it'><coordinate>ankle_angle_r</coordinate>"
        "<stiffness>3</stiffness></SpringGeneralizedForce>"
        "<PrescribedForce name='ground'><socket_frame>/bodyset/foot_r</socket_frame>"
        "</PrescribedForce>"
    )
    found = read(with_force(forces, *foot))
    assert (found.doubts, found.left_out) == ((), ())
    assert "PathSpring (1): ankle: does not act on this knee." in format_import_report(found)


def test_forces_switched_off_for_a_whole_class_are_off():
    off = "<appliesForce>false</appliesForce>"
    usual = f"<defaults><Blankevoort1991Ligament name='default'>{off}</Blankevoort1991Ligament>"
    other = f"<Blankevoort1991Ligament name='other'>{off.replace('false', 'true')}{SPAN}"
    numbers = "<linear_stiffness>900</linear_stiffness><slack_length>0.03</slack_length>"
    model = with_force(f"{other}{numbers}</Blankevoort1991Ligament>",
                       (MODEL, f"{usual}</defaults>{MODEL}"))  # fmt: skip
    found = read(model)
    assert list(found.document["ligaments"]) == ["other"]
    assert "LCL" in found.left_out[0] and "switched off" in found.left_out[0]


def test_a_model_of_ligaments_of_another_class_says_which():
    model = SMALLEST_MODEL.replace("Blankevoort1991Ligament", "UWLigament")
    with pytest.raises(InputProblem, match="1 of class UWLigament"):
        read(model)


def test_menisci_and_their_contacts_and_horns_are_counted():
    contact = (
        "<Smith2018ArticularContactForce name='femur_on_meniscus'>"
        "<socket_target_mesh>/contactgeometryset/f</socket_target_mesh>"
        "<socket_casting_mesh>/contactgeometryset/m</socket_casting_mesh>"
        "</Smith2018ArticularContactForce>"
        f"<Blankevoort1991Ligament name='horn'>{PATH.format('meniscus_r', 'tibia_r')}"
        "<slack_length>0.01</slack_length></Blankevoort1991Ligament>"
    )
    meshes = "".join(
        f"<Smith2018ContactMesh name='{name}'><socket_frame>/bodyset/{body}</socket_frame>"
        f"<mesh_file>{name}.stl</mesh_file></Smith2018ContactMesh>"
        for name, body in (("f", "femur_r"), ("m", "meniscus_r"))
    )
    sets = f"<ContactGeometrySet><objects>{meshes}</objects></ContactGeometrySet>"
    found = read(with_force(contact, *MENISCUS, (CONSTRAINTS, sets + CONSTRAINTS)))
    assert [doubt.split(",")[0] for doubt in found.doubts] == [
        "Blankevoort1991Ligament (1): horn",
        "Smith2018ArticularContactForce (1): femur_on_meniscus",
    ]
    assert list(found.document["ligaments"]) == ["LCL"]


def test_a_ligament_on_a_fibula_that_can_move_is_read_and_doubted(tmp_path, capsys):
    fibula = (
        (BODIES, f'{BODIES}<Body name="fibula_r"/>'),
        (JOINTS, '<PinJoint name="tibia_fibula_r"><socket_parent_frame>/bodyset/tibia_r'
         "</socket_parent_frame><socket_child_frame>place</socket_child_frame>"
         '<coordinates><Coordinate name="fib_r"><default_value>0.4</default_value></Coordinate>'
         '</coordinates><frames><PhysicalOffsetFrame name="place"><socket_parent>/bodyset/fibula_r'
         "</socket_parent><translation>0.02 0.05 0</translation></PhysicalOffsetFrame></frames>"
         "</PinJoint>" + JOINTS),
        ("/bodyset/tibia_r</socket_parent_frame>\n            <location>-0.018",
         "/bodyset/fibula_r</socket_parent_frame>\n            <location>-0.018"),
    )  # fmt: skip
    model = tmp_path / "model.osim"
    model.write_text(text_of(*fibula))
    assert main(["import", "osim", str(model), "--side", "r", "--out", str(tmp_path / "out")]) == 1
    printed = capsys.readouterr().out
    assert "1 fibre," in printed and "doubtful: LCL: on fibula_r, which can move" in printed
    end = import_osim(model, side="r").document["ligaments"]["LCL"]["tibial_attachment_mm"]
    c, s, x, y = np.cos(0.4), np.sin(0.4), -0.018 - 0.02, -0.052 - 0.05
    np.testing.assert_allclose(end, [1e3 * (c * x - s * y), 1e3 * (s * x + c * y), 36.0], atol=1e-9)


def test_stiffness_in_newtons_per_millimetre_is_doubted():
    model = SMALLEST_MODEL.replace(">2000<", ">35.0877193<")
    (doubt,) = read(model).doubts
    assert "below 50 N" in doubt and "N/mm" in doubt and "LCL that would be 2000 N" in doubt
    assert read(SMALLEST_MODEL).doubts == ()


# ---- where the bones are ----

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
    assert said.document == import_osim(model, side="r").document and said.doubts == ()
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
    np.testing.assert_allclose(found.knee.tibia_in_femur.matrix, rotation, atol=1e-4)
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


# ---- text that OpenSim takes ----


def test_bare_ampersands_dashes_in_comments_and_a_model_without_ground_are_read(tmp_path):
    odd = text_of(
        (MODEL, f"<publications>Smith & Jones &c</publications><!-- a -- b & c -->\n{MODEL}"),
        ('name="LCL"', 'name="LCL" note="R&D"'),
    )
    model, file = tmp_path / "model.osim", tmp_path / "knee.yaml"
    model.write_text(odd)
    document = import_osim(model, side="r").document
    assert document["ligaments"] == read(SMALLEST_MODEL).document["ligaments"] | {
        "LCL": document["ligaments"]["LCL"]
    }
    document["ligaments"]["LCL"]["stiffness_N"] = 2150.5
    write_knee(document, file)
    assert export_osim(file, model).data.decode() == odd.replace(">2000<", ">2150.5<")
    with pytest.raises(InputProblem, match="line 7, column 68: mismatched tag"):
        read(odd.replace("</Body", "</Bod").replace('"tibia_r"/>', '"tibia_r"></Bodi>'))
    weld = (
        '<WeldJoint name="root"><socket_parent_frame>/ground</socket_parent_frame>'
        "<socket_child_frame>/bodyset/femur_r</socket_child_frame></WeldJoint>"
    )
    assert list(read(text_of((JOINTS, weld + JOINTS))).document["ligaments"]) == ["LCL"]


def test_a_mesh_in_millimetres_that_the_model_scales_is_shifted_in_metres(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((60.0, 20.0, 80.0)).export(tmp_path / "t.stl")
    meshes = "".join(
        f"<Smith2018ContactMesh name='{name}'><socket_frame>/bodyset/{body}</socket_frame>"
        "<mesh_file>t.stl</mesh_file><location>0.001 0.002 -0.003</location>"
        "<scale_factors>0.001 0.001 0.001</scale_factors></Smith2018ContactMesh>"
        for name, body in (("f", "femur_r"), ("m", "tibia_r"))
    )
    contact = (
        "<Smith2018ArticularContactForce name='it'>"
        "<socket_target_mesh>/contactgeometryset/f</socket_target_mesh>"
        "<socket_casting_mesh>/contactgeometryset/m</socket_casting_mesh>"
        "</Smith2018ArticularContactForce>"
    )
    sets = f"<ContactGeometrySet><objects>{meshes}</objects></ContactGeometrySet>"
    (found,) = read(with_force(contact, (CONSTRAINTS, sets + CONSTRAINTS))).contacts
    box = trimesh.load_mesh(_mesh(tmp_path, found.femur, tmp_path))
    np.testing.assert_allclose(box.centroid, [0.001, 0.002, -0.003], atol=1e-8)
    np.testing.assert_allclose(np.ptp(box.vertices, axis=0), [0.06, 0.02, 0.08], atol=1e-8)
