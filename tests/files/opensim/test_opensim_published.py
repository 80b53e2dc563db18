"""A published OpenSim model, number by number, and its patella."""

import csv
import time
from decimal import Decimal
from pathlib import Path

import numpy as np
import pytest

from kneejax.files import InputProblem, add_osim_contacts, import_osim
from kneejax.files.opensim.exact import degrees

DATA = Path(__file__).parents[3] / "../shared/data/lenhart2015"
needs_data = pytest.mark.skipif(not DATA.exists(), reason="the shared data are not here")


def _rows(name):
    return csv.DictReader((DATA / name).read_text(encoding="utf-8").splitlines())


@needs_data
def test_every_number_of_a_published_model_to_the_last_digit():
    start = time.perf_counter()
    read = import_osim(DATA / "lenhart2015.osim", side="r")
    assert time.perf_counter() - start < 2.0
    document = read.document
    bodies = {"femur_distal_r": "femoral_attachment_mm", "tibia_proximal_r": "tibial_attachment_mm"}
    ends = bodies | {"patella_r": "patellar_attachment_mm"}
    every = document["ligaments"] | document["patella"]["ligaments"]
    checked = set()
    for row in _rows("ligaments.csv"):
        name = row["name"]
        entry = every[name]
        checked.add(name)
        for i in ("1", "2") if row["npts"] == "2" else ():
            place = [float(Decimal(row[f"p{i}_{c}_m"]) * 1000) for c in "xyz"]
            assert entry[ends[row[f"p{i}_body"]]] == place
        assert entry["stiffness_N"] == float(row["linear_stiffness_N_per_strain"])
        assert entry["slack_length_mm"] == float(Decimal(row["slack_length_m"]) * 1000)
        assert entry["transition_strain"] == float(row["transition_strain"].split()[0])
        assert entry["damping_N_s"] == float(row["damping"].split()[0])
        # One fibre begins inside its ellipsoid, where OpenSim leaves the ellipsoid out.
        inside = any(note.startswith(f"{name}:") for note in read.knee.found.notes)
        assert entry.get("wrap", "") == ("" if inside else row["wrap"])
    assert checked == set(every) and len(document["ligaments"]) == 55 and len(checked) == 76
    assert not read.knee.found.outside
    muscles = document["patella"]["muscles"]
    heads = {name for name, x in muscles.items() if x["insertion_bone"] == "patella"}
    assert heads == {"recfem", "vasint", "vaslat", "vasmed"} and len(muscles) == 13
    assert sum(x["tension_N"] for x in muscles.values()) == pytest.approx(19.61, abs=1e-3)
    # They pass in front of the femur however far the knee bends: the model's quadrant x.
    obstacles = {muscles[name]["wrap"] for name in heads}
    assert {document["patella"]["wraps"][name]["side"] for name in obstacles} == {"+x"}
    assert "shorter way" not in " ".join(read.knee.found.notes)
    alone = import_osim(DATA / "lenhart2015.osim", side="r", patella=False)
    assert "patella" not in alone.document and "PT1" in alone.knee.found.outside
    assert alone.document["ligaments"] == document["ligaments"]
    for row in _rows("wraps.csv"):
        if row["body"] not in bodies:
            continue
        entry = document["wraps"][row["name"]]
        assert entry["kind"] == row["type"]
        assert entry["center_mm"] == [float(Decimal(row[f"t{c}_m"]) * 1000) for c in "xyz"]
        turn = [degrees(Decimal(row[f"rot_{c}_rad"])) for c in "xyz"]
        assert entry["rotation_deg"] == turn
        sizes = [float(Decimal(row[f"radius_{c}_m"]) * 1000) for c in "xyz" if row[f"radius_{c}_m"]]
        if entry["kind"] == "ellipsoid":
            assert entry["semi_axes_mm"] == sizes
        else:
            assert [entry["radius_mm"]] == sizes
            assert entry["length_mm"] == float(Decimal(row["length_m"]) * 1000)
    contact = read.contacts[0]
    assert (contact.law, *contact.layer) == ("linear", 10.0, 0.45, 6.0)
    assert set(document["groups"]) >= {"ACL", "PCL", "MCL", "ACLam", "LCL", "pCAP"}


