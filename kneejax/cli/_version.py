"""`kneejax --version`."""

from __future__ import annotations

import argparse
import platform

from kneejax import __version__

#: Packages that the numbers depend on most.
_PACKAGES = ("jax", "numpy", "optimistix")


class ShowVersion(argparse.Action):
    """Print versions and exit; they are read from what is installed, nothing is imported."""

    def __init__(self, option_strings, dest, help=None):
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, help=help)

    def __call__(self, parser, namespace, values, option_string=None):
        """Answer the option."""
        print(version_text())
        parser.exit()


def version_text() -> str:
    """The package's version, and below it those that a report of a fault should name."""
    from importlib.metadata import version

    others = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    return f"kneejax {__version__}\nPython {platform.python_version()}, {others}"
