"""A scene is the knee that the mechanics computes with; pictures need what can draw them."""

import base64
import functools
import io
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import equinox as eqx
import jax
import numpy as np
import pytest
from matplotlib.figure import Figure

import kneejax as kj
from kneejax import report
from kneejax.files import mirror_document, read_knee, write_knee
from kneejax.geometry import Frame, Pose, WrapCylinder, WrapEllipsoid, WrapSphere
from kneejax.numerics import MissingPackage
from kneejax.report.scene.figures import _apart, _head
from kneejax.report.scene.rendering import (
    VIEWS,
    camera,
    pressure_colours,
    pressure_limit,
    strain_colour,
    strain_limit,
)
from kneejax.report.scene.surfaces import grid_triangles, obstacle_grid

TABLE = np.array([[15.0, 0.88, 7.51, 1.06, 1.03, -1.14], [60.0, 3.78, 3.13, 1.65, -0.99, -1.15]])
MIRROR = np.array([1.0, 1.0, -1.0])


def document():
    """The bundled knee with an MCL around a ball and an LCL through a point."""
    found = dict(read_knee(kj.files.bundled_path("knees", "four_ligament")).document)
    ligaments = {name: dict(part) for name, part in found["ligaments"].items()}
    for part in ligaments.values():
        part["source"] = "made up"
    ligaments["MCL"]["wrap"] = "ball"
    ligaments["LCL"]["via_points"] = [{"bone": "tibia", "point_mm": [-6.0, -25.0, 44.0]}]
    ball = {"kind": "sphere", "bone": "tibia", "center_mm": [6.0, -30.0, -24.0], "radius_mm": 9.0}
    return found | {
        "ligaments": ligaments,
        "wraps": {"ball": ball | {"source": "made up"}},
        "groups": {"collateral": ["MCL", "LCL"]},
    }


@pytest.fixture(scope="module")
def right(tmp_path_factory):
    folder = tmp_path_factory.mktemp("knees")
    write_knee(document(), folder / "right.yaml")
    return read_knee(folder / "right.yaml").knee


@pytest.fixture(scope="module")
def left(tmp_path_factory):
    folder = tmp_path_factory.mktemp("knees")
    write_knee(mirror_document(document()), folder / "left.yaml")
    return read_knee(folder / "left.yaml").knee


@pytest.fixture(scope="module")
def scenes(right):
    return report.scenes(right, Pose.from_table(TABLE))


@pytest.mark.long
def test_fibres_follow_their_course(right, scenes):
    found = kj.evaluate(right, Pose.from_table(TABLE))
    for i, scene in enumerate(scenes):
        for j, fibre in enumerate(scene.fibres):
            length = np.linalg.norm(np.diff(fibre.points_mm, axis=0), axis=1).sum()
            # A polyline inside an arc is a little shorter.
            assert length == pytest.approx(float(found.length[i, j]), rel=2e-3)
            assert length <= float(found.length[i, j]) + 1e-6
            np.testing.assert_allclose(fibre.strain, found.strain[i, j], rtol=1e-9)
            np.testing.assert_allclose(fibre.tension_N, found.tension[i, j], rtol=1e-9)
            end = right.ligaments.tibial_attachment[j]
            np.testing.assert_allclose(fibre.points_mm[-1], end, atol=1e-9)
    lcl = scenes[1].fibres[3].points_mm
    assert np.linalg.norm(lcl - [-6.0, -25.0, 44.0], axis=1).min() < 1e-9
    mcl = scenes[0].fibres[2].points_mm
    assert np.linalg.norm(mcl - [6.0, -30.0, -24.0], axis=1).min() > 9.0 - 1e-6


def test_a_band_from_the_pelvis_is_drawn_near_the_knee_alone(right, scenes):
    """Its upper end is cut off; the others are as long as they were."""
    row = right.ligaments.names.index("LCL")
    up = right.ligaments.femoral_attachment.at[row, 1].add(450.0)
    band = eqx.tree_at(lambda k: k.ligaments.femoral_attachment, right, up)
    (scene, *_), whole = report.scenes(band, Pose.from_table(TABLE)), scenes[0]
    drawn, before = ({f.name: f.points_mm for f in x.fibres} for x in (scene, whole))
    assert set(drawn) == set(before)
    reach = np.abs(np.concatenate([x for name, x in drawn.items() if name != "LCL"])).max()
    assert np.abs(drawn["LCL"]).max() < 2.0 * reach + 15.0 < 300.0
    np.testing.assert_allclose(drawn["ACL"], before["ACL"])


