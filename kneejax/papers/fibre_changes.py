"""Paper 4's changes of ligaments and meniscal horns, one at a time, and synthetic knees."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.mechanics import Knee
from kneejax.parameters import fibre_rows

#: What is changed of a ligament, with the unit of a change's value.
PRESTRETCH, MODULUS, ATTACHMENT = "prestretch", "youngs_modulus", "attachment"
HORNS = "horn_stiffness"
CHANGED = {PRESTRETCH: "", MODULUS: "MPa", ATTACHMENT: "", HORNS: "N/mm"}
#: What has horns, as the name of a ligament: all menisci of a knee with a ring.
MENISCI = "menisci"
#: Values of an attachment's change: which ends are halved.
HALVES = {1.0: "femoral half", 2.0: "tibial half", 3.0: "both halves"}
#: Standard deviations of synthetic knees: of attachments in each direction, mm; of reference
#: strains; of the logarithms of stiffnesses and of the cartilage's modulus.
ATTACHMENT_MM, STRAIN, LOG_STIFFNESS = 2.0, 0.02, 0.2


def _fibres(knee: Knee) -> tuple[Any, ...]:
    """What a change moves: four arrays of all fibres, and the stiffness of each pair of horns."""
    own = knee.ligaments
    horns = (contact.ring.horn_stiffness for contact in knee.contacts if contact.ring is not None)
    return (own.stiffness, own.slack_length, own.femoral_attachment, own.tibial_attachment, *horns)


def with_fibres(knee: Knee, fibres: tuple[Any, ...]) -> Knee:
    """The knee with other numbers of its fibres and horns, as `changes_of` has them."""
    return eqx.tree_at(_fibres, knee, fibres)


@dataclasses.dataclass(frozen=True)
class Change:
    """A ligament, or the menisci, that differ from the unchanged knee's.

    Attributes:
        ligament: its name, or that of a group of fibres; `menisci`.
        quantity: `prestretch`, `youngs_modulus` or `attachment`; of menisci `horn_stiffness`.
        value: how much is added: of stretch; MPa; N/mm a horn; or a key of `HALVES`.
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


def changes_of(knee: Knee, ligaments: tuple[str, ...], prestretch: tuple[float, ...],
               modulus_MPa: tuple[float, ...], reference_modulus_MPa: float,
               horn_N_per_mm: tuple[float, ...] = (),
               ) -> tuple[tuple[Change, ...], tuple[Array, ...]]:  # fmt: skip
    """Every change of every ligament, and the fibres that result.

    A prestretch adds to the reference strain of all fibres of a ligament. A change of Young's
    modulus scales their stiffnesses by `1 + change / reference_modulus_MPa`. An attachment is
    halved as in paper 4, on the femur to the most proximal half of the fibres' ends, on the tibia
    or fibula to the most distal half: the other fibres end at the nearest of those, as taut at
    the reference pose as before. A single line has no halves. Horns of menisci change together;
    what would leave them no stiffness is left out.

    Args:
        knee: the unchanged knee.
        ligaments: names of ligaments or groups.
        prestretch: values.
        modulus_MPa: values.
        reference_modulus_MPa: the modulus that the knee's stiffnesses stand for.
        horn_N_per_mm: values, for a knee with menisci.

    Returns:
        The changes, and what `with_fibres` takes, with a leading axis: the unchanged knee's first.

    Raises:
        UnknownParameter: the knee has no such ligament.
    """
    own, length = knee.ligaments, np.asarray(knee.reference_length())

    def one(ligament: str) -> Iterator[tuple[Change, Knee]]:
        rows = fibre_rows(knee, ligament)
        for value in prestretch:
            slack = np.array(own.slack_length)
            slack[rows] = length[rows] / (length[rows] / slack[rows] + value)
            yield Change(ligament, PRESTRETCH, value), _with(knee, slack_length=slack)
        for value in modulus_MPa:
            stiffness = np.array(own.stiffness)
            stiffness[rows] *= 1.0 + value / reference_modulus_MPa
            yield Change(ligament, MODULUS, value), _with(knee, stiffness=stiffness)
        for value in HALVES if len(rows) > 1 else ():
            femoral, tibial = np.array(own.femoral_attachment), np.array(own.tibial_attachment)
            if value != 2.0:
                femoral[rows] = _gathered(femoral[rows], femoral[rows][:, 1])
            if value != 1.0:
                tibial[rows] = _gathered(tibial[rows], -tibial[rows][:, 1])
            moved = _with(knee, femoral_attachment=femoral, tibial_attachment=tibial)
            slack = np.asarray(own.slack_length) * np.asarray(moved.reference_length()) / length
            yield Change(ligament, ATTACHMENT, value), _with(moved, slack_length=slack)

    found = [pair for ligament in ligaments for pair in one(ligament)]
    *fibres, horns = *_fibres(knee)[:4], np.array(_fibres(knee)[4:], float)
    for value in horn_N_per_mm if len(horns) else ():
        if (horns + value > 0.0).all():
            softer = with_fibres(knee, (*fibres, *(horns + value)))
            found.append((Change(MENISCI, HORNS, value), softer))
    variants = (_fibres(variant) for variant in (knee, *(variant for _, variant in found)))
    return tuple(change for change, _ in found), jax.tree.map(lambda *x: jnp.stack(x), *variants)


def _with(knee: Knee, **fibres: Any) -> Knee:
    arrays = {name: jnp.asarray(x) for name, x in fibres.items()}
    return dataclasses.replace(knee, ligaments=dataclasses.replace(knee.ligaments, **arrays))


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


def synthetic_knee(knee: Knee, seed: int) -> Knee:
    """A knee that differs from another as persons might, by a seeded draw.

    Attachments move by 2 mm in each direction, reference strains by 0.02, stiffnesses and
    cartilage moduli by factors around 1 (standard deviations; independent for every fibre). The
    ends of fibres around obstacles stay, so that none begins inside one. The surfaces
    are the same. Such a knee is synthetic: it is neither measured, calibrated nor validated.

    Args:
        knee: around which is drawn.
        seed: the same seed gives the same knee.

    Returns:
        A knee of the same structure and name.
    """
    draw, own, count = np.random.default_rng(seed), knee.ligaments, len(knee.ligaments.names)
    strain = np.asarray(knee.reference_strain()) + STRAIN * draw.standard_normal(count)
    bent = [row for course in own.courses for row in course.rows]
    straight = ~np.isin(np.arange(count), bent)[:, None]
    femoral, tibial = (
        ends + ATTACHMENT_MM * straight * draw.standard_normal((count, 3))
        for ends in map(np.asarray, (own.femoral_attachment, own.tibial_attachment))
    )
    stiffness = np.asarray(own.stiffness) * np.exp(LOG_STIFFNESS * draw.standard_normal(count))
    knee = _with(knee, stiffness=stiffness, femoral_attachment=femoral, tibial_attachment=tibial)
    knee = _with(knee, slack_length=knee.reference_length() / (1.0 + strain))
    softer = np.exp(LOG_STIFFNESS * draw.standard_normal())
    contacts = (dataclasses.replace(x, youngs_modulus=x.youngs_modulus * softer)
                for x in knee.contacts)  # fmt: skip
    return dataclasses.replace(knee, contacts=tuple(contacts))
