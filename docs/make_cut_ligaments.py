"""Make docs/cut_ligaments.md: what holds a bundled knee with one or two ligaments cut.

    python docs/make_cut_ligaments.py [KNEE ...]
"""

from __future__ import annotations

import itertools
import sys
from pathlib import Path

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

import kneejax as kj  # noqa: E402

kj.use_shared_fusion()

from kneejax.mechanics import NAMED_LOADS, load_of  # noqa: E402
from kneejax.statics import LoadCases, Status, balance_many  # noqa: E402

KNEES = ("four_ligament", "lenhart2015_reduced", "lenhart2015")
LIGAMENTS = ("ACL", "PCL", "MCL", "LCL")
CUTS = ((), *((name,) for name in LIGAMENTS), *itertools.combinations(LIGAMENTS, 2))
ANGLES_DEG = (0.0, 30.0, 60.0, 90.0)
#: The usual laxity loads.
LOADS = (
    ("anterior_N", 100.0), ("anterior_N", -100.0), ("internal_Nm", 5.0), ("internal_Nm", -5.0),
    ("varus_Nm", 10.0), ("varus_Nm", -10.0),
)  # fmt: skip
PAGE = Path(__file__).resolve().parent / "cut_ligaments.md"
INTRODUCTION = """# Knees with ligaments cut

Bundled knees, without muscles, with one or two ligaments cut, under the loads of laxity tests:
100 N anterior and posterior, 5 N m of internal and external torque, 10 N m of varus and valgus.
Each load is ramped up from the unloaded equilibrium at its flexion. Made by
`docs/make_cut_ligaments.py`; a single case:

```sh
kneejax simulate passive-flexion --knee four_ligament --cut ACL --load anterior_N=100
```

A cell lists the flexions 0, 30, 60 and 90 degrees:

| sign | what it means |
|---|---|
| `b` | balanced |
| `o` | balanced, with contact off the fitted surfaces |
| `s` | balanced, with a fibre beyond its failure strain: it would have torn |
| `w` | balanced, with a fibre that is doubtful at its wrap object |
| `D` | dislocated |
| `T` | bone through bone |
| 44 | limit point at this part of the load, in per cent: the stiffness became singular |
| `D44` | beyond this part of the load no equilibrium was found; the sign is the status there |
| `-` | no equilibrium without the load |
"""
LETTERS = {
    Status.BALANCED: "b", Status.OUTSIDE_REGION: "o", Status.OVERSTRETCHED: "s",
    Status.WAY_FLIPPED: "w", Status.PAST_WRAP: "w", Status.WRAP_INSIDE: "w",
    Status.UNSTABLE: "u", Status.DISLOCATED: "D", Status.TOO_DEEP: "T", Status.NO_PATCH: "o",
    Status.THROUGH_BONE: "T",
}  # fmt: skip


def cut_by_factor(knee: kj.Knee, factors) -> kj.Knee:
    """A knee whose fibres pull by a factor each: 1 whole, 0 cut. A fibre cut does not tear."""
    law = knee.ligaments
    return eqx.tree_at(
        lambda k: (k.ligaments.stiffness, k.ligaments.failure_strain),
        knee,
        (law.stiffness * factors, jnp.where(factors > 0, law.failure_strain, jnp.inf)),
    )


def outcomes(knee: kj.Knee) -> tuple[np.ndarray, ...]:
    """Status, part of the load that was held, and what the last pose was: `(cuts, loads, angles)`.
    """
    fibres = knee.ligaments.names
    groups = {**{name: (name,) for name in fibres}, **dict(knee.groups)}
    factors = np.array(
        [[not any(f in groups[name] for name in gone) for f in fibres] for gone in CUTS], float
    )
    sizes = {name: np.zeros((len(LOADS), len(ANGLES_DEG))) for name in NAMED_LOADS}
    for row, (name, size) in enumerate(LOADS):
        sizes[name][row] = size
    load = load_of(**{name: array.ravel() for name, array in sizes.items()})
    load_cases = LoadCases.at(np.tile(ANGLES_DEG, len(LOADS)), [load])
    found = balance_many(knee, cut_by_factor, factors, load_cases)
    shape = len(CUTS), len(LOADS), len(ANGLES_DEG)
    return tuple(x.reshape(shape) for x in (found.status, found.reached, found.fault))


def table(knee: kj.Knee) -> str:
    """One row a cut, one column a load."""
    found = outcomes(knee)
    words = [f"{name.split('_')[0]} {size:+g} {NAMED_LOADS[name].unit}" for name, size in LOADS]
    lines = [f"\n## {knee.name}\n", f"| cut | {' | '.join(words)} |", f"|---{'|---' * len(words)}|"]
    for gone, *of_cut in zip(CUTS, *found, strict=True):
        cells = [
            " ".join(_cell(Status(s), held, Status(f)) for s, held, f in zip(*at, strict=True))
            for at in zip(*of_cut, strict=True)
        ]
        lines.append(f"| {', '.join(gone) or 'none'} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _cell(status: Status, held: float, fault: Status) -> str:
    if status.converged:
        return LETTERS[status]
    if held == 0.0:
        return "-"
    sign = "" if status is Status.GIVES_WAY else LETTERS.get(fault, "x")
    return f"{sign}{100 * held:.0f}"


if __name__ == "__main__":
    names = sys.argv[1:] or KNEES
    PAGE.write_text(INTRODUCTION + "".join(table(kj.load_knee(name)) for name in names))
