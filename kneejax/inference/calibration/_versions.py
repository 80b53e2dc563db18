"""What a number in a result depends on besides its data."""

from __future__ import annotations

import importlib.metadata
import platform

_PACKAGES = ("kneejax", "jax", "jaxlib", "optimistix", "equinox", "lineax", "numpy", "jaxopt")


def versions() -> dict[str, str]:
    """Versions of everything that a number in a result depends on."""
    found = {"python": platform.python_version(), "platform": platform.platform()}
    for package in _PACKAGES:
        try:
            found[package] = importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found
