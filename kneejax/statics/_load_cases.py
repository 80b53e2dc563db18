"""Where a knee is balanced: what is prescribed at each place, with loads of its own."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import TIBIA, Prescribed, free_of, prescribed_of
from kneejax.mechanics import GROOD_SUNTAY, Knee, Load, Pull, Support
from kneejax.numerics import traced

#: Name of loads whose own does not matter.
_PLAIN = "load"


class LoadCases(eqx.Module):
    """What is prescribed, with loads that act besides those of the knee; the first axis counts.

    Attributes:
        prescribed: coordinate -> its value, `(load_cases,)`, rad or mm. All others are free.
        loads: arrays of shape `(load_cases, 3)`, N, N mm and mm; of a pull, `(load_cases, lines,
            ...)`.
        begin: flexion at which the knee is loaded before the others are prescribed and, where it is
            free, before it is let go, rad, `(load_cases,)`; None where flexion is prescribed.
        supports: what still holds coordinates that are being let go.
        later: how many of the loads, the last ones, begin to act only once a machine holds what is
            held. The others act before it takes hold.
        bodies: that move; those of the knee (`of`).

    Example:
        >>> import numpy as np
        >>> from kneejax.mechanics import load_of
        >>> drawer = LoadCases.at([20.0, 20.0], [load_of(anterior_N=np.array([-90.0, 90.0]))])
        >>> len(drawer), drawer.loads[0].moment.shape
        (2, (2, 3))
        >>> LoadCases.at(20.0, held={"anterior_mm": [-5.0, 0.0, 5.0]}).free
        ('adduction', 'internal_rotation', 'superior', 'lateral')
    """

    prescribed: Prescribed
    loads: tuple[Load | Pull, ...] = ()
    begin: Array | None = None
    supports: tuple[Support, ...] = ()
    later: int = eqx.field(static=True, default=0)
    bodies: tuple[str, ...] = eqx.field(static=True, default=(TIBIA,))

    @classmethod
    def at(
        cls,
        flexion_deg: ArrayLike,
        loads: Sequence[Load | Pull] = (),
        held: Mapping[str, ArrayLike] | None = None,
        flexion_is_free: bool = False,
    ) -> LoadCases:
        """Load cases at angles in degrees; numbers are repeated where one serves all.

        Args:
            flexion_deg: prescribed, `(load_cases,)` or one; where it is free, that of the
                beginning.
            loads: see `kneejax.mechanics.load_of` and `pull_of`.
            held: column -> value of further prescribed coordinates, degrees or mm, e.g.
                `{"anterior_mm": 5.0}`; see `kneejax.geometry.COLUMNS`. `drawer_mm` is the anterior
                translation in axes turned by flexion.
            flexion_is_free: whether flexion balances too.

        Raises:
            ValueError: a column is unknown, flexion stands among them, a drawer is held while
                flexion is free, which turns its axis, no angle is given, or one is no number.
        """
        _check_numbers({"flexion_deg": flexion_deg, **(held or {})})
        values = prescribed_of({"flexion_deg": flexion_deg, **_but_flexion(held or {})})
        rows = [jnp.atleast_1d(x) for x in values.values()]
        rows += [jnp.zeros(load.sizes.shape[:-1] or (1,)) for load in loads]
        size = jnp.broadcast_shapes(*(row.shape for row in rows))
        values = {name: jnp.broadcast_to(x, size) for name, x in values.items()}
        everywhere = tuple(load.at_each(size) for load in loads)
        if not flexion_is_free:
            return cls(values, everywhere)
        begin = values.pop("flexion")
        if "drawer" in values or "lift" in values:
            raise ValueError("drawer_mm is held while flexion is free: expected anterior_mm")
        return cls(values, everywhere, begin)

    def __len__(self) -> int:
        return len(self.flexion)

    @property
    def flexion(self) -> Array:
        """Flexion, prescribed or that of the beginning, rad, `(load_cases,)`."""
        return self.prescribed["flexion"] if self.begin is None else self.begin

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the free coordinates."""
        return free_of(self.prescribed, self.bodies)

    @property
    def by_flexion(self) -> bool:
        """Whether flexion, and nothing else, is prescribed."""
        return tuple(self.prescribed) == ("flexion",)

    def take(self, rows: ArrayLike) -> LoadCases:
        """Some of the load cases, in the order of `rows`."""
        return jax.tree.map(lambda x: x[jnp.asarray(rows)], self)

    def loaded(self) -> LoadCases:
        """Where the knee is loaded with flexion alone prescribed: from there the others move."""
        first = len(self.loads) - self.later
        still = (load.times(0.0) for load in self.loads[first:])
        acting = (*self.loads[:first], *still)
        return LoadCases({"flexion": self.flexion}, acting, bodies=self.bodies)

    def of(self, knee: Knee) -> LoadCases:
        """The same load cases, of all that moves in a knee."""
        same = self.bodies == knee.bodies
        return self if same else dataclasses.replace(self, bodies=knee.bodies)

    def plain(self) -> LoadCases:
        """The same with at least one load and without names: one compiled program serves more."""
        named = [load for load in self.loads if isinstance(load, Load) and load.name != _PLAIN]
        if self.loads and not named:
            return self
        nothing = Load(jnp.zeros((len(self), 3)), jnp.zeros((len(self), 3)),
                       jnp.zeros((len(self), 3)), axes=GROOD_SUNTAY)  # fmt: skip
        loads = self.loads or (nothing,)
        plain = tuple(
            dataclasses.replace(x, name=_PLAIN) if isinstance(x, Load) else x for x in loads
        )
        return dataclasses.replace(self, loads=plain)

    def load(self, knee: Knee) -> Knee:
        """A knee whose leaves end in lanes, one lane a load case, with these loads added."""
        return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -1), self).added_to(knee)

    def added_to(self, knee: Knee) -> Knee:
        """As `load`, where the arrays of these load cases end in lanes."""
        pulls = [load for load in self.loads if isinstance(load, Pull)]
        more, ends = {}, {}
        for pull in pulls:
            for row, name in enumerate(pull.lines):
                more[name] = more.get(name, 0.0) + pull.tension[row]
                if pull.ends is not None:
                    ends[name] = pull.ends[row]
        lines = tuple(
            dataclasses.replace(line, tension=line.tension + more.get(line.name, 0.0))
            for line in knee.lines
        )
        muscles = knee.muscles
        if muscles is not None and pulls:
            muscles = muscles.pulling(more)
            muscles = muscles.ending(ends) if ends else muscles
        wrenches = (load for load in self.loads if isinstance(load, Load))
        return dataclasses.replace(
            knee,
            lines=lines,
            muscles=muscles,
            loads=(*knee.loads, *wrenches, *self.supports),
        )


def _check_numbers(columns: Mapping[str, ArrayLike]) -> None:
    """Refuse what is prescribed where it is nothing, or no number."""
    for name, values in columns.items():
        if traced(values):
            continue
        values = np.atleast_1d(np.asarray(values, float))
        if not values.size:
            raise ValueError(f"{name} is empty: expected one value at least")
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            place = f", value {wrong[0] + 1} of {values.size}" if values.size > 1 else ""
            raise ValueError(f"{name} is {values.flat[wrong[0]]}{place}: expected a number")


def _but_flexion(held: Mapping[str, ArrayLike]) -> Mapping[str, ArrayLike]:
    if "flexion_deg" in held:
        raise ValueError("flexion_deg stands among what is held: give it as flexion_deg itself")
    return held
