"""What the pages print: scripts run as printed, commands are commands, and examples come along."""

import ast
import importlib
import inspect
import json
import re
import runpy
import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest

import kneejax
from kneejax.cli import main
from kneejax.cli._main import line as command_line
from kneejax.files import bundled_examples, write_rows

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "in_python.md"
README = (ROOT / "README.md").read_text(encoding="utf-8")
SPECIMEN = (ROOT / "docs" / "my_specimen.md").read_text(encoding="utf-8")
SCRIPTS = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
LONGEST = 20


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:kneejax:RuntimeWarning")
def test_the_scripts_run_as_printed(capsys):
    first, *others = SCRIPTS
    names: dict = {}
    for script in others:
        # Each by itself after the beginning, as somebody runs it who came for that one.
        own: dict = {}
        exec(compile(first + script, str(PAGE), "exec"), own)
        names |= own
    said = capsys.readouterr().out
    assert names["acl"].value == pytest.approx(5000.0, rel=1e-4)
    assert (np.diff(names["anterior_mm"]) > 0).all()
    assert "ACL.stiffness" in said and "anterior" in said
    np.testing.assert_allclose(names["test"].to_table()[0, [2, 3]], [10.0, 2.0], atol=1e-9)
    misfit, start, step = (names[name] for name in ("misfit", "start", "step"))
    assert misfit(start + step) < 0.1 * misfit(start)


def blocks(page):
    """Code in Python that a page prints."""
    return re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)


PAGES = [page for page in sorted((ROOT / "docs").glob("*.md")) if blocks(page)]


@pytest.mark.parametrize("page", [ROOT / "README.md", *PAGES], ids=lambda page: page.name)
def test_code_on_pages_names_what_there_is(page):
    """All of it parses; what it takes from kneejax exists."""
    tree = ast.parse("\n".join(blocks(page)))
    places = {"kj": kneejax, "kneejax": kneejax}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("kneejax"):
            module = importlib.import_module(node.module)
            assert all(hasattr(module, name.name) for name in node.names), node.module
            places |= {name.asname or name.name: getattr(module, name.name) for name in node.names}
        if isinstance(node, ast.Import):
            for name in node.names:
                if name.name.startswith("kneejax"):
                    module = importlib.import_module(name.name)
                    places[name.asname or "kneejax"] = module if name.asname else kneejax
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            owner = places.get(node.value.id)
            if inspect.ismodule(owner):
                assert hasattr(owner, node.attr), f"{node.value.id}.{node.attr}"


@pytest.mark.long
@pytest.mark.parametrize(
    "page", ["getting_started", "laboratory", "dynamics", "simple_joints", "identification"]
)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_code_on_pages_runs_as_printed(page, tmp_path, monkeypatch, capsys):
    """With a table of poses under the names that the pages give it."""
    monkeypatch.chdir(tmp_path)
    knee = kneejax.load_knee("four_ligament")
    table = kneejax.passive_flexion(knee, np.arange(0.0, 121.0, 5.0)).to_table()
    for name in ("specimen7.csv", "mri.csv"):
        write_rows(Path(name), kneejax.geometry.COLUMNS, np.asarray(table).tolist())
    names: dict = {}
    for block in blocks(ROOT / "docs" / f"{page}.md"):
        exec(compile(block, page, "exec"), names)
    assert "kj" in names


def commands(text):
    """Words of each command that a page prints, without `kneejax`."""
    for block in re.findall(r"```sh\n(.*?)```", text, re.DOTALL):
        for line in re.split(r"\n|&&", block.replace("\\\n", " ")):
            words = shlex.split(line, comments=True)
            if words[:1] == ["kneejax"] and words[1:2] != ["COMMAND"]:
                yield words[1:]


@pytest.mark.parametrize(
    "page", [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))], ids=lambda page: page.name
)
def test_every_printed_command_has_options_that_there_are(page):
    for words in commands(page.read_text(encoding="utf-8")):
        asked = command_line().read([re.sub(r"\$\w+", "1", word) for word in words])
        # `kneejax --version` asks for no command.
        assert asked is None or words[: len(asked.command.split())] == asked.command.split()


def test_the_readme_names_the_extras_of_its_examples_before_them():
    """Each of what needs one: without it the command ends with one line and status 2."""
    needs = {
        "to_dataframe": "tables", "--dynamic": "dynamics", "plan acl": "planning",
        "kneejax sensitivity": "sensitivity", "kneejax map": "maps", "--posterior": "posterior",
        "--jobs 2": "cohorts",
    }  # fmt: skip
    line = re.search(r'pip install "\.\[((?:\w+,)+\w+)\]"', README)
    listed = line[1].split(",")
    with (ROOT / "pyproject.toml").open("rb") as file:
        known = tomllib.load(file)["project"]["optional-dependencies"]
    assert set(listed) <= set(known)
    for words, extra in needs.items():
        assert extra in listed and line.end() < README.index(words), words


