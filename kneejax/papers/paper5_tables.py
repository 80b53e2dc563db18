"""Paper 5's printed numbers, Tables 1 to 5 and the supplementary table, against each other.

Columns are ML, AP, CD (mm), AA and IE (degrees), as `kneejax.joints.MEASURES`. Of individual
subjects and of axis points nothing is printed.
"""

from __future__ import annotations

import numpy as np

from kneejax.joints import MEASURES
from kneejax.papers.claims import Finding


def _numbers(rows: str, *shape: int) -> np.ndarray:
    """Numbers as they are printed."""
    return np.array(rows.split(), float).reshape(shape)


SUBJECTS = 10
ALPHA = 0.01
#: Nominal flexions of the lunge; of the first and the last the text gives the means reached.
FLEXION_DEG = np.array([0.0, 20.0, 45.0, 60.0, 90.0])
REACHED_DEG = np.array([3.48, 20.0, 45.0, 60.0, 86.59])
COMPARED = slice(1, 4)

EOS, MOVING_AXIS, HINGE = "EOS", "moving axis", "hinge"
NAMES = tuple(one.name for one in MEASURES)
#: The flexions that are compared, in words.
ANGLES = tuple(f"{x:g}" for x in FLEXION_DEG[COMPARED])
#: Half a unit of the last printed digit.
_HALF = 0.005

