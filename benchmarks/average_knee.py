"""The average knee beside what others measured: what it was fitted to, and what was kept aside.

    python benchmarks/average_knee.py --knee average_knee

Published values stand in `data/laxity` and `data/measurements` with their source. Counted is how
many lie within two standard deviations; 25 % of the mean stand for one that nobody published, and a
load that is not known is assumed (`ASSUMED`).

Forces inside are those that robots found by cutting a ligament and moving the knee along its path
again; what carries 1 kN of compression is told too.

Without its ACL an unloaded tibia rests further forward. A robot repeats the intact knee's passive
path and counts from it, so the displacement of a cut knee is counted from there; where the source
of the values does not say so this is assumed, and the same from the cut knee's own rest is told
too.
"""

from __future__ import annotations

import numpy as np
from _protocol import arguments, finish, load

import kneejax as kj
from kneejax.experiments import load_share, mechanics_of
from kneejax.files import LaxityBand, bundled_bands, bundled_measurements, read_lab_table
from kneejax.geometry import FREE_COORDINATES
from kneejax.parameters import cut, fibre_rows
from kneejax.statics import Status

#: Load -> its size, assumed where a table's is not known; and the test under it.
ASSUMED = {"internal_Nm": 5.0, "varus_Nm": 10.0, "anterior_N": 100.0}
TESTS = {"internal_Nm": "torsion", "varus_Nm": "varus-valgus", "anterior_N": "drawer"}
#: What the study of the average knee fits: these laxities of intact knees, and all forces of
#: `IN_SITU` but those of the whole PCL.
FITTED = ("robot_anterior_90N", "komzak2013_torsion")
#: Tables of forces -> standard deviations that were published, N, by flexion and what was read.
IN_SITU = {
    "sakane1997": {(15, "ACL"): 14.8, (15, "ACLpl"): 18.3, (90, "ACL"): 7.3},
    "gabriel2004": {(0, "ACLpl"): 30.0, (60, "ACLam"): 17.0},
    "fox1998": {(0, "PCL"): 6.0, (60, "PCLal"): 23.0, (90, "PCL"): 28.5, (90, "PCLpm"): 31.5},
}
COMPRESSION_N = 1000.0


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


def forces_beside(knee, name: str) -> list[tuple[str, float, float, float]]:
    """What, found, published and its spread of each in-situ force of a bundled table, N, of what
    the knee has."""
    table = read_lab_table(bundled_measurements()[name].path)
    (sizes,) = table.loads.values()
    rows = []
    for place, (flexion, size) in enumerate(zip(table.flexion_deg, sizes, strict=True)):
        (test,) = kj.lab_tests("drawer", [flexion], force_N=float(size), steps=2)
        carried = _carried(knee, test)[-1]
        for column, measured in table.readings.items():
            part = column.removesuffix(".tension_N")
            if np.isfinite(measured[place]) and part in carried:
                spread = IN_SITU[name][int(flexion), part]
                said = f"{name}_{part}_{size:g}N_{flexion:g}deg"
                rows.append((said, carried[part], float(measured[place]), spread))
    return rows


def _carried(knee, test: kj.LabTest) -> list[dict[str, float]]:
    """Tension of each ligament and group, N, at each step of a test at one flexion."""
    (curves,) = kj.load_curves(knee, test)
    tension = np.asarray(mechanics_of(curves).tension)[np.asarray(curves.nodes)[0]]
    names = (*knee.ligaments.names, *(name for name, _ in knee.groups))
    rows = {name: fibre_rows(knee, name) for name in names}
    return [{name: float(row[own].sum()) for name, own in rows.items()} for row in tension]


def under_compression(knee) -> dict[str, float | str]:
    """What 1 kN does: how far the tibia moves, how much the most stretched fibre has left, and what
    menisci carry of their compartments' load."""
    flexion = np.arange(0.0, 91.0, 15.0)
    (test,) = kj.lab_tests("compression", flexion, force_N=COMPRESSION_N, steps=4)
    (curves,) = kj.load_curves(knee, test)
    mechanics, pose = mechanics_of(curves), np.asarray(curves.motion.to_table("grood-suntay"))
    carried, extrusion = load_share(knee, mechanics), np.asarray(mechanics.max_extrusion)
    menisci = {name: knee.contact_names.index(name) for name in knee.menisci}
    rows: dict[str, float | str] = {}
    for angle, nodes in zip(flexion, np.asarray(curves.nodes), strict=True):
        rest, full = nodes[0], nodes[-1]
        moved = pose[full] - pose[rest]
        deep = np.nanmax(np.asarray(mechanics.max_depth)[full])
        strain = np.nanmax(np.asarray(mechanics.strain)[full])
        rows |= {
            f"compressed_{angle:g}deg_status": Status(int(curves.motion.status[full])).word,
            f"compressed_{angle:g}deg_anterior_mm": float(moved[3]),
            f"compressed_{angle:g}deg_internal_deg": float(moved[2]),
            f"compressed_{angle:g}deg_deepest_mm": float(deep),
            f"compressed_{angle:g}deg_largest_strain": float(strain),
        }
        for name, row in menisci.items():
            rows |= {
                f"compressed_{angle:g}deg_{name}_share": float(carried[full, row]),
                f"compressed_{angle:g}deg_{name}_extrusion_mm": float(extrusion[full, row]),
            }
    return rows


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
        (fitted if band.name in FITTED and not band.cut else other).append(band)
    intact, aside = (
        [row for band in part for row in beside(knee, band)] for part in (fitted, other)
    )
    own_rest = []
    for band in other:
        own_rest += beside(knee, band, bool(band.cut) and band.end == "positive")
    forces = [row for name in IN_SITU for row in forces_beside(knee, name)]
    kept = [row for row in forces if "_PCL_" in row[0]]
    flexion, internal = turning()
    table = np.asarray(kj.passive_flexion(knee, flexion).to_table("grood-suntay"))
    turned = table[:, 2] - table[0, 2]
    rows: dict[str, float] = {}
    for name, found, value, _ in intact + aside + own_rest + forces:
        rows |= {name: float(found), f"{name}_published": float(value)}
    for angle, own, value in zip(flexion, turned, internal, strict=True):
        name = f"internal_rotation_{angle:g}deg"
        rows |= {name: float(own), f"{name}_published": float(value)}
    rows |= {
        "internal_rotation_rms_error_deg": float(np.sqrt(np.mean((turned - internal) ** 2))),
        "fitted_within_2sd_percent": share(intact),
        "forces_within_2sd_percent": share(forces),
        "kept_aside_within_2sd_percent": share(aside + kept),
        "kept_aside_from_own_rest_within_2sd_percent": share(own_rest),
    }
    rows |= under_compression(knee)
    finish(options.out, f"Beside published knees, {knee.name}", rows)


if __name__ == "__main__":
    main()
