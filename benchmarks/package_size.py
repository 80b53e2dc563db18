"""How large is the package: lines, code, imports and files of each room, functions called once?

    python benchmarks/package_size.py
"""

from __future__ import annotations

import argparse
import ast
import collections
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "kneejax"
_DOCUMENTED = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
_HEADS = ("lines", "code", "imports", "files")


def lines_of(tree: ast.Module, text: str) -> dict[str, int]:
    """Lines of a file; code is without docstrings, imports, comments and blank lines."""
    apart, imports = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            imports |= set(range(node.lineno, (node.end_lineno or 0) + 1))
        elif isinstance(node, _DOCUMENTED) and ast.get_docstring(node) is not None:
            apart |= set(range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1))
    lines = text.splitlines()
    apart |= {k for k, line in enumerate(lines, 1) if not line.strip() or line.lstrip()[0] == "#"}
    code = len(lines) - len(apart | imports)
    return {"lines": len(lines), "code": code, "imports": len(imports), "files": 1}


def called_once(trees: list[ast.Module]) -> float:
    """Part of the functions of modules whose name is used in exactly one place."""
    used = collections.Counter(
        getattr(node, "id", getattr(node, "attr", None))
        for tree in trees
        for node in ast.walk(tree)
        if isinstance(node, (ast.Name, ast.Attribute)) and isinstance(node.ctx, ast.Load)
    )
    functions = [n.name for t in trees for n in t.body if isinstance(n, ast.FunctionDef)]
    return sum(used[name] == 1 for name in functions) / len(functions)


def main() -> None:
    argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0]).parse_args()
    rooms: dict[str, collections.Counter] = collections.defaultdict(collections.Counter)
    trees = []
    for path in sorted(PACKAGE.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        trees.append(ast.parse(text))
        sizes = lines_of(trees[-1], text)
        for room in (path.relative_to(PACKAGE).parts[0].removesuffix(".py"), "together"):
            rooms[room].update(sizes)
    print(f"{'':14}" + "".join(f"{head:>9}" for head in _HEADS))
    for room, sizes in sorted(rooms.items(), key=lambda one: one[1]["lines"]):
        print(f"{room:14}" + "".join(f"{sizes[head]:9,}" for head in _HEADS))
    print(f"functions of modules that are used in exactly one place: {called_once(trees):.0%}")


if __name__ == "__main__":
    main()
