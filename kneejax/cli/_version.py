"""`kneejax --version`."""

from __future__ import annotations

import platform

from kneejax import __version__

#: Packages that the numbers depend on most.
_PACKAGES = ("jax", "numpy", "optimistix")


def version_text() -> str:
    """The package's version, and below it those that a report of a fault should name."""
    from importlib.metadata import version

    others = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    return f"kneejax {__version__}\nPython {platform.python_version()}, {others}"
