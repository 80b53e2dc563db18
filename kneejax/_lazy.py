"""The face of a package: public names that import their module when they are first asked for.

`import kneejax` brings in neither JAX nor Matplotlib, which together take seconds; whoever asks
for help, or misspells an option, does not wait for them.
"""

import ast
import importlib
import re
import sys
from pathlib import Path
from typing import Any


def lazy_imports(face: dict[str, Any]) -> None:
    """Import what a package offers when it is first asked for, as its own source says (PEP 562).

    The source has these imports under `if TYPE_CHECKING:`, where editors and type checkers read
    them, so that no name stands twice; `from file import *` stands for the file's `__all__`.

    Args:
        face: `globals()` of the package's `__init__`.
    """
    package = face["__name__"]
    tree = ast.parse(Path(face["__file__"]).read_text(encoding="utf-8"))
    (block,) = (node for node in tree.body if isinstance(node, ast.If))
    stated = [node for node in block.body if isinstance(node, ast.ImportFrom)]
    modules: dict[str, str] = {}
    for module, names in ((x.module or "", [name.name for name in x.names]) for x in stated):
        modules |= dict.fromkeys(_offered(module) if names == ["*"] else names, module)

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


def _offered(module: str) -> list[str]:
    """The `__all__` of a file, which is not imported for it."""
    file = Path(__file__).parents[1].joinpath(*module.split(".")).with_suffix(".py")
    (names,) = re.findall(r"^__all__ = (\[.*?\])", file.read_text(encoding="utf-8"), re.M | re.S)
    return ast.literal_eval(names)
