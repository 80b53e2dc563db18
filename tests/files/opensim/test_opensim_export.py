"""Changed numbers go back into a model, and nothing else of it changes."""

import copy
import difflib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from kneejax.files import InputProblem, KneeFile, export_osim, import_osim, read_knee, write_knee

MODELS = Path(__file__).parent / "models"
LEFT, RIGHT = MODELS / "left_schema4.osim", MODELS / "right_schema3.osim"
LENHART = Path(__file__).parents[3] / "../shared/data/lenhart2015/lenhart2015.osim"
CASES = [(LEFT, "l"), (RIGHT, "r"), (LENHART, "r")]


def _file(document, knee=None):
    """A knee file of a document; the knee itself is read only where a strain gives a length."""
    return KneeFile(knee, {}, "", Path("knee.yaml"), document)


def _numbers(document):
    """What an export carries: everything but where it came from."""
    same = copy.deepcopy(document)
    for section in ("ligaments", "wraps"):
        for entry in same.get(section, {}).values():
            del entry["source"]
    return {name: same.get(name) for name in ("side", "reference_pose", "ligaments", "wraps")} | {
        "reference_pose": {k: v for k, v in same["reference_pose"].items() if k != "source"}
    }


def _differing_lines(old, new):
    lines = difflib.unified_diff(old.decode().splitlines(), new.decode().splitlines(), n=0)
    return [line for line in lines if line[0] in "+-" and line[:3] not in ("+++", "---")]


@pytest.fixture(params=CASES, ids=lambda case: case[0].stem)
def model(request):
    """Path, side and document of a model."""
    path, side = request.param
    if not path.exists():
        pytest.skip("the shared data are not here")
    return path, side, import_osim(path, side=side).document


def test_an_unchanged_knee_gives_the_same_bytes(model):
    path, _, document = model
    written = export_osim(_file(document), path)
    assert written.data == path.read_bytes()
    assert (written.changes, written.notes) == ((), ())


@pytest.mark.parametrize("ending", ["\r\n", "\n", "\r"])
@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-1", "utf-8-sig"])
def test_line_endings_encoding_and_comments_stay(ending, encoding, tmp_path):
    text = LEFT.read_text(encoding="utf-8").replace("stiffness by hand", "Größe < 1 & von Hand")
    declared = encoding.removesuffix("-sig")
    data = text.replace("UTF-8", declared).replace("\n", ending).encode(encoding)
    path = tmp_path / LEFT.name
    path.write_bytes(data)
    document = import_osim(path, side="l").document
    assert export_osim(_file(document), path).data == data
    document["ligaments"]["cross1"]["stiffness_N"] = 1235.5
    new = export_osim(_file(document), path).data
    assert new.decode(encoding) == data.decode(encoding).replace(">1234.5<", ">1235.5<")


def _shaken(document, rng):
    """Every number of a knee that an export writes, changed at random."""
    new = copy.deepcopy(document)
    for entry in new["ligaments"].values():
        for field in ("stiffness_N", "slack_length_mm", "transition_strain", "damping_N_s"):
            entry[field] *= 1 + 0.1 * rng.uniform()
        for field in ("femoral_attachment_mm", "tibial_attachment_mm"):
            entry[field] = [x + 0.2 * rng.uniform() for x in entry[field]]
        for via in entry.get("via_points", ()):
            via["point_mm"] = [x + 0.2 * rng.uniform() for x in via["point_mm"]]
    for entry in new.get("wraps", {}).values():
        entry["center_mm"] = [x + 0.1 * rng.uniform() for x in entry["center_mm"]]
        turn = entry.get("rotation_deg", [0.0, 0.0, 0.0])
        entry["rotation_deg"] = [x + rng.uniform() for x in turn]
        for field in ("radius_mm", "length_mm"):
            if field in entry:
                entry[field] *= 1 - 0.01 * rng.uniform()
        if "semi_axes_mm" in entry:
            entry["semi_axes_mm"] = [x * (1 - 0.01 * rng.uniform()) for x in entry["semi_axes_mm"]]
    return new


def test_import_export_import_gives_the_same_knee(model, rng, tmp_path):
    path, side, document = model
    new = _shaken(document, rng)
    data = export_osim(_file(new), path).data
    (tmp_path / path.name).write_bytes(data)
    again = import_osim(tmp_path / path.name, side=side, inside="straight").document
    for name, entry in new["ligaments"].items():
        for field in ("stiffness_N", "slack_length_mm", "transition_strain", "damping_N_s"):
            assert again["ligaments"][name][field] == entry[field]
    # In a turned frame a rotation rounds; everywhere else each digit returns.
    turned = {"outer", "back_of_knee"}
    ours, theirs = _numbers(new), _numbers(again)
    for section in ("ligaments", "wraps"):
        for name in (ours[section] or {}):
            if name in turned:
                for field in set(ours[section][name]) & {
                    "femoral_attachment_mm", "tibial_attachment_mm", "center_mm", "rotation_deg",
                }:  # fmt: skip
                    np.testing.assert_allclose(
                        theirs[section][name][field], ours[section][name][field], atol=1e-12
                    )
            else:
                assert theirs[section][name] == ours[section][name]
    # And once more: the second export of the same knee changes nothing.
    (tmp_path / "again.osim").write_bytes(data)
    assert export_osim(_file(again), tmp_path / "again.osim").data == data


@given(st.floats(1.0, 290.0), st.floats(-80.0, 80.0))
def test_any_number_comes_back_to_the_last_digit(slack, place):
    document = import_osim(RIGHT, side="r").document
    entry = document["ligaments"]["Band1"]
    entry["slack_length_mm"] = slack
    entry["tibial_attachment_mm"] = [place, -55.0, 20.0]
    data = export_osim(_file(document), RIGHT).data
    again = import_osim(RIGHT, side="r", inside="straight", data=data).document
    again = again["ligaments"]["Band1"]
    assert again["slack_length_mm"] == slack
    assert again["tibial_attachment_mm"] == [place, -55.0, 20.0]


