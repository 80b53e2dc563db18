"""What the claims of paper 1 are judged by, and how their effects are counted."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.geometry import FREE_COORDINATES
from kneejax.inference import Calibration, ParameterMap, Sweep, Sweeps, in_convention

#: The paper's coordinates: position and rotation of the femur in the tibia.
CONVENTION = "femur-in-tibia"
LIGAMENTS = ("ACL", "PCL", "MCL", "LCL")
#: Part of the largest effect that counts as none.
NONE = 0.1


@dataclasses.dataclass(frozen=True)
class Paper1Study:
    """What the claims are judged by.

    Attributes:
        sweeps: of every stiffness and reference strain, from the values of Table 1, in the
            paper's coordinates (`as_paper1_sees`).
        measured: the motion to be reached, `(n, 6)`, likewise.
        weights: of the objective, `(5,)`.
        cruciates: objective over the stiffnesses of ACL and PCL.
        own: ligament -> objective over its stiffness (x) and reference strain (y).
        calibration: by the procedures I, II and III, each gone through once.
    """

    sweeps: Sweeps
    measured: np.ndarray
    weights: np.ndarray
    cruciates: ParameterMap
    own: dict[str, ParameterMap]
    calibration: Calibration


def as_paper1_sees(sweeps: Sweeps) -> Sweeps:
    """The same sweeps in the coordinates of the femur in the tibia (paper 1, Eq 1)."""
    flexion = sweeps.flexion_deg
    seen = [
        dataclasses.replace(one, table=in_convention(one.table, flexion, CONVENTION))
        for one in sweeps.sweeps
    ]
    own = in_convention(sweeps.table, flexion, CONVENTION)
    return dataclasses.replace(sweeps, table=own, sweeps=tuple(seen))


def effect(sweep: Sweep) -> np.ndarray:
    """Range of each coordinate over the sound values of a sweep, `(load_cases, 5)`, degrees, mm."""
    table = np.where(sweep.sound[..., None], sweep.table, np.nan)
    known = np.isfinite(table).any(axis=0)
    low = np.min(np.where(np.isfinite(table), table, np.inf), axis=0)
    high = np.max(np.where(np.isfinite(table), table, -np.inf), axis=0)
    return np.where(known, np.where(known, high, 0.0) - np.where(known, low, 0.0), np.nan)


def effect_of(found: Paper1Study, name: str, coordinate: str) -> np.ndarray:
    """`effect` of one parameter on one coordinate, `(load_cases,)`, degrees or mm."""
    return effect(found.sweeps[name])[:, FREE_COORDINATES.index(coordinate)]


def acting(found: Paper1Study, ligament: str, fine: bool) -> str:
    """At how many flexions a ligament's stiffness matters on this knee; empty if all is fine."""
    if fine:
        return ""
    own = effect_of(found, f"{ligament}.stiffness", "anterior")
    part = float(np.mean(own > NONE * np.nanmax(own)))
    return f"; the {ligament} of this knee, a single line, holds it at {part:.0%} of all flexions"


def which(*parts: tuple[str, bool]) -> str:
    """What holds and what does not; empty if all holds."""
    if all(holds for _, holds in parts):
        return ""
    missing = [name for name, holds in parts if not holds]
    holding = [name for name, holds in parts if holds]
    return f"not: {', '.join(missing)}" + (f"; holds: {', '.join(holding)}" if holding else "")