#: Tables 1 to 3: motion -> mean and standard deviation over the subjects at the five flexions; the
#: hinge's CD stands in its caption.
_MOTIONS = {
    EOS: _numbers("""
          4.80 1.87   -3.39 3.42   34.63 3.48    0.05 2.68    5.06 7.59
          2.88 1.35    0.61 2.70   35.62 4.13   -1.14 3.22    8.26 6.64
          2.68 1.60    4.81 3.89   35.49 3.26   -2.30 2.50    9.61 4.88
          2.90 1.19    6.88 5.06   35.01 3.51   -2.59 2.81   10.16 4.08
          2.58 2.10   10.58 4.41   33.48 3.32   -2.62 2.49   11.29 5.86""", 5, 5, 2),
    MOVING_AXIS: _numbers("""
          4.80 1.87   -3.39 3.42   34.64 3.48    0.05 2.68    5.06 7.59
          5.30 1.35   -5.58 3.52   34.63 3.30   -1.89 2.71    6.32 5.33
          4.99 1.42   -2.98 4.16   35.60 3.52   -2.96 2.29    7.66 4.27
          4.11 1.70    1.35 5.63   35.75 3.44   -2.94 2.25    8.36 4.12
          2.58 2.10   10.57 4.41   33.48 3.32   -2.62 2.49   11.29 5.86""", 5, 5, 2),
    HINGE: _numbers("""
          4.60 1.66   -5.91 1.86   34.72 3.54   -0.26 2.17   -0.91 5.84
          4.08 1.59   -5.96 1.86   34.72 3.54    0.53 1.93   -1.66 5.94
          3.67 1.71   -6.00 1.85   34.72 3.54    1.15 2.11   -2.24 6.08
          3.23 1.88   -6.05 1.83   34.72 3.54    1.81 2.35   -2.87 6.38
          2.75 1.95   -6.10 1.83   34.72 3.54    2.52 2.55   -3.58 6.72""", 5, 5, 2),
}
MEAN = {motion: table[..., 0] for motion, table in _MOTIONS.items()}
SD = {motion: table[..., 1] for motion, table in _MOTIONS.items()}
#: Rows "Average (0-90)" and "Average (20-60)": means, then standard deviations, `(2, 2, 5)`.
AVERAGE = {
    EOS: _numbers("""
         3.17  3.90 34.84 -1.72  8.87    2.82  4.10 35.37 -2.01  9.34
         1.62  3.90  3.54  2.74  5.81    1.38  3.88  3.63  2.84  5.20""", 2, 2, 5),
    MOVING_AXIS: _numbers("""
         4.35 -0.00 34.82 -2.07  7.74    4.80 -2.40 35.33 -2.60  7.45
         1.69  4.23  3.41  2.48  5.43    1.49  4.44  3.42  2.42  4.57""", 2, 2, 5),
    HINGE: _numbers("""
         3.67 -6.00 34.72  1.15 -2.25    3.66 -6.00 34.72  1.16 -2.25
         1.76  1.84  3.54  2.22  6.19    1.73  1.84  3.54  2.13  6.13""", 2, 2, 5),
}
#: Rows "ROM": means over the subjects.
RANGE = {
    EOS: np.array([3.25, 14.09, 3.14, 3.92, 11.84]),
    MOVING_AXIS: np.array([3.37, 16.55, 3.48, 3.47, 11.23]),
    HINGE: np.array([1.98, 0.20, 0.0, 2.91, 2.85]),
}
PAIRS = ((EOS, MOVING_AXIS), (EOS, HINGE), (MOVING_AXIS, HINGE))
#: Table 4: pair -> mean difference and standard error at 20, 45, 60 degrees and of their average.
_PAIRED = {
    PAIRS[0]: _numbers("""
         -2.43 0.35    6.19 0.73    0.96 0.32    0.75 0.40    1.94 0.88
         -2.31 0.44    7.79 1.02   -0.11 0.26    0.66 0.48    1.95 1.10
         -1.21 0.43    5.53 0.86   -0.74 0.20    0.35 0.41    1.80 0.97
         -1.98 0.37    6.50 0.82    0.05 0.20    0.59 0.36    1.90 0.79""", 4, 5, 2),
    PAIRS[1]: _numbers("""
         -1.20 0.35    6.57 0.51    0.90 0.60   -1.66 0.84    9.92 1.40
         -0.99 0.61   10.82 1.09    0.78 0.67   -3.46 0.93   11.84 1.59
         -0.32 0.47   12.93 1.36    0.29 0.68   -4.40 0.97   13.03 2.15
         -0.84 0.45   10.11 0.88    0.66 0.62   -3.17 0.86   11.60 1.51""", 4, 5, 2),
    PAIRS[2]: _numbers("""
          1.23 0.37    0.38 0.83   -0.08 0.63   -2.41 0.72    7.98 1.14
          1.32 0.50    3.03 1.13    0.88 0.84   -4.11 0.87    9.90 1.09
          0.88 0.57    7.40 1.59    1.03 0.78   -4.75 0.93   11.23 1.58
          1.14 0.47    3.60 1.06    0.61 0.74   -3.76 0.82    9.70 1.10""", 4, 5, 2),
}
DIFFERENCE = {pair: table[..., 0] for pair, table in _PAIRED.items()}
STANDARD_ERROR = {pair: table[..., 1] for pair, table in _PAIRED.items()}
#: Likewise: which are marked as significant, at 20, 45 and 60 degrees.
MARKED = {
    PAIRS[0]: np.array([[1, 1, 0, 0, 0], [1, 1, 0, 0, 0], [0, 1, 0, 0, 0]], bool),
    PAIRS[1]: np.array([[0, 1, 0, 0, 1], [0, 1, 0, 0, 1], [0, 1, 0, 1, 1]], bool),
    PAIRS[2]: np.array([[0, 0, 0, 0, 1], [0, 0, 0, 1, 1], [0, 1, 0, 1, 1]], bool),
}
#: Table 5.
R2 = {
    MOVING_AXIS: np.array([0.31, 0.71, 0.91, 0.79, 0.67]),
    HINGE: np.array([0.26, 0.21, 0.70, 0.08, 0.27]),
}
ADJUSTED_R2 = {
    MOVING_AXIS: np.array([0.29, 0.70, 0.90, 0.78, 0.65]),
    HINGE: np.array([0.23, 0.18, 0.68, 0.05, 0.25]),
}
#: Supplementary table: mean difference, standard error, p, lower and upper bound. Axes: measure;
#: 20, 45, 60 degrees; pair as in `PAIRS`; the five numbers. Nine rows a measure.
POST_HOC = _numbers("""
    -2.425  0.352  0.000 -3.817 -1.034
    -1.201  0.354  0.024 -2.600  0.199
     1.225  0.369  0.027 -0.236  2.686
    -2.311  0.438  0.002 -4.044 -0.578
    -0.991  0.610  0.416 -3.404  1.421
     1.320  0.497  0.079 -0.647  3.286
    -1.206  0.429  0.061 -2.900  0.489
    -0.324  0.472  1.000 -2.190  1.541
     0.881  0.570  0.470 -1.373  3.136
     6.189  0.729  0.000  3.308  9.071
      6.57  0.508  0.000  4.560  8.580
     0.381  0.831  1.000 -2.906  3.668
     7.792  1.016  0.000  3.775 11.809
    10.817  1.085  0.000  6.525 15.108
     3.025  1.127  0.075 -1.433  7.482
      5.53  0.855  0.000  2.148  8.912
     12.93  1.362  0.000  7.545 18.314
       7.4  1.588  0.004  1.122 13.677
     0.985  0.317  0.038 -0.268  2.238
     0.903  0.604  0.507 -1.485  3.292
    -0.081  0.625  1.000 -2.552  2.389
    -0.105  0.259  1.000 -1.130  0.920
     0.778  0.672  0.831 -1.879  3.434
     0.883  0.843  0.967 -2.450  4.216
    -0.738  0.203  0.016 -1.539  0.064
     0.293  0.678  1.000 -2.389  2.975
     1.031  0.777  0.652 -2.041  4.103
     0.750  0.396  0.273 -0.817  2.317
    -1.664  0.841  0.238 -4.991  1.663
    -2.414  0.719  0.025 -5.256  0.428
     0.656  0.475  0.601 -1.222  2.534
    -3.455  0.925  0.014 -7.112  0.201
    -4.111  0.870  0.003 -7.550 -0.673
     0.349  0.406  1.000 -1.256  1.954
      -4.4  0.968  0.004 -8.227 -0.573
    -4.749  0.934  0.002 -8.441 -1.056
     1.939  0.879  0.164 -1.536  5.415
     9.916  1.403  0.000  4.368 15.463
     7.976  1.137  0.000  3.480 12.472
     1.945  1.097  0.330 -2.392  6.283
    11.841  1.590  0.000  5.554 18.129
     9.896  1.086  0.000  5.603 14.189
     1.801  0.971  0.290 -2.038  5.639
    13.029  2.154  0.001  4.511 21.546
    11.228  1.576  0.000  4.998 17.458""", 5, 3, 3, 5)


