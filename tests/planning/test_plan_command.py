"""`kneejax plan acl`: what it prints and writes."""

import csv
import json

import numpy as np
import pytest
import yaml

from kneejax import evaluate, passive_flexion
from kneejax.cli import main
from kneejax.files import load_knee_file
from kneejax.planning import undominated

#: Each compiles a search of its own.
pytestmark = pytest.mark.long

pytest.importorskip("dtaidistance")
pytest.importorskip("h5netcdf")
pytest.importorskip("pymoo")

PLAN = {
    "title": "One graft",
    "knee": "four_ligament",
    "graft": {"type": "hamstring"},
    "flexion_deg": "40:0:-10",
    "lachman": {"flexion_deg": [20]},
    "fixation": {"tension_N": 50},
    "limits": {"laxity_band_mm": 1.0},
    "map": {"points": 3},
    "optimum": {"free": ["tension"], "starts": 2, "evaluations": 4},
    "front": {"population": 8, "generations": 2},
}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    (folder / "plan.yaml").write_text(yaml.safe_dump(PLAN))
    status = main(["plan", "acl", str(folder / "plan.yaml"), "--out", str(folder / "out")])
    return status, folder / "out"


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_everything_is_written_and_says_that_it_is_for_no_patient(written):
    _, out = written
    for name in ("map_tibia.nc", "map_femur.nc", "figures/strains.png", "figures/map_tibia.png"):
        assert (out / name).stat().st_size > 1000
    first, *_ = (out / "report.html").read_text().split("<details")
    assert "Where and how tight" in first and "Optimum: tibia" in first
    sentence = "Nothing here supports a decision about a patient"
    assert (out / "report.html").read_text().count(sentence) == 2
    document = json.loads((out / "plan.json").read_text())
    assert sentence in document["note"]
    assert document["optimum"]["evaluations"] <= 4
    assert document["versions"]["dtaidistance"]


def test_the_table_has_the_knees_and_the_octagon_has_paper_2s_layout(written):
    _, out = written
    knees = {row["knee"]: row for row in rows_of(out / "plan.csv")}
    assert [*knees][:4] == ["intact", "deficient", "planned", "optimum"] and len(knees) == 12
    intact, torn = (float(knees[x]["laxity_20_deg_mm"]) for x in ("intact", "deficient"))
    assert torn > 3.0 * intact
    octagon = rows_of(out / "octagon.csv")
    assert [*octagon[0]] == ["position", "PCL", "MCL", "LCL", "graft", "total"]
    for row in octagon:
        parts = [float(row[name]) for name in ("PCL", "MCL", "LCL", "graft")]
        assert float(row["total"]) == pytest.approx(sum(parts), rel=1e-6)


def test_a_front_is_a_table_of_which_no_row_is_better(written):
    _, out = written
    rows = rows_of(out / "front.csv")
    document = json.loads((out / "plan.json").read_text())["front"]
    criteria = np.array([[float(row[name]) for name in document["criteria"]] for row in rows])
    assert undominated(criteria).all() and len(rows) == document["points"]
    assert [row["compromise"] for row in rows].count("1") == 1
    assert all(row["graft_tibia_anterior_mm"] == rows[0]["graft_tibia_anterior_mm"] for row in rows)
    assert "What must be given up for what" in (out / "report.html").read_text()


def test_status_is_1_where_something_is_doubtful_and_0_otherwise(written):
    status, out = written
    document = json.loads((out / "plan.json").read_text())
    assert status == (0 if document["optimum"]["feasible"] else 1)


def test_a_curve_of_the_graft_ends_where_its_strain_does(written):
    _, out = written
    rows = [x for x in rows_of(out / "curves.csv") if x["ligament"] == "graft"]
    planned = [x for x in rows if x["knee"] == "planned"]
    assert len(planned) == 5
    at_fixation = next(x for x in planned if float(x["flexion_deg"]) == 20.0)
    assert float(at_fixation["tension_N"]) == pytest.approx(50.0, abs=0.01)
    assert np.all([float(x["strain"]) > -0.2 for x in rows])


@pytest.mark.parametrize("word", ["planned", "optimum"])
def test_the_knee_file_carries_the_graft_that_was_fixed(word, written):
    """Its graft pulls with the tension of fixation where it was fixed; the torn fibre is gone."""
    _, out = written
    read = load_knee_file(out / f"{word}.yaml")
    assert read.knee.ligaments.names == ("PCL", "MCL", "LCL", "graft")
    row = next(x for x in rows_of(out / "plan.csv") if x["knee"] == word)
    every = rows_of(out / "curves.csv")
    curve = [x for x in every if (x["knee"], x["ligament"]) == (word, "graft")]
    angles = [float(x["flexion_deg"]) for x in curve]
    moved = passive_flexion(read.knee, angles)
    tension = np.asarray(evaluate(read.knee, moved.equilibrium.state).tension)[:, 3]
    assert np.abs(tension - [float(x["tension_N"]) for x in curve]).max() < 1e-3
    assert tension[angles.index(20.0)] == pytest.approx(float(row["graft_tension_N"]), abs=1e-3)
    said = read.document["ligaments"]["graft"]["source"]
    assert f"under {float(row['graft_tension_N']):.4g} N at 20 degrees" in said
