"""A recorded movement as what acts on a knee: a shank on a hinge, in closed form."""

import numpy as np
import pytest

from kneejax.files import InputProblem, read_activity
from kneejax.geometry import TIBIA, Pose, State

MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><Model name="swing">
<length_units>meters</length_units><force_units>N</force_units><gravity>0 -10 0</gravity>
<Ground name="ground"/><BodySet><objects>
<Body name="femur_r"><mass>8</mass></Body>
<Body name="tibia_r"><mass>4</mass><mass_center>0 -0.2 0</mass_center>
<inertia>0.05 0.01 0.05 0 0 0</inertia></Body>
</objects></BodySet>
<JointSet><objects>
<WeldJoint name="hip_r"><socket_parent_frame>/ground</socket_parent_frame>
<socket_child_frame>/bodyset/femur_r</socket_child_frame></WeldJoint>
<PinJoint name="knee_r"><socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
<socket_child_frame>/bodyset/tibia_r</socket_child_frame>
<coordinates><Coordinate name="knee_angle_r"/></coordinates></PinJoint>
</objects></JointSet>
<ForceSet><objects>
<Thelen2003Muscle name="hams_r"><max_isometric_force>1000</max_isometric_force>
<GeometryPath><PathPointSet><objects>
<PathPoint name="a"><socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
<location>-0.05 0.3 SIDE0.01</location></PathPoint>
<PathPoint name="b"><socket_parent_frame>/bodyset/tibia_r</socket_parent_frame>
<location>-0.03 -0.06 SIDE0.02</location></PathPoint>
</objects></PathPointSet></GeometryPath></Thelen2003Muscle>
<Thelen2003Muscle name="other_r"><max_isometric_force>1000</max_isometric_force>
<GeometryPath><PathPointSet><objects>
<PathPoint name="a"><socket_parent_frame>/bodyset/tibia_r</socket_parent_frame>
<location>0 0 0</location></PathPoint>
<PathPoint name="b"><socket_parent_frame>/bodyset/tibia_r</socket_parent_frame>
<location>0 -0.4 0</location></PathPoint>
</objects></PathPointSet></GeometryPath></Thelen2003Muscle>
</objects></ForceSet></Model></OpenSimDocument>"""
LOADS = """<?xml version="1.0" encoding="UTF-8"?><OpenSimDocument Version="40000">
<ExternalLoads><objects><ExternalForce name="floor">
<applied_to_body>tibia_r</applied_to_body>
<force_expressed_in_body>ground</force_expressed_in_body>
<point_expressed_in_body>ground</point_expressed_in_body>
<force_identifier>ground_force_r_v</force_identifier>
<point_identifier>ground_force_r_p</point_identifier>
<torque_identifier>ground_torque_SPIN_</torque_identifier>
</ExternalForce></objects><datafile>floor.mot</datafile></ExternalLoads></OpenSimDocument>"""
TIME = np.linspace(0.0, 1.0, 101)
ANGLE = -0.6 + 0.4 * np.sin(3.0 * TIME)
FORCE, POINT, SPIN = (20.0, 300.0, -10.0), (0.1, -0.5, 0.05), (0.0, 2.0, 0.0)


def storage(path, columns, degrees="no"):
    table = np.stack([*columns.values()], 1)
    rows = "\n".join("\t".join(f"{x:.15g}" for x in row) for row in table)
    names = "\t".join(columns)
    path.write_text(f"table\ninDegrees={degrees}\nendheader\n{names}\n{rows}\n")
    return path


def written(folder, side="r", spin="r", until=1.0, degrees="yes"):
    """A folder with a model, its coordinates, forces, and the ground."""
    model, loads = MODEL, LOADS.replace("SPIN", spin)
    sign = -1.0 if side == "l" else 1.0
    model = model.replace("SIDE", "-" if side == "l" else "")
    for old, new in (("_r", f"_{side}"),):
        model, loads = model.replace(old, new), loads.replace(old, new)
    (folder / "swing.osim").write_text(model)
    (folder / "floor.xml").write_text(loads)
    even = {"time": TIME}
    angle = np.rad2deg(ANGLE) if degrees == "yes" else ANGLE
    storage(folder / "angles.mot", even | {f"knee_angle_{side}": angle}, degrees)
    pulls = {f"hams_{side}": 100.0 + 0 * TIME, f"other_{side}": 0 * TIME}
    storage(folder / "pulls.sto", {"time": TIME * until} | pulls)
    mirror = np.array([1.0, 1.0, sign])
    numbers = [*(np.array(FORCE) * mirror), *(np.array(POINT) * mirror)]
    numbers += [*(np.array(SPIN) * sign * mirror)]
    own = [f"ground_force_{side}_{kind}{axis}" for kind in "vp" for axis in "xyz"]
    own += [f"ground_torque_{side}_{axis}" for axis in "xyz"]
    names = own + [f"ground_torque_q_{axis}" for axis in "xyz"]
    values = [x + 0 * TIME for x in (*numbers, 0.0, 0.0, 0.0)]
    storage(folder / "floor.mot", even | dict(zip(names, values, strict=True)))
    return folder


def read(folder, knee, side="r", files=("angles.mot", "pulls.sto", "floor.xml"), **options):
    given = [folder / name for name in files]
    options = {"frames": "same"} | options
    return read_activity(folder / "swing.osim", given, side=side, knee=knee, **options)


@pytest.fixture(scope="module")
def swing(tmp_path_factory, knee):
    return read(written(tmp_path_factory.mktemp("swing")), knee)


def on_tibia(record):
    """What each muscle does to the tibia at the recorded poses, `(muscles, n, 6)`."""
    state = State({TIBIA: Pose.from_table(record.pose)})
    return np.moveaxis(np.asarray(record.muscles.on_tibia(state)), -1, 1)


def test_flexion_is_that_of_the_hinge(swing):
    assert np.allclose(swing.pose[:, 0], np.rad2deg(-ANGLE), atol=1e-9)
    assert np.allclose(swing.pose[:, 1:], 0.0, atol=1e-9)


def test_inertia_weight_and_ground_are_those_of_closed_forms(swing):
    rate, faster = 1.2 * np.cos(3.0 * TIME), -3.6 * np.sin(3.0 * TIME)
    inertia = np.zeros((len(TIME), 6))
    inertia[:, 0], inertia[:, 1] = -0.8 * faster, -0.8 * rate**2
    inertia[:, 5] = -1000.0 * 0.21 * faster
    # Beyond the first and last rows the spline knows little.
    assert np.allclose(swing.acting["inertia"][3:-3], inertia[3:-3], rtol=1e-4, atol=2e-2)
    cos, sin = np.cos(ANGLE), np.sin(ANGLE)
    weight = np.stack([-40 * sin, -40 * cos, 0 * sin, 0 * sin, 0 * sin, -8000.0 * sin], 1)
    assert np.allclose(swing.acting["weight"], weight, atol=1e-9)
    turn = np.array([[cos, sin, 0 * sin], [-sin, cos, 0 * sin], [0 * sin, 0 * sin, 1 + 0 * sin]])
    moment = np.cross(POINT, FORCE) + SPIN
    ground = [np.einsum("ijn,j->ni", turn, x) for x in (FORCE, 1000.0 * moment)]
    assert np.allclose(swing.acting["ground"], np.concatenate(ground, axis=1), atol=1e-9)
    assert swing.mass_kg == 4.0
    assert np.allclose(swing.ground_N, FORCE)


def test_a_muscle_pulls_along_its_line(swing):
    assert swing.muscles.names == ("hams_r",)
    found = on_tibia(swing)[0]
    for row, wrench in zip((0, 40), found[[0, 40]], strict=True):
        c, s = np.cos(ANGLE[row]), np.sin(ANGLE[row])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        end = np.array([-30.0, -60.0, 20.0])
        way = turn.T @ [-50.0, 300.0, 10.0] - end
        force = 100.0 * way / np.linalg.norm(way)
        assert np.allclose(wrench, [*force, *np.cross(end, force)], atol=1e-9)


def test_feet_with_contacts_of_their_own_bear_what_the_ground_gives(swing, tmp_path, knee):
    """OpenSim records what a contact does to the ground, about the ground's origin."""
    folder = written(tmp_path)
    contact = """<HuntCrossleyForce name="sole"><HuntCrossleyForce::ContactParameters>
<geometry>floor ball</geometry></HuntCrossleyForce::ContactParameters></HuntCrossleyForce>"""
    ball = """<ContactGeometrySet><objects><ContactSphere name="ball">
<socket_frame>/bodyset/tibia_r</socket_frame></ContactSphere></objects></ContactGeometrySet>"""
    text = (folder / "swing.osim").read_text()
    text = text.replace("<ForceSet><objects>", f"{ball}<ForceSet><objects>{contact}")
    (folder / "swing.osim").write_text(text)
    about = np.cross(POINT, FORCE) + SPIN
    names = [f"sole.ground.{kind}.{axis}" for kind in ("force", "torque") for axis in "XYZ"]
    bears = {name: -x + 0 * TIME for name, x in zip(names, [*FORCE, *about], strict=True)}
    pulls = {"hams_r": 100.0 + 0 * TIME, "other_r": 0 * TIME}
    storage(folder / "pulls.sto", {"time": TIME} | pulls | bears)
    found = read(folder, knee, files=("angles.mot", "pulls.sto"))
    assert np.abs(found.acting["ground"] - swing.acting["ground"]).max() < 1e-6
    assert np.allclose(found.ground_N, FORCE)


