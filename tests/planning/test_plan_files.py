"""Plan files: what is refused, in one line, before a knee moves."""

import copy

import numpy as np
import pytest
import trimesh
import yaml

from kneejax.cli import main
from kneejax.files import InputProblem, bone_surface, load_knee_file, write_knee
from kneejax.parameters import UnknownParameter
from kneejax.planning import intact_knee
from kneejax.studies import read_plan

PLAN = {"title": "a plan", "knee": "four_ligament", "graft": {"type": "hamstring"}}


def read(folder, **fields):
    plan = copy.deepcopy(PLAN) | fields
    path = folder / "plan.yaml"
    path.write_text(yaml.safe_dump(plan))
    return read_plan(path)


@pytest.mark.parametrize(
    ("fields", "said"),
    [
        ({"graft": {"type": "hamstrings"}}, "graft.type: hamstrings"),
        ({"graft": {"type": "hamstring", "bundles": 3}}, "graft.bundles: 3"),
        ({"tunnel": {}}, "did you mean tunnels"),
        ({"fixation": {"tension_N": 0}}, "a graft that is not pulled has no zero-load length"),
        ({"fixation": {"tension_N": -40}}, "a graft that is not pulled has no zero-load length"),
        ({"fixation": {"tension_N": [40, 40]}}, "a list of 1 numbers"),
        ({"graft": {"type": "patellar_tendon", "bundles": 2}, "fixation": {"tension_N": 900}},
         "less than the 892 N at which a bundle fails"),
        ({"tunnels": {"tibia_mm": [[9.0, 0.0]]}}, "on the bone: anterior and medial within"),
        ({"tunnels": {"femur_mm": [[0.0, 0.0], [1.0, 1.0]]}}, "two numbers each"),
        ({"bones": {"femur": "nowhere.stl"}}, "a mesh of the femur; not at"),
        ({"bones": {"patella": "patella.stl"}}, "bones.patella"),
        ({"limits": {"graft_N": 4000}}, "at most the 2422 N at which it fails"),
        ({"limits": {"tension_N": [90, 30]}}, "a lower and a larger upper limit"),
        ({"lachman": {"flexion_deg": [200]}}, "lachman.flexion_deg"),
        ({"flexion_deg": "80:0:5"}, "a step that leads from the first angle to the last"),
        ({"map": {"points": 2}}, "map.points: 2"),
        ({"front": {"population": 3}}, "front.population: 3"),
        ({"front": True, "optimum": False}, "front: True: expected an optimum that says what is"),
        ({"optimum": {"free": ["patella"]}}, "one of tibia, femur, tension"),
    ],
)  # fmt: skip
def test_one_line_says_what_is_wrong(tmp_path, fields, said):
    with pytest.raises(InputProblem) as problem:
        read(tmp_path, **fields)
    assert said in str(problem.value)
    assert "\n" not in str(problem.value)


def test_a_ligament_that_the_knee_has_not(tmp_path):
    with pytest.raises(UnknownParameter, match="no ligament 'ACI'; did you mean"):
        read(tmp_path, ligament="ACI")


def test_a_tunnel_lies_on_the_mesh_or_is_refused(tmp_path):
    knee = read(tmp_path).surgery
    plate = trimesh.creation.box((60.0, 2.0, 60.0))
    plate.apply_translation(knee.tibia.middle - [0.0, 3.5, 0.0])
    plate.export(tmp_path / "near.stl")
    near = read(tmp_path, bones={"tibia": "near.stl"}, tunnels={"tibia_mm": [[9.0, 0.0]]})
    point, slope = near.surgery.tibia.place(np.array([[9.0, 0.0]]))
    assert point[0] - knee.tibia.middle == pytest.approx([9.0, -2.5, 0.0], abs=1e-6)
    assert slope[0] == pytest.approx(knee.tibia.axes.T, abs=1e-9)
    plate.apply_translation([0.0, -3.0, 0.0])
    plate.export(tmp_path / "far.stl")
    with pytest.raises(InputProblem, match=r"within 3 mm of the tibia's mesh; this is 5.5 mm off"):
        read(tmp_path, bones={"tibia": "far.stl"})


def test_the_nearest_point_of_a_ball_is_towards_its_middle(tmp_path):
    ball = trimesh.creation.icosphere(4, radius=25.0)
    ball.export(tmp_path / "ball.stl")
    lay = bone_surface(tmp_path / "ball.stl")
    points = np.array([[30.0, 0.0, 0.0], [10.0, 20.0, 5.0]])
    laid, normals, far = lay(points)
    away = points / np.linalg.norm(points, axis=1)[:, None]
    assert laid == pytest.approx(25.0 * away, abs=0.1)
    assert (normals * away).sum(axis=1) == pytest.approx([1.0, 1.0], abs=1e-3)
    assert far == pytest.approx(np.abs(np.linalg.norm(points, axis=1) - 25.0), abs=0.1)


