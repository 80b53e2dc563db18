"""Tables of OpenSim: what is read, what is refused, what stands between rows."""

import numpy as np
import pytest

from kneejax.files import InputProblem, read_storage
from kneejax.files.tables.storage import angles_rad, common_times

SECOND = r"row 2 \(line 7\)"
HEAD = "walk\nversion=1\ninDegrees={}\nendheader\ntime\tknee_angle_r\tankle\n"


def written(path, rows, degrees="yes"):
    path.write_text(HEAD.format(degrees) + "".join(f"{' '.join(map(str, x))}\n" for x in rows))
    return path


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("time\ta\n0\t1\n", "header: no line endheader"),
        (HEAD.format("yes") + "0 1 2\n0 3 4\n", SECOND + ", time: 0: expected more than 0 s"),
        (HEAD.format("yes") + "0 1 2\n-1 3 4\n", SECOND + ", time: -1"),
        (HEAD.format("yes") + "0 1 2\n1 3\n", SECOND + ": 2 cells: expected 3 cells"),
        (HEAD.format("yes") + "0 1 2\n1 3 much\n", SECOND + ", ankle: much: expected a number"),
        (HEAD.format("yes") + "0 1 2\n1 3 nan\n", "expected a finite number"),
        (HEAD.format("perhaps") + "0 1 2\n1 3 4\n", "inDegrees: perhaps: expected yes or no"),
        (HEAD.format("yes") + "0 1 2\n", "rows: 1 row: expected names of columns and two rows"),
        (
            HEAD.format("yes").replace("version", "nRows=3\nversion") + "0 1 2\n1 3 4\n",
            "nRows: 3: expected 2 rows, as the file has",
        ),
        (
            HEAD.format("yes").replace("version", "datacolumns 4\nversion") + "0 1 2\n1 3 4\n",
            "datacolumns: 4: expected 3 columns",
        ),
        (HEAD.format("yes") + "0 1 2\n1 3 4_0\n", SECOND + ", ankle: 4_0: expected a number"),
        ("walk\nendheader\nt\ta\n0\t1\n1\t2\n", "line 3: t: expected the column time first"),
    ],
)
def test_a_table_that_is_none_is_refused_in_one_line(text, said, tmp_path):
    path = tmp_path / "walk.sto"
    path.write_text(text)
    with pytest.raises(InputProblem, match=said) as problem:
        read_storage(path)
    assert "\n" not in str(problem.value)


def test_a_column_that_is_not_there_has_the_nearest_name(tmp_path):
    table = read_storage(written(tmp_path / "walk.sto", [(0, 1, 2), (1, 3, 4)]))
    with pytest.raises(InputProblem, match=r"did you mean knee_angle_r\?"):
        table.named("knee_angel_r")


def test_a_quintic_is_its_own_spline(tmp_path):
    time = np.linspace(0.0, 1.0, 12)
    rows = np.stack([time, time**5 - time, 10.0 * time**2], axis=1)
    table = read_storage(written(tmp_path / "walk.sto", rows.tolist()))
    between = np.array([0.05, 0.5, 0.93])
    found = table.at(between, ["knee_angle_r", "ankle"])
    assert np.allclose(found, [between**5 - between, 10.0 * between**2], atol=1e-12)


@pytest.mark.parametrize(
    ("degrees", "most", "said"), [("yes", 1.1, "radians are suspected"), ("no", 60.0, "degrees")]
)
def test_degrees_are_not_taken_for_radians(degrees, most, said, tmp_path):
    rows = [(x, most * x, 0.0) for x in (0.0, 0.5, 1.0)]
    table = read_storage(written(tmp_path / "walk.sto", rows, degrees))
    with pytest.raises(InputProblem, match=said):
        angles_rad(table, "knee_angle_r")


def test_steps_through_which_no_spline_leads_are_refused(tmp_path):
    table = read_storage(written(tmp_path / "walk.sto", [(t, t, 0) for t in (0, 1, 2, 3e300)]))
    with pytest.raises(InputProblem, match=r"walk.sto: time: steps from 1 to 3e\+300 s"):
        table.at(np.array([0.5]), ["ankle"])


def test_angles_are_read_in_the_unit_of_the_header(tmp_path):
    for degrees, most in (("yes", 60.0), ("no", np.pi / 3.0)):
        rows = [(x, most * x, 0.0) for x in (0.0, 0.5, 1.0)]
        table = read_storage(written(tmp_path / f"{degrees}.sto", rows, degrees))
        assert angles_rad(table, "knee_angle_r")[-1] == pytest.approx(np.pi / 3.0)


def test_times_of_several_tables(tmp_path):
    first = read_storage(written(tmp_path / "a.sto", [(x, x, 0) for x in (0, 1, 2, 3)]))
    second = read_storage(written(tmp_path / "b.sto", [(x, x, 0) for x in (1, 2.5, 4)]))
    late = read_storage(written(tmp_path / "c.sto", [(x, x, 0) for x in (5, 6)]))
    assert common_times([first, second]).tolist() == [1.0, 2.5]
    assert common_times([first, second], 3).tolist() == [1.0, 2.0, 3.0]
    with pytest.raises(InputProblem, match=r"c.sto: time: from 5 s: expected times that overlap"):
        common_times([first, late])


@pytest.mark.parametrize(
    ("name", "header", "degrees"),
    [
        ("slow.mot", "name slow bend\ndatacolumns 2\ndatarows 3\nrange 0 1\n", True),
        ("slow.mot", "slow\nversion=1\nnRows=3\nnColumns=2\n", False),
        ("slow.mot", "slow\nversion=1\ninDegrees=yes\n", True),
        ("slow.mot", "name slow\nAngles are in radians.\n", False),
        ("slow.sto", "slow\nAngles are in degrees.\n", True),
        ("slow.sto", "slow\n", False),
    ],
)
def test_a_header_without_a_unit_is_read_as_opensim_reads_it(name, header, degrees, tmp_path):
    """A .mot without a version is a motion of SIMM, which is in degrees."""
    path = tmp_path / name
    most = 30.0 if degrees else 0.5
    path.write_text(f"{header}endheader\ntime\tknee\n0\t{most / 3}\n0.5\t{most / 2}\n1\t{most}\n")
    table = read_storage(path)
    assert table.in_degrees == degrees
    assert np.isclose(angles_rad(table, "knee")[-1], np.deg2rad(30.0) if degrees else 0.5)


def test_a_unit_that_no_line_states_is_not_said_to_be_stated(tmp_path):
    path = tmp_path / "slow.sto"
    path.write_text("slow\nendheader\ntime\tknee\n0\t10\n0.5\t20\n1\t30\n")
    with pytest.raises(InputProblem, match="a header without a line inDegrees=yes") as problem:
        angles_rad(read_storage(path), "knee")
    assert "inDegrees=no" not in str(problem.value)
