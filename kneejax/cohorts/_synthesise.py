"""Made-up cohorts: knees that differ in size, shape and ligaments, with data whose truth is known.

Size: tibial width of 100 men and 100 women is 76.0 +- 3.0 and 67.3 +- 3.2 mm (Anthropometric
measurements of non-arthritic knees in an Egyptian population, J. Orthop. Surg. Res. 16, 2021,
doi 10.1186/s13018-021-02708-8), so 71.6 +- 5.4 mm of both together, or 7.5 %. Everything else
is a convention that stands in `Spread`.
"""

__all__ = ["MadeUpKnee", "Protocol", "Spread", "synthesise"]

import dataclasses
from collections.abc import Iterator
from typing import Any

import numpy as np

from kneejax.experiments import LabTest, MeasuredTest, lab_tests, load_curves, passive_flexion
from kneejax.files import load_knee_file
from kneejax.files.knee.file import build_knee
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import Implausible, Knee
from kneejax.parameters import UnsuitableData

#: Lengths of a knee file that do not grow with a knee: of the cartilage, of the law, of a fit.
_NOT_SIZE = ("layer_thickness_mm", "layer_variation_mm", "onset_width_mm", "fit_rms_mm",
             "fit_max_mm")  # fmt: skip
_ENDS = ("femoral_attachment_mm", "tibial_attachment_mm")
#: Draws without a balance somewhere, of each knee, after which the distributions are at fault.
_MOST_DRAWS = 50


@dataclasses.dataclass(frozen=True)
class Spread:
    """How knees of a made-up cohort differ, and how well they are measured.

    Attributes:
        size: standard deviation of the size of everything, as a part; normal, cut at two of them.
        attachment_mm: of each coordinate of each attachment beside that; normal, cut likewise.
        stiffness: of the logarithm of a ligament's stiffness; its median is the bundled knee's.
        reference_strain: of a reference strain; normal about the bundled knee's.
        noise_mm: of measured positions.
        noise_deg: of measured rotations.

    Example:
        >>> Spread(stiffness=0.1).stiffness
        0.1
    """

    size: float = 0.075
    attachment_mm: float = 1.0
    stiffness: float = 0.2
    reference_strain: float = 0.02
    noise_mm: float = 0.2
    noise_deg: float = 0.2


@dataclasses.dataclass(frozen=True)
class Protocol:
    """What is measured of each knee of a made-up cohort.

    Attributes:
        passive_deg: flexions of the passive motion.
        flexion_deg: at which drawer, torsion and varus-valgus are made.
        steps: loads of each curve, from full one way to full the other.
        force_N: of a drawer; this and the next are small enough that contact stays on the fitted
            surfaces.
        torque_Nm: of a torsion.
        varus_Nm: of a varus-valgus test.
    """

    passive_deg: tuple[float, ...] = tuple(np.arange(0.0, 91.0, 15.0).tolist())
    flexion_deg: tuple[float, ...] = (0.0, 30.0, 60.0, 90.0)
    steps: int = 11
    force_N: float = 60.0
    torque_Nm: float = 2.0
    varus_Nm: float = 5.0

    def tests(self) -> list[LabTest]:
        """The tests under load."""
        path = tuple(np.linspace(-1.0, 1.0, self.steps).round(9).tolist())
        tests = [*lab_tests("drawer", self.flexion_deg, force_N=self.force_N),
                 *lab_tests("torsion", self.flexion_deg, moment_Nm=self.torque_Nm),
                 *lab_tests("varus-valgus", self.flexion_deg, moment_Nm=self.varus_Nm)]
        return [dataclasses.replace(test, path=path) for test in tests]


@dataclasses.dataclass(frozen=True, eq=False)
class MadeUpKnee:
    """A knee whose truth is known.

    Attributes:
        name: `K001`, ...
        document: its knee file: own size and shape, ligaments of the bundled knee.
        passive: poses with noise, `(n, 6)`, degrees and mm.
        tests: under load, with noise.
        truth: parameter -> value that made the data.
        size: of everything, against the bundled knee.
        redrawn: how many draws before it had no balance at some place.
    """

    name: str
    document: dict[str, Any]
    passive: np.ndarray
    tests: tuple[MeasuredTest, ...]
    truth: dict[str, float]
    size: float
    redrawn: int