def test_beside_muscles_a_reaction_tells_what_else_acts(swing, tmp_path, knee):
    """A muscle that a joint reaction includes pulls once, along its line."""
    folder = written(tmp_path)
    whole = sum(swing.acting.values(), on_tibia(swing).sum(axis=0))
    axes = [f"knee_r_on_tibia_r_in_tibia_r_{kind}{axis}" for kind in "fmp" for axis in "xyz"]
    values = np.column_stack([-whole[:, :3], -whole[:, 3:] / 1e3, np.zeros((len(TIME), 3))])
    columns = {"time": TIME} | dict(zip(axes, values.T, strict=True))
    storage(folder / "reaction.sto", columns)
    found = read(folder, knee, files=("angles.mot", "pulls.sto", "reaction.sto"))
    assert found.muscles.names == swing.muscles.names
    acting = sum(swing.acting.values())
    assert np.abs(found.acting["besides muscles"] - acting).max() < 1e-6 * np.abs(acting).max()
    assert [*found.acting] == ["besides muscles"]


def test_a_left_leg_is_its_mirrored_right_twin(swing, tmp_path, knee):
    left = read(written(tmp_path, side="l", spin="l"), knee, side="l")
    assert np.allclose(left.pose, swing.pose, atol=1e-9)
    for name, wrench in swing.acting.items():
        assert np.allclose(left.acting[name], wrench, atol=1e-6), name
    assert np.allclose(on_tibia(left), on_tibia(swing), atol=1e-9)


