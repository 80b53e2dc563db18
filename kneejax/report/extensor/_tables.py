"""The quadriceps, the tendon and both bones as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from kneejax.experiments import Extensor
from kneejax.geometry import BODIES, COLUMNS, FEMUR, PATELLA
from kneejax.statics import Status

_PATELLA = tuple(one.column for one in BODIES[PATELLA].values())
#: One row a pose.
EXTENSOR_COLUMNS = (
    "flexion_deg", "quadriceps_N", "quadriceps_mm", "tendon_N", "patellofemoral_N",
    "tendon_by_quadriceps", "patellofemoral_by_quadriceps", "extension_Nm", "weight_Nm", "arm_mm",
    "patellofemoral_area_mm2", "patellofemoral_max_pressure_MPa", *COLUMNS[1:], *_PATELLA,
    "converged", "stable", "status",
)  # fmt: skip


def extensor_rows(found: Extensor, status: np.ndarray) -> Iterator[list[Any]]:
    """Rows of `EXTENSOR_COLUMNS`.

    Args:
        found: of any of the experiments.
        status: `Status` values, one a pose.
    """
    motion, pull, length = found.motion, found.quadriceps_N, np.asarray(found.quadriceps_mm)
    contacts = motion.knee.contacts
    here = [k for k, one in enumerate(contacts) if one.bodies == (FEMUR, PATELLA)]
    area = np.asarray(found.mechanics.area)[:, here].sum(axis=1)
    peak = np.asarray(found.mechanics.max_pressure)[:, here].max(axis=1)
    tibia, patella = np.asarray(motion.to_table()), found.patella
    for i, flexion in enumerate(found.flexion_deg):
        tendon, contact = found.tendon_N[i], found.contact_N[i]
        yield [
            round(float(flexion), 9), pull[i], length[i], tendon, contact, tendon / pull[i],
            contact / pull[i], found.extension_Nm[i], found.weight_Nm[i], found.arm_mm[i], area[i],
            peak[i], *tibia[i, 1:], *patella[i], bool(motion.equilibrium.converged[i]),
            bool(motion.stable[i]), Status(int(status[i])).word,
        ]  # fmt: skip


def extensor_lines(found: Extensor, status: np.ndarray) -> list[str]:
    """A table for the terminal: forces, their ratios, the moment arm and the patella."""
    head = ("flexion", "quadriceps", "tendon", "contact", "arm", "patella: flexion", "tilt")
    unit = ("deg", "N", "/ quadriceps", "/ quadriceps", "mm", "deg", "deg")
    width = [7, 10, 12, 12, 6, 16, 7]
    lines = ["  ".join(f"{word:>{w}}" for word, w in zip(row, width, strict=True))
             for row in (head, unit)]  # fmt: skip
    for i, flexion in enumerate(found.flexion_deg):
        pull, patella = found.quadriceps_N[i], found.patella[i]
        values = (
            f"{flexion:g}", f"{pull:.1f}", f"{found.tendon_N[i] / pull:.2f}",
            f"{found.contact_N[i] / pull:.2f}", f"{found.arm_mm[i]:.1f}", f"{patella[0]:.1f}",
            f"{patella[2]:.1f}",
        )  # fmt: skip
        row = "  ".join(f"{value:>{w}}" for value, w in zip(values, width, strict=True))
        doubt = "" if status[i] == Status.BALANCED else f"  {Status(int(status[i])).word}"
        lines.append(row + doubt)
    return lines
