"""The average knee beside what others measured: what it was fitted to, and what was kept aside.

    python benchmarks/average_knee.py [--knee average_knee]

Published values stand in `data/laxity` and `data/measurements` with their source. Counted is how
many lie within two standard deviations; 25 % of the mean stand for one that nobody published, and a
load that is not known is assumed (`ASSUMED`).
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


def beside(knee, band: LaxityBand) -> list[tuple[str, float, float, float]]:
    """What, found, published and its spread, at each flexion of a published laxity."""
    known = np.isfinite(band.size)
    size = band.size if known else ASSUMED[band.load]
    found = _ends(cut(knee, band.cut), band, size)
    if band.end == "range_increase":
        found = found - _ends(knee, band, size)
    said = " ".join([band.name, band.end, *(f"{name} cut" for name in band.cut)])
    assumed = "" if known else f", {size:g} assumed"
    return [
        (f"{said}{assumed}_{flexion:g}deg", value, mean, sd)
        for flexion, value, mean, sd in zip(
            band.flexion_deg, found, band.mean, band.sd, strict=True
        )
    ]


def _ends(knee, band: LaxityBand, size: float) -> np.ndarray:
    """How far a knee gives at each flexion, at the end or over the range of a table."""
    given = {"moment_Nm" if band.load.endswith("_Nm") else "force_N": size}
    (test,) = kj.lab_tests(TESTS[band.load], band.flexion_deg, both=True, steps=5, **given)
    (curves,) = kj.load_curves(knee, test)
    end = band.end.removesuffix("_increase")
    return np.array([getattr(row, end) for row in kj.laxity(curves)])


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
    flexion, internal = turning()
    table = np.asarray(kj.passive_flexion(knee, flexion).to_table("grood-suntay"))
    turned = table[:, 2] - table[0, 2]
    rows: dict[str, float] = {}
    for name, found, value, _ in intact + aside:
        rows |= {name: float(found), f"{name}_published": float(value)}
    for angle, own, value in zip(flexion, turned, internal, strict=True):
        name = f"internal_rotation_{angle:g}deg"
        rows |= {name: float(own), f"{name}_published": float(value)}
    rows |= {
        "internal_rotation_rms_error_deg": float(np.sqrt(np.mean((turned - internal) ** 2))),
        "fitted_within_2sd_percent": share(intact),
        "kept_aside_within_2sd_percent": share(aside),
    }
    finish(options.out, f"Beside published knees, {knee.name}", rows)


if __name__ == "__main__":
    main()
