"""What acts on a knee in a model is read, refused or named, whatever its class."""

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
from kneejax.files.opensim.contact import _mesh

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


def test_a_fibre_without_a_second_point_is_named():
    fibre = SPAN[: SPAN.index('<PathPoint name="b"')] + SPAN[SPAN.index("</objects>") :]
    model = with_force(f"<Blankevoort1991Ligament name='half'>{fibre}</Blankevoort1991Ligament>")
    assert read(model).doubts == ("half was left out: not supported: its path has 1 point.",)


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
    assert found.numbers_left_out == "left out: 1 contact, 1 fibre, 1 meniscus"
    report = format_import_report(found)
    assert "- In all, left out: 1 contact, 1 fibre, 1 meniscus.\n- Bodies" in report
    assert read(SMALLEST_MODEL).numbers_left_out == ""


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
    assert "1 fibre," in printed and "warning: LCL: on fibula_r, which can move" in printed
    end = import_osim(model, side="r").document["ligaments"]["LCL"]["tibial_attachment_mm"]
    c, s, x, y = np.cos(0.4), np.sin(0.4), -0.018 - 0.02, -0.052 - 0.05
    np.testing.assert_allclose(end, [1e3 * (c * x - s * y), 1e3 * (s * x + c * y), 36.0], atol=1e-9)


def test_stiffness_in_newtons_per_millimetre_is_doubted():
    model = SMALLEST_MODEL.replace(">2000<", ">35.0877193<")
    (doubt,) = read(model).doubts
    assert "below 50 N" in doubt and "N/mm" in doubt and "LCL that would be 2000 N" in doubt
    assert read(SMALLEST_MODEL).doubts == ()


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
    mismatch = "line 7, column 73: mismatched tag Bodi for Body of line 7"
    with pytest.raises(InputProblem, match=mismatch):
        read(odd.replace("</Body", "</Bod").replace('"tibia_r"/>', '"tibia_r"></Bodi>'))
    weld = (
        '<WeldJoint name="root"><socket_parent_frame>/ground</socket_parent_frame>'
        "<socket_child_frame>/bodyset/femur_r</socket_child_frame></WeldJoint>"
    )
    assert list(read(text_of((JOINTS, weld + JOINTS))).document["ligaments"]) == ["LCL"]


def test_entities_are_refused_before_anything_is_read():
    own = "<!DOCTYPE a [<!ENTITY name SYSTEM 'file:///etc/hostname'>]>\n<OpenSimDocument"
    model = SMALLEST_MODEL.replace("<OpenSimDocument", own).replace("smallest", "&name;")
    with pytest.raises(InputProblem, match="line 2: <!ENTITY: expected .* without entities"):
        read(model)


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
