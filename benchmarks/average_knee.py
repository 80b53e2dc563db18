"""The average knee beside what others measured: what it was fitted to, and what was kept aside.

    python benchmarks/average_knee.py --knee average_knee

Published values stand in `data/laxity`, `data/measurements` and below with their source. Counted is
how many lie within two standard deviations; 25 % of the mean stand for one that nobody published.

Without its ACL an unloaded tibia rests further forward. A robot that repeats the intact knee's path
counts from it, so the displacement of a cut knee is counted from there; where the source of the
values does not say so this is assumed, and the same from the cut knee's own rest is told too.
"""

from __future__ import annotations

import numpy as np
from _protocol import arguments, finish, load

import kneejax as kj
from kneejax.files import bundled_bands
from kneejax.parameters import cut

#: Test, flexion, load, which end, published value, its standard deviation, source.
OTHERS = (
    ("torsion", 30.0, 5.0, "positive", 12.1, np.nan, "Komzak 2013, internal"),
    ("torsion", 30.0, 5.0, "negative", -10.1, np.nan, "Komzak 2013, external"),
    ("varus-valgus", 0.0, 10.0, "range", 6.7, np.nan, "Markolf 1978"),
)
#: Walker 1988: internal rotation from extension, degrees; no spread was published.
FLEXION = np.arange(0.0, 121.0, 10.0)
INTERNAL = np.array(
    [0, 3.41, 6.27, 8.63, 10.54, 12.04, 13.18, 14.00, 14.55, 14.88, 15.04, 15.06, 14.99]
)


def drawer(knee, band) -> tuple[kj.Laxity, ...]:
    """Laxity under the load of a published one."""
    (test,) = kj.lab_tests("drawer", band.flexion_deg, force_N=band.size, steps=3)
    (curves,) = kj.load_curves(cut(knee, band.cut), test)
    return kj.laxity(curves)


def anterior(said: str, found, band, rest=None) -> list[tuple[str, float, float, float]]:
    """What, found, published and its spread, at each flexion.

    Args:
        said: what was done to the knee.
        found: its laxities.
        band: the published one.
        rest: laxities of the knee from whose unloaded poses is counted; its own by default.
    """
    rest = found if rest is None else rest
    return [
        (f"anterior_{said}_{row.flexion_deg:g}deg", row.positive + row.neutral - own.neutral, *of)
        for row, own, *of in zip(found, rest, band.mean, band.sd, strict=True)
    ]


def others(knee) -> list[tuple[str, float, float, float]]:
    """The same of torsion and varus-valgus."""
    found = []
    for name, flexion, moment, end, value, sd, source in OTHERS:
        (test,) = kj.lab_tests(name, [flexion], moment_Nm=moment, both=True, steps=5)
        (curves,) = kj.load_curves(knee, test)
        (row,) = kj.laxity(curves)
        found.append((f"{name}_{flexion:g}deg ({source})", getattr(row, end), value, sd))
    return found


def share(rows) -> float:
    """Percent of rows within two standard deviations; what gives way is not."""
    inside = [
        abs(found - value) <= 2.0 * (sd if np.isfinite(sd) else 0.25 * abs(value))
        for _, found, value, sd in rows
    ]
    return 100.0 * float(np.mean(inside))


def main() -> None:
    options = arguments("average_knee", __doc__)
    knee = load(options.knee)
    by_cut = {band.cut: band for band in bundled_bands()}
    whole, torn = (drawer(knee, band) for band in (by_cut[()], by_cut[("ACL",)]))
    intact = anterior("intact", whole, by_cut[()])
    without = anterior("ACL cut", torn, by_cut[("ACL",)], whole)
    from_own_rest = anterior("ACL cut, from its own rest", torn, by_cut[("ACL",)])
    rest = others(knee)
    aside = without + rest
    table = np.asarray(kj.passive_flexion(knee, FLEXION).to_table("grood-suntay"))
    turned = table[:, 2] - table[0, 2]
    rows: dict[str, float] = {}
    for name, found, value, _ in intact + aside + from_own_rest:
        rows |= {name: float(found), f"{name}_published": float(value)}
    for angle, own, value in zip(FLEXION, turned, INTERNAL, strict=True):
        name = f"internal_rotation_{angle:g}deg"
        rows |= {name: float(own), f"{name}_published": float(value)}
    rows |= {
        "internal_rotation_rms_error_deg": float(np.sqrt(np.mean((turned - INTERNAL) ** 2))),
        "fitted_within_2sd_percent": share(intact),
        "kept_aside_within_2sd_percent": share(aside),
        "kept_aside_from_own_rest_within_2sd_percent": share(from_own_rest + rest),
    }
    finish(options.out, f"Beside published knees, {knee.name}", rows)


if __name__ == "__main__":
    main()
