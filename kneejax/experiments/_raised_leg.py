"""A leg that is raised, through time."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from kneejax.dynamics import MovingKnee, move_within
from kneejax.experiments._extensor import Extensor, at_rest, leg_raise
from kneejax.experiments._extensor_mechanism import Shank
from kneejax.experiments._transient import MOST_ERROR_MM, Transient, described, smooth_way
from kneejax.geometry import TIBIA, coordinate, coordinates_of, table_units
from kneejax.mechanics import QUADRICEPS, Mass
from kneejax.numerics import Named, WrongValue
from kneejax.statics import converged

#: Radius of gyration of shank and foot about their centre, across, by the shank's length (Winter,
#: Biomechanics and Motor Control of Human Movement, 4th ed. 2009, Table 4.1: leg and foot).
ACROSS = 0.416
#: Of the shank about its own axis, by its length (de Leva, J Biomech 29, 1996, Table 4, males).
SHANK_ALONG = 0.103
#: Of body mass: the foot; of its length from the ankle: radius of gyration about the ankle (Winter
#: 2009, Table 4.1).
FOOT_SHARE, FOOT_FROM_ANKLE = 0.0145, 0.690
#: Of body height: length of the foot (same source, Figure 4.1), half of which is taken for the
#: way from the ankle to the heads of the metatarsals.
FOOT_LENGTH = 0.152


def leg_of_person(body_kg: float, height_m: float, ankle_kg: float = 0.0) -> Mass:
    """Shank and foot of a person of usual proportions, as one rigid body.

    Its centre lies on the tibia's long axis, and the axes of its inertia are the tibia's: the foot
    counts for the moment about the long axis, not for a centre before it.

    Args:
        body_kg: mass of the body.
        height_m: of the body.
        ankle_kg: a weight at the ankle besides.

    Source: Winter (2009), Table 4.1 and Figure 4.1; de Leva (1996), Table 4.

    Example:
        >>> leg = leg_of_person(75.0, 1.75)
        >>> [round(float(x)) for x in (leg.center_mm[1], *np.diag(leg.inertia_kg_mm2))]
        [-261, 146732, 16016, 146732]
    """
    shank = Shank.of_person(body_kg, height_m, ankle_kg)
    length = -shank.ankle_mm[1]
    across = shank.mass_kg * (ACROSS * length) ** 2
    foot_kg = FOOT_SHARE * body_kg
    foot = foot_kg * (FOOT_FROM_ANKLE * 500.0 * FOOT_LENGTH * height_m) ** 2
    along = (shank.mass_kg - foot_kg) * (SHANK_ALONG * length) ** 2 + foot
    leg = Mass(shank.mass_kg, shank.center_mm, np.diag([across, along, across]))
    return leg.with_point(ankle_kg, shank.ankle_mm) if ankle_kg else leg


#: N m; a leg that would turn with more is not held by its quadriceps: it would not sink.
_HELD_NM = 1e-3


@dataclasses.dataclass(frozen=True)
class RaisedLeg(Named):
    """A leg that is raised in some time, and the same leg held where it comes by.

    Attributes:
        transient: the motion.
        rows: of its times, those at which the leg is held too, `(poses,)`.
        held: the leg that its quadriceps holds at the flexions of these times.
        from_held: how far the motion is from that, degrees and mm, `(poses, coordinates)`, columns
            as of the motion; of flexion, how far it is from where the leg would be held with the
            quadriceps as long as it is.
    """

    transient: Transient
    rows: np.ndarray
    held: Extensor
    from_held: np.ndarray

    def _named(self) -> dict[str, tuple]:
        motion, over = self.transient.trajectory, "pose"
        away = {f"{x}_from_held": (over, y, coordinate(x).unit)
                for x, y in zip(motion.names, self.from_held.T, strict=True)}  # fmt: skip
        pull = np.asarray(self.held.quadriceps_N)
        held = {"held_time_s": (over, motion.time_s[self.rows]), "held_quadriceps_N": (over, pull)}
        return self.transient._named() | held | away

    @property
    def farthest(self) -> float:
        """Of `from_held`, degrees or mm."""
        return float(np.nanmax(np.abs(self.from_held)))


def raised_leg(
    moving: MovingKnee, flexion_deg: ArrayLike, time_s: ArrayLike, *,
    lengths: tuple[ArrayLike, ArrayLike] | None = None, most_mm: float = MOST_ERROR_MM,
    progress: Callable[[int], None] | None = None,
) -> RaisedLeg:  # fmt: skip
    """Raise a leg by a motor on its quadriceps.

    By itself the motor shortens the quadriceps from its length where the leg is held at the first
    flexion to that at the last, along a polynomial of degree 5 that begins and ends at rest. Its
    pull is a result.

    Args:
        moving: a knee of three bones with mass, damping and gravity.
        flexion_deg: from most to least, `(poses,)`; at as many the motion is compared with a leg
            that is held. Where a leg would not sink the quadriceps has nothing to do: the motion
            begins at the first flexion at which it has.
        time_s: at which the motion is told; it begins with the first and ends with the last.
        lengths: times, and lengths of the quadriceps at these, mm, smoothly joined; only their
            changes count, since the leg begins where it is held.
        most_mm: that is left of the error of the steps.
        progress: is told how many steps are done, of each of several passes.

    Raises:
        ValueError: the knee has no patella, flexions that do not fall, fewer than two at which the
            quadriceps holds the leg, or lengths beyond those with which it does.

    Source: paper 3, Eqs 19 and 20.
    """
    flexions, times = np.asarray(flexion_deg, float), np.asarray(time_s, float)
    if (np.diff(flexions) >= 0.0).any():
        found = ", ".join(f"{x:g}" for x in flexions)
        raise WrongValue("flexion_deg", found, "flexions that fall, from the hanging leg on")
    others = tuple(load for load in moving.weights if load.bone != TIBIA)
    (weight,) = (load for load in moving.weights if load.bone == TIBIA)
    knee = dataclasses.replace(moving.knee, loads=(*moving.knee.loads, *others))
    ahead = leg_raise(knee, flexions, weight)
    first, last = _ends(ahead)
    way = _way(times, np.asarray(ahead.quadriceps_mm)[[first, last]], lengths)
    names = coordinates_of(knee.bodies)
    start = np.asarray(ahead.motion.equilibrium.state.at(names))[:, first]
    found = move_within(
        most_mm, moving, start, times, held={QUADRICEPS: way},
        pull_N=float(ahead.quadriceps_N[first] - at_rest(knee)), progress=progress,
    )  # fmt: skip
    table = found.to_table()
    passed = np.where(np.isfinite(table[:, 0]), table[:, 0], np.inf)
    wanted = np.linspace(flexions[first], flexions[last], len(flexions))
    rows = np.argmin(np.abs(passed - wanted[:, None]), axis=1)
    held = leg_raise(knee, passed[rows], weight)
    there = np.asarray(held.motion.equilibrium.state.at(names)).T * table_units(names)
    away = table[rows] - there
    longer = np.asarray(way(times))[rows] - np.asarray(held.quadriceps_mm)
    away[:, 0] = np.rad2deg(longer / np.asarray(held.arm_mm))
    away[~_holds(held)] = np.nan
    return RaisedLeg(described(found, {}), rows, held, away)


def _holds(leg: Extensor) -> np.ndarray:
    """Where the quadriceps holds the leg."""
    rest = float(at_rest(leg.motion.knee))
    good = np.asarray(converged(leg.motion.status)) & (np.asarray(leg.quadriceps_N) > rest)
    return good & (np.abs(np.asarray(leg.extension_Nm)) < _HELD_NM)


def _ends(leg: Extensor) -> tuple[int, int]:
    """First and last row of the longest stretch of flexions at which the leg is held."""
    rows = np.flatnonzero(_holds(leg))
    stretch = max(np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1), key=len)
    if len(stretch) < 2:
        at = leg.flexion_deg
        found = f"{at[0]:g} to {at[-1]:g}"
        raise WrongValue("flexion_deg", found, "two at least at which the quadriceps holds the leg")
    return int(stretch[0]), int(stretch[-1])


def _way(times: np.ndarray, ends: np.ndarray, lengths) -> Callable:
    """Length over time: as given, or along a polynomial that is at rest at both ends."""
    first, last = ends
    if lengths is not None:
        given = np.asarray(lengths[1], float)
        changes = given - given[0]
        for change in (changes.max(), changes.min()):
            if not last <= first + change <= first:
                raise WrongValue(
                    "quadriceps_mm",
                    f"{change:+.4g} longer than at the start, where it has {first:.4g}",
                    f"between {last - first:.4g} and 0, with which it holds the leg",
                )
        return smooth_way(lengths[0], given, first)

    def way(t):
        part = np.clip((t - times[0]) / (times[-1] - times[0]), 0.0, 1.0)
        return first + (last - first) * part**3 * (10.0 + part * (6.0 * part - 15.0))

    return way
