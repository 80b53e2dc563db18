"""Passive flexion, and other ways to bend a knee."""

__all__ = ["Motion", "Way", "flipped", "near_flip", "passive_flexion", "ways_of", "with_flips"]

import dataclasses
import enum
from collections.abc import Iterable, Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments._evaluate import Mechanics
from kneejax.geometry import COLUMNS, COORDINATES, Pose, convert, coordinate, scales, table_units
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import Named, WrongValue, compiled, imported, numpy_for, traced
from kneejax.parameters import fibre_rows
from kneejax.statics import (
    Equilibria,
    Equilibrium,
    LoadCases,
    Status,
    balance_near,
    balance_one,
    continued_in_trace,
    differentiable,
    equilibrium_of,
    force_along,
    itself,
)

# Two ways around whose lengths differ by less compete, mm.
_CLOSE_MM = 0.5


class Way(enum.IntEnum):
    """How a fibre runs at a pose; what that makes of the pose, its `Status` says.

    A small motion may flip a fibre that is `NEAR_FLIP`: its ways around both sides of the obstacle
    are nearly as long.
    """

    STRAIGHT = 0
    FREE = 1
    WRAPPED = 2
    NEAR_FLIP = 3
    FLIPPED = 4
    BEYOND_ENDS = 5
    INSIDE = 6

    @property
    def word(self) -> str:
        """Name for tables."""
        return self.name.lower()


def ways_of(found: Mechanics) -> np.ndarray:
    """How each fibre runs at each pose.

    Args:
        found: of poses that follow each other; a fibre is compared with the pose before.

    Returns:
        `Way` values, `(poses, ligaments)`.
    """
    wrapped, side = np.asarray(found.wrap_angle) > 0, np.asarray(found.wrap_side)
    where = {
        Way.INSIDE: np.asarray(found.wrap_inside), Way.STRAIGHT: (side == 0.0).all(axis=-1),
        Way.BEYOND_ENDS: np.asarray(found.wrap_beyond), Way.FLIPPED: flipped(found),
        Way.NEAR_FLIP: near_flip(found), Way.WRAPPED: wrapped,
    }  # fmt: skip
    return np.select([*where.values()], [*where], Way.FREE)


def near_flip(found: Mechanics) -> np.ndarray:
    """Whose ways around both sides are nearly as long, `(poses, ligaments)`."""
    return (np.asarray(found.wrap_angle) > 0) & (np.asarray(found.other_side) < _CLOSE_MM)


def flipped(found: Mechanics) -> np.ndarray:
    """Which fibres pass their obstacle on the other side than at the pose before.

    Args:
        found: of poses that follow each other.

    Returns:
        Truth values, `(poses, ligaments)`.
    """
    wrapped, side = np.asarray(found.wrap_angle) > 0, np.asarray(found.wrap_side)
    turned = np.zeros_like(wrapped)
    # Only a fibre that lies on its obstacle at both poses can change sides by a jump.
    turned[1:] = wrapped[1:] & wrapped[:-1] & ((side[1:] * side[:-1]).sum(axis=-1) < 0.0)
    return turned


def with_flips(status: ArrayLike, found: Mechanics) -> np.ndarray:
    """Status of poses that follow each other: a fibre is compared with the pose before.

    Args:
        status: of each pose by itself, `(poses,)`.
        found: their mechanics.

    Returns:
        `Status` values, `way_flipped` where that is the worst.
    """
    status = np.asarray(status)
    jumps = flipped(found).any(axis=1) & (status < Status.WAY_FLIPPED)
    return np.where(jumps, int(Status.WAY_FLIPPED), status)


