"""Fibres that no knee has: numbers out of range, lengths, ends inside what they go around."""

__all__ = ["RANGES", "Implausible", "Range", "at_reference", "check_fibres", "range_of_parameter"]

from functools import partial

import equinox as eqx
import jax
import numpy as np
from jax import Array

from kneejax.geometry import State
from kneejax.mechanics.ligaments import Ligaments
from kneejax.quantities import QUANTITIES
from kneejax.quantities import RANGES as RANGES
from kneejax.quantities import Range as Range
from kneejax.quantities import range_of_parameter as range_of_parameter


class Implausible(ValueError):
    """A number that no knee has.

    Attributes:
        fibre: whose.
        quantity: which: a quantity of a parameter, `length`, or `wrap` for an end inside what the
            fibre goes around.
        value: in words.
        expected: in words.

    Example:
        >>> wrong = Implausible("ACL", "length", "900 mm", "between 1 and 300 mm")
        >>> wrong.fibre, wrong.quantity
        ('ACL', 'length')
    """

    def __init__(self, fibre: str, quantity: str, value: str, expected: str):
        super().__init__(f"{fibre}.{quantity}: {value}: expected {expected}")
        self.fibre, self.quantity, self.value, self.expected = fibre, quantity, value, expected


@partial(jax.jit, static_argnums=2)
def at_reference(ligaments: Ligaments, state: State, around: bool = True) -> tuple[Array, Array]:
    """Whether ends lie inside obstacles, and lengths, straight where no detour is asked for.

    Compiled: one by one the operations, each a program, would take 0.6 s and 40 MB.
    """
    inside = ligaments.ends_inside(state)
    if not around:
        ligaments = eqx.tree_at(lambda x: x.courses, ligaments, ())
    return inside, ligaments.length(state)


def check_fibres(ligaments: Ligaments, inside: Array, lengths: Array) -> None:
    """Refuse a knee whose fibres have numbers that none has.

    Args:
        ligaments: all fibres.
        inside: of each, whether an end lies inside what it goes around, from `at_reference`.
        lengths: at the reference pose, mm, likewise.

    Raises:
        Implausible: the first number that is out of its range.

    Example:
        >>> import jax.numpy as jnp
        >>> from kneejax.files import load_knee
        >>> ligaments = load_knee("four_ligament").ligaments
        >>> check_fibres(ligaments, jnp.zeros(4, bool), jnp.full(4, 35.0))
    """
    names = ligaments.names
    for row in np.flatnonzero(np.asarray(inside)):
        raise Implausible(
            names[row], "wrap", "an end lies inside what the fibre goes around",
            "attachments and via points outside it at the reference pose",
        )  # fmt: skip
    points = np.stack([ligaments.femoral_attachment, ligaments.tibial_attachment])
    _check_numbers(names, "attachment", np.abs(points).max(axis=(0, 2), initial=0.0),
                   RANGES["point_mm"])  # fmt: skip
    _check_lengths(names, np.asarray(lengths), points)
    for one in QUANTITIES.values():
        own = {"ligament", "band"} & {*one.owners}
        if own and hasattr(ligaments, one.name) and not one.bone:
            values = np.asarray(getattr(ligaments, one.name))
            _check_numbers(names, one.name, values, one.allowed)


def _check_numbers(
    names: tuple[str, ...], quantity: str, values: np.ndarray, allowed: Range
) -> None:
    for name, value in zip(names, values.tolist(), strict=True):
        if not allowed.holds(value):
            raise Implausible(name, quantity, f"{value:g}", allowed.expected(value))


def _check_lengths(names: tuple[str, ...], lengths: np.ndarray, points: np.ndarray) -> None:
    allowed, largest = RANGES["length_mm"], np.abs(points).max(initial=0.0)
    for name, length in zip(names, lengths.tolist(), strict=True):
        if allowed.holds(length):
            continue
        expected = f"{allowed} between the attachments"
        if length < allowed.lower and largest < 0.5:
            expected += "; no coordinate reaches 0.5, so metres are suspected: give millimetres"
        elif length > allowed.upper:
            expected += "; a smaller unit than mm, or attachments in another frame, are suspected"
        raise Implausible(name, "length", f"{length:.4g} mm at the reference pose", expected)
