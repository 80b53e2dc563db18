"""The bundled knees made of lenhart2015: what they hold, their left twins, their script."""

import runpy
from pathlib import Path

import equinox as eqx
import jax
import numpy as np
import pytest

import kneejax as kj
from kneejax.files import bundled_path, load_knee_file, mirror_document, read_knee, write_knee
from kneejax.geometry import Pose, State, convert_table
from kneejax.mechanics import load_of
from kneejax.parameters import select

SCRIPT = Path(__file__).parents[2] / "data" / "make_lenhart2015.py"
NAMES = ("lenhart2015", "lenhart2015_reduced")
#: Near the knee's own passive motion.
POSES = np.array(
    [
        [0.0, 0.0, 0.1, 1.4, 0.1, -0.2],
        [30.0, 2.1, 10.0, 4.2, -0.5, -0.5],
        [90.0, 4.9, -3.9, 1.0, -7.8, -0.8],
    ]
)


@pytest.fixture(scope="module")
def right():
    return {name: load_knee_file(name) for name in NAMES}


@pytest.fixture(scope="module")
def left(right, tmp_path_factory):
    """The same knees written as left ones, and read again."""
    folder = tmp_path_factory.mktemp("left")
    for name, file in right.items():
        write_knee(mirror_document(file.document), folder / f"{name}.yaml")
    return {name: read_knee(folder / f"{name}.yaml") for name in right}


def same_code(knee, twin):
    """The twin, said to be of the other's side: a word for people, and one compilation less."""
    assert {knee.side, twin.side} == {"left", "right"}
    answer = jax.tree.map(lambda x: x, twin)
    object.__setattr__(answer, "side", knee.side)
    return answer


def test_every_fibre_between_femur_and_tibia_is_there(right):
    full, reduced = (right[name].knee for name in NAMES)
    assert len(full.ligaments.names) == 55 and len(reduced.ligaments.names) == 11
    total = [float(np.sum(knee.ligaments.stiffness)) for knee in (full, reduced)]
    assert total[0] == total[1]
    for knee in (full, reduced):
        assert knee.contact_names == ("medial", "lateral")
        assert [line.name for line in knee.lines] == ["patellar_tendon"]


def test_sources_are_stated_and_no_machine_is_named(right):
    for name, file in right.items():
        text = bundled_path("knees", name).read_text(encoding="utf-8")
        assert "Lenhart et al." in file.description
        assert "/" not in text  # no path
        for fibre in file.knee.ligaments.names:
            assert "lenhart2015" in str(file.document["ligaments"][fibre]["source"])


def test_groups_hold_the_same_ligaments_in_both_knees(right):
    full, reduced = (right[name].knee for name in NAMES)
    fibres, lines = dict(full.groups), dict(reduced.groups)
    assert set(lines) <= set(fibres)
    for name, members in lines.items():
        whole = {fibre for line in members for fibre in fibres.get(line, ()) or fibres[name]}
        assert whole == set(fibres[name])
    assert set(fibres["ACL"]) == {n for n in full.ligaments.names if n.startswith("ACL")}
    for knee in (full, reduced):
        chosen = select(knee, ["ACL.stiffness", "MCL.stiffness"])
        assert len(chosen) == 2 and chosen.fibres(0) == dict(knee.groups)["ACL"]


def test_a_left_file_holds_mirrored_numbers_and_the_same_twin(right, left):
    for name in NAMES:
        ours, twin = right[name], left[name]
        assert twin.document["side"] == "left"
        for fibre, part in ours.document["ligaments"].items():
            x, y, z = part["femoral_attachment_mm"]
            assert twin.document["ligaments"][fibre]["femoral_attachment_mm"] == [x, y, -z]
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, rtol=0, atol=1e-12),
            ours.knee, same_code(ours.knee, twin.knee),
        )  # fmt: skip


