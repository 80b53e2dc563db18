"""Paper 5 computed from its printed means, and from a stand-in for its axis points.

Neither the axis points nor the poses of its ten men were published.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.geometry import Pose
from kneejax.joints import (
    MEASURES,
    Comparison,
    Joint,
    clinical_measures,
    compare_motions,
    condyle_axes,
    hinge,
    is_tested,
    moving_axis,
    poses_from_clinical,
)
from kneejax.mechanics import Knee, condyle_points
from kneejax.papers import paper5_tables as printed

#: Whose condyles and ligaments stand in, and how its ligaments are called.
DONOR, _LCL, _MCL = "lenhart2015_reduced", "LCL", "MCLs"
#: From the epicondyles to the femoral attachments of the LCL and of the superficial MCL: posterior
#: and proximal, mm. LaPrade et al., Am J Sports Med 31 (2003), ten knees; J Bone Joint Surg Am 89
#: (2007), eight; both as their abstracts say. Across they say nothing, and 0 is assumed.
_LCL_FROM_EPICONDYLE, _MCL_FROM_EPICONDYLE = (-3.1, 1.4, 0.0), (-4.8, 3.2, 0.0)
#: Ends of the extension and of the flexion facet, degrees from anterior through distal. `contact`:
#: within 30 degrees of where the tibia touches at 0 and at 87 degrees, as the paper selects them.
#: `arcs`: before and after 25 degrees of flexion. Martelli and Pinskerova, J Bone Joint Surg Br 84
#: (2002), see the tibia leave the front segment at 20 +- 10 degrees (abstract). No verdict changes
#: from 15 to 35 degrees.
FACETS = {"contact": ((60.0, 120.0), (147.0, 207.0)), "arcs": ((60.0, 115.0), (115.0, 207.0))}
#: Sets of axis points that are drawn to see how much depends on them.
DRAWS = 500
#: Standard deviations of a draw, mm: of the epicondyles' midpoint against all centres, and of each
#: centre, in the sagittal plane. And the range of sizes: the ten are men of 1.82 m on average, the
#: donor is smaller.
MIDPOINT_SD_MM, CENTRE_SD_MM, SIZES = 3.0, 3.0, (1.0, 1.15)
#: Calibration poses of the moving axis: the first and the last of the five.
ENDS = [0, -1]
#: Assumed correlations of a subject's measures between flexions, and cohorts drawn for each.
CORRELATIONS, COHORTS = (0.25, 0.5, 0.75), 20


@dataclasses.dataclass(frozen=True)
class Paper5Study:
    """What the claims are judged by.

    Attributes:
        facets: the stand-in for the axis points, see `axis_points`.
        epicondyles: likewise.
        moving_axis: facets -> clinical measures of the moving axis on the printed mean poses, at
            the five flexions, shape `(5, 5)`.
        spread: the same of drawn axis points, shape `(DRAWS, 5, 5)`.
        hinge: of one hinge through the femur's origin, put at the first row of Table 3, whose tilt
            is fitted to its other rows, shape `(5, 5)`.
        hinge_tilt_deg: of its axis in the frontal plane; lateral end up is positive.
        stays_fixed: largest move of the axis points beyond the calibration angles, mm.
        cohorts: assumed correlation -> comparisons of synthetic cohorts of ten; the first of each
            is tested.
        seed: of all that is drawn.
    """

    facets: np.ndarray
    epicondyles: np.ndarray
    moving_axis: dict[str, np.ndarray]
    spread: np.ndarray
    hinge: np.ndarray
    hinge_tilt_deg: float
    stays_fixed: float
    cohorts: dict[float, tuple[Comparison, ...]]
    seed: int


def paper5_study(knee: Knee, seed: int = 5) -> Paper5Study:
    """Compute what paper 5's claims are judged by.

    Args:
        knee: whose condyles stand in for those of the ten men.
        seed: of drawn axis points and synthetic cohorts.

    Returns:
        The `Paper5Study`.

    Raises:
        UnsuitableMotions: pingouin, for the analysis of variance, is not installed.
    """
    is_tested(printed.SUBJECTS)  # or pingouin is missing: better known before the work
    rng = np.random.default_rng(seed)
    stand_ins = {name: axis_points(knee, name)[0] for name in FACETS}
    (facets, epicondyles), mean = axis_points(knee), printed.MEAN[printed.EOS]
    own = {name: measures_of(moving_axis, one[None], ENDS, mean[None, ENDS])[0]
           for name, one in stand_ins.items()}  # fmt: skip
    drawn = np.array([_drawn(stand_ins, rng) for _ in range(DRAWS)])
    spread = measures_of(moving_axis, drawn, ENDS, np.tile(mean[ENDS], (DRAWS, 1, 1)))
    tilt, hinged = _printed_hinge()
    # The axis 17 degrees beyond its two calibration poses.
    ends = printed.REACHED_DEG[ENDS]
    joint = moving_axis(facets, Pose.from_table(poses_from_clinical(ends, mean[ENDS])))
    at, beyond = (
        np.asarray(joint.axis_points(np.deg2rad(ends + off))[0])
        for off in (0.0, np.array([-17.0, 17.0]))
    )
    cohorts = {
        rho: tuple(_cohort(stand_ins, tilt, rho, rng, tested=i == 0) for i in range(COHORTS))
        for rho in CORRELATIONS
    }
    stays_fixed = float(np.abs(beyond - at).max())
    return Paper5Study(facets, epicondyles, own, spread, hinged, tilt, stays_fixed, cohorts, seed)


def axis_points(knee: Knee, facets: str = "contact") -> tuple[np.ndarray, np.ndarray]:
    """Facet centres and epicondyles of a knee, read off its surfaces and ligaments.

    Centres are those of `kneejax.joints.condyle_axes`, from points of the fitted condyles. (The
    first version fitted circles to half of each condyle's width together, which is round across
    too: residuals of 2.4 mm, radii of 9 mm. It was replaced after its numbers had been seen; the
    criteria were not.)

    Args:
        knee: with two condyles, medial then lateral, and the ligaments of `DONOR`.
        facets: a key of `FACETS`.

    Returns:
        Extension and flexion facet centres, medial and lateral, `(2, 2, 3)`, and the medial and
        lateral epicondyle, `(2, 3)`, mm. The frame is paper 5's: origin midway between the
        epicondyles, Y the long axis, taken to be the femur's, Z lateral in the plane of both.
    """
    extension_deg, flexion_deg = FACETS[facets]
    centres = condyle_axes(*condyle_points(knee), extension_deg, flexion_deg).points
    names = list(knee.ligaments.names)
    attachments = np.asarray(knee.ligaments.femoral_attachment)
    away = {_MCL: _MCL_FROM_EPICONDYLE, _LCL: _LCL_FROM_EPICONDYLE}
    epicondyles = np.array([attachments[names.index(name)] - x for name, x in away.items()])
    origin, across = epicondyles.mean(axis=0), epicondyles[1] - epicondyles[0]
    turn = np.arctan2(across[0], across[2])
    c, s = np.cos(turn), np.sin(turn)
    axes = np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])
    return (centres - origin) @ axes.T, (epicondyles - origin) @ axes.T


def measures_of(
    make: Callable[[jax.Array, Pose], Joint], points: np.ndarray, at: int | list[int],
    measures: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Motion of joints, each put at clinical measures at some of the printed flexions.

    Args:
        make: `moving_axis`, of extension and flexion centres, `(2, 2, 3)`, mm, which is calibrated
            on two poses; or `hinge`, of the medial and lateral epicondyle, `(2, 3)`, on one.
        points: of each joint, `(joints, ...)`.
        at: which flexions.
        measures: there, shape `(joints, 2, 5)` or `(joints, 5)`.

    Returns:
        What the joints say at the five printed flexions, shape `(joints, 5, 5)`.
    """
    poses = poses_from_clinical(printed.REACHED_DEG[at], measures)
    return clinical_measures(_tables(make, jnp.asarray(points), jnp.asarray(poses)))


