"""Load cases, and what varies between the knees of a batch.

What may vary is a function of the caller's. If searches took it along, each choice of parameters
would compile them anew (9 s); they take the numbers that it changes, and stiffness and slack length
of all ligaments always, so that one program serves every choice among those.
"""

__all__ = ["LoadCases", "Vary", "in_lanes"]

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.flatten_util import ravel_pytree
from jax.typing import ArrayLike

from kneejax.geometry import TIBIA, Prescribed, free_of, prescribed_of
from kneejax.mechanics import GROOD_SUNTAY, Knee, Load, Pull, Support
from kneejax.numerics import numpy_for, traced

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
    ) -> "LoadCases":
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
                flexion is free, which turns its axis, no angle is given, one is no number, or
                `loads` is no list of loads.
        """
        held = held or {}
        if not (isinstance(loads, Sequence) and all(isinstance(x, Load | Pull) for x in loads)):
            one = "[kj.load_of(anterior_N=100.0)]"
            raise ValueError(f"loads: {type(loads).__name__}: expected a list of loads, as {one}")
        _check_numbers({**held, "flexion_deg": flexion_deg})
        if "flexion_deg" in held:
            raise ValueError("flexion_deg stands among what is held: give it as flexion_deg itself")
        values = prescribed_of({"flexion_deg": flexion_deg, **held})
        shapes = [jnp.shape(x) or (1,) for x in values.values()]
        shapes += [load.sizes.shape[:-1] or (1,) for load in loads]
        size, xp = jnp.broadcast_shapes(*shapes), numpy_for(values)
        values = {n: jnp.asarray(xp.broadcast_to(x, size), float) for n, x in values.items()}
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

    def take(self, rows: ArrayLike) -> "LoadCases":
        """Some of the load cases, in the order of `rows`, or those of a mask."""
        # By NumPy: JAX would compile a program for each number of them.
        xp = numpy_for(self, rows)
        taken = xp.asarray(rows)
        taken = taken if taken.size else taken.astype(int)
        return jax.tree.map(lambda x: xp.asarray(x)[taken], self)

    def loaded(self) -> "LoadCases":
        """Where the knee is loaded with flexion alone prescribed: from there the others move."""
        first = len(self.loads) - self.later
        still = (load.times(0.0) for load in self.loads[first:])
        acting = (*self.loads[:first], *still)
        return LoadCases({"flexion": self.flexion}, acting, bodies=self.bodies)

    def of(self, knee: Knee) -> "LoadCases":
        """The same load cases, of all that moves in a knee."""
        same = self.bodies == knee.bodies
        return self if same else dataclasses.replace(self, bodies=knee.bodies)

    def plain(self) -> "LoadCases":
        """The same with at least one load and without names: one compiled program serves more."""
        named = [load for load in self.loads if isinstance(load, Load) and load.name != _PLAIN]
        if self.loads and not named:
            return self
        nothing = np.zeros((len(self), 3))
        loads = self.loads or (Load(nothing, nothing, nothing, axes=GROOD_SUNTAY),)
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
        wrenches = [load for load in self.loads if isinstance(load, Load)]
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
        loads = (*knee.loads, *wrenches, *self.supports)
        return dataclasses.replace(knee, lines=lines, muscles=muscles, loads=loads)


def _check_numbers(columns: Mapping[str, ArrayLike]) -> None:
    """Refuse what is prescribed where it is nothing, or no number."""
    for name, values in columns.items():
        if traced(values):
            continue
        try:
            values = np.atleast_1d(np.asarray(values, float))
        except (TypeError, ValueError):
            raise ValueError(f"{name} is {values}: expected numbers") from None
        if values.ndim > 1:
            said = "expected one value, or a list of one for each pose"
            raise ValueError(f"{name} has the shape {values.shape}: {said}")
        if not values.size:
            raise ValueError(f"{name} is empty: expected one value at least")
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            place = f", value {wrong[0] + 1} of {values.size}" if values.size > 1 else ""
            raise ValueError(f"{name} is {values.flat[wrong[0]]}{place}: expected a number")


#: A function `(knee, value) -> knee` of the same structure; hashable, since it steers compiling.
Vary = Callable[[Knee, Any], Knee]

#: Variants whose numbers are computed in one call.
_CHUNK = 256


@dataclasses.dataclass(frozen=True)
class Variants:
    """Variants of one knee."""

    knee: Knee  # without a lane axis; its contacts' points are placed where contacts do not vary
    numbers: dict[int, np.ndarray]  # leaves that vary, by their places; the first axis counts

    @classmethod
    def of(cls, knee: Knee, vary: Vary, values: Any) -> "Variants":
        """Variants by their values, whose leaves begin with the variant."""
        values = jax.tree.map(np.asarray, values)
        count, parts = len(jax.tree.leaves(values)[0]), []
        for first in range(0, count, _CHUNK):
            rows = np.minimum(np.arange(first, first + _CHUNK), count - 1)
            some = jax.tree.map(lambda x, rows=rows: x[rows], values)
            parts.append(_numbers(vary, knee, some))
        leaves = parts[0] if parts else {}
        numbers = {leaf: np.concatenate([part[leaf] for part in parts])[:count] for leaf in leaves}
        nothing = jax.tree.map(lambda _: False, knee)
        of_contacts = jax.tree.map(lambda _: True, knee.contacts)
        marks = jax.tree.leaves(dataclasses.replace(nothing, contacts=of_contacts))
        still = not any(marks[leaf] for leaf in numbers)
        return cls(knee.for_many_poses() if still else knee, numbers)

    def __len__(self) -> int:
        return len(next(iter(self.numbers.values()), ()))

    def take(self, rows: np.ndarray) -> "Variants":
        """Some of the variants."""
        return Variants(self.knee, {k: x[rows] for k, x in self.numbers.items()})


@partial(jax.jit, static_argnums=0)
def _numbers(vary: Vary, knee: Knee, values: Any) -> dict[int, jax.Array]:
    def of_one(value: Any) -> dict[int, jax.Array]:
        springs = knee.ligaments.stiffness, knee.ligaments.slack_length
        pairs = zip(jax.tree.leaves(knee), jax.tree.leaves(vary(knee, value)), strict=True)
        # A number that `vary` leaves alone is handed through as the very same array.
        return {
            leaf: new
            for leaf, (old, new) in enumerate(pairs)
            if old is not new or any(old is spring for spring in springs)
        }

    return jax.vmap(of_one)(values)


def _with_numbers(knee: Knee, numbers: Mapping[int, Any]) -> Knee:
    """A knee with leaves by their places whose arrays end in lanes; one lane for all others."""
    leaves, structure = jax.tree.flatten(knee)
    lanes = (
        numbers[place] if place in numbers else jnp.asarray(x)[..., None]
        for place, x in enumerate(leaves)
    )
    return jax.tree.unflatten(structure, lanes)


def in_lanes(knee: Knee, vary: Vary, values: Any) -> Knee:
    """The knee with a lane for each value; numbers that do not vary have one lane for all, but
    stiffness and slack length of all ligaments have their own.

    Args:
        knee: without a lane axis.
        vary: see `Vary`.
        values: leaves begin with the lane.

    Returns:
        A knee whose leaves end in lanes.

    Example:
        >>> from kneejax.files import load_knee
        >>> from kneejax.parameters import select
        >>> knee = load_knee("four_ligament")
        >>> chosen = select(knee, ["ACL.stiffness"])
        >>> lanes = in_lanes(knee, chosen.apply, np.array([[4000.0], [6000.0]]))
        >>> lanes.ligaments.stiffness.shape
        (4, 2)
    """
    numbers = _numbers(vary, knee, values)
    return _with_numbers(knee, {leaf: jnp.moveaxis(x, 0, -1) for leaf, x in numbers.items()})


class Case(NamedTuple):
    """A load case of a knee of its own: the numbers that vary by their places, what acts there."""

    numbers: dict[int, Any]
    load_cases: LoadCases

    def of(self, rows: Array) -> "Case":
        """Those of rows `(numbers, lanes)`, which were made of cases like this one."""
        return jax.vmap(ravel_pytree(self)[1], in_axes=-1, out_axes=-1)(rows)

    def knees(self, knee: Knee) -> Knee:
        """With their loads; of a case whose arrays end in lanes."""
        return self.load_cases.added_to(_with_numbers(knee, self.numbers)).for_many_poses()

    def rows_of(self, some: Any) -> np.ndarray:
        """Which rows are numbers of this case's own arrays, `(numbers, 1)`."""
        chosen = {id(x) for x in jax.tree.leaves(some)}
        marks = jax.tree.map(lambda x: np.full(np.shape(x), id(x) in chosen), self)
        return in_rows(marks, 0)[:, None]


def in_rows(tree: Any, axes: int) -> Any:
    """All numbers of arrays that begin with the same axes, beside each other: `(..., numbers)`."""
    leaves = jax.tree.leaves(tree)
    numpy = np if all(isinstance(x, np.ndarray) for x in leaves) else jnp
    return numpy.concatenate([x.reshape(*x.shape[:axes], -1) for x in leaves], axis=-1)
