"""Numbers of a knee by name, read and written: of fibres, structures and other parts.

A structure drawn as several fibres is a group of them. Its stiffness and its damping are the sums
over its fibres, which act side by side; of any other quantity its value is the mean. Setting a
value keeps how the fibres differ: strains and points shift together, anything else is scaled by one
factor. A structure's stiffness once was the mean over its fibres: files of that time lack
`MEANING`, and a number of that time that a person gives is doubted.

Of compartments, lines, muscles, loads and wraps a name leads from the part through its fields to
one number, any leaf of a knee: `medial.youngs_modulus`, `medial.tibial_surface.superior`,
`quadriceps.tension`, `PatTen.radius`. Fields are those of the part's own class, or as
`kneejax.quantities` calls them.
"""

__all__ = [
    "MEANING", "Assumption", "DoubtfulValue", "doubt_prior", "doubt_value", "fibres_summed",
    "sums_in_words",
]

import dataclasses
import math
import warnings
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee, ligament_law
from kneejax.numerics import numpy_for, traced
from kneejax.quantities import AXES, QUANTITIES, quantity_of

#: Ends of a ligament, by the bones that they are on.
BONES = {one.name: one.bone for one in QUANTITIES.values() if one.bone}
#: Quantities that say how a fibre is strained at the reference pose -> their value without strain.
OF_STRAIN = {"reference_strain": 0.0, "prestretch": 1.0}


def value_of(numbers: Array, rows: tuple[int, ...], quantity: str) -> Array:
    """The value of a structure of some fibres, by their rows: sum or mean of `numbers_of`."""
    xp = numpy_for(numbers)
    own = xp.asarray(numbers)[np.array(rows)]
    return (xp.sum if quantity_of(quantity).summed else xp.mean)(own, axis=0)


def numbers_of(knee: Knee, quantity: str) -> Array:
    """A quantity of every fibre."""
    fibres = knee.ligaments
    if quantity in OF_STRAIN:
        both = knee.reference_length(), fibres.slack_length
        length, slack = map(numpy_for(both).asarray, both)
        return length / slack - (1.0 - OF_STRAIN[quantity])
    if quantity == "youngs_modulus":
        both = fibres.stiffness, fibres.area
        stiffness, area = map(numpy_for(both).asarray, both)
        return stiffness / numpy_for(both).where(area > 0.0, area, np.inf)
    end, _, axis = quantity.partition(".")
    if not axis:
        return getattr(fibres, quantity)
    column, first = AXES.index(axis), _is_first(knee, end)
    both = fibres.femoral_attachment, fibres.tibial_attachment
    xp = numpy_for(both)
    ends = [xp.asarray(points)[:, column] for points in both]
    if first.all() or not first.any():
        return ends[not first.any()]
    return xp.where(first.reshape(-1, *(1,) * (ends[0].ndim - 1)), *ends)


def _is_first(knee: Knee, end: str) -> np.ndarray:
    """Whether the bone of an end is the first of the two that each fibre joins, `(fibres,)`."""
    return np.array([pair[0] == BONES[end] for pair in knee.ligaments.bodies])


def write_value(knee: Knee, rows: tuple[int, ...], quantity: str, value: Array) -> Knee:
    """The knee in which a structure has a value, as `value_of` reads it, of any quantity but those
    that tell its strain (`strained`)."""
    end, _, axis = quantity.partition(".")
    if quantity_of(quantity).summed:
        value = value / len(rows)
    old, own = numbers_of(knee, quantity), _rows_of(knee, rows)
    changed = _shared(old, own, value, shifts=bool(axis))
    xp = numpy_for(knee, changed)
    if quantity == "youngs_modulus":
        quantity, old = "stiffness", knee.ligaments.stiffness
        changed = changed * knee.ligaments.area
    elif quantity == "area":  # of the same material
        stiffness = numbers_of(knee, "youngs_modulus") * changed
        knee = _with(knee, "stiffness", xp.where(own, stiffness, knee.ligaments.stiffness))
    if not axis:
        return _with(knee, quantity, xp.where(own, changed, old))
    column, first = np.arange(len(AXES)) == AXES.index(axis), _is_first(knee, end)
    for field, at in (("femoral_attachment", first), ("tibial_attachment", ~first)):
        place = (own & at)[:, None] & column
        if place.any():
            array = getattr(knee.ligaments, field)
            knee = _with(knee, field, xp.where(place, changed[:, None], array))
    return knee