def _drawn(stand_ins: dict[str, np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Facet centres of somebody like the donor: another size, other centres, other landmarks."""
    own = list(stand_ins.values())[rng.integers(len(stand_ins))]
    sagittal = np.array([1.0, 1.0, 0.0])
    centres = own * rng.uniform(*SIZES)
    centres = centres + MIDPOINT_SD_MM * rng.normal(size=3) * sagittal
    return centres + CENTRE_SD_MM * rng.normal(size=centres.shape) * sagittal


@functools.partial(jax.jit, static_argnums=0)
def _tables(
    make: Callable[[jax.Array, Pose], Joint], points: jax.Array, calibration: jax.Array
) -> jax.Array:
    """Motions at the printed flexions of joints, each made of its points and calibration poses."""

    def motion(own: jax.Array, poses: jax.Array) -> jax.Array:
        joint = make(own, Pose.from_table(poses))
        return joint.pose(jnp.deg2rad(printed.REACHED_DEG)).to_table()

    return jax.vmap(motion)(points, calibration)


def _tilted(tilt_deg: float) -> np.ndarray:
    """Points of an axis through the femur's origin, in the frontal plane."""
    direction = np.array([0.0, np.sin(np.deg2rad(tilt_deg)), np.cos(np.deg2rad(tilt_deg))])
    return 40.0 * np.array([-direction, direction])


def _printed_hinge() -> tuple[float, np.ndarray]:
    """The tilt that comes nearest to Table 3 in units of its standard errors, and its rows."""
    rows = printed.MEAN[printed.HINGE]
    errors = printed.SD[printed.HINGE] / np.sqrt(printed.SUBJECTS)

    def motion(tilt_deg: float) -> np.ndarray:
        return measures_of(hinge, _tilted(tilt_deg)[None], 0, rows[:1])[0]

    def misfit(tilt_deg: float) -> float:
        return float((((motion(tilt_deg) - rows) / errors) ** 2).sum())

    from scipy.optimize import minimize_scalar

    found: Any = minimize_scalar(misfit, bounds=(-20.0, 20.0), method="bounded")
    return float(found.x), motion(float(found.x))


def _cohort(stand_ins: dict[str, np.ndarray], tilt_deg: float, rho: float, rng: np.random.Generator,
            tested: bool) -> Comparison:  # fmt: skip
    """Ten synthetic subjects with the printed means and standard deviations.

    Each has axis points of its own, drawn like `_drawn`, and a hinge with the printed mean and
    spread at 0 degrees, as far from that mean as its measured pose is from its own, and with the
    tilt that Table 3 shows, give or take 2 degrees. (In the first version hinges were put at the
    measured pose, with the stand-in's tilt, which turned them the wrong way; replaced after its
    numbers had been seen.)
    """
    mean, sd, count = printed.MEAN[printed.EOS], printed.SD[printed.EOS], printed.SUBJECTS
    measured = synthetic_measures(rho, count, rng)
    facets = np.array([_drawn(stand_ins, rng) for _ in range(count)])
    tilts = rng.normal(tilt_deg, 2.0, size=count)
    apart = (measured[:, 0] - mean[0]) / sd[0]
    first = printed.MEAN[printed.HINGE][0] + printed.SD[printed.HINGE][0] * apart
    models = {"moving axis": measures_of(moving_axis, facets, ENDS, measured[:, ENDS]),
              "hinge": measures_of(hinge, np.array([*map(_tilted, tilts)]), 0, first)}  # fmt: skip
    return compare_motions(printed.FLEXION_DEG, measured, models, calibrated_at_deg=(0.0, 90.0),
                           anova=tested, alpha=printed.ALPHA)  # fmt: skip


def synthetic_measures(rho: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Measures of synthetic subjects, normal with the printed EOS means and standard deviations.

    Args:
        rho: correlation of a subject's measures at any two flexions.
        count: how many subjects.
        rng: draws them.

    Returns:
        Shape `(count, 5, 5)`: subjects, printed flexions, measures.
    """
    mean, sd = printed.MEAN[printed.EOS], printed.SD[printed.EOS]
    shared = rng.normal(size=(count, 1, len(MEASURES)))
    own = rng.normal(size=(count, *mean.shape))
    return mean + sd * (np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * own)
