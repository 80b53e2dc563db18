"""Packages that only some questions need."""

from __future__ import annotations

import importlib
import warnings
from typing import Any

from kneejax.inference._parameters import UnsuitableData


def imported(module: str, package: str, extra: str = "posterior") -> Any:
    """An optional module.

    Args:
        module: what to import.
        package: that it comes with.
        extra: of kneejax, that asks for the package.

    Returns:
        The module.

    Raises:
        UnsuitableData: it is not installed; the sentence says what to do.
    """
    try:
        with warnings.catch_warnings():
            # ArviZ 0.23 announces 1.0 when it is imported.
            warnings.simplefilter("ignore", FutureWarning)
            return importlib.import_module(module)
    except ImportError as problem:
        if problem.name and not module.startswith(problem.name.split(".")[0]):
            raise
        what = f"the {extra} needs" if extra == "posterior" else f"{extra} need"
        raise UnsuitableData(
            f"{what} {package}, which is not installed: pip install 'kneejax[{extra}]'"
        ) from problem
