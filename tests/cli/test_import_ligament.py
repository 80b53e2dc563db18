"""`kneejax import ligament` puts a band made of a mesh into a knee; or writes nothing."""

import numpy as np
import pytest
import trimesh

from kneejax.cli import main
from kneejax.files import load_knee_file
from kneejax.parameters import select

KNEE, HALF = "four_ligament", (5.0, 3.0)


@pytest.fixture
def words(tmp_path):
    """A bar along the knee's own MCL, between two balls, at the reference pose."""
    read = load_knee_file(KNEE)
    knee, row = read.knee, read.knee.ligaments.names.index("MCL")
    there = knee.reference_pose.placement
    turn = np.array([[float(x) for x in line] for line in there.rotation])
    shift = np.array([float(x) for x in there.translation])
    first, second = (np.asarray(x)[row] for x in (knee.ligaments.femoral_attachment,
                                                  knee.ligaments.tibial_attachment))  # fmt: skip
    second = turn @ second + shift
    bar = trimesh.creation.cylinder(1.0, segment=[first, second], sections=48).subdivide()
    bar = bar.subdivide()
    along = (second - first) / np.linalg.norm(second - first)
    across = np.cross(along, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(along, [0.0, 0.0, 1.0]))
    beside, line = np.cross(along, across), bar.vertices - first
    bar.vertices = first + np.stack([
        (line @ along)[:, None] * along, HALF[0] * (line @ across)[:, None] * across,
        HALF[1] * (line @ beside)[:, None] * beside]).sum(axis=0)  # fmt: skip
    plates = [trimesh.creation.cylinder(12.0, segment=[at, at + way * 3.0 * along]).subdivide()
              for at, way in ((first, -1.0), (second, 1.0))]  # fmt: skip
    plates = [one.subdivide_to_size(2.0) for one in plates]
    plates[1].vertices = (plates[1].vertices - shift) @ turn
    for name, mesh in zip(("MCL", "femur", "tibia"), (bar, *plates), strict=True):
        mesh.export(tmp_path / f"{name}.stl")
    return ["import", "ligament", str(tmp_path / "MCL.stl"), "--knee", KNEE,
            "--femur-bone", str(tmp_path / "femur.stl"), "--tibia-bone",
            str(tmp_path / "tibia.stl"), "--within", "0.05", "--out", str(tmp_path / "out"),
            "--modulus", "200", "--prestretch", "1.03", "--fibres", "12"]  # fmt: skip


def test_the_mesh_takes_the_place_of_the_fibre(words, tmp_path, capsys):
    assert main(words) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "drawn as 12 fibres, in place of MCL" in said
    knee = load_knee_file(tmp_path / "out" / "knee.yaml").knee
    rows = [i for i, name in enumerate(knee.ligaments.names) if name.startswith("MCL")]
    assert len(rows) == 12 and dict(knee.groups)["MCL"] == tuple(
        knee.ligaments.names[i] for i in rows
    )
    area = np.pi * HALF[0] * HALF[1]
    assert np.asarray(knee.ligaments.stiffness)[rows].sum() == pytest.approx(200 * area, rel=5e-3)
    stretch = select(knee, ["MCL.prestretch"]).read(knee)
    np.testing.assert_allclose(np.asarray(stretch), [1.03], atol=1e-9)
    own = load_knee_file(KNEE).knee.ligaments
    middle = np.asarray(knee.ligaments.tibial_attachment)[rows].mean(axis=0)
    old = np.asarray(own.tibial_attachment)[own.names.index("MCL")]
    np.testing.assert_allclose(middle, old, atol=0.05)
    assert (tmp_path / "out" / "cross_sections.csv").read_text().startswith("along_mm,area_mm2")


def test_a_band_of_toe_and_line(words, tmp_path):
    assert main([*words, "--law", "blankevoort", "--transition-strain", "0.05"]) == 0
    document = load_knee_file(tmp_path / "out" / "knee.yaml").document
    assert document["ligaments"]["MCL01"]["transition_strain"] == 0.05
    assert "MCL" not in document["ligaments"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--transition-strain", "0.05"], "--law blankevoort"),
        (["--modulus", "-1"], "youngs_modulus_MPa"),
        (["--within", "0"], "triangles"),
    ],
)
def test_what_is_wrong_is_said_and_nothing_written(words, more, said, tmp_path, capsys):
    if more[0] in words:
        words[words.index(more[0]) + 1] = more[1]
        more = []
    assert main([*words, *more]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out" / "knee.yaml").exists()
