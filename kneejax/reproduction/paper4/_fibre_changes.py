"""One ligament changed at a time: prestretch, Young's modulus and attachment, as in paper 4."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee
from kneejax.parameters import fibre_rows

#: What is changed of a ligament, with the unit of a change's value.
PRESTRETCH, MODULUS, ATTACHMENT = "prestretch", "youngs_modulus", "attachment"
CHANGED = {PRESTRETCH: "", MODULUS: "MPa", ATTACHMENT: ""}
#: Values of an attachment's change: which ends are halved.
HALVES = {1.0: "femoral half", 2.0: "tibial half", 3.0: "both halves"}


class Fibres(NamedTuple):
    """What a change moves: numbers of every fibre, in the arrays of `kneejax.mechanics.Ligaments`.

    Attributes:
        stiffness: N per unit strain.
        slack_length: mm.
        femoral_attachment: mm.
        tibial_attachment: mm.
    """

    stiffness: np.ndarray
    slack_length: np.ndarray
    femoral_attachment: np.ndarray
    tibial_attachment: np.ndarray

    @classmethod
    def of(cls, knee: Knee) -> Fibres:
        """The fibres of a knee."""
        return cls(*(np.array(getattr(knee.ligaments, name)) for name in cls._fields))


def with_fibres(knee: Knee, fibres: Fibres) -> Knee:
    """The knee with other numbers of its fibres."""
    return eqx.tree_at(
        lambda k: tuple(getattr(k.ligaments, name) for name in Fibres._fields), knee, tuple(fibres)
    )


@dataclasses.dataclass(frozen=True)
class Change:
    """A ligament that differs from the unchanged knee's.

    Attributes:
        ligament: its name, or that of a group of fibres.
        quantity: `prestretch`, `youngs_modulus` or `attachment`.
        value: how much is added: of stretch; MPa; or a key of `HALVES`.
    """

    ligament: str
    quantity: str
    value: float

    @property
    def parameter(self) -> str:
        """Name of what is changed, e.g. `MCL.prestretch`."""
        return f"{self.ligament}.{self.quantity}"

    @property
    def label(self) -> str:
        """The value in words or with its unit.

        Example:
            >>> Change("MCL", "youngs_modulus", -25.0).label
            '-25 MPa'
        """
        if self.quantity == ATTACHMENT:
            return HALVES[self.value]
        return f"{self.value:+g} {CHANGED[self.quantity]}".strip()


def changes_of(
    knee: Knee,
    ligaments: tuple[str, ...],
    prestretch: tuple[float, ...],
    modulus_MPa: tuple[float, ...],
    reference_modulus_MPa: float,
) -> tuple[tuple[Change, ...], Fibres]:
    """Every change of every ligament, and the fibres that result.

    A prestretch adds to the reference strain of all fibres of a ligament. A change of Young's
    modulus scales their stiffnesses by `1 + change / reference_modulus_MPa`. An attachment is
    halved as in paper 4, on the femur to the most proximal half of the fibres' ends, on the tibia
    or fibula to the most distal half: the other fibres end at the nearest of those, as taut at
    the reference pose as before. A single line has no halves.

    Args:
        knee: the unchanged knee.
        ligaments: names of ligaments or groups.
        prestretch: values.
        modulus_MPa: values.
        reference_modulus_MPa: the modulus that the knee's stiffnesses stand for.

    Returns:
        The changes, and fibres whose arrays have a leading axis: the unchanged knee's first.

    Raises:
        UnknownParameter: the knee has no such ligament.
    """
    same, length = Fibres.of(knee), _lengths(knee)

    def one(ligament: str) -> Iterator[tuple[Change, Fibres]]:
        rows = fibre_rows(knee, ligament)
        for value in prestretch:
            slack = same.slack_length.copy()
            slack[rows] = length[rows] / (length[rows] / slack[rows] + value)
            yield Change(ligament, PRESTRETCH, value), same._replace(slack_length=slack)
        for value in modulus_MPa:
            stiffness = same.stiffness.copy()
            stiffness[rows] *= 1.0 + value / reference_modulus_MPa
            yield Change(ligament, MODULUS, value), same._replace(stiffness=stiffness)
        if len(rows) > 1:
            for value in HALVES:
                halved = _halved(knee, same, length, rows, value)
                yield Change(ligament, ATTACHMENT, value), halved

    found = [pair for ligament in ligaments for pair in one(ligament)]
    fibres = jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), same, *(f for _, f in found))
    return tuple(change for change, _ in found), fibres


def _lengths(knee: Knee) -> np.ndarray:
    return np.asarray(knee.reference_length())


def _halved(knee: Knee, same: Fibres, length: np.ndarray, rows: list[int], value: float) -> Fibres:
    femoral, tibial = same.femoral_attachment.copy(), same.tibial_attachment.copy()
    if value != 2.0:
        femoral[rows] = _gathered(femoral[rows], femoral[rows][:, 1])
    if value != 1.0:
        tibial[rows] = _gathered(tibial[rows], -tibial[rows][:, 1])
    moved = same._replace(femoral_attachment=femoral, tibial_attachment=tibial)
    now = _lengths(with_fibres(knee, Fibres(*map(jnp.asarray, moved))))
    return moved._replace(slack_length=same.slack_length * now / length)


def _gathered(ends: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Ends `(n, 3)`, those of the lower half moved to the nearest of the higher half.

    Example:
        >>> ends = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]])
        >>> _gathered(ends, ends[:, 0])[:, 0].tolist()
        [2.0, 2.0, 2.0, 3.0]
    """
    order = np.argsort(-height, kind="stable")
    kept = ends[order[: -(-len(ends) // 2)]]
    away = np.linalg.norm(ends[:, None] - kept[None], axis=-1)
    # Those that are kept are nearest to themselves.
    return kept[np.argmin(away, axis=1)]