def test_the_difference_is_the_changed_numbers():
    document = import_osim(LEFT, side="l").document
    entry = document["ligaments"]["cross1"]
    entry["stiffness_N"], entry["slack_length_mm"] = 1300.0, 30.5
    entry["tibial_attachment_mm"][1] = -22.5
    written = export_osim(_file(document), LEFT)
    changed = _differing_lines(LEFT.read_bytes(), written.data)
    assert [line[1:].strip() for line in changed if line[0] == "-"] == [
        "<location>0.0123456789012345 -0.021999999999999999 0.001</location>",
        "<linear_stiffness>1234.5</linear_stiffness>",
        "<slack_length>0.030300000000000001</slack_length>",
    ]
    assert [line[1:].strip() for line in changed if line[0] == "+"] == [
        "<location>0.0123456789012345 -0.0225 0.001</location>",
        "<linear_stiffness>1300</linear_stiffness>",
        "<slack_length>0.0305</slack_length>",
    ]
    assert len(written.changes) == 3


def test_names_with_colons_and_both_kinds_of_empty_elements_stay(tmp_path):
    text = LEFT.read_text(encoding="utf-8")
    odd = "<A::B name='it'><c></c><d /><!-- <e/> -- --></A::B>\n\t\t<defaults>"
    text = text.replace("<defaults>", odd.replace("'", '"'), 1)
    path = tmp_path / LEFT.name
    path.write_text(text, encoding="utf-8")
    document = import_osim(path, side="l").document
    document["ligaments"]["cross1"]["stiffness_N"] = 1235.5
    new = export_osim(_file(document), path).data.decode()
    assert new == text.replace(">1234.5<", ">1235.5<")


def test_a_number_that_the_file_leaves_out_is_added():
    document = import_osim(LEFT, side="l").document
    document["ligaments"]["cross2"]["transition_strain"] = 0.045
    changed = _differing_lines(LEFT.read_bytes(), export_osim(_file(document), LEFT).data)
    assert changed == ["+\t\t\t\t\t<transition_strain>0.045</transition_strain>"]


def test_a_path_from_the_tibia_to_a_welded_body_is_written_where_it_stands():
    document = import_osim(LEFT, side="l").document
    document["ligaments"]["cross2"]["femoral_attachment_mm"] = [2.25, -3.0, -6.0]
    changed = _differing_lines(LEFT.read_bytes(), export_osim(_file(document), LEFT).data)
    assert [line[0] + line[1:].strip() for line in changed] == [
        "-<location>0.007 -0.394 -0.004</location>", "+<location>0.00725 -0.394 -0.004</location>",
    ]  # fmt: skip


def test_a_reference_strain_is_written_as_a_slack_length(tmp_path):
    document = import_osim(RIGHT, side="r").document
    entry = document["ligaments"]["Band1"]
    del entry["wrap"], entry["slack_length_mm"]
    text = RIGHT.read_text(encoding="utf-8").replace("<wrap_object>Knauf", "<!-- --><wrap_object>")
    start, end = text.index("<PathWrap>"), text.index("</PathWrap>") + len("</PathWrap>")
    model = tmp_path / RIGHT.name
    model.write_text(text[:start] + text[end:], encoding="utf-8")
    entry["reference_strain"] = 0.04
    del document["wraps"]
    write_knee(document, tmp_path / "knee.yaml")
    knee_file = read_knee(tmp_path / "knee.yaml")
    length = float(knee_file.knee.reference_length()[0])
    data = export_osim(knee_file, model).data
    again = import_osim(model, side="r", data=data).document["ligaments"]["Band1"]
    assert again["slack_length_mm"] == pytest.approx(length / 1.04, rel=1e-15)
    # The strain that the model's own length has is no change.
    entry["reference_strain"] = length / 58.0 - 1.0
    write_knee(document, tmp_path / "knee.yaml")
    assert export_osim(read_knee(tmp_path / "knee.yaml"), model).changes == ()


def test_what_cannot_be_written_is_refused_by_name():
    document = import_osim(LEFT, side="l").document
    for change, words in (
        (lambda d: d["ligaments"].update(cross3=d["ligaments"]["cross1"]), "cross3"),
        (lambda d: d["ligaments"]["cross1"].update(wrap="rim"), "ligaments.cross1.wrap"),
        (lambda d: d["ligaments"]["inner_band"].pop("via_points"), "via_points"),
        (lambda d: d["wraps"]["rim"].update(bone="femur"), "wraps.rim.bone"),
        (lambda d: d["wraps"]["back_of_knee"].update(side="+x"), "wraps.back_of_knee.side"),
        (lambda d: d.update(side="right"), "side"),
    ):
        other = copy.deepcopy(document)
        change(other)
        with pytest.raises(InputProblem, match=words):
            export_osim(_file(other), LEFT)


def test_what_a_person_should_know_is_said():
    document = import_osim(LEFT, side="l").document
    document["imported_from"]["sha256"] = "0" * 64
    del document["ligaments"]["capsule"]
    notes = " ".join(export_osim(_file(document), LEFT).notes)
    assert "differs from the one that was imported" in notes and "capsule" in notes
    deep = import_osim(LEFT, side="l").document
    deep["ligaments"]["capsule"]["femoral_attachment_mm"] = [-5.0, 0.0, 0.0]
    assert "inside" in " ".join(export_osim(_file(deep), LEFT).notes)
