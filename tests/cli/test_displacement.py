"""What `simulate` prints of poses, and how far it says that a load moved the tibia."""

from types import SimpleNamespace

import numpy as np
import pytest

from kneejax.geometry import CONVENTION_WORDS, CONVENTIONS, convert_table
from kneejax.report.flexion import displacement
from kneejax.report.pose_tables import change_table, pose_table
from kneejax.statics import Status

#: Bent by a right angle, unloaded; then drawn 0.9 mm forwards, which is down the femur, and turned.
FREE = np.array([[0.0, 1.0, 2.0, 1.0, -28.0, 0.5], [90.0, 0.0, 0.0, 2.0, -30.0, 1.0]])
DRAWN = FREE + np.array([[0, 0, -1, 2.0, 0, 0], [0, 0.5, -0.25, 0.0, -0.9, 0.0]])

def motion(table, *status):
    return SimpleNamespace(to_table=lambda: table, status=np.array(status))

def test_a_drawer_is_read_along_the_floating_axis():
    fine = (Status.BALANCED, Status.BALANCED)
    moved = displacement(motion(DRAWN, *fine), motion(FREE, *fine))
    assert moved[1, [0, 1, 2]] == pytest.approx([0.5, -0.25, 0.9], abs=1e-12)
    # In extension the femur's and the floating axis are one.
    assert moved[0, [0, 1, 2]] == pytest.approx([0.0, -1.0, 2.0], abs=1e-12)
    lines = change_table(FREE[:, 0], moved).text().splitlines()
    assert "its own axes" in lines[0] and lines[-1].split() == [
        "90.0", "0.50", "-0.25", "0.90", f"{moved[1, 3]:.2f}", f"{moved[1, 4]:.2f}",
    ]  # fmt: skip

def test_where_either_knee_does_not_balance_nothing_is_known():
    fine, lost = Status.BALANCED, Status.NOT_CONVERGED
    for loads in (((fine, lost), (fine, fine)), ((fine, fine), (fine, lost))):
        moved = displacement(motion(DRAWN, *loads[0]), motion(FREE, *loads[1]))
        assert np.isfinite(moved[0]).all() and np.isnan(moved[1]).all()

@pytest.mark.parametrize("convention", CONVENTIONS)
def test_poses_are_printed_with_their_convention_and_units(convention):
    table = convert_table(FREE, "femoral", convention)
    shown = pose_table(FREE, [Status.BALANCED] * 2, convention)
    lines = shown.text().splitlines()
    said = " ".join(lines)
    assert f"Poses, {convention}: {CONVENTION_WORDS[convention]}" in said
    units = next(line for line in lines if line.split()[:1] == ["deg"])
    assert units.split() == ["deg"] * 3 + ["mm"] * 3
    assert [float(x) for x in lines[-1].split()[:6]] == pytest.approx(table[1], abs=0.051)