def test_landmarks_bring_the_axis_to_the_knees_own(swing, tmp_path, knee):
    found = read(written(tmp_path), knee, frames="auto")
    assert not found.same_frames and "shifts the femur by" in found.notes[0]
    assert np.allclose(found.pose[:, 0], swing.pose[:, 0], atol=1e-9)
    # Frames of the same axes: forces are the same, and moments about a shifted origin.
    for name, wrench in swing.acting.items():
        assert np.allclose(found.acting[name][:, :3], wrench[:, :3], atol=1e-9)
    # At the flexion of the reference pose the tibia is where that has it.
    reference = np.asarray(knee.reference_pose.to_table()).ravel()
    nearest = int(np.argmin(np.abs(found.pose[:, 0] - reference[0])))
    assert np.allclose(found.pose[nearest, 3:], reference[3:], atol=3.0)


def test_a_joint_reaction_is_taken_up_by_the_knee(swing, tmp_path, knee):
    """Given what the hinge transmits, the other way round, it is all that acts."""
    folder = written(tmp_path)
    whole = sum(swing.acting.values()) + on_tibia(swing)[0]
    point = np.array([0.01, 0.02, -0.03])
    force = -whole[:, :3]
    moment = -whole[:, 3:] / 1e3 - np.cross(point, force)
    names = [f"knee_r_on_tibia_r_in_tibia_r_{kind}{axis}" for kind in "fmp" for axis in "xyz"]
    rows = [*force.T, *moment.T, *(x + 0 * TIME for x in point)]
    table = dict(zip(["time", *names], [TIME, *rows], strict=True))
    storage(folder / "reaction.sto", table)
    found = read(folder, knee, files=("angles.mot", "reaction.sto"))
    assert not found.muscles.names
    assert np.allclose(found.acting["joint reaction"], whole, atol=1e-6)


def test_a_torque_of_another_force_is_doubted(tmp_path, knee):
    (doubt,) = read(written(tmp_path, spin="q"), knee).doubts
    assert "takes its torque from ground_torque_q; ground_torque_r would fit" in doubt


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({}, {"side": "l"}, "l"),
        ({}, {"files": ["angles.mot", "floor.xml"]}, "muscle forces: missing"),
        ({}, {"files": ["pulls.sto", "floor.xml"]}, "coordinates: missing"),
        ({}, {"files": ["angles.mot", "pulls.sto", "floor.mot"]}, "a table with the coordinate"),
        ({}, {"files": ["angles.mot", "angles.mot"]}, "a second table of coordinates"),
        ({}, {"frames": "equal"}, "one of auto, same, landmarks"),
        ({"until": -1.0}, {}, "time"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(change, options, said, tmp_path, knee):
    folder = written(tmp_path, **change)
    with pytest.raises(InputProblem, match=said) as problem:
        read(folder, knee, **options)
    assert "\n" not in str(problem.value)


def test_degrees_taken_for_radians_are_refused(tmp_path, knee):
    folder = written(tmp_path, degrees="no")
    text = (folder / "angles.mot").read_text().replace("inDegrees=no", "inDegrees=yes")
    (folder / "angles.mot").write_text(text)
    with pytest.raises(InputProblem, match="radians are suspected"):
        read(folder, knee)


def test_a_muscle_without_a_force_is_named(tmp_path, knee):
    folder = written(tmp_path)
    text = (folder / "pulls.sto").read_text().replace("hams_r", "hamz_r")
    text = text.replace("other_r", "other_r\tsoleus_r")
    lines = [x + "\t0" if x[:1].isdigit() or x[:1] == "-" else x for x in text.splitlines()]
    (folder / "pulls.sto").write_text("\n".join(lines))
    model = (folder / "swing.osim").read_text()
    more = '<Thelen2003Muscle name="soleus_r"/></objects></ForceSet>'
    (folder / "swing.osim").write_text(model.replace("</objects></ForceSet>", more))
    with pytest.raises(InputProblem, match=r"hams_r.*did you mean hamz_r"):
        read(folder, knee)
