"""What the study of paper 4 is asked and what it answers: settings, outcomes, scores."""

from __future__ import annotations

import dataclasses

import numpy as np

from kneejax.experiments import BODY_WEIGHT_N, VarusValgus, VarusValgusRamp
from kneejax.parameters import UnsuitableData
from kneejax.reproduction.paper4._fibre_changes import Change


@dataclasses.dataclass(frozen=True)
class OneAtATime:
    """Settings of the study; the defaults are paper 4's.

    Attributes:
        ligaments: names that every knee must have, of ligaments or groups.
        prestretch: added to the reference strain.
        modulus_MPa: added to Young's modulus.
        reference_modulus_MPa: modulus that the knees' own stiffnesses stand for. A line has a
            stiffness and no cross-section, so a change of modulus is taken as a change of stiffness
            in proportion. 345 MPa was measured on fascicles of the ACL, PCL and LCL (Butler, Kay
            and Stouffer 1986); with it, 100 MPa are 29 per cent.
        full_Nm: moment that is aimed at.
        body_weight_N: half of it is the axial load.
        axial_steps: of the ramp.
        moment_steps: likewise.
        least_Nm: a variant that does not get so far is left out where pressures are compared.
    """

    ligaments: tuple[str, ...] = ("ACL", "PCL", "MCL", "LCL")
    prestretch: tuple[float, ...] = (-0.1, -0.075, -0.05, -0.025, 0.025, 0.05, 0.075, 0.1)
    modulus_MPa: tuple[float, ...] = (-100.0, -75.0, -50.0, -25.0, 25.0, 50.0, 75.0, 100.0)
    reference_modulus_MPa: float = 345.0
    full_Nm: float = 40.0
    body_weight_N: float = BODY_WEIGHT_N
    axial_steps: int = 4
    moment_steps: int = 80
    least_Nm: float = 10.0

    def __post_init__(self):
        lowest = -min(self.modulus_MPa, default=0.0)
        if self.reference_modulus_MPa <= lowest:
            raise UnsuitableData(
                f"reference_modulus_MPa is {self.reference_modulus_MPa:g}; expected more than "
                f"{lowest:g}, which a change takes away"
            )
        if not self.full_Nm >= self.least_Nm > 0:
            raise UnsuitableData(
                f"full_Nm is {self.full_Nm:g}; expected at least least_Nm, which is "
                f"{self.least_Nm:g} and has to be above 0"
            )
        for name in ("body_weight_N", "axial_steps", "moment_steps"):
            if not getattr(self, name) > 0:
                raise UnsuitableData(f"{name} is {getattr(self, name):g}; expected more than 0")

    @property
    def steps(self) -> int:
        """Of a ramp."""
        return self.axial_steps + self.moment_steps

    def ramp(self, direction: str) -> VarusValgusRamp:
        """The loads in a direction."""
        return VarusValgusRamp.towards(
            direction, self.full_Nm, self.body_weight_N, self.axial_steps, self.moment_steps
        )


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a change did in one direction; contacts in the order of the knee's.

    Attributes:
        change: of one ligament.
        direction: `varus` or `valgus`.
        moment_reached_Nm: last moment held, positive in varus.
        convergence_percent: difference in the last time held, of paper 4's time.
        rmse_deg: of the varus rotation over the moments that both knees hold; NaN without one.
        compared_at_Nm: moment at which pressures are compared; NaN where they are not.
        peak_MPa: peak pressure of each contact.
        unchanged_peak_MPa: likewise, of the unchanged knee.
        center_mm: its place in the tibia's frame, `(contacts, 3)`.
        unchanged_center_mm: likewise, of the unchanged knee.
        pressure_percent: difference of the peak pressures, mean of the contacts. A contact that
            the unchanged knee does not have counts nowhere.
        displacement_mm: of the places, mean of the contacts that both knees have.
        ending: what ended the ramp, as in `VarusValgus.ending`.
    """

    change: Change
    direction: str
    moment_reached_Nm: float
    convergence_percent: float
    rmse_deg: float
    compared_at_Nm: float
    peak_MPa: np.ndarray
    unchanged_peak_MPa: np.ndarray
    center_mm: np.ndarray
    unchanged_center_mm: np.ndarray
    pressure_percent: float
    displacement_mm: float
    ending: str


@dataclasses.dataclass(frozen=True)
class Influence:
    """How much a parameter matters for an outcome.

    Attributes:
        parameter: e.g. `MCL.prestretch`.
        outcome: a key of `LIMITS`.
        average: direction -> mean over the values.
        scores: direction -> score of that mean.
    """

    parameter: str
    outcome: str
    average: dict[str, float]
    scores: dict[str, float]

    @property
    def score(self) -> float:
        """Mean of the directions' scores; NaN where one is unknown."""
        return float(np.mean(list(self.scores.values())))


@dataclasses.dataclass(frozen=True)
class KneeStudy:
    """One knee's answers.

    Attributes:
        name: of the knee.
        contacts: their names.
        changes: in the order of the variants after the first, which is the unchanged knee.
        runs: direction -> all variants on the ramp.
        tension_N: direction -> ligament -> tension in the unchanged knee at its last step.
        outcomes: one per change and direction.
        influences: one per parameter and outcome.
        doubts: sentences on what limits the answers.
        seconds: spent.
    """

    name: str
    contacts: tuple[str, ...]
    changes: tuple[Change, ...]
    runs: dict[str, VarusValgus]
    tension_N: dict[str, dict[str, float]]
    outcomes: tuple[Outcome, ...]
    influences: tuple[Influence, ...]
    doubts: tuple[str, ...]
    seconds: float

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what is changed, in order."""
        return tuple(dict.fromkeys(change.parameter for change in self.changes))

    def influence(self, parameter: str, outcome: str) -> Influence | None:
        """That of a parameter on an outcome; None if the knee has not got the parameter."""
        for one in self.influences:
            if (one.parameter, one.outcome) == (parameter, outcome):
                return one
        return None


@dataclasses.dataclass(frozen=True)
class KneeComparison:
    """Knees side by side.

    Attributes:
        knees: one per knee.
        settings: of the study.
        versions: package -> version.
    """

    knees: tuple[KneeStudy, ...]
    settings: OneAtATime
    versions: dict[str, str]

    @property
    def parameters(self) -> tuple[str, ...]:
        """Parameters of all knees together, quantity by quantity."""
        every = dict.fromkeys(name for knee in self.knees for name in knee.parameters)
        quantities = list(dict.fromkeys(name.split(".")[1] for name in every))
        return tuple(sorted(every, key=lambda name: quantities.index(name.split(".")[1])))

    @property
    def doubts(self) -> tuple[str, ...]:
        """Those of all knees, with their names."""
        return tuple(f"{knee.name}: {doubt}" for knee in self.knees for doubt in knee.doubts)
