"""What paper 5's printed numbers say about each other: claims that need no joint."""

from __future__ import annotations

import numpy as np

from kneejax.joints import MEASURES
from kneejax.reproduction._claims import Claim, judged
from kneejax.reproduction.paper5 import _printed as printed

_NAMES = tuple(one.name for one in MEASURES)
_EOS, _AXIS, _HINGE = printed.EOS, printed.MOVING_AXIS, printed.HINGE
#: Half a unit of the last printed digit, and what rounding can make of a sum of two and of three.
_HALF = 0.005
#: The flexions that are compared, in words.
ANGLES = tuple(f"{x:g}" for x in printed.FLEXION_DEG[printed.COMPARED])


def table_claims() -> tuple[Claim, ...]:
    """Claims 5.1 to 5.11: Tables 1 to 5 and the supplementary table against each other."""
    return (
        _averages(), _differences(), _difference_averages(), _post_hoc(), _marks(), _adjusted(),
        _correlations(), _higher_r2(), _closer(), _trends(), _one_hinge(),
    )  # fmt: skip


def _averages() -> Claim:
    apart, worst = 0.0, ""
    for motion, average in printed.AVERAGE.items():
        for kind, table in enumerate((printed.MEAN[motion], printed.SD[motion])):
            for row, span in enumerate((slice(None), printed.COMPARED)):
                off = np.abs(table[span].mean(axis=0) - average[kind, row])
                if off.max() > apart:
                    apart = float(off.max())
                    worst = (
                        f"{motion}, {('mean', 'SD')[kind]} of {_NAMES[off.argmax()]}, "
                        f"{('0 to 90', '20 to 60')[row]} degrees"
                    )
    return Claim(
        "5.1",
        "Averages of Tables 1 to 3 are those of their rows, of means and of standard deviations.",
        "Each of the 60 differs from the mean of its rows by at most 0.01, what rounding can do.",
        "Average (0-90), Average (20-60)",
        f"largest difference {apart:.3f} ({worst})",
        judged(apart <= 2.0 * _HALF + 1e-9),
    )


def _differences() -> Claim:
    off = {
        pair: printed.MEAN[pair[0]][printed.COMPARED]
        - printed.MEAN[pair[1]][printed.COMPARED]
        - table[:3]
        for pair, table in printed.DIFFERENCE.items()
    }
    return Claim(
        "5.2",
        "Mean differences of Table 4 are the differences of the means of Tables 1 to 3.",
        "Each of the 45 agrees within 0.015, what rounding of three numbers can do.",
        "Table 4",
        *_off(off, 3.0 * _HALF, "the supplementary table"),
    )


def _off(
    off: dict[tuple[str, str], np.ndarray], limit: float, other: str
) -> tuple[str, str, str]:
    """What differs by more than rounding can do, the verdict on it, and the reason."""
    count = sum(x.size for x in off.values())
    beyond = [
        f"{pair[0]} - {pair[1]}, {_NAMES[j]} at {ANGLES[i]} degrees by {abs(x[i, j]):.3f}"
        for pair, x in off.items()
        for i, j in np.argwhere(np.abs(x) > limit + 1e-9)
    ]
    largest = max(float(np.abs(x).max()) for x in off.values())
    ours = f"{count - len(beyond)} of {count} agree; largest difference {largest:.3f}"
    reason = f"beyond rounding: {'; '.join(beyond)} (compare {other})" if beyond else ""
    return ours, judged(not beyond), reason


def _difference_averages() -> Claim:
    off = {
        pair: (table[:3].mean(axis=0) - table[3])[None]
        for pair, table in printed.DIFFERENCE.items()
    }
    ours, verdict, reason = _off(off, 2.0 * _HALF, "5.2")
    return Claim(
        "5.3",
        "Average mean differences of Table 4, which the abstract repeats with AA and IE exchanged, "
        "are those of its rows.",
        "Each of the 15 agrees within 0.01.",
        "moving axis -1.98, 6.50, 0.05, 0.59, 1.90; hinge -0.84, 10.11, 0.66, -3.17, 11.60",
        ours,
        verdict,
        reason.replace(f" at {ANGLES[0]} degrees", ""),
    )


