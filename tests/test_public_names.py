"""What `import kneejax` offers, and that it costs nothing until it is used."""

import ast
import importlib
import inspect
import pkgutil
import subprocess
import sys
from pathlib import Path
from types import GenericAlias

import pytest

import kneejax

#: What imports a module when a name is first asked for. No module may have that name itself: once
#: it is imported, it hides what the name stands for.
FACES = [
    room
    for x in pkgutil.walk_packages(kneejax.__path__, "kneejax.")
    if x.ispkg and hasattr(room := importlib.import_module(x.name), "__getattr__")
]
FACES.append(kneejax)


def stated(package):
    """Name -> module, from the imports of an `__init__`, which editors and type checkers read."""
    tree = ast.parse(Path(package.__file__).read_text(encoding="utf-8"))
    found = {}
    for node in ast.walk(tree):
        for alias in node.names if isinstance(node, ast.ImportFrom) else ():
            if alias.name == "*":
                own = importlib.import_module(node.module)
                offered = [*stated(own)] if hasattr(own, "__path__") else own.__all__
                assert len(offered) == len(set(offered)), f"{node.module} names one twice"
                found |= dict.fromkeys(offered, node.module)
            elif alias.asname == alias.name:
                found[alias.name] = node.module
    return found


@pytest.mark.parametrize("package", FACES, ids=lambda package: package.__name__)
def test_every_public_name_is_there(package):
    assert sorted(package.__all__) == sorted(stated(package))
    for name, module in stated(package).items():
        if module == package.__name__:  # a room itself
            found = importlib.import_module(f"{module}.{name}")
        else:
            found = getattr(importlib.import_module(module), name)
        assert getattr(package, name) is found
        assert name in dir(package)


def test_a_name_that_there_is_not_is_an_attribute_error():
    with pytest.raises(AttributeError, match="'kneejax' has no attribute 'calibrte'") as caught:
        _ = kneejax.calibrte  # pyright: ignore[reportAttributeAccessIssue]
    # From these Python suggests a name.
    assert caught.value.name == "calibrte" and caught.value.obj is kneejax


def test_to_import_the_package_is_cheap():
    check = "import sys, kneejax, kneejax.files; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert not {"jax", "numpy", "scipy", "yaml", "kneejax.geometry"} & set(done.stdout.split())


def test_what_calibrates_imports_no_plan():
    """Annotations that name a lazy room are words: evaluated, they import it."""
    check = "import sys, kneejax.cli._studies; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", check], capture_output=True, text=True, check=True)
    assert not {"kneejax.planning._plan", "scipy.optimize"} & set(done.stdout.split())


ROOMS = sorted(
    x.name for x in pkgutil.walk_packages(kneejax.__path__, "kneejax.") if x.ispkg
)  # fmt: skip


@pytest.mark.parametrize("room", ["kneejax", *ROOMS])
def test_every_public_name_says_what_it_is_in_a_sentence(room):
    silent = []
    package = importlib.import_module(room)
    for name in stated(package):
        thing = getattr(package, name)
        if not (inspect.isclass(thing) or callable(thing)) or isinstance(thing, GenericAlias):
            continue
        # A dataclass without a docstring gets its signature for one.
        said = (inspect.getdoc(thing) or "").split("\n\n")[0].strip()
        if not said.endswith(".") or said.startswith(f"{name}("):
            silent.append(name)
    assert not silent
