"""Imported knees against OpenSim itself: pose of the bones, places of the points."""

import re
from pathlib import Path

import numpy as np
import pytest

from kneejax.files import import_osim
from kneejax.files.opensim.model import simm_spline
from kneejax.geometry import Pose

pytestmark = pytest.mark.opensim
MODELS = Path(__file__).parent / "models"
LENHART = Path(__file__).parents[3] / "../shared/data/lenhart2015/lenhart2015.osim"
# Classes of OpenSim JAM that OpenSim does not have, and the one that our file leaves half empty.
FOREIGN = re.compile(
    r"<(Smith2018\w+|Ligament|Millard2012EquilibriumMuscle)\b(?: name=\"[^\"]*\")?>.*?</\1>", re.S
)
# The one with <defaults> comes last: OpenSim keeps them for every model that follows.
CASES = [
    (LENHART, "r"),
    (MODELS / "right_schema3.osim", "r"),
    (MODELS / "left_schema4.osim", "l"),
]


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case[0].stem)
def both(request, tmp_path_factory):
    """What we read, and OpenSim's model and state of the same file."""
    osim = pytest.importorskip("opensim")
    path, side = request.param
    if not path.exists():
        pytest.skip("the shared data are not here")
    known = tmp_path_factory.mktemp("osim") / path.name
    known.write_text(FOREIGN.sub("", path.read_text(encoding="utf-8")), encoding="utf-8")
    osim.Logger.setLevelString("Off")
    model = osim.Model(str(known))
    return import_osim(path, side=side), model, model.initSystem(), osim


def _array(vector):
    return np.array([vector.get(i) for i in range(3)])


def test_reference_pose_is_that_of_the_default_coordinates(both):
    read, model, state, osim = both
    bodies = [model.getBodySet().get(name) for name in (read.knee.femur, read.knee.tibia)]
    theirs = [
        _array(bodies[1].findStationLocationInAnotherFrame(state, osim.Vec3(*x), bodies[0]))
        for x in np.vstack([np.zeros(3), 0.1 * np.eye(3)])
    ]
    mirror = np.array([1.0, 1.0, -1.0 if read.knee.side == "l" else 1.0])
    table = [read.document["reference_pose"][c] for c in list(read.document["reference_pose"])[:6]]
    placement = Pose.from_table(table).placement
    for x, there in zip(np.vstack([np.zeros(3), 0.1 * np.eye(3)]), theirs, strict=True):
        ours = np.array(placement.apply(tuple(1e3 * x * mirror)), float) * mirror
        np.testing.assert_allclose(ours, 1e3 * there, atol=1e-9)


def test_every_point_is_where_opensim_has_it_in_its_bone(both):
    read, model, state, osim = both
    bones = {
        "femur": model.getBodySet().get(read.knee.femur),
        "tibia": model.getBodySet().get(read.knee.tibia),
    }
    assert read.ligaments
    for name, ligament in read.ligaments.items():
        force = osim.Blankevoort1991Ligament.safeDownCast(model.getForceSet().get(ligament.key))
        path = osim.GeometryPath.safeDownCast(force.getComponent("path"))
        points = path.getPathPointSet()
        by_name = {points.get(i).getName(): points.get(i) for i in range(points.getSize())}
        entry = read.document["ligaments"][name]
        vias = entry.get("via_points", [])
        places = [
            ("femur", entry["femoral_attachment_mm"]),
            *((via["bone"], via["point_mm"]) for via in vias),
            ("tibia", entry["tibial_attachment_mm"]),
        ]
        assert len(places) == points.getSize()
        for (bone, place), point in zip(places, ligament.points, strict=True):
            theirs = by_name[point.element.name]
            there = theirs.getParentFrame().findStationLocationInAnotherFrame(
                state, theirs.getLocation(state), bones[bone]
            )
            np.testing.assert_allclose(place, 1e3 * _array(there), atol=1e-9)
        assert entry["stiffness_N"] == force.get_linear_stiffness()
        assert entry["slack_length_mm"] == pytest.approx(1e3 * force.get_slack_length(), rel=1e-15)
        assert entry["transition_strain"] == force.get_transition_strain()
        assert entry["damping_N_s"] == force.get_damping_coefficient()


def test_wrap_objects_stand_as_in_opensim(both):
    read, model, state, osim = both
    for name, wrap in read.wraps.items():
        entry, bone = read.document["wraps"][name], read.document["wraps"][name]["bone"]
        body = model.getBodySet().get(getattr(read.knee, bone))
        found = [osim.WrapObject.safeDownCast(c) for c in list(model.getComponentsList())]
        theirs = next(o for o in found if o is not None and o.getName() == wrap.element.name)
        frame = theirs.getFrame()
        for x in np.vstack([np.zeros(3), 0.01 * np.eye(3)]):
            within = theirs.getTransform().shiftFrameStationToBase(osim.Vec3(*x))
            there = _array(frame.findStationLocationInAnotherFrame(state, within, body))
            angles = np.deg2rad(entry.get("rotation_deg", [0.0, 0.0, 0.0]))
            ours = _turned(angles, 1e3 * x) + entry["center_mm"]
            np.testing.assert_allclose(ours, 1e3 * there, atol=1e-9)


def _turned(angles, x):
    c, s = np.cos(angles), np.sin(angles)
    rx = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
    ry = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
    rz = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
    return rx @ ry @ rz @ x


def test_opensims_own_rewriting_of_schema_3_is_the_same_knee(tmp_path):
    osim = pytest.importorskip("opensim")
    osim.Logger.setLevelString("Off")
    model = osim.Model(str(MODELS / "right_schema3.osim"))
    model.initSystem()
    model.printToXML(str(tmp_path / "new.osim"))
    old, new = (
        import_osim(path, side="r").document
        for path in (MODELS / "right_schema3.osim", tmp_path / "new.osim")
    )
    for section in ("ligaments", "wraps"):
        for entry in (*old[section].values(), *new[section].values()):
            del entry["source"]
        assert new[section] == old[section]
    for column in list(old["reference_pose"])[:6]:
        assert new["reference_pose"][column] == pytest.approx(old["reference_pose"][column])


@pytest.mark.parametrize("count", [2, 3, 4, 5, 9])
def test_splines_equal_those_of_opensim(count, rng):
    osim = pytest.importorskip("opensim")
    knots, values = np.cumsum(rng.uniform(0.2, 1.0, count)), rng.normal(size=count)
    spline = osim.SimmSpline()
    for x, y in zip(knots, values, strict=True):
        spline.addPoint(x, y)
    for x in np.linspace(knots[0] - 1, knots[-1] + 1, 60):
        theirs = spline.calcValue(osim.Vector(1, x))
        assert simm_spline(knots, values, x) == pytest.approx(theirs, abs=1e-12)