def _post_hoc() -> Claim:
    from scipy import stats

    mean, error, p, low, high = np.moveaxis(printed.POST_HOC, -1, 0)
    freedom = printed.SUBJECTS - 1
    ours = np.minimum(1.0, 3.0 * 2.0 * stats.t.sf(np.abs(mean / error), freedom))
    half = stats.t.isf(printed.ALPHA / 6.0, freedom) * error
    bounds = np.abs(np.stack([mean - half - low, mean + half - high])).max()
    off = np.abs(ours - p).max()
    return Claim(
        "5.4",
        "p and confidence intervals of the supplementary table follow from its means and errors.",
        "Paired t-tests with 9 degrees of freedom, p three-fold and at most 1, within 0.005; "
        "intervals that hold three pairs at once with 99 %, within 0.02.",
        "Bonferroni, alpha 0.01",
        f"largest difference of p {off:.4f}, of a bound {bounds:.3f}",
        judged(bool(off <= 0.005 and bounds <= 0.02)),
    )


def _marks() -> Claim:
    small = printed.POST_HOC[..., 2] <= printed.ALPHA
    marked = np.stack([printed.MARKED[pair].T for pair in printed.PAIRS], axis=-1)
    wrong = int((small != marked).sum())
    return Claim(
        "5.5",
        "Differences are significant where Table 4 says so.",
        "Its asterisks are the p up to 0.01 of the supplementary table, all 45.",
        f"{int(marked.sum())} asterisks",
        f"{int(small.sum())} p up to 0.01; {45 - wrong} of 45 agree",
        judged(wrong == 0),
    )


def _adjusted() -> Claim:
    points = 3 * printed.SUBJECTS
    fits = []
    for model, r2 in printed.R2.items():
        low, high = (1.0 - (1.0 - r2 + x) * (points - 1) / (points - 2) for x in (_HALF, -_HALF))
        fits.append((low - _HALF <= printed.ADJUSTED_R2[model])
                    & (printed.ADJUSTED_R2[model] <= high + _HALF))  # fmt: skip
    good = int(np.sum(fits))
    return Claim(
        "5.6",
        "Adjusted R2 of Table 5 is R2 adjusted for the number of values.",
        "1 - (1 - R2) 29 / 28 (30 values, one predictor) agrees for all ten, both rounded.",
        "Table 5",
        f"{good} of 10 agree",
        judged(good == 10),
    )


def pooled_r2(model: str) -> np.ndarray:
    """R2 of Table 5 from Tables 1 to 4: means, spreads, and spreads of differences.

    Args:
        model: `moving axis` or `hinge` as Table 5 has them.

    Returns:
        Shape `(5,)`: squared correlation of 30 values of ten subjects at three flexions.
    """
    n = printed.SUBJECTS
    x, y = (printed.MEAN[name][printed.COMPARED] for name in (model, _EOS))
    sx, sy = (printed.SD[name][printed.COMPARED] for name in (model, _EOS))
    apart = printed.STANDARD_ERROR[(_EOS, model)][:3] ** 2 * n
    within = (sx**2 + sy**2 - apart) / 2.0

    def pooled(own: np.ndarray, a: np.ndarray, b: np.ndarray) -> np.ndarray:
        between = n * (a - a.mean(axis=0)) * (b - b.mean(axis=0))
        return ((n - 1) * own + between).sum(axis=0)

    return pooled(within, x, y) ** 2 / (pooled(sx**2, x, x) * pooled(sy**2, y, y))


def _correlations() -> Claim:
    ours = {model: pooled_r2(model) for model in printed.R2}
    off = max(float(np.abs(ours[model] - r2).max()) for model, r2 in printed.R2.items())
    return Claim(
        "5.7",
        "R2 of Table 5 is the squared correlation of all values at 20, 45 and 60 degrees.",
        "Computed from the means, standard deviations and standard errors of Tables 1 to 4, each "
        "of the ten agrees within 0.03 (all of these are rounded).",
        "; ".join(f"{model} {measures_row(r2)}" for model, r2 in printed.R2.items()),
        "; ".join(f"{model} {measures_row(r2)}" for model, r2 in ours.items()),
        judged(off <= 0.03),
        f"largest difference {off:.3f}",
    )