def _with(knee: Knee, field: str, values: Array) -> Knee:
    return eqx.tree_at(lambda k: getattr(k.ligaments, field), knee, jnp.asarray(values, float))


def strained(knee: Knee, strains: Sequence[tuple[tuple[int, ...], Array]]) -> Knee:
    """The knee with reference strains of some fibres, by their rows.

    Lengths are asked for once: each way around an obstacle is a search, and no compiler sees that
    two searches are one.
    """
    both = knee.reference_length(), knee.ligaments.slack_length
    length, slack = map(numpy_for(both).asarray, both)
    for rows, value in strains:
        own = _rows_of(knee, rows)
        strain = _shared(length / slack - 1.0, own, value, shifts=True)
        changed = ligament_law.slack_length_from_strain(length, strain)
        slack = numpy_for(changed, slack).where(own, changed, slack)
    return _with(knee, "slack_length", slack)


def _shared(old: Array, own: np.ndarray, value: Array, shifts: bool) -> Array:
    """Numbers of all fibres, changed so that the mean of some becomes a value.

    Each number is computed from its own and picked by a mask: what was gathered, changed and
    scattered in lanes aborted XLA 0.10 (a check of its fused kernels).
    """
    xp = numpy_for(old, value)
    if own.sum() == 1:
        return xp.broadcast_to(value, old.shape)
    old = xp.asarray(old)
    mean = xp.sum(xp.where(own, old, 0.0)) / own.sum()
    if shifts:
        return old + (value - mean)
    # Fibres that have nothing yet (no damping, cut) share alike.
    nothing = mean == 0.0
    return xp.where(nothing, value, old * (value / xp.where(nothing, 1.0, mean)))


def _rows_of(knee: Knee, rows: tuple[int, ...]) -> np.ndarray:
    """Which fibres these are, `(fibres,)`."""
    return np.isin(np.arange(len(knee.ligaments.names)), rows)


#: What a file with values by parameter says of itself, field and value.
MEANING = {"stiffness_of": "structure"}
#: A prior that is narrower than this part of a structure's stiffness may be that of one fibre.
_NARROW = 0.05


class DoubtfulValue(UserWarning):
    """A value that is probably not what was meant."""


class Assumption(UserWarning):
    """What was taken to be so of what a file or a study does not say, in a sentence."""


def fibres_summed(knee: Knee, name: str) -> int:
    """Number of fibres over which a parameter's value is a sum.

    Args:
        knee: any knee.
        name: `LIGAMENT.quantity`, `GROUP.quantity`, ...

    Returns:
        1 for a fibre, for a mean, and for parameters of other parts.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("lenhart2015_reduced")
        >>> [fibres_summed(knee, f"MCL.{x}") for x in ("stiffness", "slack_length")]
        [3, 1]
    """
    owner, _, quantity = name.partition(".")
    return len(dict(knee.groups).get(owner, (owner,))) if quantity_of(quantity).summed else 1


def sums_in_words(knee: Knee | None, names: Sequence[str]) -> str:
    """Which parameters are sums over fibres, as a sentence; empty where none is.

    Args:
        knee: that has the parameters; None where there is none.
        names: of the parameters.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("lenhart2015_reduced")
        >>> sums_in_words(knee, ["MCL.stiffness", "LCL.stiffness", "MCL.slack_length"])
        'Sums over the fibres of a structure: MCL.stiffness (3 fibres).'
    """
    counts = {} if knee is None else {name: fibres_summed(knee, name) for name in names}
    summed = [f"{name} ({count} fibres)" for name, count in counts.items() if count > 1]
    return f"Sums over the fibres of a structure: {', '.join(summed)}." if summed else ""