def test_groups_name_their_fibres(scenes):
    names = {name: [f.name for f in fibres] for name, fibres in scenes[0].groups.items()}
    assert names == {"ACL": ["ACL"], "PCL": ["PCL"], "collateral": ["MCL", "LCL"]}


def test_pressed_points_lie_under_the_femur(right, scenes):
    """Where pressure is drawn, the femoral sheet is drawn below the plateau, and nowhere else."""
    scene = scenes[0]
    for plateau, sheet in zip(scene.plateaus, scene.condyles, strict=True):
        pressed = plateau.points_mm[plateau.pressure_MPa > 0.3]
        assert len(pressed) > 10
        around = sheet.points_mm.reshape(-1, 3)
        nearest = np.argmin(
            np.linalg.norm((around[None] - pressed[:, None])[..., [0, 2]], axis=-1), axis=1
        )
        assert np.mean(around[nearest, 1] < pressed[:, 1] + 0.2) > 0.9


def test_a_left_knee_is_drawn_as_the_mirror_image(left, scenes):
    for ours, twin in zip(report.scenes(left, Pose.from_table(TABLE)), scenes, strict=True):
        assert ours.lateral == -1.0 and "left" in ours.title
        for part in ("fibres", "condyles", "plateaus", "obstacles"):
            for a, b in zip(getattr(ours, part), getattr(twin, part), strict=True):
                np.testing.assert_allclose(a.points_mm, b.points_mm * MIRROR, atol=1e-9)
        np.testing.assert_allclose(ours.directions["lateral"], [0.0, 0.0, -1.0])


def test_bones_keep_their_side():
    right = kj.load_knee("four_ligament")
    left = jax.tree.map(lambda x: x, right)
    object.__setattr__(left, "side", "left")
    corners = np.array([[0.0, 0.0, 5.0], [10.0, 0.0, 5.0], [0.0, 10.0, 30.0]])
    faces = np.array([[0, 1, 2]])
    poses = Pose.from_table(TABLE[1:])
    place = poses.placement
    turn = np.array([[float(x[0]) for x in row] for row in place.rotation])
    shift = np.array([float(x[0]) for x in place.translation])
    femur = report.BoneMesh("femur", corners, faces)
    (scene,) = report.scenes(right, poses, [femur, report.BoneMesh("tibia", corners, faces)])
    np.testing.assert_allclose(scene.bones[0].points_mm, (corners - shift) @ turn, atol=1e-9)
    np.testing.assert_allclose(scene.bones[1].points_mm, corners)
    mirrored = report.BoneMesh("femur", corners * MIRROR, faces)
    (other,) = report.scenes(left, poses, [mirrored])
    np.testing.assert_allclose(other.bones[0].points_mm, scene.bones[0].points_mm * MIRROR)
    with pytest.raises(ValueError, match="patella"):
        report.scenes(right, poses, [report.BoneMesh("patella", corners, faces)])


def test_obstacles_have_their_shape():
    frame = Frame([5.0, -3.0, 2.0], [0.3, -0.2, 0.5])
    passing = np.array([[5.0, 0.0, -20.0], [5.0, 0.0, 20.0]])
    own = [
        np.stack(frame.placement.apply_inverse(tuple(np.moveaxis(grid, -1, 0))), axis=-1)
        for grid in (
            obstacle_grid(WrapEllipsoid([8.0, 5.0, 3.0], frame), passing),
            obstacle_grid(WrapCylinder(6.0, 500.0, frame), passing),
            obstacle_grid(WrapSphere(4.0, frame), passing),
        )
    ]
    np.testing.assert_allclose(np.linalg.norm(own[0] / [8.0, 5.0, 3.0], axis=-1), 1.0)
    np.testing.assert_allclose(np.hypot(own[1][..., 0], own[1][..., 1]), 6.0)
    assert np.ptp(own[1][..., 2]) < 80.0  # cut near the fibres
    np.testing.assert_allclose(np.linalg.norm(own[2], axis=-1), 4.0)


