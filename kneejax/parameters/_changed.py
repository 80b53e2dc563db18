"""A knee with other numbers, or cut: without ligaments, menisci or parts of them."""

__all__ = ["cut", "fibres_cut", "replaced", "without_menisci"]

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike

from kneejax.mechanics import Contact, Implausible, Knee, at_reference, check_fibres
from kneejax.numerics import numpy_for, traced
from kneejax.parameters._numbers import doubt_value
from kneejax.parameters._selection import UnknownParameter, fibre_rows, select
from kneejax.quantities import nearest_name, range_of_parameter

#: What a partial meniscectomy may be of.
_PARTS = ("inner", "anterior", "posterior")
#: Farther off than any cartilage, mm: where the outline of a meniscus is that is gone.
_NOWHERE = 1e4


def replaced(knee: Knee, values: Mapping[str, ArrayLike]) -> Knee:
    """What `Knee.replace` gives, and says."""
    values = {name: _allowed(knee, name, value) for name, value in values.items()}
    if given := _of_each(knee, values):
        selection = select(knee, [*given])
        every = [*given.values()]
        knee = selection.apply(knee, numpy_for(every).stack(every))
    if values and not traced(knee):
        # Straight lengths are a check, too, and reading the knee has compiled them.
        check_fibres(knee.ligaments, *at_reference(knee.ligaments, knee.at_reference, False))
    return knee


def _allowed(knee: Knee, name: str, value: ArrayLike) -> ArrayLike:
    """A value that its parameter may have; refuses others, and doubts one of a single fibre."""
    selection = select(knee, [name])
    if traced(value):
        return value
    owner, quantity = name.split(".", 1)
    if np.ndim(value) or np.asarray(value).dtype.kind not in "iuf":
        raise Implausible(owner, quantity, f"{value}", "a number")
    allowed, value = range_of_parameter(selection.names[0]), float(np.asarray(value))
    if allowed and not allowed.holds(value):
        raise Implausible(owner, quantity, f"{value:g}", allowed.expected(value))
    doubt_value(knee, name, value)
    return value


def _of_each(knee: Knee, values: Mapping[str, ArrayLike]) -> dict[str, ArrayLike]:
    """The value of each single parameter: a name counts before a wildcard, that of one number
    before that of several. Areas first, since a stiffness follows them."""
    ranked, given, driven = [], {}, {}
    for name in values:
        (owner, _, quantity), selection = name.partition("."), select(knee, [name])
        own = [selection.quantity(i) for i in range(len(selection))]
        ranked.append(((owner == "*", any(one != quantity for one in own)), name, selection))
    for rank, name, selection in sorted(ranked, key=lambda one: one[0]):
        for i, parameter in enumerate(selection.names):
            numbers, quantity = selection.numbers(i), selection.quantity(i)
            taken = {number: driven[number] for number in numbers if number in driven}
            for number, (other, *its) in taken.items():
                if its[0] == rank or its[1] != quantity:
                    said = f"{other} and {name} give one number ({numbers[number]})"
                    raise UnknownParameter(f"{said}: choose one")
            if not taken:
                given[parameter] = values[name]
                driven |= dict.fromkeys(numbers, (name, rank, quantity))
    return dict(sorted(given.items(), key=lambda one: not one[0].endswith(".area")))


def cut(knee: Knee, names: Sequence[str]) -> Knee:
    """The same knee with some ligaments cut, which neither pull nor tear, and some menisci removed.

    Args:
        knee: any knee.
        names: of ligaments, or of groups of them; of menisci (`Knee.menisci`), whole as
            `medial_meniscus`, or a part of one: `medial_meniscus:inner=0.5` is the inner half of
            its width, `medial_meniscus:posterior=0.4` 40 % of its arc from the posterior horn,
            in all its width, `medial_meniscus:inner=0.5,anterior=0.3` the inner half in 30 % of
            the arc.

    Raises:
        UnknownParameter: naming the nearest ligament, group or meniscus; a knee without menisci;
            a part that is none.

    Example:
        >>> import kneejax as kj
        >>> cut(kj.load_knee("four_ligament"), ["ACL"]).ligaments.stiffness.tolist()[0]
        0.0
        >>> cut(kj.load_knee("average_knee"), ["medial_meniscus"]).menisci
        ('medial_meniscus', 'lateral_meniscus')
    """
    torn = np.isin(np.arange(len(knee.ligaments.names)), fibres_cut(knee, names))
    law = knee.ligaments.stiffness, knee.ligaments.failure_strain
    where = numpy_for(law).where
    ends = jnp.asarray(where(torn, 0.0, law[0])), jnp.asarray(where(torn, np.inf, law[1]))
    knee = eqx.tree_at(lambda k: (k.ligaments.stiffness, k.ligaments.failure_strain), knee, ends)
    return without_menisci(knee, names)


