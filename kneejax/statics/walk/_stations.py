"""Where a knee is balanced: prescribed flexions, each with loads of its own."""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.mechanics import GROOD_SUNTAY, Knee, Load


class Stations(eqx.Module):
    """Prescribed flexions with loads that act besides those of the knee; the first axis counts.

    Attributes:
        flexion: rad, `(stations,)`.
        loads: arrays of shape `(stations, 3)`, N, N mm and mm.

    Example:
        >>> import numpy as np
        >>> from kneejax.mechanics import load_of
        >>> drawer = Stations.at([20.0, 20.0], [load_of(anterior_N=np.array([-90.0, 90.0]))])
        >>> len(drawer), drawer.loads[0].moment.shape
        (2, (2, 3))
    """

    flexion: Array
    loads: tuple[Load, ...] = ()

    @classmethod
    def at(cls, flexion_deg: ArrayLike, loads: tuple[Load, ...] | list[Load] = ()) -> Stations:
        """Stations at angles in degrees; numbers of loads are repeated where one serves all."""
        flexion = jnp.deg2rad(jnp.atleast_1d(jnp.asarray(flexion_deg, float)))
        everywhere = [
            jax.tree.map(lambda x: jnp.broadcast_to(x, (*flexion.shape, 3)), load) for load in loads
        ]
        return cls(flexion, tuple(everywhere))

    def __len__(self) -> int:
        return self.flexion.shape[0]

    def take(self, rows: ArrayLike) -> Stations:
        """Some of the stations, in the order of `rows`."""
        return jax.tree.map(lambda x: x[jnp.asarray(rows)], self)

    def plain(self) -> Stations:
        """The same with at least one load and without names: one compiled program serves more."""
        nothing = Load(jnp.zeros((len(self), 3)), jnp.zeros((len(self), 3)),
                       jnp.zeros((len(self), 3)), axes=GROOD_SUNTAY)  # fmt: skip
        loads = self.loads or (nothing,)
        return Stations(
            self.flexion, tuple(dataclasses.replace(x, name="load") for x in loads)
        )

    def load(self, knee: Knee) -> Knee:
        """A knee whose leaves end in lanes, one lane a station, with these loads added."""
        loads = jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), self.loads)
        return dataclasses.replace(knee, loads=(*knee.loads, *loads))
