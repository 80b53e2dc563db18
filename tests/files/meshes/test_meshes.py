import sys

import numpy as np
import pytest
import trimesh

from kneejax.files import InputProblem, read_mesh_points

TRIANGLE = (
    "solid x\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 20 0 0\nvertex 0 20 0\n"
    "endloop\nendfacet\nendsolid x\n"
)
POINTS = (
    "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    "property float z\nend_header\n0 0 0\n1 1 1\n"
)


@pytest.mark.parametrize("ending", [".stl", ".ply", ".obj", ".STL"])
@pytest.mark.parametrize(("size", "scale"), [(20.0, 1.0), (0.02, 1000.0)])
def test_a_sphere(tmp_path, ending, size, scale):
    path = tmp_path / f"sphere{ending}"
    trimesh.creation.icosphere(2, radius=size).export(path)
    mesh = read_mesh_points(path)
    assert mesh.scale == scale
    assert mesh.points_mm.shape == mesh.normals.shape == (162, 3)
    assert mesh.faces.shape == (320, 3)
    np.testing.assert_allclose(np.linalg.norm(mesh.points_mm, axis=1), 20.0, rtol=1e-5)
    assert (np.sum(mesh.normals * mesh.points_mm, axis=1) > 19.5).all()
    stated = read_mesh_points(path, unit="m" if scale == 1000 else "mm")
    np.testing.assert_array_equal(stated.points_mm, mesh.points_mm)


def refusal(path, unit="auto"):
    with pytest.raises(InputProblem) as caught:
        read_mesh_points(path, unit)
    line = str(caught.value)
    assert "\n" not in line and line.startswith(f"{path}: ") and "expected " in line
    return line


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.stl", b"", "empty"),
        ("a.stl", b"solid x\nendsolid x\n", "no triangles"),
        ("a.stl", TRIANGLE.encode(), "1 triangle:"),
        ("a.stl", b"hello, this is not a mesh", "triangle"),
        ("a.stl", bytes(range(256)) * 4, "triangle"),
        ("a.ply", b"hello, this is not a mesh", "a triangle mesh in PLY"),
        ("a.ply", POINTS.encode(), "no triangles"),
        ("a.obj", b"v 0 0 0\nv 1 0 0\n", "no triangles"),
        ("a.obj", b"\x00\xff\xfe", "a triangle mesh"),
        ("a.txt", b"v 0 0 0", "ending in .stl"),
        ("mesh", b"v 0 0 0", "no ending"),
        ("a.obj", b"v 0 0 0\nv 20 0 0\nv 0 20 nan\nv 0 0 20\n"
         b"f 1 2 3\nf 1 2 4\nf 1 3 4\nf 2 3 4\n", "finite"),
    ],
)  # fmt: skip
def test_a_bad_mesh_is_refused(tmp_path, name, content, words):
    path = tmp_path / name
    path.write_bytes(content)
    assert words in refusal(path)


def test_units(tmp_path):
    path = tmp_path / "sphere.stl"
    trimesh.creation.icosphere(1, radius=2.0).export(path)
    assert "diagonal" in refusal(path)
    assert read_mesh_points(path, "mm").scale == 1.0
    assert "one of auto, m, mm" in refusal(path, "inch")


def test_a_directory_and_a_missing_file(tmp_path):
    assert "a folder" in refusal(tmp_path)
    assert "missing" in refusal(tmp_path / "a.stl")


def written_by_vtk(path, mesh, ascii=False):
    reason = "VTK is not here"
    core = pytest.importorskip("vtkmodules.vtkCommonDataModel", reason=reason)
    support = pytest.importorskip("vtkmodules.util.numpy_support", reason=reason)
    points = pytest.importorskip("vtkmodules.vtkCommonCore", reason=reason).vtkPoints()
    writer = pytest.importorskip("vtkmodules.vtkIOXML", reason=reason).vtkXMLPolyDataWriter()
    points.SetData(support.numpy_to_vtk(np.ascontiguousarray(mesh.vertices), deep=True))
    polygons, data = core.vtkCellArray(), core.vtkPolyData()
    for face in mesh.faces:
        polygons.InsertNextCell(len(face), [int(i) for i in face])
    data.SetPoints(points)
    data.SetPolys(polygons)
    writer.SetInputData(data)
    writer.SetFileName(str(path))
    if ascii:
        writer.SetDataModeToAscii()
    assert writer.Write()


class Box:
    """Eight corners, six squares."""

    vertices = np.array([[x, y, z] for x in (0, 0.03) for y in (0, 0.02) for z in (0, 0.01)], float)
    faces = np.array(
        [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    )


def test_what_vtk_wrote(tmp_path, capfd):
    ball = trimesh.creation.icosphere(2, radius=20.0)
    ball.export(tmp_path / "ball.ply")
    expected = read_mesh_points(tmp_path / "ball.ply")
    for name in ("ball.vtp", "BALL.VTP"):
        written_by_vtk(tmp_path / name, ball, ascii=name.isupper())
        found = read_mesh_points(tmp_path / name)
        np.testing.assert_allclose(found.points_mm, expected.points_mm, atol=1e-5)
        np.testing.assert_array_equal(found.faces, expected.faces)
    written_by_vtk(tmp_path / "box.vtp", Box)
    box = read_mesh_points(tmp_path / "box.vtp")
    assert (box.scale, box.points_mm.shape, box.faces.shape) == (1000.0, (8, 3), (12, 3))
    assert (np.sum(box.normals * (box.points_mm - [15.0, 10.0, 5.0]), axis=1) > 0).all()
    whole = (tmp_path / "ball.vtp").read_bytes()
    for content in (whole[: len(whole) // 2], b"<VTKFile/>", b"hello, this is not a mesh"):
        (tmp_path / "bad.vtp").write_bytes(content)
        said = refusal(tmp_path / "bad.vtp")
        assert "not complete, or damaged" in said or "no triangles" in said
    assert capfd.readouterr() == ("", "")


def test_without_vtk_its_files_are_refused_with_a_way_out(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "vtkmodules", None)
    monkeypatch.setitem(sys.modules, "vtkmodules.vtkCommonCore", None)
    (tmp_path / "bone.vtp").write_bytes(b"<VTKFile/>")
    line = refusal(tmp_path / "bone.vtp")
    assert "kneejax[view]" in line and "STL" in line


@pytest.mark.parametrize(("ending", "options"), [
    (".ply", {"encoding": "ascii"}), (".ply", {}), (".stl", {}), (".stl", {"text": True}),
    (".obj", {}),
])  # fmt: skip
def test_a_mesh_that_was_cut_short_is_refused(tmp_path, ending, options):
    """Parsers read what is left: 151 of 320 triangles, or faces that begin a corner late."""
    kind = "stl_ascii" if options.pop("text", False) else ending[1:]
    data = trimesh.creation.icosphere(2, radius=20.0).export(file_type=kind, **options)
    data = data.encode() if isinstance(data, str) else data
    path = tmp_path / f"sphere{ending}"
    cuts = (7,) if ending == ".obj" else (7, len(data) // 3 + 5)  # an OBJ file counts nothing
    for cut in cuts:
        path.write_bytes(data[:-cut])
        said = refusal(path)
        assert any(word in said for word in ("triangle", "row", "corner"))
    if b"\x00" not in data and ending == ".ply":
        head, _, rows = data.partition(b"end_header\n")
        path.write_bytes(head + b"end_header\n" + rows.partition(b"\n")[2])
        assert "vertex, row 162: 4 numbers: expected a whole row" in refusal(path)