def fibres_cut(knee: Knee, names: Sequence[str]) -> list[int]:
    """Rows of the fibres among what is cut, each once.

    Args:
        knee: any knee.
        names: as `cut` takes them.

    Raises:
        UnknownParameter: a name is neither of a ligament nor of a meniscus.

    Example:
        >>> import kneejax as kj
        >>> fibres_cut(kj.load_knee("average_knee"), ["LCL", "medial_meniscus"])
        [33, 34, 35, 36]
    """
    return sorted({row for x in names if _meniscus(knee, x) is None for row in fibre_rows(knee, x)})


def without_menisci(knee: Knee, names: Sequence[str]) -> Knee:
    """The knee without the menisci, or parts of them, among what is cut.

    Args:
        knee: any knee.
        names: as `cut` takes them.

    Example:
        >>> import kneejax as kj
        >>> knee = without_menisci(kj.load_knee("average_knee"), ["ACL", "lateral_meniscus"])
        >>> float(knee.contacts[3].tibial.outline.min())
        10000.0
    """
    contacts = list(knee.contacts)
    for name in names:
        if (row := _meniscus(knee, name)) is not None:
            contacts[row] = _resected(contacts[row], name)
    if all(one is other for one, other in zip(contacts, knee.contacts, strict=True)):
        return knee
    return dataclasses.replace(knee, contacts=tuple(contacts), foundations=None)


def _meniscus(knee: Knee, name: str) -> int | None:
    """Row of the contact that is a meniscus; None where a ligament is meant."""
    owner = name.partition(":")[0]
    if owner in knee.menisci:
        return knee.contact_names.index(owner)
    if ":" in name or "menisc" in owner.lower():
        if not knee.menisci:
            raise UnknownParameter(f"knee {knee.name!r} has no menisci: {name!r} cannot be removed")
        near = nearest_name(owner, knee.menisci) or " or ".join(knee.menisci)
        end = f"has no meniscus {owner!r}; did you mean {near}?"
        raise UnknownParameter(f"knee {knee.name!r} {end}")
    return None


def _resected(contact: Contact, name: str) -> Contact:
    """A meniscus without what a name says."""
    parts, ring, tibial = _parts(name), contact.ring, contact.tibial
    outline = getattr(tibial, "outline", None)
    if not parts:
        corners = np.full((4, 2) if outline is None else outline.shape, _NOWHERE)
    elif ring is None or outline is None:
        raise UnknownParameter(f"{name}: expected the whole meniscus, since this one has no ring")
    else:
        arc = {end: parts.get(end, 0.0) for end in _PARTS[1:]}
        if not any(arc.values()):
            arc["anterior"] = 1.0
        ring, corners = ring.resected(np.asarray(outline), parts.get("inner", 1.0), **arc)
    tibial = dataclasses.replace(tibial, outline=jnp.asarray(corners))
    return dataclasses.replace(contact, tibial=tibial, ring=ring)


def _parts(name: str) -> dict[str, float]:
    """What a name says of a part: of the width from inside, of the arc from either horn; nothing
    where all is meant."""
    parts = {}
    for word in filter(None, name.partition(":")[2].split(",")):
        part, _, size = word.partition("=")
        try:
            parts[part] = float(size)
        except ValueError:
            parts[part] = np.nan
        if part not in _PARTS or not 0.0 < parts[part] < 1.0:
            near = nearest_name(part, _PARTS) or " or ".join(_PARTS)
            raise UnknownParameter(f"{name}: {word!r}: expected {near}=PART, between 0 and 1")
    if sum(parts.get(end, 0.0) for end in _PARTS[1:]) >= 1.0:
        raise UnknownParameter(f"{name}: expected less than the whole arc, or no part of it")
    return parts
