"""Notebooks, benchmarks and the scripts that make pages ask kneejax for what it has.

They take minutes to run; that a name or an argument of theirs is gone shows in a second.
"""

import ast
import importlib
import inspect
import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CALLERS = sorted(
    path
    for pattern in ("notebooks/*.ipynb", "benchmarks/*.py", "docs/*.py", "docs/figures/*.py")
    for path in ROOT.glob(pattern)
)


def tree_of(path):
    """The Python of a file; of a notebook, of all its cells without what only IPython reads."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".ipynb":
        cells = [x["source"] for x in json.loads(text)["cells"] if x["cell_type"] == "code"]
        lines = [line for cell in cells for line in [*"".join(cell).splitlines(), ""]]
        text = "\n".join(line for line in lines if not line.startswith("%"))
    return ast.parse(text)


def imported(tree):
    """Name in the file -> what kneejax gives for it; raises where it gives nothing."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "kneejax":
                    found[alias.asname or "kneejax"] = importlib.import_module(alias.name)
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "kneejax":
            module = importlib.import_module(node.module)
            for alias in node.names:
                found[alias.asname or alias.name] = getattr(module, alias.name)
    return found


def meant(node, names):
    """What a dotted name stands for while it leads through kneejax's modules, otherwise None."""
    if isinstance(node, ast.Name):
        return names.get(node.id)
    if isinstance(node, ast.Attribute):
        holder = meant(node.value, names)
        if inspect.ismodule(holder) or inspect.isclass(holder):
            return getattr(holder, node.attr)
    return None


def wrong_calls(tree, names):
    """Calls of functions of kneejax with arguments that they do not take."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Call):
            continue
        called = meant(node.func, names)
        unpacked = any(isinstance(x, ast.Starred) for x in node.args)
        if not inspect.isfunction(called) or unpacked or any(k.arg is None for k in node.keywords):
            continue
        try:
            inspect.signature(called).bind(*node.args, **{k.arg: k.value for k in node.keywords})
        except TypeError as error:
            yield f"line {node.lineno}: {called.__name__}: {error}"


@pytest.mark.parametrize("path", CALLERS, ids=lambda path: path.name)
def test_names_and_arguments_exist(path):
    tree = tree_of(path)
    names = imported(tree)
    for node in ast.walk(tree):
        meant(node, names)
    assert not list(wrong_calls(tree, names))
