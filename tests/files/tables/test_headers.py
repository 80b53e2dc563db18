"""Tables of robots, whose columns are recognised by the words and units of their headers."""

import numpy as np
import pytest

from kneejax.files import InputProblem, read_lab_table, read_poses
from kneejax.files.tables.headers import header_meaning
from kneejax.geometry import COLUMNS, FREE_COORDINATES
from kneejax.parameters import Assumption

SIMVITRO = {  # as Open Knee(s) names them
    "Knee JCS Medial": -4.0, "Knee JCS Posterior": -6.0, "Knee JCS Superior": -30.0,
    "Knee JCS Flexion": 30.0, "Knee JCS Valgus": 1.5, "Knee JCS Internal Rotation": 8.0,
    "JCS Load Lateral Drawer": 3.0, "JCS Load Anterior Drawer": 90.0,
    "JCS Load Distraction": -20.0, "JCS Load Extension Torque": 1.0,
    "JCS Load Varus Torque": 0.5, "JCS Load External Rotation Torque": -2.0,
}  # fmt: skip
READ = {"lateral": 4.0, "anterior": 6.0, "superior": -30.0, "adduction": -1.5,
        "internal_rotation": 8.0}  # fmt: skip
LOADS = {"lateral_N": 3.0, "anterior_N": 90.0, "compression_N": 20.0, "varus_Nm": 0.5,
         "internal_Nm": 2.0}  # fmt: skip


def unit_of(header):
    if "Load" in header:
        return "Nm" if "Torque" in header else "N"
    turns = any(x in header for x in ("Flexion", "Valgus", "Rotation"))
    return "deg" if turns else "mm"


def table(folder, columns, name="017_AP laxity.csv"):
    """A table of header -> a number or a number for each row."""
    rows = np.column_stack(np.broadcast_arrays(*(np.atleast_1d(x) for x in columns.values())))
    lines = [",".join(columns), *(",".join(f"{x:.9g}" for x in row) for row in rows)]
    (folder / name).write_text("\n".join(lines) + "\n")
    return folder / name


def read(path, says="", **options):
    with pytest.warns(Assumption) as found:
        answer = read_lab_table(path, **options)
    (said,) = found
    assert says in str(said.message) and "\n" not in str(said.message)
    return answer


def check(answer, flexion=30.0):
    assert answer.flexion_deg == pytest.approx(flexion)
    assert {name: sizes[0] for name, sizes in answer.loads.items()} == pytest.approx(LOADS)
    own = dict(zip(FREE_COORDINATES, answer.observed[0], strict=True))
    assert own == pytest.approx(READ)


@pytest.mark.parametrize("written", ["{} [{}]", "{}({})"])
def test_columns_of_simvitro_need_no_mapping(tmp_path, written):
    columns = {written.format(header, unit_of(header)): x for header, x in SIMVITRO.items()}
    check(read(table(tmp_path, columns), "lateral_mm from -Knee JCS Medial"))


def test_extension_is_flexion_with_its_sign_reversed():
    bent, straight = (header_meaning(f"Knee JCS {way} [deg]") for way in ("Flexion", "Extension"))
    assert bent[1:] == ("flexion_deg", 1.0, "deg", True, False)
    assert straight[1:] == ("flexion_deg", -1.0, "deg", True, False)


def test_metres_and_radians_are_converted_as_the_header_says(tmp_path):
    other = {"mm": ("m", 1e-3), "deg": ("rad", np.pi / 180), "N": ("kN", 1e-3), "Nm": ("Nmm", 1e3)}
    columns = {}
    for header, x in SIMVITRO.items():
        unit, factor = other[unit_of(header)]
        columns[f"{header} [{unit}]"] = factor * x
    check(read(table(tmp_path, columns), "anterior_mm from -1000 * Knee JCS Posterior [m]"))


def test_units_that_nobody_states_are_told_by_size(tmp_path):
    flexion = np.array([30.0, 30.2, 59.8, 90.4])
    columns = SIMVITRO | {"Knee JCS Flexion": flexion}
    check(read(table(tmp_path, columns), "(mm, by their size: up to 30)"), flexion)
    metres = {header: x * (1e-3 if unit_of(header) == "mm" else 1.0)
              for header, x in columns.items()}  # fmt: skip
    check(read(table(tmp_path, metres), "(metres, by their size: up to 0.03)"), flexion)
    radians = {header: np.radians(x) if unit_of(header) == "deg" else x
               for header, x in columns.items()}  # fmt: skip
    check(read(table(tmp_path, radians), "(radians, by their size: up to 1.58)"), flexion)


