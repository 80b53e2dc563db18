"""Words, numbers and shapes that tables and pictures are made of."""

import numpy as np
import pytest

from kneejax.geometry import Pose
from kneejax.report.calibration_parameters import limits
from kneejax.report.information import slack_words
from kneejax.report.look.colours import part_styles
from kneejax.report.look.tables import Column, Table
from kneejax.report.pose_tables import named_places, pose_table, status_doubts
from kneejax.report.scene.figures import _apart
from kneejax.report.scene.pressure import degrees, spread
from kneejax.report.scene.rendering import strain_colour
from kneejax.report.scene.surfaces import grid_triangles, lots, state_of, tube


def test_limits_are_said_from_both_sides_or_from_one():
    assert limits(4127.0, 6081.0) == "4127 to 6081"
    assert limits(4929.0, float("nan")) == "above 4929"
    assert limits(float("nan"), 4929.0) == "below 4929"


def test_a_slack_ligament_is_said_by_ranges_of_flexion():
    slack = [True, False, False, True, True]
    words = "below 20 and above 40 degrees"
    assert slack_words(np.array([0, 20, 40, 60, 80]), np.array(slack)) == words


def test_bundles_of_a_structure_share_its_colour():
    styles = part_styles(["aACL", "pACL"])
    assert styles["aACL"] == {"color": "#D55E00", "linestyle": "-"}
    assert styles["pACL"] == {"color": "#D55E00", "linestyle": "--"}


def test_a_doubt_says_what_to_try_and_what_is_wrong():
    places = named_places(["0", "30"], "degrees")
    (said,) = status_doubts([0, 12], ["", "the search stopped 2 mm from a balance"], *places)
    assert said == (
        "30 degrees: no balance found: look for a fibre too tight or a load that nothing holds, or "
        "leave this pose out\n  at 30: the search stopped 2 mm from a balance"
    )


def test_cells_have_no_negative_zero_and_a_dash_for_nothing():
    column = Column("anterior_mm", show=".1f")
    assert [column.text(x) for x in (-0.02, -0.2, float("nan"))] == ["0.0", "-0.2", "-"]


def test_columns_of_words_stand_to_the_left_unless_they_say_otherwise():
    table = Table(["part", "force_N", Column("size", words=False)], [["ACL", 1.0, "big"]])
    assert [one.words for one in table.columns] == [True, False, False]
    assert [one.words for one in Table(["part"], []).columns] == [False]


def test_poses_as_people_read_them():
    first, *_, last = pose_table([[30.0, 1.0, 4.0, 2.0, -28.0, 0.5]], [0]).terminal().splitlines()
    assert first == "flexion  adduction  int.rot.  anterior  superior  lateral  status"
    assert last == "   30.0       1.00      4.00      2.00    -28.00     0.50  balanced"


@pytest.mark.parametrize(("count", "rows"), [(9, [0, 4, 8]), (2, [0, 1])])
def test_few_of_many_poses_lie_evenly_apart(count, rows):
    assert spread(count, 3).tolist() == rows


def test_angles_colours_and_labels_of_a_scene():
    assert (degrees(-1e-7), degrees(29.6)) == ("0°", "30°")
    assert (strain_colour(0.05, 0.05), strain_colour(-1.0, 0.05)) == ("#b40426", "#A9ADB2")
    assert _apart([0.0, 0.1, 5.0], -6.0, 6.0, 1.0) == pytest.approx([-0.45, 0.55, 5.0])


def test_meshes_of_a_scene():
    assert grid_triangles(2, 2).tolist() == [[0, 2, 1], [1, 2, 3]]
    corners, faces = tube(np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0]]), 2.0, sides=4)
    assert (corners.shape, faces.shape) == ((8, 3), (8, 3))
    assert np.abs(corners[:, :2]).max() == pytest.approx(1.0)


def test_poses_are_computed_in_lots_of_one_size():
    nine = state_of(Pose.from_table(np.zeros((9, 6))))
    assert [lot.shape for lot in lots(nine)] == [(8,), (8,)]
