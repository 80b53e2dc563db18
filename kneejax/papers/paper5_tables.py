"""Paper 5's printed numbers, which stand in paper5.yaml, against each other.

Columns are ML, AP, CD (mm), AA and IE (degrees), as `kneejax.joints.MEASURES`. Of individual
subjects and of axis points nothing is printed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from kneejax.joints import MEASURES
from kneejax.papers.claims import Finding, claimed, in_words

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
#: Half a unit of the last printed digit.
_HALF = 0.005


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


def table_findings() -> dict[str, Finding]:
    """Claims 5.1 to 5.11: Tables 1 to 5 and the supplementary table against each other."""
    return _averages() | _statistics() | _models()


def measures_row(values: np.ndarray, form: str = ".2f") -> str:
    """Five numbers with the names of their clinical measures, for a row of the report."""
    return in_words(dict(zip(NAMES, values, strict=True)), f"{{}} {{:{form}}}")


def _averages() -> dict[str, Finding]:
    """Claims 5.1 to 5.3: averages and differences are those of their rows."""
    apart, spans = {}, {"0 to 90": slice(None), "20 to 60": COMPARED}
    for motion, averages in AVERAGE.items():
        for (kind, tables), rows in zip({"mean": MEAN, "SD": SD}.items(), averages, strict=True):
            for (angles, span), row in zip(spans.items(), rows, strict=True):
                off = np.abs(tables[motion][span].mean(axis=0) - row)
                where = f"{motion}, {kind} of {NAMES[off.argmax()]}, {angles} degrees"
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
        "5.4": Finding(off <= 0.005 and bounds <= 0.02,
                       f"largest difference of p {off:.4f}, of a bound {bounds:.3f}"),
        "5.5": Finding(wrong == 0, f"{int(small.sum())} p up to 0.01; {45 - wrong} of 45 agree"),
        "5.6": Finding(adjusted == 10, f"{adjusted} of 10 agree"),
        "5.7": Finding(
            apart <= 0.03,
            in_words({model: measures_row(r2) for model, r2 in pooled.items()}, "{} {}", "; "),
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
            in_words({x: tuple(y) for x, y in turns.items()}, "{} AA {:+.2f}, IE {:+.2f}", "; "),
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
