"""The knees with the bundles of papers 2 and 3: their script, their tables, how they stand."""

import runpy
from pathlib import Path

import numpy as np
import pytest

import kneejax as kj
from kneejax.files import bundled_path, load_knee_file, write_knee

SCRIPT = Path(__file__).parents[2] / "data" / "make_ten_bundle.py"
NAMES = ("ten_bundle", "twelve_bundle")


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(SCRIPT))


def test_the_script_makes_the_committed_files_byte_for_byte(script, tmp_path):
    for name, document in script["documents"]().items():
        write_knee(document, tmp_path / "knee.yaml")
        assert (tmp_path / "knee.yaml").read_bytes() == bundled_path("knees", name).read_bytes()


def test_every_bundle_of_paper_2_has_the_numbers_of_its_table_1(script):
    lines = load_knee_file("ten_bundle").document["ligaments"]
    assert list(lines) == list(script["TABLE_1"])
    for name, (length, stiffness, strain) in script["TABLE_1"].items():
        own = lines[name]
        ends = [np.array(own[f"{end}_attachment_mm"]) for end in ("femoral", "tibial")]
        assert np.linalg.norm(ends[1] - ends[0]) == pytest.approx(length, abs=2e-3)
        assert (own["stiffness_N"], own["reference_strain"]) == (stiffness, strain)


def test_what_was_reconstructed_of_paper_3_is_said():
    document = load_knee_file("twelve_bundle").document
    said = {name: line["source"] for name, line in document["ligaments"].items()}
    assert all("lost" in said[name] for name in ("pPC", "pCM"))
    assert all("assumed" in said[name] for name in ("LPC", "MPC"))
    assert any("ASSUMPTION" in part["to"] for part in document["adaptations"])


@pytest.mark.long
@pytest.mark.parametrize("name", [NAMES[0], pytest.param(NAMES[1], marks=pytest.mark.long)])
def test_they_stand_from_0_to_90_degrees(name):
    motion = kj.passive_flexion(kj.load_knee(name), [0.0, 30.0, 60.0, 90.0])
    assert np.asarray(motion.status).tolist() == [0, 0, 0, 0]


@pytest.mark.long
def test_the_ten_bundles_give_most_near_20_to_30_degrees():
    (test,) = kj.lab_tests("drawer", [0.0, 20.0, 30.0, 60.0, 90.0], force_N=90.0, steps=4)
    (curves,) = kj.load_curves(kj.load_knee("ten_bundle"), test)
    found = [row.positive for row in kj.laxity(curves)]
    assert min(found[1:3]) > max(found[0], *found[3:])