def test_on_a_slope_a_tunnel_moves_along_the_bone(tmp_path):
    middle = read(tmp_path).surgery.tibia.middle
    roof = trimesh.creation.box((90.0, 2.0, 90.0))
    roof.apply_transform(trimesh.transformations.rotation_matrix(0.2, [0.0, 0.0, 1.0]))
    roof.apply_translation(middle - [0.0, 1.6, 0.0])
    roof.export(tmp_path / "roof.stl")
    tibia = read(tmp_path, bones={"tibia": "roof.stl"}).surgery.tibia
    (here, there), slope = tibia.place(np.array([[0.0, 0.0], [0.5, 0.3]]))
    assert slope[0] @ [0.5, 0.3] == pytest.approx(there - here, abs=1e-9)


def test_what_a_plan_says_is_what_is_planned(tmp_path):
    plan = read(
        tmp_path, set={"MCL.stiffness": 1234.0}, octagon_apothem_mm=8.0, window=3,
        fixation={"flexion_deg": 15.0, "tension_N": 60.0}, flexion_deg="60:0:-20",
        limits={"graft_N": 300.0, "laxity_band_mm": 1.5, "tension_N": [30.0, 90.0]},
        lachman={"flexion_deg": [25.0], "force_N": 90.0},
        tunnels={"tibia_mm": [[1.0, -2.0]], "femur_mm": [[0.5, 3.0]]},
        footprints={"femur_mm": [5.0, 8.0]}, map={"points": 5, "femur_half_mm": 6.0},
    )  # fmt: skip
    surgery = plan.surgery
    assert float(plan.own.ligaments.stiffness[2]) == 1234.0
    assert (plan.octagon_mm, surgery.window, surgery.fixation_deg) == (8.0, 3, 15.0)
    assert plan.base.tolist() == [1.0, -2.0, 0.5, 3.0, 60.0]
    limits = surgery.limits
    assert (limits.graft_N, limits.band_mm, limits.tension_N) == (300.0, 1.5, (30.0, 90.0))
    through = surgery.protocol
    assert through.extension_deg.tolist() == [60.0, 40.0, 20.0, 0.0]
    assert (through.lachman_deg, through.force_N) == ((25.0,), 90.0)
    assert surgery.femur.semi_axes_mm == (5.0, 8.0)
    assert (plan.map_points, plan.map_half_mm) == (5, {"tibia": 11.0, "femur": 6.0})


def test_the_bundled_plan_is_paper_2s(tmp_path):
    plan = read_plan("ten_bundle")
    assert plan.surgery.plan.torn == ("aACL", "pACL")
    assert len(plan.surgery.protocol.extension_deg) == 33
    assert plan.octagon_mm == 10.0
    assert plan.free_choices.all()


def test_a_plan_on_the_knee_of_three_bones_is_the_same_plan():
    two, three = read_plan("ten_bundle"), read_plan("ten_bundle", patella=True)
    assert three.own.bodies == ("tibia", "patella")
    assert three.base.tolist() == two.base.tolist()
    assert three.surgery.plan.torn == two.surgery.plan.torn
    intact = intact_knee(three)
    assert intact.muscles.names[-1] == "graft" and len(intact.muscles.quadriceps) > 1
    assert float(intact.muscles.tension[-1]) == 0.0


def test_a_plan_asked_for_a_patella_that_its_knee_has_not_says_so(tmp_path):
    document = dict(load_knee_file("four_ligament").document)
    del document["patella"]
    write_knee(document, tmp_path / "bare.yaml")
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(PLAN | {"knee": "bare.yaml"}))
    with pytest.raises(InputProblem, match="patella: missing: expected this section"):
        read_plan(tmp_path / "plan.yaml", patella=True)


def test_two_bundles_stand_where_the_halves_of_the_ligament_do(tmp_path):
    plan = read(tmp_path, knee="ten_bundle", graft={"type": "hamstring", "bundles": 2})
    assert plan.surgery.replaced == (("aACL",), ("pACL",))
    ends, _ = plan.surgery.ends(plan.base[None])
    own = plan.own.ligaments
    # On the plane of the footprint, which passes through the middle of both.
    assert ends[0, :, 3] == pytest.approx(np.asarray(own.tibial_attachment)[:2, 0])


def test_bad_input_writes_nothing_and_ends_with_2(tmp_path, capsys):
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(PLAN | {"graft": {"type": "wool"}}))
    out = tmp_path / "out"
    assert main(["plan", "acl", str(tmp_path / "plan.yaml"), "--out", str(out)]) == 2
    assert "graft.type" in capsys.readouterr().err
    assert not out.exists()
    assert main(["plan", "acl", "--points", "2", "--out", str(out)]) == 2
    assert "--points" in capsys.readouterr().err