def doubt_value(knee: Knee, name: str, value: float) -> None:
    """Warn of a structure's value that is nearer, as a ratio, to that of one of its fibres.

    Args:
        knee: whose structure it is, with the value that it has so far.
        name: of the parameter.
        value: that it is to have.

    Warns:
        DoubtfulValue: naming both.

    Example:
        >>> import kneejax as kj
        >>> doubt_value(kj.load_knee("four_ligament"), "ACL.stiffness", 5000.0)
    """
    count, total, words = of_whole(knee, name)
    if count > 1 and 0.0 < value < total / math.sqrt(count):
        warnings.warn(f"{name}: {value:g} {words}", DoubtfulValue, 2)


def doubt_prior(knee: Knee, name: str, deviation: float) -> None:
    """Warn of a prior of a structure's stiffness that is narrow, but not for one of its fibres.

    Args:
        knee: whose structure it is.
        name: of the parameter.
        deviation: its standard deviation.

    Warns:
        DoubtfulValue: naming both.

    Example:
        >>> import kneejax as kj
        >>> doubt_prior(kj.load_knee("four_ligament"), "ACL.stiffness", 500.0)
    """
    count, total, words = of_whole(knee, name)
    if count > 1 and _NARROW * total / count <= deviation < _NARROW * total:
        warnings.warn(f"{name}: a prior of {deviation:g} {words}", DoubtfulValue, 2)


def of_whole(knee: Knee, name: str) -> tuple[int, float, str]:
    """Over how many fibres a value is a sum, the sum in this knee, and both in words."""
    owner, _, quantity = name.partition(".")
    if (count := fibres_summed(knee, name)) == 1:
        return 1, 0.0, ""
    unit, total = quantity_of(quantity).unit, over_fibres(knee, dict(knee.groups)[owner], quantity)
    return count, total, (
        f"{unit} is of the whole {owner}, drawn as {count} fibres with {total:,.0f} {unit} in this "
        f"knee; one fibre has {total / count:,.0f} {unit} in the mean"
    )


def over_fibres(knee: Knee, fibres: Sequence[str], quantity: str) -> float:
    """The sum of a quantity over some fibres, by name."""
    rows = [knee.ligaments.names.index(fibre) for fibre in fibres]
    return float(np.asarray(numbers_of(knee, quantity))[rows].sum())


#: Kind of part -> its owner's name in `kneejax.quantities`.
_PARTS = {"contacts": "contact", "lines": "line", "muscles": "muscle", "loads": "load",
          "courses": "obstacle"}


@dataclasses.dataclass(frozen=True)
class Leaf:
    """One number of a knee, or all numbers of one array of it; hashable."""

    part: str  # `contacts`, `lines`, `muscles`, `loads` or `courses`
    row: int  # which of them
    fields: tuple[str, ...]  # from the part to the array
    place: tuple[int, ...] = ()  # of the number in the array; empty for a number by itself

    def array(self, knee: Knee) -> Array:
        """The array in which the number stands."""
        found: Any = getattr(knee.ligaments if self.part == "courses" else knee, self.part)
        if self.part != "muscles":  # one object; the row stands first in the place
            found = found[self.row]
        for field in self.fields:
            found = getattr(found, field)
        return found

    def read(self, knee: Knee) -> Array:
        """The number."""
        array = self.array(knee)
        return numpy_for(array).asarray(array)[self.place]

    def write(self, knee: Knee, value: Array) -> Knee:
        """The knee with another number there."""
        array = self.array(knee)
        if traced(array, value):
            changed = jnp.asarray(array, float).at[self.place].set(value)
        else:
            changed = np.array(array, float)
            changed[self.place] = value
        return eqx.tree_at(self.array, knee, jnp.asarray(changed))