def test_straight_fibres_of_a_left_knee_in_its_own_frame(left):
    """NumPy, with Z to the person's right, where varus and inward turns have the other sign."""
    file = left["lenhart2015"]
    parts = file.document["ligaments"]
    straight = [name for name, part in parts.items() if "wrap" not in part]
    ends = [
        np.array([parts[name][f"{end}_attachment_mm"] for name in straight])
        for end in ("femoral", "tibial")
    ]
    ligaments = file.knee.ligaments
    straightened = eqx.tree_at(lambda x: x.courses, ligaments, ())
    rows = [ligaments.names.index(name) for name in straight]
    for pose in POSES:
        f, a, r = np.radians(pose[:3]) * [-1.0, -1.0, -1.0]
        turn = (
            np.array([[np.cos(f), -np.sin(f), 0], [np.sin(f), np.cos(f), 0], [0, 0, 1]])
            @ np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
            @ np.array([[np.cos(r), 0, np.sin(r)], [0, 1, 0], [-np.sin(r), 0, np.cos(r)]])
        )
        tibial = ends[1] @ turn.T + pose[3:] * [1.0, 1.0, -1.0]
        expected = np.linalg.norm(tibial - ends[0], axis=1)
        found = np.asarray(straightened.length(State({"tibia": Pose.from_table(pose)})))
        np.testing.assert_allclose(found[rows], expected, atol=1e-9)


@pytest.mark.slow
def test_mechanics_of_a_left_knee_are_the_mirrored_right_ones(right, left):
    knee, twin = (files["lenhart2015"].knee for files in (right, left))
    ours, theirs = (
        kj.evaluate(each, Pose.from_table(POSES)) for each in (knee, same_code(knee, twin))
    )
    for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(theirs), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-9)
    assert np.all(np.asarray(ours.contact_force)[..., 1].sum(axis=1) < 0)  # down on the tibia


@pytest.mark.slow
def test_passive_flexion_of_a_left_knee_is_the_mirrored_right_one(right, left):
    knee, twin = (files["lenhart2015_reduced"].knee for files in (right, left))
    angles = np.array([0.0, 30.0, 90.0])
    ours, theirs = (kj.passive_flexion(each, angles) for each in (knee, same_code(knee, twin)))
    assert np.all(ours.equilibrium.converged) and np.all(ours.stable)
    np.testing.assert_allclose(ours.to_table(), theirs.to_table(), rtol=0, atol=1e-9)


@pytest.mark.slow
def test_a_drawer_at_90_degrees_is_read_along_the_floating_axis(right):
    """The femur's anterior axis points along the bent tibia: it shows a tenth of a mm of it."""
    knee = right["lenhart2015"].knee

    def at_90(size_N):
        motion = kj.passive_flexion(knee, [90.0], [load_of(anterior_N=size_N)])
        assert kj.Status(int(motion.status[0])) is kj.Status.BALANCED
        return motion.to_table()

    pulled, free = at_90(90.0), at_90(0.0)
    clinical, femoral = (
        (convert_table(pulled, "femoral", c) - convert_table(free, "femoral", c))[0]
        for c in ("grood-suntay", "femoral")
    )
    assert clinical[3] == pytest.approx(0.83, abs=0.03)
    assert femoral[3] == pytest.approx(0.10, abs=0.03)
    # What the femur's axes call inferior is the drawer.
    assert femoral[4] == pytest.approx(-clinical[3], abs=0.03)


@pytest.mark.slow
def test_the_script_makes_the_committed_files_byte_for_byte(tmp_path):
    script = runpy.run_path(str(SCRIPT))
    if not script["DEFAULT_SOURCE"].exists():
        pytest.skip("the model and its meshes are not here")
    script["write_both"](script["DEFAULT_SOURCE"], tmp_path)
    for name in NAMES:
        made = (tmp_path / f"{name}.yaml").read_bytes()
        assert made == bundled_path("knees", name).read_bytes()