def test_degrees_that_may_be_radians_are_refused(tmp_path):
    path = table(tmp_path, {"JCS Flexion": 0.5, "JCS Load Anterior [N]": 90, "JCS Anterior": 5})
    with pytest.raises(InputProblem) as found:
        read_lab_table(path)
    said = 'write flexion_deg: "1 * JCS Flexion" or "57.29578 * JCS Flexion" under columns'
    assert said in str(found.value)
    answer = read(path, columns={"flexion_deg": "57.29578 * JCS Flexion"})
    assert answer.flexion_deg == pytest.approx(28.64789)


@pytest.mark.parametrize(
    ("name", "load", "size"),
    [("AP drawer", "Applied Load (N)", ("anterior_N", 90.0)),
     ("posterior drawer", "Applied Load (N)", ("anterior_N", -90.0)),
     ("torsion", "Torque (Nmm)", ("internal_Nm", 0.09)),
     ("VV", "Applied Torque (N m)", ("varus_Nm", 90.0))],
)  # fmt: skip
def test_plain_names_of_kneehub_and_a_load_without_direction(tmp_path, name, load, size):
    columns = {"Flexion (deg)": 30.0, "Varus (deg)": -1.5, "Internal Rotation (deg)": 8.0,
               "Anterior (mm)": 6.0, load: 90.0}  # fmt: skip
    answer = read(table(tmp_path, columns, "trial.csv"), f"{size[0]} from", about=name)
    assert answer.loads == {size[0]: pytest.approx([size[1]])}
    assert answer.observed[0, 0] == -1.5


def test_a_load_without_direction_in_a_test_without_a_name_is_refused(tmp_path):
    columns = {"Flexion (deg)": 30, "Applied Load (N)": 90, "Anterior (mm)": 6}
    path = table(tmp_path, columns, "a.csv")
    with pytest.raises(InputProblem, match=r"its direction: a test named .*anterior_N") as found:
        read_lab_table(path)
    assert "\n" not in str(found.value)


def test_flexions_moment_is_passed_over_with_a_sentence(tmp_path):
    columns = {f"{header} [{unit_of(header)}]": x for header, x in SIMVITRO.items()}
    said = "JCS Load Extension Torque [Nm] is not used, since flexion is prescribed"
    check(read(table(tmp_path, columns), said))


@pytest.mark.parametrize(
    "header",
    ["Patella Flexion [deg]", "Anterior Translation - Control", "Varus [mm]", "anterior",
     "Knee JCS Flexion [furlong]", "Varus-Valgus Torque (Nm)", "Load Cell 2 (N)", "note"],
)  # fmt: skip
def test_what_means_something_else_or_both_senses_is_not_guessed(header):
    assert header_meaning(header) is None


def test_all_that_is_wrong_with_a_table_is_said_at_once(tmp_path):
    columns = {"Knee JCS Flexion [deg]": 30.0, "Flexion Angle [deg]": 31.0, "Load Cell 2": 3.0,
               "JCS Load Anterior Drawer [N]": 1e7, "Anterior [mm]": 5.0}  # fmt: skip
    path = table(tmp_path, columns)
    with pytest.raises(InputProblem) as found:
        read_lab_table(path, {"varus_Nm": "Torque", "posterior_N": "x"})
    lines = str(found.value).split("\n")
    assert all(line.startswith(f"{path}: ") for line in lines)
    expected = ["posterior_N: expected", "Torque: missing", "one column of flexion_deg",
                "Load Cell 2: expected a column", "10000000: expected between"]  # fmt: skip
    for words, line in zip(expected, lines, strict=True):
        assert words in line


def test_a_column_called_mm_that_holds_metres_is_suspected(tmp_path):
    columns = {"flexion_deg": 30.0, "anterior_N": 90.0, "anterior_mm": 0.006}
    path = table(tmp_path, columns)
    with pytest.raises(InputProblem, match="anterior_mm: at most 0.006: .*metres are suspected"):
        read_lab_table(path)
    # Who says the factor knows the unit.
    answer = read_lab_table(path, {"anterior_mm": "1 * anterior_mm"})
    assert answer.observed[0, FREE_COORDINATES.index("anterior")] == 0.006


def test_poses_are_recognised_too(tmp_path):
    names = [header for header in SIMVITRO if "Load" not in header]
    path = table(tmp_path, {f"{x} [{unit_of(x)}]": SIMVITRO[x] for x in names})
    with pytest.warns(Assumption, match="adduction_deg from -Knee JCS Valgus"):
        (row,) = read_poses(path, "grood-suntay")
    assert row[:3] == pytest.approx([30.0, -1.5, 8.0]) and len(row) == len(COLUMNS)