@pytest.mark.long
def test_the_readmes_script_prints_words_not_numbers(capsys):
    (script,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    exec(compile(script, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split()[:2] == ["flexion_deg", "adduction_deg"]
    assert [line.split()[-1] for line in lines[1:]] == ["balanced"] * 4


def test_the_example_of_a_specimen_is_copied_whole_and_printed_as_it_is(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    printed = list(commands(SPECIMEN))
    assert printed[0] == ["knees", "--copy", "specimen"]
    assert main(printed[0]) == 0
    for path in bundled_examples()["specimen"].path.rglob("*.*"):
        copy = tmp_path / "specimen" / path.relative_to(bundled_examples()["specimen"].path)
        assert copy.read_bytes() == path.read_bytes()
    assert main(printed[0]) == 2
    assert "--copy" in capsys.readouterr().err
    assert main(["knees", "--copy", "specimens"]) == 2
    assert "did you mean specimen" in capsys.readouterr().err
    assert main(["knees", "--copy", "four_ligament"]) == 0
    assert (tmp_path / "four_ligament.yaml").is_file()
    study = (tmp_path / "specimen" / "study.yaml").read_text(encoding="utf-8")
    assert f"```yaml\n{study}```" in SPECIMEN
    for table in ("drawer.csv", "torsion.csv"):
        first = (tmp_path / "specimen" / table).read_text(encoding="utf-8").splitlines()[:3]
        assert "```\n" + "\n".join(first) + "\n```" in SPECIMEN


@pytest.mark.slow
@pytest.mark.long
def test_the_specimens_page_ends_in_a_fit_that_finds_the_ligaments(tmp_path, monkeypatch):
    """Copied, imported, fitted, and looked at again, as printed: nothing to doubt in any of it."""
    monkeypatch.chdir(tmp_path)
    for words in commands(SPECIMEN):
        assert main(words) == 0, words
        monkeypatch.chdir(tmp_path / "specimen")
    found = json.loads(Path("specimen_7/result.json").read_text(encoding="utf-8"))
    assert found["success"] and len(found["parameters"]) == 8
    made = runpy.run_path(str(ROOT / "data" / "make_example.py"))
    inside = []
    for ligament, (factor, more) in made["SPECIMEN"].items():
        stiff, strain = (
            found["parameters"][f"{ligament}.{x}"] for x in ("stiffness", "reference_strain")
        )
        for estimate, true in (
            (stiff, factor * stiff["start"]), (strain, strain["start"] + more)
        ):  # fmt: skip
            low, high = estimate["low"], estimate["high"]
            inside.append((low is None or low < true) and (high is None or true < high))
    # 95 % limits: the eighth lies 0.0006 of strain beyond its own.
    assert sum(inside) >= 7


def test_each_has_at_most_twenty_lines():
    first, *others = SCRIPTS
    assert len(others) == 7
    for script in others:
        assert len((first + script).strip().splitlines()) <= LONGEST


POINT = '<PathPoint name="{0}-P{1}"><body>{2}</body><location>{1} 0 0</location></PathPoint>'
MUSCLE = '<Muscle name="{}">{}<max_isometric_force>{}</max_isometric_force></Muscle>'


def muscle(name, bodies, force):
    points = "".join(POINT.format(name, k, body) for k, body in enumerate(bodies, 1))
    return MUSCLE.format(name, points, force)


def test_a_hamstring_is_divided_by_shares_and_ends_of_three_and_nothing_else():
    path = PAGE.parent / "figures" / "make_push_off.py"
    script = runpy.run_path(str(path))
    lump, other = [], []
    for side in "rl":
        lump.append(muscle(f"bifemlh_{side}", ("pelvis", "tibia", "tibia"), 2700))
        for name, ends, force in (("bifemlh", 1, 900), ("semimem", 2, 1200), ("semiten", 3, 600)):
            other.append(muscle(f"{name}_{side}", ("hip", *["shank"] * ends), force))
    new = script["three_hamstrings"]("\n".join(["begin", *lump, "end"]), "".join(other))
    assert new.startswith("begin\n") and new.endswith("\nend")
    found = re.findall(r'<Muscle name="(\w+)">.*?force>(\d+)<', new, re.DOTALL)
    shares = [("bifemlh", "900"), ("semimem", "1200"), ("semiten", "600")]
    assert found == [(f"{name}_{side}", force) for side in "rl" for name, force in shares]
    own = re.search(r'<Muscle name="semiten_l">.*?</Muscle>', new, re.DOTALL)[0]
    assert re.findall(r'name="(\w+-P\d)"><body>(\w+)</body><location>(\d)', own) == [
        ("semiten_l-P1", "pelvis", "1"), ("semiten_l-P2", "tibia", "2"),
        ("semiten_l-P3", "tibia", "3"), ("semiten_l-P4", "tibia", "4"),
    ]  # fmt: skip