def table_findings() -> dict[str, Finding]:
    """Claims 5.1 to 5.11: Tables 1 to 5 and the supplementary table against each other."""
    return _averages() | _statistics() | _models()


def measures_row(values: np.ndarray) -> str:
    """Five numbers with the names of their clinical measures, for a row of the report."""
    return ", ".join(f"{name} {value:.2f}" for name, value in zip(NAMES, values, strict=True))


def _averages() -> dict[str, Finding]:
    """Claims 5.1 to 5.3: averages and differences are those of their rows."""
    apart = {}
    for motion, average in AVERAGE.items():
        for kind, table in enumerate((MEAN[motion], SD[motion])):
            for row, span in enumerate((slice(None), COMPARED)):
                off = np.abs(table[span].mean(axis=0) - average[kind, row])
                where = (
                    f"{motion}, {('mean', 'SD')[kind]} of {NAMES[off.argmax()]}, "
                    f"{('0 to 90', '20 to 60')[row]} degrees"
                )
                apart[where] = float(off.max())
    worst = max(apart, key=apart.__getitem__)
    rows = {
        pair: MEAN[pair[0]][COMPARED] - MEAN[pair[1]][COMPARED] - table[:3]
        for pair, table in DIFFERENCE.items()
    }
    means = {pair: (table[:3].mean(axis=0) - table[3])[None] for pair, table in DIFFERENCE.items()}
    averaged = _off(means, 2.0 * _HALF, "5.2")
    reason = (averaged.reason or "").replace(f" at {ANGLES[0]} degrees", "")
    return {
        "5.1": Finding(
            apart[worst] <= 2.0 * _HALF + 1e-9, f"largest difference {apart[worst]:.3f} ({worst})"
        ),
        "5.2": _off(rows, 3.0 * _HALF, "the supplementary table"),
        "5.3": averaged._replace(reason=reason),
    }


def _off(off: dict[tuple[str, str], np.ndarray], limit: float, other: str) -> Finding:
    """What differs by more than rounding can do."""
    count = sum(x.size for x in off.values())
    beyond = [
        f"{pair[0]} - {pair[1]}, {NAMES[j]} at {ANGLES[i]} degrees by {abs(x[i, j]):.3f}"
        for pair, x in off.items()
        for i, j in np.argwhere(np.abs(x) > limit + 1e-9)
    ]
    largest = max(float(np.abs(x).max()) for x in off.values())
    reason = f"beyond rounding: {'; '.join(beyond)} (compare {other})" if beyond else ""
    ours = f"{count - len(beyond)} of {count} agree; largest difference {largest:.3f}"
    return Finding(not beyond, ours, reason)


