"""What one parameter at a time does to the motion: slopes, and sweeps over a range."""

__all__ = [
    "USUAL_COUNT", "LocalSensitivity", "Sweep", "Sweeps", "local_sensitivity", "step_widths",
    "sweep", "sweep_values",
]

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from kneejax.geometry import BY_COORDINATE
from kneejax.inference.fit import named, table_of
from kneejax.mechanics import Knee
from kneejax.numerics import Named
from kneejax.parameters import (
    Selection,
    UnsuitableData,
    default_bounds,
    doubt_value,
    percent_scales,
    prior_scales,
    select,
    structure_range,
    unphysiological,
)
from kneejax.statics import (
    FAILURES,
    LoadCases,
    Progress,
    Status,
    balance_lines,
    balance_with_slopes,
    fails,
)

#: How a slope is scaled -> words that finish "mm or degrees per ...".
SCALES = {"prior": "standard deviation of the prior", "percent": "per cent of the parameter"}


@dataclasses.dataclass(frozen=True)
class LocalSensitivity(Named):
    """Derivatives of a motion with respect to parameters; rows that failed are NaN.

    Attributes:
        names: parameters, `(p,)`.
        units: of the parameters; empty for strains.
        values: of the parameters, `(p,)`.
        flexion_deg: shape `(n,)`.
        table: free coordinates, degrees and mm, `(n, 5)`.
        status: `Status` values, `(n,)`.
        derivative: of coordinates (degrees, mm) with respect to parameters in their units,
            `(n, 5, p)`.
        scale: `prior` or `percent`.
        widths: of one step of that scale in the parameters' units, `(p,)`.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    values: np.ndarray
    flexion_deg: np.ndarray
    table: np.ndarray
    status: np.ndarray
    derivative: np.ndarray
    scale: str
    widths: np.ndarray

    OVER = {
        "flexion_deg": {"flexion_deg": "", "status": Status},
        "flexion_deg coordinate": {"table": ""}, "parameter": {"values": "", "widths": ""},
        "flexion_deg coordinate parameter": {"derivative": "", "scaled": ""},
    }  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        own = {"parameter": ("parameter", self.names), "parameter_unit": ("parameter", self.units)}
        return super()._named() | BY_COORDINATE | own

    @property
    def scaled(self) -> np.ndarray:
        """Degrees and mm for one step of the scale, `(n, 5, p)`: what can be compared."""
        return self.derivative * self.widths

    def largest(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest scaled slope (with its sign) over flexion and its row, each `(5, p)`."""
        size = np.nan_to_num(np.abs(self.scaled))
        row = size.argmax(axis=0)
        return np.take_along_axis(np.nan_to_num(self.scaled), row[None], axis=0)[0], row


def local_sensitivity(
    knee: Knee,
    parameters: Sequence[str],
    flexion_deg: ArrayLike,
    *,
    scale: str = "prior",
    given: Mapping[str, float] | None = None,
) -> LocalSensitivity:
    """Differentiate the motion of a knee with respect to parameters.

    The derivatives are exact: they follow from the implicit function theorem at each balance, not
    from differences of two motions.

    Args:
        knee: where the slopes are taken.
        parameters: names or wildcards.
        flexion_deg: prescribed angles, `(n,)`.
        scale: `prior` for one standard deviation of a prior (see `prior_scales`), `percent` for
            one per cent of the value (0.01 for a reference strain).
        given: standard deviations of priors, by name, wildcard or quantity.

    Returns:
        The `LocalSensitivity`.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: an unknown scale, a prior of zero width, or a per cent that means nothing.

    Example:
        It compiles for long; names are checked at once:

        >>> import kneejax as kj
        >>> try:
        ...     kj.local_sensitivity(kj.load_knee("four_ligament"), ["ACL.stifness"], [0.0, 30.0])
        ... except Exception as problem:
        ...     print(problem)
        unknown parameter 'ACL.stifness'; did you mean 'ACL.stiffness'?
    """
    selection = select(knee, tuple(parameters))
    values = np.asarray(selection.read(knee))
    widths = step_widths(selection, values, scale, given)
    flexion = np.atleast_1d(np.asarray(flexion_deg, float))
    load_cases = LoadCases.at(flexion)
    found = balance_with_slopes(knee, selection.apply, values[None], load_cases)
    table, slope = table_of(found)
    units = tuple(unit for _, unit in named(selection))
    return LocalSensitivity(
        selection.names, units, values, flexion, table[0], found.status[0], slope[0], scale, widths
    )


