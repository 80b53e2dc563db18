"""A ligament's mesh as a band: areas, direction, cross-sections of known bodies."""

import numpy as np
import pytest
import trimesh

from kneejax.files import InputProblem, band_of_meshes
from kneejax.geometry import Pose

POSE = Pose.from_table([20.0, 2.0, -5.0, 4.0, -30.0, 1.0])


def elliptic_bar(half, length=30.0, taper=0.0):
    """From y = 0 down, with fine ends, its widths by a linear factor along it."""
    bar = trimesh.creation.cylinder(1.0, length, sections=96)
    bar = bar.subdivide().subdivide()
    points = bar.vertices[:, [0, 2, 1]] * [1.0, -1.0, 1.0]
    points[:, 1] -= 0.5 * length
    wide = 1.0 + taper * points[:, 1] / length
    points[:, 0] *= half[0] * wide
    points[:, 2] *= half[1] * wide
    made = trimesh.Trimesh(points, bar.faces, process=False)
    made.fix_normals()
    return made


@pytest.fixture
def files(tmp_path):
    def write(bar):
        plate = trimesh.creation.box([60.0, 4.0, 60.0]).subdivide_to_size(3.0)
        upper = plate.copy().apply_translation([0.0, 2.0, 0.0])
        lower = plate.copy().apply_translation([0.0, -32.0, 0.0])
        there = POSE.placement
        turn = np.array([[float(c) for c in row] for row in there.rotation])
        shift = np.array([float(c) for c in there.translation])
        lower.vertices = (lower.vertices - shift) @ turn  # into the tibia's frame
        paths = [tmp_path / f"{name}.stl" for name in ("ligament", "femur", "tibia")]
        for path, mesh in zip(paths, (bar, upper, lower), strict=True):
            mesh.export(path)
        return paths, turn, shift

    return write


def test_an_elliptic_bar_between_two_plates_is_found(files):
    paths, turn, shift = files(elliptic_bar((6.0, 3.0)))
    band = band_of_meshes(*paths, POSE, within_mm=0.05)
    area = np.pi * 6.0 * 3.0
    np.testing.assert_allclose(band.areas_mm2, area, rtol=2e-3)
    assert band.area_mm2 == pytest.approx(area, rel=2e-3)
    np.testing.assert_allclose(band.direction, [0.0, -1.0, 0.0], atol=1e-3)
    np.testing.assert_allclose(band.femoral.centre, [0.0, 0.0, 0.0], atol=0.02)
    np.testing.assert_allclose(turn @ band.tibial.centre + shift, [0.0, -30.0, 0.0], atol=0.02)
    for found in (band.femoral.half_axes, band.tibial.half_axes @ turn.T):
        squares = found.T @ found
        np.testing.assert_allclose(squares, np.diag([36.0, 0.0, 9.0]), atol=0.4)
    entry = band.entry()
    assert entry["area_mm2"] == band.area_mm2 and len(entry["tibial_area"]["half_axes_mm"]) == 2


def test_a_tapered_bar_has_the_sections_of_a_cone_and_their_harmonic_mean(files):
    paths, *_ = files(elliptic_bar((6.0, 3.0), taper=0.4))
    band = band_of_meshes(*paths, POSE, within_mm=0.05)
    width = 1.0 - 0.4 * band.along_mm / 30.0
    np.testing.assert_allclose(band.areas_mm2, np.pi * 18.0 * width**2, rtol=4e-3)
    assert band.area_mm2 == pytest.approx(1.0 / np.mean(1.0 / band.areas_mm2))


def test_a_left_knee_has_the_mirrored_band(files, tmp_path):
    paths, *_ = files(elliptic_bar((6.0, 3.0), taper=0.4))
    left = [tmp_path / f"left_{path.name}" for path in paths]
    for path, mirrored in zip(paths, left, strict=True):
        mesh = trimesh.load(path)
        mesh.vertices = mesh.vertices * [1.0, 1.0, -1.0]
        mesh.invert()
        mesh.export(mirrored)
    band = band_of_meshes(*paths, POSE, within_mm=0.05)
    other = band_of_meshes(*left, POSE, within_mm=0.05, side="left")
    mirror = [1.0, 1.0, -1.0]
    np.testing.assert_allclose(other.tibial.centre * mirror, band.tibial.centre, atol=1e-4)
    squares = [x.T @ x for x in (other.tibial.half_axes * mirror, band.tibial.half_axes)]
    np.testing.assert_allclose(*squares, atol=1e-3)
    assert other.area_mm2 == pytest.approx(band.area_mm2, rel=1e-6)


def test_a_ligament_elsewhere_is_refused_with_what_to_look_for(files):
    bar = elliptic_bar((6.0, 3.0)).apply_translation([0.0, -5.0, 0.0])
    paths, *_ = files(bar)
    with pytest.raises(InputProblem, match="is the pose that of the scan"):
        band_of_meshes(*paths, POSE, within_mm=0.05)
