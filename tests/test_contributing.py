"""The command that CONTRIBUTING.md writes as an example is one."""

import csv
import re
import sys
import types
from pathlib import Path

import pytest

from kneejax.cli import _main, main
from kneejax.cli._line import CommandLine
from kneejax.cli.options import ABOVE, COMMANDS

TEXT = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture
def slack(monkeypatch):
    """The two files of the example, as if they stood in the package."""
    schema, body = re.findall(r"```python\n(# kneejax/cli/.*?)```", TEXT, re.DOTALL)
    assert schema.count("\n") + body.count("\n") < 60
    for name, code in (("options._slack", schema), ("_slack", body)):
        module = types.ModuleType(f"kneejax.cli.{name}")
        monkeypatch.setitem(sys.modules, module.__name__, module)
        exec(code, module.__dict__)
    model = sys.modules["kneejax.cli.options._slack"].Slack
    line = CommandLine({**COMMANDS, "Example": (model,)}, ABOVE)
    monkeypatch.setattr(_main, "line", lambda: line)
    return model


def test_the_example_is_read_explained_checked_and_run_again(slack, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["slack", "--help"]) == 0
    said = capsys.readouterr().out
    assert said.startswith("List the slack lengths") and slack.example in said
    for words, wrong in (
        ("four_ligament --longer-mm 60", "--longer-mm: 60: expected a number between 0 and 50 mm"),
        ("four_ligament --percent", "--percent: given: expected --longer-mm with it"),
        ("four_ligamnt", "did you mean four_ligament?"),
        ("four_ligament --ony ACL", "did you mean --only?"),
    ):
        assert main(["slack", *words.split()]) == 2
        assert wrong in capsys.readouterr().err
    words = "four_ligament --longer_mm 5 --only ACL --only PCL --percent"
    assert main(["slack", *words.split()]) == 0
    assert "ACL: 30.8 mm (+19.4%)" in capsys.readouterr().out
    file = tmp_path / "kneejax-slack" / "slack.csv"
    first = file.read_text()
    assert [row["ligament"] for row in csv.DictReader(first.splitlines())] == ["ACL", "PCL"]
    assert main(["rerun", "kneejax-slack"]) == 0 and file.read_text() == first