def test_colours_tell_strain_and_pressure(scenes):
    limit = strain_limit(scenes)
    assert limit >= max(f.strain for s in scenes for f in s.fibres)
    assert strain_colour(limit, limit) != strain_colour(-limit, limit)
    assert strain_colour(5 * limit, limit) == strain_colour(limit, limit)
    plateau = scenes[0].plateaus[0]
    colours = pressure_colours(plateau, pressure_limit(scenes))
    assert colours.shape == (*plateau.pressure_MPa.shape, 3)
    apart = colours[plateau.pressure_MPa == 0]
    assert len(apart) and np.ptp(apart, axis=0).max() == 0.0
    assert not np.allclose(colours.reshape(-1, 3)[plateau.pressure_MPa.argmax()], apart[0])


def test_triangles_of_a_grid_cover_it():
    x, y = np.meshgrid(np.linspace(0, 3, 5), np.linspace(0, 2, 4), indexing="ij")
    points = np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3)
    a, b, c = np.moveaxis(points[grid_triangles(5, 4)], 1, 0)
    across = np.cross(b - a, c - a)[:, 2]
    assert abs(across.sum()) / 2 == pytest.approx(6.0)
    assert (np.sign(across) == np.sign(across[0])).all()


def test_cameras_see_the_knee_as_a_clinician_does(left, scenes):
    lateral = scenes[0].directions["lateral"]
    # From the front a right knee's lateral side is to the left.
    assert camera("anterior", scenes).right @ lateral == pytest.approx(-1.0)
    other = report.scenes(left, Pose.from_table(TABLE))
    assert camera("anterior", other).right @ other[0].directions["lateral"] == pytest.approx(1.0)
    for view in VIEWS:
        seen = camera(view, scenes)
        axes = np.stack([seen.right, seen.up, seen.towards])
        np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
        flat = np.abs(seen.seen(np.concatenate([scene.points_mm for scene in scenes])))
        assert (flat <= np.array(seen.half_mm) + 1e-9).all()
    toes = camera("medial", scenes), camera("medial", other)
    assert toes[0].right[0] == pytest.approx(-1.0) and toes[1].right[0] == pytest.approx(1.0)


@pytest.mark.parametrize("wanted", [[0.0, 0.0, 0.0], [9.5, 9.9, 3.0], [-9.9, -9.8], [], [1.0]])
def test_labels_keep_apart_and_inside(wanted):
    places = _apart(wanted, -10.0, 10.0, 1.0)
    assert all(
        b - a >= 1.0 - 1e-9 for a, b in zip(sorted(places), sorted(places)[1:], strict=False)
    )
    assert all(-10.0 - 1e-9 <= y <= 10.0 + 1e-9 for y in places)
    assert np.argsort(places, kind="stable").tolist() == np.argsort(wanted, kind="stable").tolist()


def messages(page):
    """What a page has packed for its drawing library: (time, message) in order."""
    msgspec, zstandard = pytest.importorskip("msgspec"), pytest.importorskip("zstandard")
    packed = base64.b64decode(re.search(r'__VISER_EMBED_DATA__="([^"]*)"', page)[1])
    inner = zstandard.ZstdDecompressor().decompress(packed[8:])
    size = int.from_bytes(inner[:8], "little")
    return msgspec.msgpack.decode(inner[8 : 8 + size], strict=False)["messages"]


def test_page_stands_alone_and_moves(scenes):
    pytest.importorskip("viser")
    page = report.scene_page(scenes)
    assert "Strain, %" in page and "Pressure, MPa" in page and len(page) < 2e6
    assert "<script src" not in page and 'src="http' not in page
    every = str(messages(page))
    assert "15\u00b0 flexion" in every and "60\u00b0 flexion" in every
    assert "ligaments/collateral/MCL" in every and "ACL" in every
    assert max(time for time, _ in messages(page)) > 0.0
    still = messages(report.scene_page(scenes[:1]))
    assert max(time for time, _ in still) == 0.0