def step_widths(
    selection: Selection, values: np.ndarray, scale: str, given: Mapping[str, float] | None = None
) -> np.ndarray:
    """One step of a scale in the parameters' own units, `(p,)`; refuses as `local_sensitivity`,
    whose arguments these are."""
    if scale not in SCALES:
        raise UnsuitableData(f"unknown scale {scale!r}: expected one of {', '.join(SCALES)}")
    if scale == "prior":
        return prior_scales(selection, values, given)
    return percent_scales(selection, values)


#: N per unit strain, paper 1, section 3, of structures; other quantities go over their bounds.
_STIFFNESS = (300.0, 9300.0)
#: Values of a parameter where nobody says how many.
USUAL_COUNT = 31
#: Part of a slack length to either side, the same as that of a reference strain.
_SLACK = 0.2


@dataclasses.dataclass(frozen=True)
class Sweep(Named):
    """One parameter over its values, everything else kept.

    Attributes:
        name: e.g. `ACL.stiffness`.
        unit: e.g. `N`; empty for strains.
        own: the baseline value, that of the knee itself.
        values: ascending, `(values,)`.
        table: free coordinates, degrees and mm, `(values, load_cases, 5)`; NaN where no balance.
        status: `Status` values, `(values, load_cases)`.
        unphysiological: balanced, but not as a knee moves (see `unphysiological`),
            `(values, load_cases)`.
        failures: statuses of balances that count for nothing.
    """

    name: str
    unit: str
    own: float
    values: np.ndarray
    table: np.ndarray
    status: np.ndarray
    unphysiological: np.ndarray
    failures: tuple[Status, ...] = FAILURES

    OVER = {"value load_case": {"status": Status, "unphysiological": ""},
            "value load_case coordinate": {"table": ""}}  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        own = {"value": ("value", self.values, {"units": self.unit or "1", "parameter": self.name})}
        return super()._named() | BY_COORDINATE | own

    @property
    def sound(self) -> np.ndarray:
        """Balanced, no failure, and physiological, `(values, load_cases)`."""
        return ~fails(self.status, self.failures) & ~self.unphysiological


@dataclasses.dataclass(frozen=True)
class Sweeps:
    """Parameters of one knee, swept one at a time.

    Attributes:
        flexion_deg: of the load cases, `(load_cases,)`.
        table: baseline motion, of the knee itself, degrees and mm, `(load_cases, 5)`.
        status: `Status` values of that motion, `(load_cases,)`.
        sweeps: one per parameter.
    """

    flexion_deg: np.ndarray
    table: np.ndarray
    status: np.ndarray
    sweeps: tuple[Sweep, ...]

    def __getitem__(self, name: str) -> Sweep:
        return next(one for one in self.sweeps if one.name == name)


