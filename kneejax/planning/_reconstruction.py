"""Grafts, and a knee reconstructed with them.

Wilson's and Woo's numbers were compared with their abstracts, Shani's with a table that quotes them
(Int J Sports Phys Ther 18, 2023, 493: 370 to 466 N/mm and 1450 to 2186 N, with a bone block).

A graft is a fibre whose pull is either elastic or, while a surgeon tightens it, a given tension:
it stands among the ligaments and among the muscles, and one of both is nothing. So the intact knee,
the knee at fixation and the reconstructed knee are variants of one structure, found by one program.
"""

__all__ = ["GRAFTS", "Reconstruction", "reconstruction_of"]

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import FEMUR_AND_TIBIA
from kneejax.mechanics import BLANKEVOORT, Knee, Ligaments, Muscles
from kneejax.parameters import fibre_rows

#: Length to which a measured stiffness belongs, mm: between the tunnels' mouths a graft is about as
#: long as the ligament that it replaces. A longer free length makes it softer in proportion.
FREE_LENGTH_MM = 30.0
#: Strain at which the toe of the law ends, as of the ligaments of papers 1 to 3.
TRANSITION_STRAIN = 0.06
#: Rounding of the law's corners, in strain; a force errs by at most 0.03 N.
TRANSITION_WIDTH = 0.0001


class GraftType(NamedTuple):
    """A kind of graft."""

    name: str  # in plans and tables
    says: str  # what it is, in a phrase
    stiffness_N_per_mm: float  # of the whole graft
    failure_N: float  # load at which it failed
    source: str  # who measured both

    @property
    def stiffness_N(self) -> float:
        """N per unit strain, at `FREE_LENGTH_MM`."""
        return self.stiffness_N_per_mm * FREE_LENGTH_MM


#: Name -> graft. Means of human tissue; single grafts differ by a quarter and more.
GRAFTS = {
    graft.name: graft
    for graft in (
        GraftType(
            "hamstring", "semitendinosus and gracilis, each looped once: four strands", 238.0,
            2422.0, "Wilson et al., American Journal of Sports Medicine 27 (1999), matched pairs",
        ),
        GraftType(
            "patellar_tendon", "middle third of the patellar tendon with its bone blocks", 210.0,
            1784.0, "Wilson et al., American Journal of Sports Medicine 27 (1999), matched pairs",
        ),
        GraftType(
            "quadriceps_tendon", "full thickness of the quadriceps tendon with a bone block",
            466.0, 2186.0, "Shani et al., Arthroscopy 32 (2016), as quoted by others",
        ),
        GraftType(
            "native", "the anterior cruciate ligament of young adults, for comparison", 242.0,
            2160.0, "Woo et al., American Journal of Sports Medicine 19 (1991)",
        ),
    )
}  # fmt: skip


#: Numbers of a bundle; before them all stands how much of the torn ligament acts.
BUNDLE_NUMBERS = 9


@dataclasses.dataclass(frozen=True)
class Operated:
    """Makes a knee of its numbers; hashable, since it steers compiling.

    A value is `1 + 9 x bundles` numbers: whether the torn ligament acts (1) or not (0), then of
    each bundle its femoral and its tibial end (3 each, mm), slack length (mm), stiffness (N per
    unit strain) and given tension (N).
    """

    torn: tuple[int, ...]  # rows of the ligament's own fibres
    grafts: tuple[int, ...]  # rows of the grafts among the ligaments
    pulls: tuple[int, ...]  # and among the muscles

    def __call__(self, knee: Knee, value: Any) -> Knee:
        """The knee with these numbers."""
        value = jnp.asarray(value)
        bundle = value[1:].reshape(len(self.grafts), BUNDLE_NUMBERS)
        slack, stiffness, tension = bundle[:, 6], bundle[:, 7], bundle[:, 8]
        own, pulls = knee.ligaments, knee.muscles
        assert pulls is not None
        put = functools.partial(_put, self.grafts)
        torn = np.isin(np.arange(len(own.names)), self.torn)
        acts = jnp.where(torn, value[0] * own.stiffness, own.stiffness)
        # What does not act does not tear.
        tears = jnp.where(torn & (value[0] == 0.0), jnp.inf, own.failure_strain)
        idle = jnp.where(stiffness > 0.0, own.failure_strain[-1], jnp.inf)
        ligaments = eqx.tree_at(
            lambda x: (x.femoral_attachment, x.tibial_attachment, x.slack_length, x.stiffness,
                       x.failure_strain),
            own,
            (put(own.femoral_attachment, bundle[:, :3]), put(own.tibial_attachment, bundle[:, 3:6]),
             put(own.slack_length, slack), put(acts, stiffness), put(tears, idle)),
        )  # fmt: skip
        put = functools.partial(_put, self.pulls)
        muscles = eqx.tree_at(
            lambda x: (x.femoral_attachment, x.tibial_attachment, x.tension),
            pulls,
            (put(pulls.femoral_attachment, bundle[:, :3]),
             put(pulls.tibial_attachment, bundle[:, 3:6]), put(pulls.tension, tension)),
        )  # fmt: skip
        return dataclasses.replace(knee, ligaments=ligaments, muscles=muscles)