class Motion(eqx.Module, Named):
    """Balanced poses of a knee, one after the other.

    Attributes:
        flexion_deg: prescribed or, where it is free, that at which a pose was begun, `(poses,)`.
        pose: fields of shape `(poses,)`; NaN where the search failed.
        status: `Status` value of each pose.
        residual_force: largest unbalanced force, `(poses,)`, N; where the search failed, what it
            left.
        residual_moment: largest unbalanced moment, `(poses,)`, N mm; likewise.
        left_mm: how far the search ended from a balance, `(poses,)`, mm (rotations at 30 mm).
        reached: part of the load, or of the way to what is held, under which the knee still
            balanced, `(poses,)`.
        stable: `(poses,)`.
        equilibrium: the solution in full, for further derivatives.
        knee: that moved; without a lane axis.
        load_cases: what was asked for.
    """

    flexion_deg: Array
    pose: Pose
    status: Array
    residual_force: Array
    residual_moment: Array
    left_mm: Array
    reached: Array
    stable: Array
    equilibrium: Equilibrium
    knee: Knee
    load_cases: LoadCases

    def to_table(self, convention: str = "femoral") -> Array:
        """Poses in rows of degrees and mm.

        Args:
            convention: what the columns mean, one of `kneejax.geometry.CONVENTIONS`;
                `grood-suntay` for clinical translations.

        Returns:
            `(poses, 6)`, in the order of `kneejax.geometry.COLUMNS`.
        """
        if convention == "femoral":
            return self.pose.to_table()
        found = convert(self.equilibrium.state.at(COORDINATES), "femoral", convention)
        rows = numpy_for(found).asarray(found).T * table_units(COORDINATES)
        return jnp.asarray(rows, float)

    def tension(self, name: str) -> Array:
        """Tension of a ligament, the sum over its fibres.

        Args:
            name: of a fibre or of a group of fibres, e.g. `ACL`; `*` stands for any letters.

        Returns:
            N, `(poses,)`; NaN where the search failed.

        Raises:
            UnknownParameter: the knee has no fibre of this name.

        Example:
            >>> import kneejax as kj
            >>> motion = kj.passive_flexion(kj.load_knee("four_ligament"), [0.0, 30.0])
            >>> motion.tension("ACL").shape
            (2,)
        """
        rows = fibre_rows(self.knee, name)
        every = add_lane_axis(self.knee.ligaments).tension(self.equilibrium.state)
        return jnp.sum(every[jnp.array(rows)], axis=0)

    def reaction(self, name: str) -> Array:
        """What holds a prescribed coordinate: the force that a machine must exert along it.

        Args:
            name: of a prescribed coordinate, e.g. `anterior`; see `kneejax.geometry.COORDINATES`.

        Returns:
            N of a translation, N mm of a rotation, `(poses,)`, positive where it pushes towards
            more of the coordinate; NaN where the search failed.

        Raises:
            ValueError: the coordinate is free, so nothing holds it.

        Example:
            >>> import kneejax as kj
            >>> held = {"anterior_mm": [0.0, 3.0]}
            >>> motion = kj.passive_flexion(kj.load_knee("four_ligament"), 30.0, held=held)
            >>> force_N = motion.reaction("anterior")
            >>> bool(force_N[1] > force_N[0])
            True
        """
        if name not in self.load_cases.prescribed:
            known = ", ".join(self.load_cases.prescribed)
            raise WrongValue("name", repr(name), f"one that is prescribed: {known}")
        if traced(self):
            return _reaction(name, self.knee, self.load_cases, self.equilibrium)
        row = sorted(self.load_cases.prescribed).index(name)
        return jnp.where(self.equilibrium.converged, self.equilibrium.reaction[row], jnp.nan)

    def to_dataframe(self) -> Any:
        """The poses as a table of pandas, with status and, where something is held, its reaction.

        Returns:
            A `pandas.DataFrame`: columns of `kneejax.geometry.COLUMNS` in degrees and mm, `status`
            in words, and `reaction_NAME_N` or `reaction_NAME_Nm` of what is held besides flexion.

        Raises:
            MissingPackage: pandas is not installed; the sentence says what to do.
        """
        pandas = imported("pandas", "pandas", "tables")
        return pandas.DataFrame(self._columns())

    OVER = {"pose": {"reached": "1", "stable": "", "residual_force": "N",
                     "residual_moment": "N mm", "left_mm": ""}}  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        return {name: ("pose", x) for name, x in self._columns().items()} | super()._named()

    def _columns(self) -> dict[str, Any]:
        """Column -> a number or word for each pose."""
        table = dict(zip(COLUMNS, np.asarray(self.to_table()).T, strict=True))
        columns = table | {"status": [Status(int(status)).word for status in self.status]}
        for name in self.load_cases.prescribed:
            if name != "flexion":
                size, unit = (1000.0, "Nm") if coordinate(name).unit == "deg" else (1.0, "N")
                columns[f"reaction_{name}_{unit}"] = np.asarray(self.reaction(name)) / size
        return columns


@compiled(static_argnums=(0,))
def _reaction(name: str, knee: Knee, load_cases: LoadCases, equilibrium: Equilibrium) -> Array:
    """Generalised force that is left on a prescribed coordinate, differentiable, `(poses,)`."""
    lanes = load_cases.load(add_lane_axis(knee))
    return force_along(lanes, equilibrium.state, equilibrium.contact_points, (name,))[0]


