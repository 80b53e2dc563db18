"""A folder of results holds one run: replaced whole, resumed where it can be, or refused."""

import json
import os
import random
from pathlib import Path

import pytest

from kneejax._whole_files import write_whole
from kneejax.cli import _results_folder, main
from kneejax.cli._results_folder import ResultsFolder, owned, read_mark, replace_knee
from kneejax.files import SMALLEST_MODEL, InputProblem, write_text
from kneejax.files.reading import read_text


def chosen(out, **more):
    return {"study": None, "out": out} | more


def run(out, files, **more):
    """A command that writes these files."""
    folder = ResultsFolder(out)
    with folder.gathered(chosen(out, **more)):
        for name, text in files.items():
            write_text(out / name, text)
        folder.commit({"command": more.get("command", "evaluate")})


def held(out):
    """Files in a folder, without its settings."""
    return {
        path.relative_to(out).as_posix(): path.read_text()
        for path in out.rglob("*")
        if path.is_file() and path.name != "settings.json"
    }


def damaged(path, mode):
    """Damage a file as disks and people do."""
    data, draw = bytearray(path.read_bytes()), random.Random(1)
    for _ in range(max(3, len(data) // 2000)):
        data[draw.randrange(len(data) // 10, len(data))] ^= 1 << draw.randrange(8)
    ways = {"flip": data, "half": data[: len(data) // 2], "empty": b"", "text": b"not a cache"}
    path.write_bytes(ways[mode])


STUDY = {"result.json": "{}", "poses.csv": "1", "figures/fit.png": "a", "report.html": "study"}


def test_another_run_replaces_all_of_the_one_before_and_nothing_else(tmp_path):
    out = tmp_path / "out"
    run(out, STUDY)
    assert held(out) == STUDY
    (out / "notes.txt").write_text("mine")
    run(out, {"cohort.csv": "2", "report.html": "cohort"})
    assert held(out) == {"cohort.csv": "2", "report.html": "cohort", "notes.txt": "mine"}
    assert not (out / "figures").exists()
    listed = json.loads((out / "settings.json").read_text())["written"]
    assert {*listed} == {"cohort.csv", "report.html", "checksum"}


@pytest.mark.parametrize("error", [KeyboardInterrupt(), OSError(28, "No space left on device")])
def test_what_ends_a_run_leaves_the_one_before(tmp_path, error):
    def ended(out):
        folder = ResultsFolder(out)
        with pytest.raises(type(error)), folder.gathered(chosen(out)):
            write_text(out / "result.json", "new")
            raise error

    out = tmp_path / "out"
    ended(out)
    assert not out.exists()
    run(out, STUDY)
    ended(out)
    assert held(out) == STUDY and owned(out) == {*STUDY, "settings.json"}


def test_a_file_of_somebody_else_is_not_replaced(tmp_path):
    (tmp_path / "poses.csv").write_text("measured")
    with pytest.raises(InputProblem, match=r"poses\.csv: file: exists already: expected another"):
        run(tmp_path, STUDY)
    assert held(tmp_path) == {"poses.csv": "measured"}


def test_what_a_run_would_replace_is_not_its_input(tmp_path):
    run(tmp_path / "out", STUDY)
    folder = ResultsFolder(tmp_path / "out")
    with pytest.raises(InputProblem, match=r"--out: folder: .*another folder than that of poses"):
        with folder.gathered(chosen(tmp_path / "out")):
            read_text(tmp_path / "out" / "poses.csv", "a table")


@pytest.mark.parametrize("steps", range(6))
def test_a_process_killed_while_it_replaces_is_finished_by_the_next(tmp_path, monkeypatch, steps):
    out, new = tmp_path / "out", {"a.csv": "2", "report.html": "new", "b/c.png": "3"}
    run(out, STUDY)
    left = [steps]

    def killed(step):
        def one(*given):
            if not left[0]:
                raise SystemExit
            left[0] -= 1
            return step(*given)

        return one

    with monkeypatch.context() as patch:
        patch.setattr(_results_folder, "_move", killed(_results_folder._move))
        patch.setattr(_results_folder, "_remove", killed(_results_folder._remove))
        patch.setattr(_results_folder.shutil, "rmtree", lambda *_, **__: None)
        if steps < 5:
            with pytest.raises(SystemExit):
                run(out, new)
        else:
            run(out, new)
    ResultsFolder(out)
    assert held(out) == new and owned(out) == {*new, "settings.json"}


@pytest.mark.parametrize("mode", ["flip", "half", "empty", "text"])
def test_without_a_list_what_was_there_is_set_aside(tmp_path, mode, capsys):
    out = tmp_path / "out"
    run(out, STUDY)
    damaged(out / "settings.json", mode)
    if mode == "flip":  # in a list that is JSON still
        run(out, STUDY | {"result.json": "{}"})
        text = (out / "settings.json").read_text()
        (out / "settings.json").write_text(text.replace("result.json", "resulx.json"))
    run(out, {"report.html": "new"})
    assert "set-aside-" in capsys.readouterr().err
    aside = {name: text for name, text in held(out).items() if "set-aside" in name}
    assert held(out).keys() - aside.keys() == {"report.html"}
    assert {name.split("/", 1)[1] for name in aside} >= {*STUDY}


def test_a_folder_that_also_holds_the_input_is_refused_without_a_list(tmp_path, monkeypatch):
    run(tmp_path, STUDY)
    damaged(tmp_path / "settings.json", "empty")
    (tmp_path / "study.yaml").write_text("title: mine")
    for study, there in ((os.fspath(tmp_path / "study.yaml"), "/"), (None, tmp_path)):
        monkeypatch.chdir(there)
        with pytest.raises(InputProblem, match="expected a list of the files"):
            run(tmp_path, {"report.html": "new"}, study=study)


def test_a_cohort_lets_go_of_a_study_and_goes_on_with_its_own_knees(tmp_path):
    out = tmp_path / "out"
    run(out, STUDY)

    def cohort(names, wanted=("K1",)):
        folder = ResultsFolder(out)
        with folder.gathered(chosen(out)):
            folder.begin(lambda name: name.split("/")[:2] in [["knees", x] for x in wanted])
            for name in names:
                replace_knee(out / "knees" / name, lambda: knee(out / "knees" / name))
            yield folder
            write_text(out / "cohort.csv", "2")
            folder.holds = [f"knees/{name}/task.json" for name in wanted]
            folder.commit({"command": "calibrate"})

    def knee(folder):
        write_whole(folder / "result.json", b"1")
        return {"task": folder.name}

    stopped = cohort(["K1", "K2"], ("K1", "K2"))
    next(stopped)
    stopped.close()
    assert held(out).keys() == {f"knees/{k}/{x}" for k in ("K1", "K2")
                                for x in ("result.json", "task.json")}  # fmt: skip
    for _ in cohort([]):
        pass
    mine = {"cohort.csv", "knees/K1/result.json", "knees/K1/task.json"}
    assert held(out).keys() == mine and owned(out) == mine | {"settings.json"}
    run(out, STUDY)
    assert held(out) == STUDY


@pytest.mark.parametrize("mode", ["flip", "half", "empty", "text"])
@pytest.mark.parametrize("name", ["result.json", "task.json", "report.html"])
def test_a_knee_whose_files_are_damaged_is_computed_again(tmp_path, mode, name):
    def write():
        write_whole(tmp_path / "K2" / "result.json", b'{"parameters": {}}')
        write_whole(tmp_path / "K2" / "report.html", b"<html>a page</html>")
        return {"task": "of this knee", "failed": ""}

    for _ in range(2):
        replace_knee(tmp_path / "K2", write)
        assert (read_mark(tmp_path / "K2") or {})["task"] == "of this knee"
        damaged(tmp_path / "K2" / name, mode)
        assert read_mark(tmp_path / "K2") is None


def test_a_list_that_leads_out_of_its_folder_is_none(tmp_path):
    from kneejax._whole_files import with_checksum

    (tmp_path / "mine.txt").write_text("mine")
    out = tmp_path / "out"
    for name in ("../mine.txt", os.fspath(tmp_path / "mine.txt")):
        run(out, STUDY)
        settings = json.loads((out / "settings.json").read_text())
        settings["files"] = with_checksum({name: "x"})
        (out / "settings.json").write_text(json.dumps(settings))
        run(out, {"a.csv": "1"})
        assert (tmp_path / "mine.txt").read_text() == "mine"


def test_a_command_that_is_interrupted_leaves_no_folder(tmp_path, monkeypatch):
    def ended(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("kneejax.files.format_import_report", ended)
    model, out = tmp_path / "smallest.osim", tmp_path / "out"
    model.write_text(SMALLEST_MODEL)
    words = ["import", "osim", str(model), "--side", "r", "--out", str(out)]
    assert main(words) == 130
    assert [*tmp_path.iterdir()] == [model]
    monkeypatch.undo()
    assert main(words) in (0, 1)
    assert owned(out) == {"knee.yaml", "import_report.md", "report.html", "settings.json"}


@pytest.mark.parametrize("at", ["writing", "syncing"])
def test_a_full_disk_names_the_file_and_nothing_is_written(tmp_path, monkeypatch, capsys, at):
    """Once: [Errno 28] without a file, status 2, two files written."""
    model, out = tmp_path / "smallest.osim", tmp_path / "out"
    model.write_text(SMALLEST_MODEL)
    write = Path.write_bytes

    def full(path, *given):
        if isinstance(path, int) or path.name == "import_report.md":
            raise OSError(28, "No space left on device")
        return write(path, *given)

    monkeypatch.setattr(*((Path, "write_bytes") if at == "writing" else (os, "fsync")), full)
    assert main(["import", "osim", str(model), "--side", "r", "--out", str(out)]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"kneejax: {out}{os.sep}") and "No space left on device" in line
    assert not out.exists()
