"""The bundled knee is what its script makes of the public meshes."""

import runpy
from pathlib import Path

import pytest

from kneejax.files import bundled_path, write_knee

SCRIPT = Path(__file__).parents[2] / "data" / "make_four_ligament.py"


def test_the_script_makes_the_committed_file_byte_for_byte(tmp_path):
    script = runpy.run_path(str(SCRIPT))
    if not script["DEFAULT_SOURCE"].exists():
        pytest.skip("the meshes are not bundled")
    made = tmp_path / "knee.yaml"
    write_knee(script["document"](script["DEFAULT_SOURCE"]), made)
    assert made.read_bytes() == bundled_path("knees", "four_ligament").read_bytes()