def test_a_bone_is_sent_once_and_then_moved(right):
    """Points of what is rigid are the same in each pose: its frame moves."""
    pytest.importorskip("viser")
    ball = np.random.default_rng(0).normal(size=(40, 3))
    femur = report.BoneMesh("femur", 20.0 * ball, np.arange(39).reshape(-1, 3))
    page = report.scene_page(report.scenes(right, Pose.from_table(TABLE), [femur]))
    later = [message for time, message in messages(page) if time > 0.0]
    assert any("position" in str(message) and "/femur" in str(message) for message in later)
    sent = [m for m in later if m.get("name", "").startswith(("/femur/bone", "/femur/cartilage"))]
    assert not any("vertices" in str(message) for message in sent)


def test_odd_names_do_no_harm_to_the_page(right):
    pytest.importorskip("viser")
    odd = jax.tree.map(lambda x: x, right)
    object.__setattr__(odd, "name", "</script><script>alert(1)</script>$x$")
    page = report.scene_page(report.scenes(odd, Pose.from_table(TABLE[:1])))
    assert "<script>alert" not in page


@functools.cache
def can_draw():
    """Whether PyVista draws here, asked of another process: without a driver VTK may abort."""
    pytest.importorskip("pyvista")
    program = (
        "import pyvista as p; q = p.Plotter(off_screen=True, window_size=(40, 40));"
        "q.add_mesh(p.Sphere()); assert q.screenshot(return_img=True).std() > 0"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, timeout=120)
    return answer.returncode == 0


@pytest.fixture
def drawing():
    if not can_draw():
        pytest.skip("PyVista cannot draw off-screen here")


def test_render_shows_parts_where_the_camera_puts_them(scenes, drawing):
    from kneejax.report.scene.rendering import render

    seen = camera("anterior", scenes[:1])
    image = render(scenes[0], seen, 0.1, 3.0, height=300).astype(int)
    height, width, _ = image.shape
    assert width / height == pytest.approx(seen.half_mm[0] / seen.half_mm[1], rel=0.02)
    assert (image[0] == 255).all()  # white around
    for fibre in scenes[0].fibres:
        x, y = seen.seen(fibre.points_mm[-1])
        column = round((0.5 + 0.5 * x / seen.half_mm[0]) * (width - 1))
        row = round((0.5 - 0.5 * y / seen.half_mm[1]) * (height - 1))
        near = image[max(row - 2, 0) : row + 3, max(column - 2, 0) : column + 3]
        assert near.min() < 240, fibre.name


def test_pictures_and_film(scenes, drawing):
    from PIL import Image

    still = report.scene_figure(scenes[1], views=("anterior", "lateral"))
    words = {text.get_text() for axes in still.axes for text in axes.texts}
    assert {"ACL", "collateral", "Anterior", "Lateral", "20 mm"} <= words
    assert report.picture_png(still)[:4] == b"\x89PNG"
    moving = report.scenes_figure(scenes, views=("medial",))
    assert [axes.get_title("center") for axes in moving.axes[:2]] == ["15°", "60°"]
    film = Image.open(io.BytesIO(report.film(scenes)))
    assert film.format == "GIF" and film.n_frames == 2
    with pytest.raises(ValueError, match="expected one of anterior"):
        report.scene_figure(scenes[0], views=("from the moon",))


