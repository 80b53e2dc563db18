"""Load, area and pressure of a knee with menisci and after meniscectomy, beside published ones.

Menisci that fill the room between condyle and plateau in extension are made of `average_knee`: its
rims, with rings, on the plateaus of `lenhart2015`, and a little higher than that room, since an
unloaded knee rests on its menisci (Walker and Erkman 1975). The tibia is pressed against the femur
in extension without turning, and all is read at the same load of the compartment. The command
`kneejax simulate compression --cut medial_meniscus` says the same of any knee in equilibrium.

Published of human knees in extension: menisci bear at least 45 % of the load (Shrive, O'Connor and
Goodfellow, Clin Orthop 131, 1978), the medial one about half of its compartment's and the lateral
one most (Walker and Erkman, Clin Orthop 109, 1975); at 1000 N contact area is 1150 mm^2 with and
520 mm^2 without menisci, peak pressure 3 and 6 MPa (Fukubayashi and Kurosawa, Acta Orthop Scand 51,
1980); without the inner third area falls by about 10 % (Baratz, Fu and Mengato, Am J Sports Med 14,
1986).

    python menisci.py
"""

import dataclasses
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.interpolate import BSpline

import kneejax as kj
from kneejax.experiments import load_share
from kneejax.geometry import Pose, State
from kneejax.mechanics import Ring

COMPARTMENTS = "medial", "lateral"
WIDTH_MM, HIGHER_MM, LAYER_MM = 10.0, 0.2, 6.0
#: Along the fibres and across them, MPa; Poisson's ratio across (Haut Donahue et al. 2003).
ALONG_MPA, ACROSS_MPA, POISSON = 120.0, 20.0, 0.2


def knee_with_menisci(hoop_modulus=ALONG_MPA, coronary=60.0):
    """The average knee with rings that touch the femur all around in extension, on the plateaus of
    lenhart2015 as they were measured: their reference pose is extension."""
    knee, contacts, own = kj.load_knee("average_knee"), [], kj.load_knee("lenhart2015")
    measured = dict(zip(own.contact_names, own.contacts, strict=True))
    for name, contact in zip(knee.contact_names, knee.contacts, strict=True):
        if name not in knee.menisci:
            contacts.append(measured[name])
            continue
        compartment = name.partition("_")[0]
        below = measured[compartment]
        outline = np.asarray(contact.tibial.outline)
        ring = Ring(hoop_modulus, 0.5 * WIDTH_MM * 8.0, 200.0, coronary, contact.ring.middle,
                    contact.ring.horns)  # fmt: skip
        tibial = dataclasses.replace(
            below.tibial, coefficients=jnp.asarray(_heights(below)), outline=jnp.asarray(outline)
        )
        contacts.append(dataclasses.replace(
            contact, tibial=tibial, ring=ring, youngs_modulus=jnp.asarray(ACROSS_MPA),
            poisson_ratio=jnp.asarray(POISSON), layer_thickness=jnp.asarray(LAYER_MM),
        ))  # fmt: skip
    return dataclasses.replace(knee, contacts=tuple(contacts))


def _heights(below):
    """Control values of the surface that fills the room above a plateau in extension."""
    plateau = below.tibial
    table = np.asarray(plateau.coefficients)
    cells = [n - 3 for n in table.shape]
    ends = [np.asarray(x) for x in (plateau.x, plateau.z)]
    s = [np.linspace(-1.0, 1.0, 4 * n + 1) for n in cells]
    x, z = np.meshgrid(*(a + 0.5 * (1.0 + t) * (b - a) for t, (a, b) in zip(s, ends, strict=True)),
                       indexing="ij")  # fmt: skip
    floor = np.asarray(plateau.point(x.ravel(), z.ravel())[1]).reshape(x.shape)
    there = State({"tibia": Pose.from_table([0.0] * 6)}).tibia.placement
    up = np.arange(-4.0, 9.0, 0.05)[:, None, None]
    inside = below.femoral.level(below.femur_to_plateau(there).apply_inverse((x, floor + up, z)))
    inside = np.asarray(inside) < 0.0
    room = np.where(inside.any(axis=0), up[np.argmax(inside, axis=0), 0, 0], up[-1])
    rise = np.minimum(room + HIGHER_MM, 9.0)
    bases = [BSpline.design_matrix(t, -1.0 + 2.0 / n * np.arange(-3, n + 4), 3).toarray()
             for t, n in zip(s, cells, strict=True)]  # fmt: skip
    added = np.linalg.lstsq(bases[0], rise, rcond=1e-6)[0]
    return table + np.linalg.lstsq(bases[1], added.T, rcond=1e-6)[0].T


class Carried(NamedTuple):
    """What a compartment carries, and how, at a load."""

    share: float
    area_mm2: float
    peak_MPa: float
    extrusion_mm: float


def pressed(knee, load_N=500.0):
    """Of each compartment, at the same load of each.

    Args:
        knee: with or without menisci.
        load_N: on each compartment, along the tibia.
    """
    up = np.linspace(-2.0, 1.6, 28)
    found = kj.evaluate(knee, Pose.from_table(np.stack([0 * up, *[0 * up] * 3, up, 0 * up], 1)))
    force, share = -np.asarray(found.contact_force)[..., 1], load_share(knee, found)
    answer = {}
    for name in COMPARTMENTS:
        own = [name, *(x for x in (f"{name}_meniscus",) if x in knee.contact_names)]
        rows = [knee.contact_names.index(x) for x in own]
        of_all, last = force[:, rows].sum(axis=1), rows[-1]
        numbers = (
            share[:, last] * (len(rows) > 1), np.asarray(found.area)[:, rows].sum(axis=1),
            np.asarray(found.max_pressure)[:, rows].max(axis=1), found.max_extrusion[:, last],
        )  # fmt: skip
        answer[name] = Carried(*(float(np.interp(load_N, of_all, np.asarray(x))) for x in numbers))
    return answer


def removed(part=""):
    """Names of both menisci, or of a part of each, as `kneejax.cut` takes them."""
    return [f"{name}_meniscus{part}" for name in COMPARTMENTS]


def main():
    kj.configure()
    whole = knee_with_menisci()
    knees = {
        "with menisci": whole, "without the inner third": kj.cut(whole, removed(":inner=0.333")),
        "without the inner two thirds": kj.cut(whole, removed(":inner=0.667")),
        "without 40 % of the arc": kj.cut(whole, removed(":posterior=0.4")),
        "without menisci": kj.cut(whole, removed()), "hoop of 1 MPa": knee_with_menisci(1.0),
    }  # fmt: skip
    print("500 N on each compartment, extension: share of the meniscus, contact area, peak "
          "pressure, extrusion")  # fmt: skip
    for title, knee in knees.items():
        for name, own in pressed(knee).items():
            print(f"{title:30s}{name:9s}{own.share:6.0%}{own.area_mm2:8.0f} mm^2"
                  f"{own.peak_MPa:8.2f} MPa{own.extrusion_mm:8.2f} mm", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