def sweep(
    knee: Knee,
    parameters: Sequence[str] | Mapping[str, ArrayLike | None],
    load_cases: ArrayLike | LoadCases,
    *,
    count: int = USUAL_COUNT,
    progress: Progress | None = None,
    failures: tuple[Status, ...] = FAILURES,
) -> Sweeps:
    """Vary parameters one at a time and balance the knee at every value.

    The sweep of a parameter begins at the knee's own value and goes both ways, each pose predicted
    from its neighbours, so that it stays on the knee's branch of equilibria as long as there is
    one.

    Args:
        knee: gives everything that is not varied.
        parameters: names or wildcards; or a mapping from them to values, None for the usual ones:
            `count` values from 300 to 9300 N (paper 1; of a structure drawn as several fibres also
            a quarter to four times its own), from -0.2 to 0.2 of reference strain (paper 1), over
            a fifth of the slack length to either side, or over the bounds of the quantity.
        load_cases: load cases: angles in degrees, or `LoadCases` with loads of their own.
        count: how many values where none are given.
        progress: called now and then with balances done and asked for.
        failures: statuses of balances that count for nothing: such poses are not sound.

    Returns:
        The `Sweeps`; load cases in ascending flexion if angles are given.

    Raises:
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: a parameter twice, fewer than two values, or values that are not finite,
            distinct numbers.

    Source: paper 1, sections 3.1 and 3.2.

    Example:
        It compiles for long; names are checked at once:

        >>> import kneejax as kj
        >>> try:
        ...     kj.sweep(kj.load_knee("four_ligament"), ["ACL.stifness"], [0.0, 30.0])
        ... except Exception as problem:
        ...     print(problem)
        unknown parameter 'ACL.stifness'; did you mean 'ACL.stiffness'?
    """
    selection, values = sweep_values(knee, parameters, count)
    if isinstance(load_cases, LoadCases):
        flexion = np.rad2deg(np.asarray(load_cases.flexion))
    else:
        flexion = np.unique(np.asarray(load_cases, float))
        load_cases = LoadCases.at(flexion)
    own = np.asarray(selection.read(knee))
    # Each line gets the knee's own value besides, where its path begins. All have one shape: a
    # short one stands at its last value.
    begin = np.array([np.searchsorted(v, o) for v, o in zip(values, own, strict=True)])
    longest = 1 + max(len(line) for line in values)
    lines = np.tile(own, (len(values), longest, 1))
    for i, line in enumerate(values):
        followed = np.insert(line, begin[i], own[i])
        lines[i, :, i] = np.pad(followed, (0, longest - len(followed)), mode="edge")

    found = balance_lines(knee, selection.apply, lines, load_cases, begin, progress=progress)
    motion, outcome = found.table[0, begin[0]], found.status[0, begin[0]]
    sweeps = []
    for i, (name, unit) in enumerate(named(selection)):
        asked = np.delete(np.arange(len(values[i]) + 1), begin[i])
        table, status = found.table[i, asked], found.status[i, asked]
        strange = unphysiological(table, motion)
        line = values[i], table, status, strange, failures
        sweeps.append(Sweep(name, unit, float(own[i]), *line))
    return Sweeps(flexion, motion, outcome, tuple(sweeps))


def sweep_values(
    knee: Knee, parameters: Sequence[str] | Mapping[str, ArrayLike | None], count: int = USUAL_COUNT
) -> tuple[Selection, list[np.ndarray]]:
    """The parameters that `sweep` asks for and the values of each; refuses as it does."""
    names = list(parameters)
    if not names:
        raise UnsuitableData("no parameter to sweep: name at least one, such as ACL.stiffness")
    given = parameters if isinstance(parameters, Mapping) else {}
    owner: dict[str, str] = {}
    for asked in names:
        for name in select(knee, [asked]).names:
            if name in owner:
                both = "" if owner[name] == asked else f" (by {owner[name]} and by {asked})"
                raise UnsuitableData(f"{name} is swept twice{both}: name it once")
            owner[name] = asked
    selection = select(knee, tuple(owner))
    values = []
    for i, name in enumerate(selection.names):
        line = given.get(owner[name])
        if line is None:
            quantity, fibres = selection.quantity(i), selection.fibres(i)
            if quantity == "stiffness":
                low, high = structure_range(knee, fibres, _STIFFNESS) if fibres else _STIFFNESS
            elif quantity == "slack_length":
                value = float(selection.read(knee)[i])
                low, high = (1 - _SLACK) * value, (1 + _SLACK) * value
            else:
                low, high = (float(limit[i]) for limit in default_bounds(knee, selection))
            line = np.linspace(low, high, max(count, 0))
        line = np.asarray(line, float)
        if line.ndim != 1 or len(line) < 2:
            raise UnsuitableData(f"{name}: a sweep of {line.size} value: expected at least two")
        if not np.isfinite(line).all():
            raise UnsuitableData(f"{name}: a sweep over values that are not finite")
        if not (np.diff(line) > 0).all():
            raise UnsuitableData(
                f"{name}: a sweep from {line[0]:g} to {line[-1]:g}: expected ascending values, "
                "the lower end first"
            )
        doubt_value(knee, name, float(line[-1]))
        values.append(line)
    return selection, values