def test_a_missing_package_is_said_with_its_cure(scenes, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(MissingPackage, match=r"pip install 'kneejax\[view\]'"):
        report.scene_figure(scenes[0])
    monkeypatch.setitem(sys.modules, "viser", None)
    with pytest.raises(MissingPackage, match="viser"):
        report.scene_page(scenes)


def test_report_imports_without_the_extra():
    program = (
        "import sys; sys.modules['pyvista'] = sys.modules['viser'] = None; import kneejax.report"
    )
    environment = dict(os.environ, JAX_PLATFORMS="cpu")
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.long
def test_fibres_around_obstacles_of_one_kind_are_drawn_together(tmp_path):
    """Two balls of different size share a program; each fibre still goes around its own."""
    made = document()
    made["wraps"] |= {
        "small": made["wraps"]["ball"] | {"center_mm": [2.0, -32.0, 40.0], "radius_mm": 5.0}
    }
    del made["ligaments"]["LCL"]["via_points"]
    made["ligaments"]["LCL"]["wrap"] = "small"
    write_knee(made, tmp_path / "knee.yaml")
    knee = read_knee(tmp_path / "knee.yaml").knee
    poses = Pose.from_table(TABLE)
    found = kj.evaluate(knee, poses)
    for i, scene in enumerate(report.scenes(knee, poses)):
        strains = [fibre.strain for fibre in scene.fibres]
        np.testing.assert_allclose(strains, found.strain[i], rtol=1e-9)
        for row, center, radius in ((2, [6.0, -30.0, -24.0], 9.0), (3, [2.0, -32.0, 40.0], 5.0)):
            away = np.linalg.norm(scene.fibres[row].points_mm - center, axis=1)
            assert away.min() > radius - 1e-6
            assert (scene.fibres[row].points_mm.shape[0] > 2) and away.min() < 3 * radius
    assert float(found.wrap_angle[0, 2]) > 0


def test_the_number_of_poses_does_not_change_a_pose(right, scenes):
    table = np.linspace(TABLE[0], TABLE[1], 9)
    many = report.scenes(right, Pose.from_table(table))
    assert len(many) == 9
    for ours, alone in ((many[0], scenes[0]), (many[8], scenes[1])):
        for a, b in zip(ours.fibres, alone.fibres, strict=True):
            np.testing.assert_allclose(a.points_mm, b.points_mm, atol=1e-9)
        for a, b in zip(ours.plateaus, alone.plateaus, strict=True):
            np.testing.assert_allclose(a.pressure_MPa, b.pressure_MPa, atol=1e-9)


def test_plateaus_end_at_the_cartilages_border():
    """The drawn triangles cover the outline's area, with no teeth of the grid."""
    from kneejax.report.scene.scene import _to_the_rim

    turn = np.linspace(0.0, 2.0 * np.pi, 91)[:-1]
    rim = np.stack([10.0 * np.cos(turn), 0.0 * turn, 7.0 * np.sin(turn)], axis=1)
    x, z = np.meshgrid(np.linspace(-10, 10, 40), np.linspace(-7, 7, 40), indexing="ij")
    points = np.stack([x, 0.0 * x, z], axis=-1)
    covered = (x / 10.0) ** 2 + (z / 7.0) ** 2 < 1.0
    placed, faces, own = _to_the_rim(covered, points, rim)
    a, b, c = np.moveaxis(placed.reshape(-1, 3)[faces], 1, 0)
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    assert area == pytest.approx(np.pi * 70.0, rel=0.01)
    used = placed.reshape(-1, 3)[np.unique(faces)]
    assert np.hypot(used[:, 0] / 10.0, used[:, 2] / 7.0).max() < 1.0 + 1e-9
    assert covered.ravel()[own[np.unique(faces)]].all()


def test_long_bones_do_not_make_the_knee_small(right):
    """A page looks from where it looks without bones."""
    pytest.importorskip("viser")
    long = np.array([[0.0, -400.0, 0.0], [9.0, 400.0, 0.0], [0.0, 400.0, 9.0]])
    bones = [report.BoneMesh(bone, long, np.array([[0, 1, 2]])) for bone in ("femur", "tibia")]
    pages = [report.scene_page(report.scenes(right, Pose.from_table(TABLE), some))
             for some in ((), bones)]  # fmt: skip
    cameras = [[str(m) for _, m in messages(page) if "Camera" in m["type"]] for page in pages]
    assert cameras[0] and cameras[0] == cameras[1]


def test_colours_that_no_scale_explains_are_named():
    """Of obstacles and of the quadriceps, where they are drawn."""
    fibre = SimpleNamespace(is_muscle=True)
    for obstacles, fibres, words in (
        ((), (), []), ((1,), (fibre,), ["wrap obstacles", "quadriceps"]),
        ((1,), (), ["wrap obstacles"]), ((), (fibre,), ["quadriceps"])):  # fmt: skip
        figure = Figure()
        _head(figure, "knee", SimpleNamespace(obstacles=obstacles, fibres=fibres))
        assert [text.get_text()[2:] for text in figure.texts[1:]] == words
