"""Wrap objects of a model: on which side a cylinder is passed."""

from pathlib import Path

import pytest

from kneejax.files import import_osim

LEFT = Path(__file__).parent / "models" / "left_schema4.osim"


@pytest.mark.parametrize(
    ("quadrant", "side"), [("-x", "-x"), ("y", "+y"), ("+Y", "+y"), ("all", None)]
)
def test_a_cylinder_in_a_quadrant_is_passed_on_that_side(quadrant, side):
    text = LEFT.read_bytes()
    sizes = b"<length>0.12</length>"
    data = text.replace(sizes, sizes + f"<quadrant>{quadrant}</quadrant>".encode())
    read = import_osim(LEFT, side="l", data=data)
    assert read.document["ligaments"]["capsule"]["wrap"] == "back_of_knee"
    assert read.document["wraps"]["back_of_knee"].get("side") == side
    # Along its axis a cylinder has no sides.
    odd = text.replace(sizes, sizes + b"<quadrant>z</quadrant>")
    assert "quadrant z" in import_osim(LEFT, side="l", data=odd).knee.found.unsupported["capsule"]
