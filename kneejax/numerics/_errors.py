"""Errors for the person who made the mistake: packages that are missing, values that cannot be."""

__all__ = ["MissingPackage", "WrongValue", "check_installed", "imported"]

import importlib
import importlib.util
import warnings
from typing import Any


class MissingPackage(ValueError):
    """An optional package that a question needs and that is not installed.

    Example:
        >>> try:
        ...     imported("no_such_module", "no-such-package", "maps")
        ... except MissingPackage as error:
        ...     print("maps" in str(error))
        True
    """

#: Extra of kneejax -> how a sentence on its packages begins.
_WHO_NEEDS = {
    "cohorts": "workers and cohort.nc need",
    "lbfgsb": "the method lbfgsb needs",
    "maps": "maps need",
    "planning": "a plan needs",
    "tables": "tables need",
    "sensitivity": "global indices need",
    "opensim": "inverse dynamics and static optimisation need",
    "view": "the 3-D view needs",
    "explore": "the explorer needs",
    "notebook": "sliders in a notebook need",
}


def imported(module: str, package: str, extra: str = "posterior") -> Any:
    """An optional module.

    Args:
        module: what to import.
        package: that it comes with.
        extra: of kneejax, that asks for the package.

    Returns:
        The module.

    Raises:
        MissingPackage: it is not installed, or lacks something itself; the sentence says what to
            do.

    Example:
        >>> imported("math", "math", "maps").pi > 3
        True
    """
    try:
        with warnings.catch_warnings():
            # ArviZ 0.23 announces 1.0 when it is imported, jaxopt that it is maintained no longer.
            warnings.simplefilter("ignore", FutureWarning)
            warnings.simplefilter("ignore", DeprecationWarning)
            return importlib.import_module(module)
    except ImportError as problem:
        found = not problem.name or not module.startswith(problem.name.split(".")[0])
        raise _missing(package, extra, str(problem) if found else "") from problem


def check_installed(package: str, extra: str) -> None:
    """Say before the work that a package is missing, without importing it.

    Imported beforehand, what draws and writes would add its memory to that of compiling.

    Args:
        package: to look for.
        extra: of kneejax, that asks for it.

    Raises:
        MissingPackage: it is not installed; the sentence says what to do.

    Example:
        >>> check_installed("numpy", "maps")
    """
    if importlib.util.find_spec(package) is None:
        raise _missing(package, extra)


def _missing(package: str, extra: str, why: str = "") -> MissingPackage:
    what = _WHO_NEEDS.get(extra, f"the {extra} needs")
    state = f"cannot be imported ({why})" if why else "is not installed"
    return MissingPackage(f"{what} {package}, which {state}: pip install 'kneejax[{extra}]'")


class WrongValue(ValueError):
    """An argument that is not what it should be: `FIELD: FOUND; expected EXPECTED`.

    Attributes:
        field: name of the argument, or of the part of it.
        found: what was given, in words.
        expected: what should be given.

    Example:
        >>> print(WrongValue("flexion", "400 degrees", "between -20 and 160"))
        flexion: 400 degrees; expected between -20 and 160
    """

    def __init__(self, field: str, found: str, expected: str):
        self.field, self.found, self.expected = field, found, expected
        super().__init__(f"{field}: {found}; expected {expected}")

    def __reduce__(self):
        return type(self), (self.field, self.found, self.expected)
