"""Paper 5's printed numbers, which stand in paper5.yaml, and what is computed from its means.

Columns are ML, AP, CD (mm), AA and IE (degrees), as `kneejax.joints.MEASURES`. Neither the axis
points nor the poses of its ten men were published: another knee's condyles stand in.
"""

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
from kneejax.papers.claims import claimed

SUBJECTS = 10
ALPHA = 0.01
#: Nominal flexions of the lunge; of the first and the last the text gives the means reached.
FLEXION_DEG = np.array([0.0, 20.0, 45.0, 60.0, 90.0])
REACHED_DEG = np.array([3.48, 20.0, 45.0, 60.0, 86.59])
COMPARED = slice(1, 4)

EOS, MOVING_AXIS, HINGE = "EOS", "moving axis", "hinge"
PAIRS = ((EOS, MOVING_AXIS), (EOS, HINGE), (MOVING_AXIS, HINGE))
NAMES = tuple(one.name for one in MEASURES)
#: The flexions that are compared, in words.
ANGLES = tuple(f"{x:g}" for x in FLEXION_DEG[COMPARED])


def _printed(name: str, *shape: int) -> dict[Any, np.ndarray]:
    """Motion, or pair of motions, -> numbers as they stand in paper5.yaml."""
    pairs = {" - ".join(pair): pair for pair in PAIRS}
    return {
        pairs.get(key, key): np.array(rows.split(), float).reshape(shape)
        for key, rows in claimed(5)["tables"][name].items()
    }


_MOTIONS, _PAIRED = _printed("motions", 5, 5, 2), _printed("differences", 4, 5, 2)
#: Tables 1 to 3: motion -> mean and standard deviation at the five flexions.
MEAN, SD = ({motion: table[..., k] for motion, table in _MOTIONS.items()} for k in (0, 1))
#: Rows "Average (0-90)" and "Average (20-60)": means, then standard deviations, `(2, 2, 5)`.
AVERAGE = _printed("averages", 2, 2, 5)
#: Rows "ROM": means over the subjects.
RANGE = _printed("ranges", 5)
#: Table 4: pair -> mean difference and standard error at 20, 45, 60 degrees and of their average.
DIFFERENCE, STANDARD_ERROR = (
    {pair: table[..., k] for pair, table in _PAIRED.items()} for k in (0, 1)
)
#: Likewise: which are marked as significant, at 20, 45 and 60 degrees.
MARKED = {pair: table.astype(bool) for pair, table in _printed("marked", 3, 5).items()}
#: Table 5.
R2, ADJUSTED_R2 = ({x: two[k] for x, two in _printed("r2", 2, 5).items()} for k in (0, 1))
#: Supplementary table: mean difference, standard error, p, lower and upper bound. Axes: measure;
#: 20, 45, 60 degrees; pair as in `PAIRS`; the five numbers.
POST_HOC = np.array(claimed(5)["tables"]["post_hoc"].split(), float).reshape(5, 3, 3, 5)

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
#: Of all that is drawn.
SEED = 5


@dataclasses.dataclass(frozen=True)
class Paper5Study:
    """What the claims are judged by."""

    facets: np.ndarray  # the stand-in for the axis points, see `axis_points`
    epicondyles: np.ndarray  # likewise
    moving_axis: dict[str, np.ndarray]  # facets -> measures on the printed mean poses, `(5, 5)`
    spread: np.ndarray  # the same of drawn axis points, shape `(DRAWS, 5, 5)`
    #: Of one hinge through the femur's origin, at the first row of Table 3, fitted to the others.
    hinge: np.ndarray
    hinge_tilt_deg: float  # of its axis in the frontal plane; lateral end up is positive
    stays_fixed: float  # largest move of the axis points beyond the calibration angles, mm
    cohorts: dict[float, tuple[Comparison, ...]]  # by assumed correlation; the first is tested


def paper5_study(knee: Knee) -> Paper5Study:
    """Compute what paper 5's claims are judged by, the knee's condyles those of the ten men."""
    is_tested(SUBJECTS)  # or pingouin is missing: better known before the work
    rng = np.random.default_rng(SEED)
    stand_ins = {name: axis_points(knee, name)[0] for name in FACETS}
    (facets, epicondyles), mean = axis_points(knee), MEAN[EOS]
    own = {name: measures_of(moving_axis, one[None], ENDS, mean[None, ENDS])[0]
           for name, one in stand_ins.items()}  # fmt: skip
    drawn = np.array([_drawn(stand_ins, rng) for _ in range(DRAWS)])
    spread = measures_of(moving_axis, drawn, ENDS, np.tile(mean[ENDS], (DRAWS, 1, 1)))
    tilt, hinged = _printed_hinge()
    # The axis 17 degrees beyond its two calibration poses.
    ends = REACHED_DEG[ENDS]
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
    return Paper5Study(facets, epicondyles, own, spread, hinged, tilt, stays_fixed, cohorts)