def _put(rows: tuple[int, ...], array: Array, new: Array) -> Array:
    """An array with other rows in some places.

    By masks and sums: where such arrays are scattered, XLA 0.10 aborts the process.
    """
    where = np.arange(len(array))[:, None] == np.array(rows)
    across = (slice(None), *(None,) * (array.ndim - 1))
    spread = sum(where[:, k][across] * new[k] for k in range(len(rows)))
    return jnp.where(where.any(axis=1)[across], spread, array)


@dataclasses.dataclass(frozen=True)
class Reconstruction:
    """A knee in which a ligament is to be replaced.

    Attributes:
        knee: with the grafts' fibres, whose numbers mean nothing until `vary` sets them.
        vary: sets them.
        ligament: that is replaced, a fibre or a group.
        torn: names of the ligament's own fibres.
        bundles: names of the grafts.
        stiffness_N: of each bundle, N per unit strain.
        failure_N: of each bundle.
    """

    knee: Knee
    vary: Operated
    ligament: str
    torn: tuple[str, ...]
    bundles: tuple[str, ...]
    stiffness_N: tuple[float, ...]
    failure_N: tuple[float, ...]

    @property
    def others(self) -> tuple[str, ...]:
        """Fibres that neither are torn nor grafts."""
        gone = {*self.torn, *self.bundles}
        return tuple(name for name in self.knee.ligaments.names if name not in gone)

    def rows(self, names: Sequence[str]) -> np.ndarray:
        """Rows of some fibres."""
        return np.array([self.knee.ligaments.names.index(name) for name in names], int)

    def value(
        self, ends: np.ndarray, slack_mm: np.ndarray | float = 1.0, tension_N: Any = 0.0,
        elastic: bool = True, torn: bool = True,
    ) -> np.ndarray:
        """Numbers of variants.

        Args:
            ends: femoral and tibial, `(variants, bundles, 6)`, mm.
            slack_mm: slack lengths, `(variants, bundles)` or one.
            tension_N: given tensions, likewise.
            elastic: whether the grafts' springs act.
            torn: whether the ligament itself is gone.

        Returns:
            `(variants, numbers)`.
        """  # fmt: skip
        shape, springs = ends.shape[:2], np.array(self.stiffness_N) if elastic else 0.0
        each = (np.broadcast_to(x, shape)[..., None] for x in (slack_mm, springs, tension_N))
        bundles = np.concatenate([ends, *each], axis=-1).reshape(shape[0], -1)
        return np.hstack([np.full((shape[0], 1), 0.0 if torn else 1.0), bundles])


def reconstruction_of(
    knee: Knee, ligament: str = "ACL", bundles: int = 1, stiffness_N: float = 7140.0,
    failure_N: float = 2422.0,
) -> Reconstruction:  # fmt: skip
    """Put grafts in the place of a ligament; several share stiffness and strength evenly.

    Args:
        knee: any knee.
        ligament: that is torn: a fibre or a group of fibres.
        bundles: of the graft.
        stiffness_N: of the whole graft, N per unit strain.
        failure_N: load at which the whole graft fails.

    Raises:
        UnknownParameter: the knee has no such ligament.

    Example:
        >>> import kneejax as kj
        >>> reconstruction_of(kj.load_knee("ten_bundle")).others[:2]
        ('aPCL', 'pPCL')
    """
    rows = fibre_rows(knee, ligament)
    own, row = knee.ligaments, rows[0]
    names = ("graft",) if bundles == 1 else tuple(f"graft{k + 1}" for k in range(bundles))
    stiffness, failure = stiffness_N / bundles, failure_N / bundles

    def more(x: Array, value: float | None = None) -> Array:
        """With rows of the grafts at the end: those of the ligament's first fibre, or a value."""
        new = x[row] if value is None else jnp.full_like(x[row], value)
        return jnp.concatenate([x, jnp.broadcast_to(new, (bundles, *jnp.shape(x)[1:]))])

    with_grafts = Ligaments(
        more(own.femoral_attachment), more(own.tibial_attachment), more(own.stiffness, 0.0),
        more(own.slack_length), more(own.transition_strain, TRANSITION_STRAIN),
        more(own.transition_width, TRANSITION_WIDTH), (*own.names, *names), own.courses,
        more(own.failure_strain, failure / stiffness + 0.5 * TRANSITION_STRAIN),
        (*own.bodies, *(FEMUR_AND_TIBIA,) * bundles), more(own.damping, 0.0), own.dampers,
        more(own.area, 0.0), (*own.laws, *(BLANKEVOORT,) * bundles),
    )  # fmt: skip
    femoral, tibial = (
        jnp.tile(x[row], (bundles, 1)) for x in (own.femoral_attachment, own.tibial_attachment)
    )
    pulls = Muscles(femoral, tibial, jnp.zeros(bundles), names)
    first, pulled = len(own.names), 0
    if knee.muscles is not None:
        pulls, pulled = knee.muscles.with_more(pulls), len(knee.muscles.names)
    groups = (*knee.groups, ("graft", names)) if bundles > 1 else knee.groups
    grafts, lines = range(first, first + bundles), range(pulled, pulled + bundles)
    return Reconstruction(
        dataclasses.replace(knee, ligaments=with_grafts, muscles=pulls, groups=groups),
        Operated(tuple(rows), tuple(grafts), tuple(lines)), ligament,
        tuple(own.names[row] for row in rows), names, (stiffness,) * bundles, (failure,) * bundles,
    )  # fmt: skip
