"""`kneejax import osim` and `kneejax export osim` end to end."""

from pathlib import Path

import pytest

from kneejax.cli import main
from kneejax.files import load_knee_file

MODELS = Path(__file__).parents[1] / "files" / "opensim" / "models"
LEFT, RIGHT = MODELS / "left_schema4.osim", MODELS / "right_schema3.osim"


@pytest.fixture
def straight(tmp_path):
    """A model whose only fibre goes around nothing, so that its knee is built at once."""
    text = RIGHT.read_text(encoding="utf-8")
    start, end = text.index("<PathWrap>"), text.index("</PathWrap>") + len("</PathWrap>")
    path = tmp_path / "straight.osim"
    path.write_text(text[:start] + text[end:], encoding="utf-8")
    return path


def test_import_then_export(straight, tmp_path, capsys):
    out = tmp_path / "imported"
    assert main(["import", "osim", str(straight), "--side", "r", "--out", str(out)]) == 0
    assert "Oberschenkel_r" in (out / "import_report.md").read_text(encoding="utf-8")
    page = (out / "report.html").read_text(encoding="utf-8")
    assert ">Band1</td>" in page and "Oberschenkel_r taken as the femur" in page
    knee = load_knee_file(out / "knee.yaml")
    assert knee.knee.ligaments.names == ("Band1",)
    assert main(["describe", str(out / "knee.yaml")]) == 0

    new = tmp_path / "new.osim"
    command = ["export", "osim", str(out / "knee.yaml"), str(straight), "--out", str(new)]
    assert main(command) == 0
    assert new.read_bytes() == straight.read_bytes()

    text = (out / "knee.yaml").read_text(encoding="utf-8")
    changed = text.replace("stiffness_N: 2500.0", "stiffness_N: 2600.5")
    (out / "knee.yaml").write_text(changed, encoding="utf-8")
    capsys.readouterr()
    assert main(command) == 0
    assert "Band1.stiffness_N: 2500 -> 2600.5" in capsys.readouterr().out
    before = straight.read_text(encoding="utf-8")
    assert new.read_text(encoding="utf-8") == before.replace(">2500<", ">2600.5<")

    command[-1] = str(straight)
    assert main(command) == 2
    assert "another file than the model" in capsys.readouterr().err
    assert straight.read_text(encoding="utf-8") == before


def test_what_is_not_supported_is_named_and_the_status_says_so(tmp_path, capsys):
    arguments = ["import", "osim", str(LEFT), "--side", "l", "--out", str(tmp_path)]
    assert main(arguments) == 1
    printed = capsys.readouterr().out
    for name in ("twice.around", "through.the.ring", "moving", "by.a.curve"):
        assert name in printed
    for name in ("twice*", "through*", "one*", "moving", "by.a.curve"):
        arguments += ["--without", name]
    assert main(arguments) == 1  # the kneecap's band and contact
    printed = capsys.readouterr().out
    assert "(1): to.the.kneecap, on" in printed and "(1): kneecap_contact, on" in printed
    assert main([*arguments, "--without-patella"]) == 0


def test_bad_input_is_one_line_and_nothing_is_written(tmp_path, capsys):
    out = tmp_path / "nothing"
    broken = tmp_path / "broken.osim"
    broken.write_text(RIGHT.read_text(encoding="utf-8")[:2000], encoding="utf-8")
    for arguments, words in (
        ([str(RIGHT), "--side", "l"], "--side: l"),
        ([str(broken), "--side", "r"], "line "),
        ([str(tmp_path / "none.osim"), "--side", "r"], "missing"),
        ([str(RIGHT), "--side", "r", "--geometry", str(tmp_path / "meshes")], "folder"),
        ([str(RIGHT), "--side", "r", "--geometry", str(tmp_path)], "contacts: none"),
        ([str(LEFT), "--side", "l", "--geometry", str(tmp_path)], "thigh.stl"),
        ([str(RIGHT), "--side", "r", "--femur", "Oberschenkel_r"], "together"),
    ):
        assert main(["import", "osim", *arguments, "--out", str(out)]) == 2
        error = capsys.readouterr().err
        assert error.count("\n") == 1 and words in error
        assert not out.exists()
