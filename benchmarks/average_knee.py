"""The average knee beside what others measured: what it was fitted to, and what was kept aside.

    python benchmarks/average_knee.py --knee average_knee

Published values stand in `data/laxity` and `data/measurements` with their source. Counted is how
many lie within two standard deviations; 25 % of the mean stand for one that nobody published, and a
load that is not known is assumed (`ASSUMED`).

Without its ACL an unloaded tibia rests further forward. A robot repeats the intact knee's passive
path and counts from it, so the displacement of a cut knee is counted from there; where the source
of the values does not say so this is assumed, and the same from the cut knee's own rest is told
too.
"""

from __future__ import annotations

import numpy as np
from _protocol import arguments, finish, load

import kneejax as kj
from kneejax.files import LaxityBand, bundled_bands, bundled_measurements, read_lab_table
from kneejax.geometry import FREE_COORDINATES
from kneejax.parameters import cut

#: Load -> its size, assumed where a table's is not known; and the test under it.
ASSUMED = {"internal_Nm": 5.0, "varus_Nm": 10.0, "anterior_N": 100.0}
TESTS = {"internal_Nm": "torsion", "varus_Nm": "varus-valgus", "anterior_N": "drawer"}
FITTED = "robot_anterior_90N"


def beside(
    knee, band: LaxityBand, own_rest: bool = False
) -> list[tuple[str, float, float, float]]:
    """What, found, published and its spread, at each flexion of a published laxity.

    Args:
        knee: intact.
        band: what was published.
        own_rest: whether one end of a cut knee is counted from where that rests itself.
    """
    known = np.isfinite(band.size)
    size = band.size if known else ASSUMED[band.load]
    from_intact = bool(band.cut) and band.end == "positive" and not own_rest
    rows = _laxities(cut(knee, band.cut), band, size, knee if from_intact else None)
    end = band.end.removesuffix("_increase")
    found = np.array([getattr(row, end) for row in rows])
    if end != band.end:
        found = found - [row.range for row in _laxities(knee, band, size)]
    said = " ".join([band.name, band.end, *(f"{name} cut" for name in band.cut)])
    said += ("" if known else f", {size:g} assumed") + (", from its own rest" if own_rest else "")
    return [
        (f"{said}_{flexion:g}deg", value, mean, sd)
        for flexion, value, mean, sd in zip(
            band.flexion_deg, found, band.mean, band.sd, strict=True
        )
    ]


def _laxities(knee, band: LaxityBand, size: float, intact=None) -> tuple[kj.Laxity, ...]:
    """Laxity both ways under a load of a published one; of a cut knee counted from the intact
    one's path, if that is given."""
    given = {"moment_Nm" if band.load.endswith("_Nm") else "force_N": size}
    (test,) = kj.lab_tests(TESTS[band.load], band.flexion_deg, both=True, steps=5, **given)
    (curves,) = kj.load_curves(knee, test, intact)
    return kj.laxity(curves)


def share(rows) -> float:
    """Percent of rows within two standard deviations; what gives way is not."""
    inside = [
        abs(found - value) <= 2.0 * (sd if np.isfinite(sd) else 0.25 * abs(value))
        for _, found, value, sd in rows
    ]
    return 100.0 * float(np.mean(inside))


def turning() -> tuple[np.ndarray, np.ndarray]:
    """Internal rotation from extension, degrees, over flexion (Walker 1988)."""
    walker = bundled_measurements()["walker1988"]
    table = read_lab_table(walker.path, walker.columns, unloaded=True)
    return table.flexion_deg, table.observed[:, FREE_COORDINATES.index("internal_rotation")]


def main() -> None:
    options = arguments("average_knee", __doc__)
    knee = load(options.knee)
    fitted, other = [], []
    for band in bundled_bands():
        (fitted if band.name == FITTED and not band.cut else other).append(band)
    intact, aside = (
        [row for band in part for row in beside(knee, band)] for part in (fitted, other)
    )
    own_rest = []
    for band in other:
        own_rest += beside(knee, band, bool(band.cut) and band.end == "positive")
    flexion, internal = turning()
    table = np.asarray(kj.passive_flexion(knee, flexion).to_table("grood-suntay"))
    turned = table[:, 2] - table[0, 2]
    rows: dict[str, float] = {}
    for name, found, value, _ in intact + aside + own_rest:
        rows |= {name: float(found), f"{name}_published": float(value)}
    for angle, own, value in zip(flexion, turned, internal, strict=True):
        name = f"internal_rotation_{angle:g}deg"
        rows |= {name: float(own), f"{name}_published": float(value)}
    rows |= {
        "internal_rotation_rms_error_deg": float(np.sqrt(np.mean((turned - internal) ** 2))),
        "fitted_within_2sd_percent": share(intact),
        "kept_aside_within_2sd_percent": share(aside),
        "kept_aside_from_own_rest_within_2sd_percent": share(own_rest),
    }
    finish(options.out, f"Beside published knees, {knee.name}", rows)


if __name__ == "__main__":
    main()
