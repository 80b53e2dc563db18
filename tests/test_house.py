"""What `docs/architecture.md` says of folders; `lint-imports` holds the direction between rooms."""

import ast
import graphlib
import re
from collections import defaultdict
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "kneejax"
ALL_CHECKS = PACKAGE.parent / ".ci" / "run"


def modules():
    """Each file's name as a module, the folder it is in, and its tree."""
    for path in sorted(PACKAGE.rglob("*.py")):
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
        yield module, ".".join(parts[:-1]), ast.parse(path.read_text())


def imports(tree):
    """Every module of the package that a file imports something from, with what it takes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            if node.module.split(".")[0] == "kneejax":
                yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (x.name for x in node.names if x.name.split(".")[0] == "kneejax")


#: Lines of a file, and of a function in the rooms that solve, docstrings counted.
LONGEST_FILE, LONGEST_FUNCTION = 400, 60
SOLVING = ("kneejax.mechanics", "kneejax.statics", "kneejax.dynamics")


def inside(module, folder):
    return f"{module}.".startswith(f"{folder}.")


def test_what_a_folder_keeps_private_is_imported_in_that_folder_only():
    wrong = []
    for module, folder, tree in modules():
        for taken in imports(tree):
            parts = taken.split(".")
            private = next((i for i, part in enumerate(parts) if part.startswith("_")), None)
            if private is not None and not inside(folder, ".".join(parts[:private])):
                wrong.append(f"{module} imports {taken}")
    assert not wrong, "offer it in the folder's __init__.py: " + "; ".join(wrong)


def test_a_folder_offers_only_what_it_holds():
    wrong = [
        f"{module} offers {taken}"
        for module, folder, tree in modules()
        if module == folder != "kneejax"
        for taken in imports(tree)
        if not inside(taken, folder) and not inside(taken, "kneejax._lazy")
    ]
    assert not wrong, "; ".join(wrong)


def test_folders_and_files_of_a_room_import_each_other_in_no_circle():
    """What one folder holds counts as one: its files may know each other."""
    graph = defaultdict(set)
    for module, folder, tree in modules():
        room = ".".join(folder.split(".")[:2])
        if module == folder == room or room == "kneejax":
            continue
        here = ".".join(module.split(".")[:3])
        for taken in imports(tree):
            there = ".".join(taken.split(".")[:3])
            if inside(taken, room) and there != here:
                graph[here].add(there)
    try:
        order = list(graphlib.TopologicalSorter(graph).static_order())
    except graphlib.CycleError as circle:
        pytest.fail(" -> ".join(circle.args[1]))
    assert set(graph) <= set(order)


def test_files_that_pages_name_are_there():
    root = PACKAGE.parent
    rooms = ("kneejax", "benchmarks", "data", "docs", "tests", "notebooks")
    files = (x for room in rooms for x in (root / room).rglob("*.py"))
    every = [f"/{x.relative_to(root).as_posix()}" for x in files]
    pages = [*(root / "docs").glob("*.md"), root / "README.md", root / "benchmarks" / "README.md"]
    texts = {page.name: page.read_text(encoding="utf-8") for page in pages}
    named = {(page, x) for page, text in texts.items() for x in re.findall(r"`([\w/]+\.py)`", text)}
    gone = [x for x in sorted(named) if not any(file.endswith(f"/{x[1]}") for file in every)]
    assert not gone


def test_no_file_hides_two_rooms():
    root, own = PACKAGE.parent, Path(__file__).parent
    lengths = {
        path.relative_to(root): len(path.read_text(encoding="utf-8").splitlines())
        for folder in (PACKAGE, own)
        for path in folder.rglob("*.py")
    }
    long = {str(path): count for path, count in lengths.items() if count > LONGEST_FILE}
    assert not long, f"at most {LONGEST_FILE} lines: {long}"


def test_who_reads_a_solver_reads_short_functions():
    long = [
        f"{module}.{node.name}: {node.end_lineno - node.lineno + 1} lines"
        for module, _, tree in modules()
        if any(inside(module, room) for room in SOLVING)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and node.end_lineno - node.lineno + 1 > LONGEST_FUNCTION
    ]
    assert not long, f"at most {LONGEST_FUNCTION} lines: {'; '.join(long)}"


@pytest.mark.skipif(not ALL_CHECKS.exists(), reason="not in a checkout")
def test_what_the_command_leaves_out_all_checks_run(pytestconfig):
    """What pytest deselects by itself is a stage of its own."""
    settings = pytestconfig.getini("addopts")
    assert [word for word in settings if word.startswith("-m")] == ["-m=not slow and not long"]
    stages = [line for line in ALL_CHECKS.read_text().splitlines() if line.startswith("stage ")]
    assert 'stage "Long and slow tests" second' in stages
    # What is skipped is said: -rs.
    assert 'python -m pytest -n auto -m "long or slow" tests -rs' in ALL_CHECKS.read_text()