def axis_points(knee: Knee, facets: str = "contact") -> tuple[np.ndarray, np.ndarray]:
    """Facet centres and epicondyles of a knee, read off its surfaces and ligaments.

    Extension and flexion facet centres, medial and lateral, `(2, 2, 3)`, and the medial and lateral
    epicondyle, `(2, 3)`, mm. The frame is paper 5's: origin midway between the epicondyles, Y the
    long axis, taken to be the femur's, Z lateral in the plane of both.

    Centres are those of `kneejax.joints.condyle_axes`, from points of the fitted condyles. (The
    first version fitted circles to half of each condyle's width together, which is round across
    too: residuals of 2.4 mm, radii of 9 mm. It was replaced after its numbers had been seen; the
    criteria were not.)
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
    """What joints say at the five printed flexions, `(joints, 5, 5)`, each put at measures at some.

    Made by `moving_axis` of extension and flexion centres, `(joints, 2, 2, 3)`, mm, at two
    flexions, or by `hinge` of both epicondyles, `(joints, 2, 3)`, at one.
    """
    poses = poses_from_clinical(REACHED_DEG[at], measures)
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
        return joint.pose(jnp.deg2rad(REACHED_DEG)).to_table()

    return jax.vmap(motion)(points, calibration)


def _tilted(tilt_deg: float) -> np.ndarray:
    """Points of an axis through the femur's origin, in the frontal plane."""
    direction = np.array([0.0, np.sin(np.deg2rad(tilt_deg)), np.cos(np.deg2rad(tilt_deg))])
    return 40.0 * np.array([-direction, direction])


def _printed_hinge() -> tuple[float, np.ndarray]:
    """The tilt that comes nearest to Table 3 in units of its standard errors, and its rows."""
    rows = MEAN[HINGE]
    errors = SD[HINGE] / np.sqrt(SUBJECTS)

    def motion(tilt_deg: float) -> np.ndarray:
        return measures_of(hinge, _tilted(tilt_deg)[None], 0, rows[:1])[0]

    def misfit(tilt_deg: float) -> float:
        return float((((motion(tilt_deg) - rows) / errors) ** 2).sum())

    from scipy.optimize import minimize_scalar

    tilt = float(minimize_scalar(misfit, bounds=(-20.0, 20.0), method="bounded").x)  # pyright: ignore
    return tilt, motion(tilt)


def _cohort(stand_ins: dict[str, np.ndarray], tilt_deg: float, rho: float, rng: np.random.Generator,
            tested: bool) -> Comparison:  # fmt: skip
    """Ten synthetic subjects with the printed means and standard deviations.

    Each has axis points of its own, drawn like `_drawn`, and a hinge with the printed mean and
    spread at 0 degrees, as far from that mean as its measured pose is from its own, and with the
    tilt that Table 3 shows, give or take 2 degrees. (In the first version hinges were put at the
    measured pose, with the stand-in's tilt, which turned them the wrong way; replaced after its
    numbers had been seen.)
    """
    mean, sd, count = MEAN[EOS], SD[EOS], SUBJECTS
    measured = synthetic_measures(rho, count, rng)
    facets = np.array([_drawn(stand_ins, rng) for _ in range(count)])
    tilts = rng.normal(tilt_deg, 2.0, size=count)
    apart = (measured[:, 0] - mean[0]) / sd[0]
    first = MEAN[HINGE][0] + SD[HINGE][0] * apart
    models = {"moving axis": measures_of(moving_axis, facets, ENDS, measured[:, ENDS]),
              "hinge": measures_of(hinge, np.array([*map(_tilted, tilts)]), 0, first)}  # fmt: skip
    return compare_motions(FLEXION_DEG, measured, models, calibrated_at_deg=(0.0, 90.0),
                           anova=tested, alpha=ALPHA)  # fmt: skip


def synthetic_measures(rho: float, count: int, rng: np.random.Generator) -> np.ndarray:
    """Measures of synthetic subjects, `(count, 5, 5)`, normal with the printed EOS means and
    standard deviations; `rho` correlates those of a subject at any two flexions."""
    mean, sd = MEAN[EOS], SD[EOS]
    shared = rng.normal(size=(count, 1, len(MEASURES)))
    own = rng.normal(size=(count, *mean.shape))
    return mean + sd * (np.sqrt(rho) * shared + np.sqrt(1.0 - rho) * own)
