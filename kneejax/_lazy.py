"""The face of a package: public names that import their module when they are first asked for.

`import kneejax` brings in neither JAX nor Matplotlib, which together take seconds; whoever asks
for help, or misspells an option, does not wait for them.
"""

from __future__ import annotations

import ast
import importlib
import sys
from collections.abc import Callable, Mapping
from typing import Any


def lazy_names(
    package: str, modules: Mapping[str, str]
) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """Make `__getattr__` and `__dir__` of a package (PEP 562).

    Args:
        package: its full name.
        modules: public name -> full name of the module that defines it; a module inside the
            package stands for itself.

    Returns:
        Both functions.
    """

    def __getattr__(name: str) -> Any:
        face = sys.modules[package]
        if name not in modules:
            # With these two, Python suggests the nearest name of `__dir__`.
            raise AttributeError(
                f"module {package!r} has no attribute {name!r}", name=name, obj=face
            )
        module = importlib.import_module(modules[name])
        found = module if modules[name] == f"{package}.{name}" else getattr(module, name)
        # From now on the name is found without asking.
        setattr(face, name, found)
        return found

    def __dir__() -> list[str]:
        return sorted({*vars(sys.modules[package]), *modules})

    return __getattr__, __dir__


def lazy_imports(face: dict[str, Any]) -> None:
    """Import what a package offers when it is first asked for, as its own source says.

    The source has these imports under `if TYPE_CHECKING:`, where editors and type checkers read
    them, so that no name stands twice.

    Args:
        face: `globals()` of the package's `__init__`.
    """
    with open(face["__file__"], encoding="utf-8") as source:
        tree = ast.parse(source.read())
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    stated = (node for node in block.body if isinstance(node, ast.ImportFrom))
    modules = {name.name: node.module or "" for node in stated for name in node.names}
    asked, listed = lazy_names(face["__name__"], modules)
    face |= {"_MODULES": modules, "__all__": [*modules], "__getattr__": asked, "__dir__": listed}
