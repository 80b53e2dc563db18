"""What a command was asked for stands beside what it wrote, and is asked for again."""

import json
import os

import pytest

from kneejax import __version__
from kneejax.cli import main
from kneejax.cli._main import line
from kneejax.cli._settings import ADDED
from kneejax.parameters import MEANING

POSES = "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm\n"


@pytest.fixture
def evaluated(tmp_path, monkeypatch, capsys):
    """A folder of `evaluate`, asked for by paths that lead from where it ran."""
    (tmp_path / "poses.csv").write_text(POSES + "30,0,2,1,0,0.5\n")
    monkeypatch.chdir(tmp_path)
    main(["evaluate", "four_ligament", "poses.csv", "--out", "out"])
    capsys.readouterr()
    return tmp_path / "out"


def settings_of(folder):
    return json.loads((folder / "settings.json").read_text())


def edited(folder, **changes):
    (folder / "settings.json").write_text(json.dumps(settings_of(folder) | changes))


def test_a_folder_says_what_was_asked_for(evaluated):
    settings = settings_of(evaluated)
    assert settings.pop("versions")["kneejax"] == __version__
    files = {"ligaments.csv", "contact.csv", "report.html", "checksum"}
    assert {*settings.pop("written")} == files
    assert settings == {
        "command": "evaluate",
        "knee": "four_ligament",
        "poses": "poses.csv",
        "convention": "femoral",
        "svg": False,
        "stiffness_of": "structure",
        "working_folder": os.fspath(evaluated.parent),
    }


def test_no_option_is_called_as_what_is_added_to_the_options():
    models = line().commands.values()
    known = {field.alias for model in models for field in model.model_fields.values()}
    assert "files" in known and not known & {*ADDED}


def test_a_command_runs_again_from_anywhere(evaluated, tmp_path, monkeypatch, capsys):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert main(["rerun", str(evaluated), "--out", "again"]) in (0, 1)
    again = tmp_path / "elsewhere" / "again"
    assert os.getcwd() == os.fspath(tmp_path / "elsewhere")
    assert "versions differ" not in capsys.readouterr().out
    assert settings_of(again) == settings_of(evaluated)
    for name in ("ligaments.csv", "contact.csv"):
        assert (again / name).read_text() == (evaluated / name).read_text()

    # Into the same folder, by other versions; those that answered now are recorded.
    (evaluated / "contact.csv").unlink()
    edited(evaluated, versions=settings_of(evaluated)["versions"] | {"jax": "0.1"})
    assert main(["rerun", str(evaluated)]) in (0, 1)
    assert f"versions differ from those of {evaluated}: jax 0.1 then, " in capsys.readouterr().out
    assert (evaluated / "contact.csv").exists() and settings_of(evaluated) == settings_of(again)


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f: (f / "settings.json").unlink(), "settings.json: file: missing: expected this"),
        (lambda f: (f / "settings.json").write_text("{"), "settings.json: line 1: "),
        (lambda f: (f / "settings.json").write_text("[]"), "settings.json: command: missing: "),
        (lambda f: (f.parent / "poses.csv").unlink(), "poses: poses.csv: expected a file that is"),
        (lambda f: edited(f, working_folder="/nowhere"), "/nowhere/poses.csv is gone"),
        (lambda f: edited(f, knee="mine/knee.yaml"), "mine/knee.yaml is gone"),
        (lambda f: edited(f, knee="four_ligamnt"), "did you mean four_ligament?"),
        (lambda f: edited(f, command="evalute"), "command: evalute: expected a command"),
        (lambda f: edited(f, conventio="x"), "conventio: x: expected no such option of kneejax"),
        (lambda f: edited(f, convention="tibal"), "did you mean tibial?"),
        (lambda f: edited(f, versions=None), "settings.json: versions: missing: expected"),
    ],
)
def test_what_cannot_run_again_is_said(spoil, said, evaluated, monkeypatch, capsys):
    spoil(evaluated)
    monkeypatch.setattr("kneejax.cli._look.evaluate", lambda *_: pytest.fail("it computed"))
    out = evaluated.parent / "again"
    status = main(["rerun", str(evaluated), "--out", str(out)])
    error = capsys.readouterr().err
    assert status == 2 and said in error and error.count("\n") == 1
    assert not out.exists()


def test_older_settings_with_the_mean_of_fibres_are_refused(evaluated, monkeypatch, capsys):
    """A structure's stiffness was once the mean of its fibres; a single line's is what it was."""
    changes = {
        "command": "simulate",
        "experiment": "passive-flexion",
        "set": {"ACL.stiffness": 9e3},
    }
    kept = {n: x for n, x in settings_of(evaluated).items() if n in ("versions", "working_folder")}
    file = evaluated / "settings.json"
    file.write_text(json.dumps(kept | changes | {"knee": "lenhart2015_reduced"}))
    assert main(["rerun", str(evaluated)]) == 2
    said = f"{file}: ACL.stiffness: 9000.0: expected the sum over the structure's 2 fibres; these "
    assert said in capsys.readouterr().err
    monkeypatch.setattr("kneejax.cli._simulate.run", lambda _: 0)
    for knee, more in (("lenhart2015_reduced", MEANING), ("four_ligament", {})):
        file.write_text(json.dumps(kept | changes | {"knee": knee} | more))
        assert main(["rerun", str(evaluated)]) == 0


def test_a_folder_that_is_none_is_said(tmp_path, capsys):
    for place, found in ((tmp_path / "none", "missing"), (tmp_path / "file", "a file")):
        if found == "a file":
            place.write_text("")
        assert main(["rerun", str(place)]) == 2
        said = f"{place}: folder: {found}: expected a folder that a kneejax command wrote"
        assert said in capsys.readouterr().err


def test_an_export_leaves_no_settings_beside_the_model(tmp_path):
    from kneejax.files import SMALLEST_MODEL

    model, knee = tmp_path / "smallest.osim", tmp_path / "imported"
    model.write_text(SMALLEST_MODEL)
    assert main(["import", "osim", str(model), "--side", "r", "--out", str(knee)]) in (0, 1)
    assert settings_of(knee)["command"] == "import osim" and settings_of(knee)["side"] == "r"
    new = tmp_path / "new" / "smallest.osim"
    main(["export", "osim", str(knee / "knee.yaml"), str(model), "--out", str(new)])
    assert new.exists() and not (new.parent / "settings.json").exists()
