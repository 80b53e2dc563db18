"""The site in docs/: all pages reached, all figures shown, an example for each public name."""

import importlib
import importlib.util
import inspect
import json
import re
import sys
from pathlib import Path

import pytest

import kneejax

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


@pytest.fixture(scope="module")
def pages():
    """`docs/site_pages.py`, which makes pages from the code."""
    spec = importlib.util.spec_from_file_location("site_pages", DOCS / "site_pages.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["site_pages"] = module
    spec.loader.exec_module(module)
    yield module
    del sys.modules["site_pages"]


@pytest.fixture(scope="module")
def made(pages, tmp_path_factory):
    folder = tmp_path_factory.mktemp("generated")
    pages.write_all(folder, ROOT / "notebooks")
    return folder


def below(page):
    """The pages that the tables of contents of a page name."""
    for block in re.findall(r"```\{toctree\}\n(.*?)```", page.read_text(encoding="utf-8"), re.S):
        yield from (line for line in block.split("\n") if line and not line.startswith(":"))


def test_the_contents_reach_every_page(made):
    reached, ahead = {"index"}, ["index"]
    while ahead:
        page = DOCS / f"{ahead.pop()}.md"
        new = [name for name in below(page) if name not in reached] if page.exists() else []
        reached.update(new)
        ahead += new
    there = {path.stem for path in DOCS.glob("*.md")}
    there |= {f"generated/{path.stem}" for path in made.iterdir()}
    assert reached == there


def test_every_figure_is_in_the_gallery_or_the_reference(made):
    shown = (DOCS / "gallery.md").read_text() + (made / "bundled.md").read_text()
    assert not [path.name for path in DOCS.glob("figures/*.png") if path.name not in shown]


def test_every_figure_of_the_gallery_has_its_command():
    sections = (DOCS / "gallery.md").read_text().split("\n## ")[1:]
    assert sections
    for section in sections:
        assert re.search(r"!\[.+\]\(figures/\w+\.png\)", section)
        assert re.search(r"```sh\n(kneejax|python) ", section)


def test_links_between_pages_lead_somewhere(made):
    missing = []
    for page in [*DOCS.glob("*.md"), ROOT / "README.md", ROOT / "CONTRIBUTING.md"]:
        for link in re.findall(r"\]\((?!http|#|mailto)([^)\s#]+)", page.read_text("utf-8")):
            target = page.parent / link
            if "generated/" in link:
                target = made / Path(link).name
            if not target.exists():
                missing.append((page.name, link))
    assert not missing


def test_every_public_name_has_an_example_that_runs(pages):
    """Its own doctest; of what rooms offer also that of what returns it, or a test."""
    assert not [x for x in pages._top_level() if not pages.has_example(getattr(kneejax, x))]
    silent = []
    for room in pages.ROOMS:
        module = importlib.import_module(room)
        for name in pages._offered(module):
            thing = getattr(module, name)
            if pages.where_shown(name, thing).startswith("Runs within"):
                silent.append(f"{room}.{name}")
    assert len(silent) <= 18, silent


def test_pages_of_the_code_hold_all_of_it(made):
    commands = (made / "commands.md").read_text()
    from kneejax.cli.options import COMMANDS

    for model in (model for models in COMMANDS.values() for model in models):
        assert f"### kneejax {model.command}\n" in commands
    names = (made / "api.rst").read_text()
    for name in kneejax.__all__:
        if not inspect.ismodule(getattr(kneejax, name)):
            assert f"kneejax.{name}\n" in names


def test_outputs_of_notebooks_need_no_network(pages, tmp_path):
    data = {"text/html": ["<script src='https://x'></script>"], "text/plain": ["figure"]}
    data["application/vnd.plotly.v1+json"] = {}
    cell = {"cell_type": "code", "source": [], "outputs": [{"data": data}]}
    (tmp_path / "one.ipynb").write_text(json.dumps({"cells": [cell]}))
    pages._copy_notebook(tmp_path / "one.ipynb", tmp_path / "two.ipynb")
    (kept,) = json.loads((tmp_path / "two.ipynb").read_text())["cells"][0]["outputs"]
    assert [*kept["data"]] == ["text/plain"]
