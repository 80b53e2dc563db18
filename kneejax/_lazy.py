"""The face of a package: public names that import their module when they are first asked for.

`import kneejax` brings in neither JAX nor Matplotlib, which together take seconds; whoever asks
for help, or misspells an option, does not wait for them.
"""

from __future__ import annotations

import ast
import importlib
import sys
from typing import Any


def lazy_imports(face: dict[str, Any]) -> None:
    """Import what a package offers when it is first asked for, as its own source says (PEP 562).

    The source has these imports under `if TYPE_CHECKING:`, where editors and type checkers read
    them, so that no name stands twice.

    Args:
        face: `globals()` of the package's `__init__`.
    """
    package = face["__name__"]
    with open(face["__file__"], encoding="utf-8") as source:
        tree = ast.parse(source.read())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    stated = (node for node in block.body if isinstance(node, ast.ImportFrom))
    modules = {name.name: node.module or "" for node in stated for name in node.names}

    def __getattr__(name: str) -> Any:
        if name not in modules:
            # With these two, Python suggests the nearest name of `__dir__`.
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}",
                name=name, obj=sys.modules[package],
            )  # fmt: skip
        if modules[name] == package:  # a room itself
            found = importlib.import_module(f"{package}.{name}")
        else:
            found = getattr(importlib.import_module(modules[name]), name)
        # From now on the name is found without asking.
        face[name] = found
        return found

    def __dir__() -> list[str]:
        return sorted({*face, *modules})

    face |= {"__all__": [*modules], "__getattr__": __getattr__, "__dir__": __dir__}