def measures_row(values: np.ndarray) -> str:
    """Five numbers with the names of their clinical measures, for a row of the report."""
    pairs = zip(_NAMES, values, strict=True)
    return ", ".join(f"{name} {value:.2f}" for name, value in pairs)


def _higher_r2() -> Claim:
    higher = printed.R2[_AXIS] > printed.R2[_HINGE]
    return Claim(
        "5.8",
        "The moving axis has the higher R2 for each clinical measure (abstract).",
        "In Table 5, all five.",
        "higher for each",
        f"{int(higher.sum())} of 5",
        judged(bool(higher.all())),
    )


def _closer() -> Claim:
    axis, other = (np.abs(printed.DIFFERENCE[(_EOS, model)][3]) for model in (_AXIS, _HINGE))
    closer = axis < other
    farther = [name for name, x in zip(_NAMES, closer, strict=True) if not x]
    return Claim(
        "5.9",
        "The moving axis approximates the secondary kinematics better than the hinge (abstract).",
        "In Table 4, its average mean difference is the smaller one for each of the five.",
        "better overall; almost exclusively (3)",
        f"moving axis {measures_row(axis)}; hinge {measures_row(other)}",
        judged(bool(closer.all())),
        f"not {', '.join(farther)}, which the discussion calls overestimated" if farther else "",
    )


def _trends() -> Claim:
    turns = {motion: table[-1, 3:] - table[0, 3:] for motion, table in printed.MEAN.items()}
    eos, axis, other = (turns[motion] for motion in (_EOS, _AXIS, _HINGE))
    holds = eos[0] < 0 < eos[1] and (axis * eos > 0).all() and (other * eos < 0).all()
    return Claim(
        "5.10",
        "Abduction and internal rotation grow with flexion; the moving axis agrees, the hinge "
        "opposes.",
        "From 0 to 90 degrees the printed mean AA falls and IE rises in EOS and in the moving "
        "axis; in the hinge the other way round.",
        "increased; agreed; opposed (3)",
        "; ".join(f"{motion} AA {x[0]:+.2f}, IE {x[1]:+.2f}" for motion, x in turns.items()),
        judged(bool(holds)),
        "the moving axis returns towards 0 in AA after 45 degrees",
    )


def _one_hinge() -> Claim:
    """ML, AP and CD of a hinge follow from its turns: its femur's origin stays in the tibia."""
    rows = printed.MEAN[_HINGE]
    off = {sign: np.abs(_same_point(rows, sign) - rows[:, :3]).max() for sign in (1.0, -1.0)}
    return Claim(
        "5.11",
        "The hinge runs between the epicondyles, midway between which is the femur's origin.",
        "With that point fixed in the tibia where row 0 of Table 3 has it, AA and IE of the other "
        "rows give their ML, AP and CD within 0.2 mm.",
        "CD fixed at 34.72",
        f"within {off[1.0]:.2f} mm; with ML positive medially within {off[-1.0]:.2f} mm",
        judged(bool(off[1.0] <= 0.2)),
        "so ML is positive laterally, which the paper does not print",
    )


def _same_point(rows: np.ndarray, sign: float) -> np.ndarray:
    """ML, AP, CD at the turns of each row, with the femur's origin fixed in the tibia as in row 0.

    Flexion is not needed: projections do not depend on it.
    """
    signed = rows * np.array([sign, 1.0, 1.0, 1.0, 1.0])
    adduction, rotation = np.deg2rad(rows[:, 3]), np.deg2rad(rows[:, 4])
    ca, sa, ci, si = np.cos(adduction), np.sin(adduction), np.cos(rotation), np.sin(rotation)
    nought = np.zeros_like(ca)
    # Axes of Grood and Suntay in the tibia: femoral lateral, floating, downwards.
    axes = np.stack(
        [
            np.stack([-ca * si, sa, ca * ci], axis=-1),
            np.stack([ci, nought, si], axis=-1),
            np.broadcast_to([0.0, -1.0, 0.0], (len(rows), 3)),
        ],
        axis=1,
    )
    point = np.linalg.solve(axes[0], signed[0, :3])
    return (axes @ point) * np.array([sign, 1.0, 1.0])
