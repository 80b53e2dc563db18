"""Synthetic knees: a knee with its ligaments and cartilage drawn anew around what they are."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np

from kneejax.mechanics import Knee
from kneejax.reproduction.paper4._fibre_changes import Fibres, with_fibres

#: Standard deviations: of attachments in each direction, mm; of reference strains; of the
#: logarithms of stiffnesses and of the cartilage's modulus.
ATTACHMENT_MM, STRAIN, LOG_STIFFNESS = 2.0, 0.02, 0.2


def made_up_knee(knee: Knee, seed: int) -> Knee:
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
    draw, old, count = np.random.default_rng(seed), Fibres.of(knee), len(knee.ligaments.names)
    strain = np.asarray(knee.reference_strain()) + STRAIN * draw.standard_normal(count)
    bent = [row for course in knee.ligaments.courses for row in course.rows]
    straight = ~np.isin(np.arange(count), bent)[:, None]
    femoral, tibial = (
        jnp.asarray(ends + ATTACHMENT_MM * straight * draw.standard_normal((count, 3)))
        for ends in (old.femoral_attachment, old.tibial_attachment)
    )
    stiffness = old.stiffness * np.exp(LOG_STIFFNESS * draw.standard_normal(count))
    moved = Fibres(jnp.asarray(stiffness), jnp.asarray(old.slack_length), femoral, tibial)
    length = with_fibres(knee, moved).reference_length()
    knee = with_fibres(knee, moved._replace(slack_length=length / (1.0 + strain)))
    softer = np.exp(LOG_STIFFNESS * draw.standard_normal())
    contacts = tuple(
        dataclasses.replace(contact, youngs_modulus=contact.youngs_modulus * softer)
        for contact in knee.contacts
    )
    return dataclasses.replace(knee, contacts=contacts)