def parts_of(knee: Knee) -> dict[str, list[tuple[str, int]]]:
    """Name of a part -> its places in the knee; a fibre's is the course that it runs in."""
    every = [("contacts", row, name) for row, name in enumerate(knee.contact_names)]
    every += [("lines", row, line.name) for row, line in enumerate(knee.lines)]
    if knee.muscles is not None:
        every += [("muscles", row, name) for row, name in enumerate(knee.muscles.names)]
    every += [("loads", row, getattr(load, "name", "")) for row, load in enumerate(knee.loads)]
    every += [("courses", row, knee.ligaments.names[fibre])
              for row, course in enumerate(knee.ligaments.courses) for fibre in course.rows]
    found: dict[str, list[tuple[str, int]]] = {}
    for part, row, name in every:
        found.setdefault(name, []).append((part, row))
    return found


def leaves_called(knee: Knee, owner: str, quantity: str) -> dict[str, Leaf]:
    """The numbers that a name means: quantity -> number, one, or each component where the name
    stands for a whole array; none where the part has no such number."""
    for part, row in parts_of(knee).get(owner, []):
        words = quantity.split(".")
        declared = QUANTITIES.get(words[0])
        fields = tuple((declared.paths if declared else {}).get(_PARTS[part], words[0]).split("."))
        found = _descended(Leaf(part, row, ()), (*fields, *words[1:]), knee)
        if found is not None:
            return {quantity + end: leaf for end, leaf in _components(found, knee).items()}
    return {}


def quantities_of(knee: Knee, owner: str) -> tuple[str, ...]:
    """What may be named of a part besides what every ligament has, for advice."""
    kinds = [_PARTS[part] for part, _ in parts_of(knee).get(owner, [])]
    names = [one.name for kind in kinds for one in QUANTITIES.values() if kind in one.owners]
    return tuple(name for name in names if leaves_called(knee, owner, name))


def _descended(leaf: Leaf, words: tuple[str, ...], knee: Knee) -> Leaf | None:
    """The number or array that words lead to from a part."""
    found = leaf.array(knee)
    for count, word in enumerate(words):
        if isinstance(found, jax.Array | np.ndarray):
            return _at(leaf, words[count:], found)
        known = dataclasses.fields(found) if isinstance(found, eqx.Module) else ()
        if word not in [field.name for field in known]:
            return None
        found = getattr(found, word)
        leaf = dataclasses.replace(leaf, fields=(*leaf.fields, word))
        if leaf.part == "muscles":
            if not isinstance(found, jax.Array | np.ndarray):
                return None
            leaf, found = dataclasses.replace(leaf, place=(leaf.row,)), found[leaf.row]
    return leaf if isinstance(found, jax.Array | np.ndarray) else None


def _at(leaf: Leaf, words: tuple[str, ...], array: Array) -> Leaf | None:
    """A component of an array, by its number or the name of its axis."""
    place = []
    if len(words) > array.ndim:
        return None
    for size, word in zip(array.shape, words, strict=False):
        if word in AXES and size == len(AXES):
            place.append(AXES.index(word))
        elif word.isdigit() and int(word) < size:
            place.append(int(word))
        else:
            return None
    return dataclasses.replace(leaf, place=(*leaf.place, *place))


def _components(leaf: Leaf, knee: Knee) -> dict[str, Leaf]:
    """The number itself, or all of an array by the ends of their names."""
    rest, found = leaf.array(knee).shape[len(leaf.place) :], {}
    is_point = rest[-1:] == (len(AXES),)
    for place in np.ndindex(*rest):
        words = [*map(str, place[:-1]), AXES[place[-1]]] if is_point else map(str, place)
        end = "".join(f".{word}" for word in words)
        found[end] = dataclasses.replace(leaf, place=(*leaf.place, *place))
    return found