def _statistics() -> dict[str, Finding]:
    """Claims 5.4 to 5.7: p, intervals, asterisks, R2."""
    from scipy import stats

    mean, error, p, low, high = np.moveaxis(POST_HOC, -1, 0)
    ours = np.minimum(1.0, 3.0 * 2.0 * stats.t.sf(np.abs(mean / error), SUBJECTS - 1))
    half = stats.t.isf(ALPHA / 6.0, SUBJECTS - 1) * error
    bounds = np.abs(np.stack([mean - half - low, mean + half - high])).max()
    off = np.abs(ours - p).max()
    small = p <= ALPHA
    marked = np.stack([MARKED[pair].T for pair in PAIRS], axis=-1)
    wrong = int((small != marked).sum())
    points, adjusted = 3 * SUBJECTS, 0
    for model, r2 in R2.items():
        least, most = (1.0 - (1.0 - r2 + x) * (points - 1) / (points - 2) for x in (_HALF, -_HALF))
        printed = ADJUSTED_R2[model]
        adjusted += int(((least - _HALF <= printed) & (printed <= most + _HALF)).sum())
    pooled = {model: pooled_r2(model) for model in R2}
    apart = max(float(np.abs(pooled[model] - r2).max()) for model, r2 in R2.items())
    return {
        "5.4": Finding(
            off <= 0.005 and bounds <= 0.02,
            f"largest difference of p {off:.4f}, of a bound {bounds:.3f}",
        ),
        "5.5": Finding(
            wrong == 0, f"{int(small.sum())} p up to 0.01; {45 - wrong} of 45 agree"
        ),
        "5.6": Finding(adjusted == 10, f"{adjusted} of 10 agree"),
        "5.7": Finding(
            apart <= 0.03,
            "; ".join(f"{model} {measures_row(r2)}" for model, r2 in pooled.items()),
            f"largest difference {apart:.3f}",
        ),
    }  # fmt: skip


def pooled_r2(model: str) -> np.ndarray:
    """R2 of Table 5 from Tables 1 to 4: means, spreads, and spreads of differences.

    Args:
        model: `moving axis` or `hinge` as Table 5 has them.

    Returns:
        Shape `(5,)`: squared correlation of 30 values of ten subjects at three flexions.
    """
    n = SUBJECTS
    x, y = (MEAN[name][COMPARED] for name in (model, EOS))
    sx, sy = (SD[name][COMPARED] for name in (model, EOS))
    within = (sx**2 + sy**2 - STANDARD_ERROR[(EOS, model)][:3] ** 2 * n) / 2.0

    def pooled(own: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        between = n * (a - a.mean(axis=0)) * (b - b.mean(axis=0))
        return ((n - 1) * own + between).sum(axis=0)

    return pooled(within, x, y) ** 2 / (pooled(sx**2, x, x) * pooled(sy**2, y, y))


def _models() -> dict[str, Finding]:
    """Claims 5.8 to 5.11: which model is nearer, how rotations go, whether the hinge is one."""
    higher = R2[MOVING_AXIS] > R2[HINGE]
    axis, other = (np.abs(DIFFERENCE[(EOS, model)][3]) for model in (MOVING_AXIS, HINGE))
    farther = [name for name, x, y in zip(NAMES, axis, other, strict=True) if not x < y]
    turns = {motion: table[-1, 3:] - table[0, 3:] for motion, table in MEAN.items()}
    eos = turns[EOS]
    follows = eos[0] < 0 < eos[1] and (turns[MOVING_AXIS] * eos > 0).all()
    # ML, AP and CD of a hinge follow from its turns: its femur's origin stays in the tibia.
    rows = MEAN[HINGE]
    off = {sign: np.abs(_same_point(rows, sign) - rows[:, :3]).max() for sign in (1.0, -1.0)}
    return {
        "5.8": Finding(higher.all(), f"{int(higher.sum())} of 5"),
        "5.9": Finding(
            not farther,
            f"moving axis {measures_row(axis)}; hinge {measures_row(other)}",
            farther and f"not {', '.join(farther)}, which the discussion calls overestimated" or "",
        ),
        "5.10": Finding(
            follows and (turns[HINGE] * eos < 0).all(),
            "; ".join(f"{motion} AA {x[0]:+.2f}, IE {x[1]:+.2f}" for motion, x in turns.items()),
        ),
        "5.11": Finding(
            off[1.0] <= 0.2,
            f"within {off[1.0]:.2f} mm; with ML positive medially within {off[-1.0]:.2f} mm",
        ),
    }


def _same_point(rows: np.ndarray, sign: float) -> np.ndarray:
    """ML, AP, CD at the turns of each row, with the femur's origin fixed in the tibia as in row 0.

    Flexion is not needed: projections do not depend on it.
    """
    signed = rows * np.array([sign, 1.0, 1.0, 1.0, 1.0])
    adduction, rotation = np.deg2rad(rows[:, 3]), np.deg2rad(rows[:, 4])
    ca, sa, ci, si = np.cos(adduction), np.sin(adduction), np.cos(rotation), np.sin(rotation)
    # Axes of Grood and Suntay in the tibia: femoral lateral, floating, downwards.
    axes = np.zeros((len(rows), 3, 3))
    axes[:, 0] = np.stack([-ca * si, sa, ca * ci], axis=-1)
    axes[:, 1] = np.stack([ci, 0.0 * ci, si], axis=-1)
    axes[:, 2] = [0.0, -1.0, 0.0]
    point = np.linalg.solve(axes[0], signed[0, :3])
    return (axes @ point) * np.array([sign, 1.0, 1.0])