@needs_data
def test_a_published_model_has_no_ligaments_on_its_other_side():
    with pytest.raises(InputProblem, match="none between femur_l and tibia_l"):
        import_osim(DATA / "lenhart2015.osim", side="l")


@needs_data
def test_names_that_a_knee_file_does_not_allow_are_changed_in_the_patella_too():
    text = (DATA / "lenhart2015.osim").read_bytes()
    for name in (b"PatTen_r", b"KnExt_at_fem_r"):
        text = text.replace(name, name.replace(b"_", b" "))
    section = import_osim("odd.osim", side="r", data=text).document["patella"]
    assert {"PatTen_r", "KnExt_at_fem_r"} <= set(section["wraps"])
    assert section["ligaments"]["PT1"]["wrap"] == "PatTen_r"
    assert section["muscles"]["vasmed"]["wrap"] == "KnExt_at_fem_r"


@needs_data
def test_a_patella_without_its_mesh_is_refused_in_one_line(tmp_path):
    for name in ("femur-cartilage", "tibia-cartilage"):
        file = f"lenhart2015-R-{name}.stl"
        (tmp_path / file).symlink_to(DATA / "meshes" / file)
    read = import_osim(DATA / "lenhart2015.osim", side="r")
    with pytest.raises(InputProblem, match="mesh of patella_cartilage.*--without-patella"):
        add_osim_contacts(read, tmp_path)


@needs_data
def test_a_band_from_the_pelvis_is_as_long_as_its_model_says_and_follows_the_hip():
    """2 % longer than slack where all coordinates are zero, as the model's authors set it. A hip
    that bends by 30 degrees turns the origin about its centre, forwards in the femur."""
    model, hip = DATA / "lenhart2015.osim", np.array([5.551356, 374.181436, 1.170623])
    straight, bent = (
        import_osim(model, side="r", at=at).document["patella"]
        for at in (None, {"hip_flex_r": 30.0})
    )
    bands = [x["ligaments"]["ITB1"] for x in (straight, bent)]
    origin, other = (np.array(x["femoral_attachment_mm"]) - hip for x in bands)
    via = np.array(bands[0]["via_points"][0]["point_mm"])
    end = np.array(bands[0]["tibial_attachment_mm"])
    length = np.linalg.norm(origin + hip - via) + np.linalg.norm(end - via)
    assert length / bands[0]["slack_length_mm"] == pytest.approx(1.02, abs=1e-6)
    assert np.linalg.norm(other) == pytest.approx(np.linalg.norm(origin), abs=1e-4)
    turn = np.arctan2(other[0], other[1]) - np.arctan2(origin[0], origin[1])
    assert np.rad2deg(turn) == pytest.approx(30.0, abs=1e-4)
    assert bands[1]["via_points"] == bands[0]["via_points"]
    origins = [{n: m["origin_mm"] for n, m in x["muscles"].items()} for x in (straight, bent)]
    moved = {name for name, place in origins[0].items() if place != origins[1][name]}
    assert {"bflh", "semimem", "semiten"} <= moved
    assert not moved & {"bfsh", "vasint", "vasmed", "vaslat", "gasmed", "gaslat"}
    assert "at hip_flex_r=30" in bands[1]["source"]


@needs_data
@pytest.mark.parametrize(
    ("at", "words"),
    [
        ({"hip_flexion_r": 30.0}, ("--at", "did you mean hip_flex_r?")),
        ({"knee_flex_r": 30.0}, ("--at", "a coordinate of hip or foot", "hip_flex_r")),
        ({"hip_flex_r": 300.0}, ("--at hip_flex_r: 300", "-60 to 150 degrees")),
    ],
)
def test_a_pose_of_hip_and_foot_that_the_model_has_not_is_refused(at, words):
    with pytest.raises(InputProblem) as caught:
        import_osim(DATA / "lenhart2015.osim", side="r", at=at)
    assert "\n" not in str(caught.value) and all(word in str(caught.value) for word in words)