def passive_flexion(
    knee: Knee, flexion_deg: ArrayLike, loads: tuple[Load, ...] | list[Load] = (), *,
    held: Mapping[str, ArrayLike] | None = None, flexion_is_free: bool = False,
) -> Motion:  # fmt: skip
    """Move a knee through flexion: at each angle the other coordinates balance.

    Every angle is reached from the reference pose in strides of 5 degrees, and there the loads grow
    from nothing, one after the other. So no pose depends on which others were asked for, and a load
    beyond which the knee gives way is reported (`reached`). A coordinate that is held is taken
    where the loaded knee has it and moved to its value along a straight line, as a machine moves
    it; a flexion that is free is let go where the knee was loaded.

    Args:
        knee: any knee; the loads that it carries itself act from the beginning.
        flexion_deg: prescribed angles, `(poses,)` or one; where flexion is free, those of the
            beginning.
        loads: further loads on the tibia, each one for all poses or one per pose.
        held: column -> value, degrees or mm, of further coordinates that are prescribed, one for
            all poses or one per pose, e.g. `{"anterior_mm": [-5.0, 0.0, 5.0]}`; `drawer_mm` is
            the anterior translation in axes turned by flexion.
        flexion_is_free: whether flexion balances too.

    Returns:
        The motion, differentiable with respect to every number of the knee, to any order. Poses
        that fail are NaN in their own row, with the reason in `status`, and so are their
        derivatives, forward and backward.

    Raises:
        ValueError: `held` names no coordinate of the tibia, or a drawer while flexion is free; no
            flexion is given, or one is no number.
        RuntimeError: float64 is switched off.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> motion = kj.passive_flexion(knee, [0.0, 30.0])
        >>> bool(motion.stable.all())
        True
    """
    return followed(knee, LoadCases.at(flexion_deg, loads, held, flexion_is_free))


def followed(knee: Knee, load_cases: LoadCases) -> Motion:
    """Where a knee is balanced at any load cases, each reached as `passive_flexion` says."""
    load_cases = load_cases.of(knee)
    still = jax.lax.stop_gradient((knee, load_cases))
    if not traced(still):
        return motion_of(knee, load_cases, in_rows(balance_one(*still)))
    equilibrium = continued_in_trace(*still)
    return again(knee, load_cases, equilibrium, jnp.where(equilibrium.converged, 1.0, 0.0))


def balanced_near(knee: Knee, load_cases: LoadCases, begin: Iterable[np.ndarray]) -> Equilibria:
    """Balances of one knee, each near where it is expected: free coordinates and contact points,
    arrays begin with the load case. No path leads there, and it may be another branch: compare."""
    q, contact_points = (np.asarray(x)[None] for x in begin)
    return balance_near(knee, itself, np.zeros(1), load_cases, q, contact_points)


def apart_mm(names: Iterable[str], one: ArrayLike, other: ArrayLike) -> np.ndarray:
    """How far coordinates of these names, which end each array, are from others at most, rotations
    at 30 mm."""
    return np.abs((np.asarray(one) - np.asarray(other)) / np.array(scales(names))).max(axis=-1)


def expected(knee: Knee, load_cases: LoadCases, q: ArrayLike, contact_points: ArrayLike) -> Motion:
    """As `balanced_near`, of arrays that end in poses."""
    begin = (np.moveaxis(np.asarray(x), -1, 0) for x in (q, contact_points))
    load_cases = load_cases.of(knee)
    return motion_of(knee, load_cases, in_rows(balanced_near(knee, load_cases, begin)))


def again(knee: Knee, load_cases: LoadCases, equilibrium: Equilibrium, reached: Array) -> Motion:
    """A motion that has been found, as a function of the knee, of equal numbers, and of what is
    prescribed; its derivatives are asked of these."""
    load_cases = load_cases.of(knee)
    motion = _described(knee, load_cases, equilibrium, reached)
    # What a program hands through would have others compiled anew for it.
    return dataclasses.replace(motion, knee=knee, load_cases=load_cases)


def in_rows(found: Equilibria) -> dict[str, np.ndarray]:
    """Fields of balances of one knee, arrays begin with the load case, and `reached`."""
    return found.in_nodes() | {"reached": np.asarray(found.reached[0])}


def motion_of(knee: Knee, load_cases: LoadCases, rows: dict[str, np.ndarray]) -> Motion:
    """What was found, as `in_rows` has it, as a motion: see `again`."""
    nodes = {name: np.moveaxis(x, 0, -1) for name, x in rows.items() if name != "reached"}
    equilibrium = equilibrium_of(jax.lax.stop_gradient(load_cases.of(knee)), nodes)
    return again(knee, load_cases, equilibrium, jnp.asarray(rows["reached"], float))


@compiled()
def _described(knee: Knee, load_cases: LoadCases, found: Equilibrium, reached: Array) -> Motion:
    """One program: otherwise a derivative would compile each of its operations."""
    lanes = load_cases.load(add_lane_axis(knee))
    equilibrium = differentiable(lanes, load_cases.prescribed, found)
    turns = np.array([coordinate(name).unit == "deg" for name in load_cases.free])
    moment, force = jnp.abs(equilibrium.residual[turns]), jnp.abs(equilibrium.residual[~turns])
    return Motion(
        jnp.rad2deg(load_cases.flexion), equilibrium.pose, equilibrium.status,
        jnp.max(force, axis=0, initial=0.0), jnp.max(moment, axis=0, initial=0.0),
        equilibrium.left_mm, reached, equilibrium.stable, equilibrium, knee, load_cases,
    )  # fmt: skip