def synthesise(count: int, seed: int = 0, knee: str = "four_ligament", spread: Spread | None = None,
               protocol: Protocol | None = None) -> Iterator[MadeUpKnee]:  # fmt: skip
    """Make up a cohort, knee by knee.

    A knee depends on the seed and on its number alone: the first ten of a hundred are those of
    ten. A draw that has no balance somewhere in the protocol is drawn again.

    Args:
        count: of knees.
        seed: of all draws.
        knee: bundled knee or knee file that is varied.
        spread: how knees differ, and the noise.
        protocol: what is measured.

    Raises:
        UnsuitableData: knees of these distributions do not balance.
    """
    spread, protocol = spread or Spread(), protocol or Protocol()
    base = load_knee_file(knee)
    digits = max(3, len(str(count)))
    for number in range(1, count + 1):
        draws = np.random.default_rng([seed, number])
        name = f"K{number:0{digits}}"
        for redrawn in range(_MOST_DRAWS):
            made = _drawn(name, base.document, base.knee, spread, protocol, draws)
            if made is not None:
                yield dataclasses.replace(made, redrawn=redrawn)
                break
        else:
            raise UnsuitableData(f"{name}: {_MOST_DRAWS} draws in a row have no balance at some "
                                 "flexion or load: expected narrower distributions")


def _drawn(
    name: str, document: dict[str, Any], base: Knee, spread: Spread, protocol: Protocol, draws
) -> MadeUpKnee | None:
    """A knee and its data; None where there is no such knee, or it does not balance."""
    size = 1.0 + spread.size * _cut_normal(draws, ())
    own = _scaled(document, float(size))
    for ligament in own["ligaments"].values():
        for end in _ENDS:
            moved = np.array(ligament[end]) + spread.attachment_mm * _cut_normal(draws, (3,))
            ligament[end] = moved.round(4).tolist()
    own["description"] = (f"Made-up knee {name}: {document['name']}, {size:.4f} times as large, "
                          "attachments moved")
    names, count = base.ligaments.names, len(base.ligaments.names)
    stiffness = np.exp(spread.stiffness * draws.standard_normal(count)) * base.ligaments.stiffness
    strain = base.reference_strain() + spread.reference_strain * draws.standard_normal(count)
    truth = {f"{one}.{quantity}": float(x)
             for quantity, values in (("stiffness", stiffness), ("reference_strain", strain))
             for one, x in zip(names, values, strict=True)}  # fmt: skip
    try:
        true = build_knee(own, name).knee.replace(truth)
    except Implausible:  # a strain or a length that no knee has
        return None
    passive = np.array(passive_flexion(true, list(protocol.passive_deg)).to_table())
    tests = [MeasuredTest.of(one) for one in load_curves(true, protocol.tests())]
    known = [x.observed[:, np.isin(FREE_COORDINATES, x.coordinates)] for x in tests]
    if not all(np.isfinite(one).all() for one in (passive, *known)):
        return None
    sd = np.array([spread.noise_deg] * 2 + [spread.noise_mm] * 3)
    passive[:, 1:] += sd * draws.standard_normal((len(passive), 5))
    stated = {"sd_mm": spread.noise_mm, "sd_deg": spread.noise_deg}
    for k, test in enumerate(tests):
        seen = test.observed + sd * draws.standard_normal(test.observed.shape)
        tests[k] = dataclasses.replace(test, observed=seen, **stated)
    return MadeUpKnee(name, own, passive, tuple(tests), truth, float(size), 0)


def _cut_normal(draws, shape: tuple[int, ...]) -> np.ndarray:
    """Standard normal numbers, none beyond two standard deviations."""
    x = draws.standard_normal(shape)
    while (far := np.abs(x) > 2.0).any():
        x = np.where(far, draws.standard_normal(shape), x)
    return x


def _scaled(value: Any, size: float, length: bool = False) -> Any:
    """Every length in a document times a size; all but those that do not grow with a knee."""
    if isinstance(value, dict):
        return {name: one if name == "source" else
                _scaled(one, size, str(name).endswith("_mm") and name not in _NOT_SIZE)
                for name, one in value.items() if name != "adaptations"}  # fmt: skip
    if isinstance(value, list):
        return [_scaled(one, size, length) for one in value]
    return round(value * size, 6) if length and isinstance(value, int | float) else value
