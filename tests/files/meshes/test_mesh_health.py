"""Broken meshes are repaired with a sentence, or refused with one."""

import numpy as np
import pytest

from kneejax.files import InputProblem
from kneejax.files.meshes.health import borders, check_holes, take_apart
from kneejax.files.meshes.points import MeshPoints


def flat(count=21, size=20.0, shift=0.0):
    x = np.linspace(0, size, count)
    a, b = np.meshgrid(x, x, indexing="ij")
    points = np.stack([a, 0 * a + shift, b], axis=-1).reshape(-1, 3)
    row = np.arange(count * count).reshape(count, count)
    p, q, r, s = (x.ravel() for x in (row[:-1, :-1], row[:-1, 1:], row[1:, 1:], row[1:, :-1]))
    return points, np.concatenate([np.stack([p, q, r], 1), np.stack([p, r, s], 1)])


def apart(points, faces, scale=1.0):
    mesh = MeshPoints(points, np.zeros_like(points), faces, scale)
    return take_apart(mesh, "folder/sheet.stl")


def test_a_sound_sheet_gives_no_findings():
    sheets, findings = apart(*flat())
    assert findings == [] and len(sheets) == 1 and not sheets[0].closed
    assert sheets[0].area == pytest.approx(400.0)
    (border,) = borders(sheets[0])
    assert len(border) == 80
    points, areas, normals = sheets[0].corners()
    assert areas.sum() == pytest.approx(400.0)
    np.testing.assert_allclose(normals, np.tile([0.0, 1.0, 0.0], (len(points), 1)), atol=1e-12)


def test_triangles_that_face_the_other_way_are_turned(rng):
    points, faces = flat()
    wrong = rng.random(len(faces)) < 0.2
    faces = np.where(wrong[:, None], faces[:, ::-1], faces)
    (sheet,), findings = apart(points, faces)
    assert (sheet.normals[:, 1] > 0.99).all()
    assert any(f"{wrong.sum()} of 800 triangles faced the other way" in line for line in findings)


def test_a_closed_volume_faces_outwards():
    import trimesh

    ball = trimesh.creation.icosphere(2, radius=10.0)
    for faces in (ball.faces, ball.faces[:, ::-1]):
        (sheet,), _ = apart(np.array(ball.vertices), np.array(faces))
        assert sheet.closed
        assert (np.sum(sheet.normals * sheet.centers, axis=1) > 9).all()


def test_corners_that_coincide_and_triangles_without_area_go():
    points, faces = flat()
    twice = np.r_[points, points + 1e-5]
    faces = np.r_[faces[:400], faces[400:] + len(points), [[0, 1, 1]], faces[:3]]
    (sheet,), findings = apart(twice, faces)
    assert len(sheet.faces) == 800
    text = " ".join(findings)
    assert "corners that coincide" in text
    assert "1 triangle without area" in text and "3 triangles that stood there twice" in text


def test_two_sheets_and_a_fragment():
    first, second = flat(), flat(11, 10.0, shift=30.0)
    speck = np.array([[90.0, 0, 0], [91, 0, 0], [90, 0, 1]]), np.array([[0, 2, 1]])
    points = np.concatenate([first[0], second[0], speck[0]])
    faces = np.concatenate([first[1], second[1] + 441, speck[1] + 441 + 121])
    sheets, findings = apart(points, faces)
    assert [round(sheet.area) for sheet in sheets] == [400, 100]
    assert any("1 fragment " in line for line in findings)


@pytest.mark.parametrize(("radius", "refused"), [(2.6, False), (8.2, True)])
def test_small_holes_are_bridged_and_large_ones_refused(radius, refused):
    points, faces = flat(41, 40.0)
    centers = points[faces].mean(axis=1)
    away = np.hypot(centers[:, 0] - 20, centers[:, 2] - 20)
    (sheet,), findings = apart(points, faces[away > radius])
    if refused:
        with pytest.raises(InputProblem, match="a hole of .* mm at"):
            check_holes(sheet, findings)
    else:
        check_holes(sheet, findings)
        assert any("the fit bridges it" in line for line in findings)


def test_edges_of_three_triangles_are_no_surface():
    points, faces = flat(5, 10.0)
    wing = np.r_[points, points + [0.3, 5.0, 0.1]]
    fins = np.stack([faces[:, 0], faces[:, 1], faces[:, 2] + len(points)], axis=1)
    with pytest.raises(InputProblem, match="more than two triangles"):
        apart(wing, np.r_[faces, fins])


def test_lengths_in_another_unit_are_said():
    assert "multiplied by 1000" in " ".join(apart(*flat(), scale=1000.0)[1])
