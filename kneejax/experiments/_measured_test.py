"""A test under load as somebody measured it."""

__all__ = [
    "COUNTED_FROM", "READINGS", "WITHOUT_LOADS", "MeasuredTest", "counts_like_poses",
    "reading_unit", "weights_by_load",
]

import dataclasses
import functools
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import FREE_COORDINATES, OTHER_COLUMNS
from kneejax.mechanics import AXES, GROOD_SUNTAY, NAMED_LOADS
from kneejax.numerics import WrongValue

if TYPE_CHECKING:
    from kneejax.experiments._curves import Curves
    from kneejax.experiments._frames import Frames

#: What measured numbers are counted from -> what that means.
COUNTED_FROM = {
    "unloaded": "changes from the unloaded pose of the same flexion",
    "intact": "changes from the unloaded pose of the same flexion before anything was cut",
    "least_load": "poses; the one under the least load of the same flexion counts as zero, its "
    "error being one constant of the curve",
    "opposite": "poses; each under a positive load less the one under the opposite load, within "
    "5 % of it",
    "offset": "poses; each coordinate is off by an unknown constant, the same in all of the test",
    "offset_each_flexion": "the same, with constants of its own at each flexion",
    "absolute": "poses in the model's own frame",
    "extension": "changes from the pose at the least flexion, whose error is one constant of all, "
    "under the same loads",
}
#: What can be read of a part of the knee, as `PART.KIND` -> what that means. Forces are counted as
#: they are, strains like displacements. Coordinates of the patella, by their columns
#: (`patella_tilt_deg`), are read too, and counted as those of the tibia are, with unknown
#: constants of their own.
READINGS = {
    "tension_N": "pull of a ligament or group, the sum over its fibres",
    "strain": "of a ligament, or the mean over a group's fibres",
    "contact_N": "size of the force between two surfaces",
}
#: Of these a test may be a motion without loads.
WITHOUT_LOADS = ("offset", "absolute", "extension")
#: Part of the largest load of a curve under which its neutral pose may have been measured.
_NEARLY_ZERO = 0.1
#: Part of a load by which its opposite may differ.
_PAIRED = 0.05


@dataclasses.dataclass(frozen=True, eq=False)
class MeasuredTest:
    """Poses, or changes of pose, that were measured under stated loads.

    Attributes:
        name: what tables and figures call it.
        flexion_deg: of each row, `(n,)`.
        loads: name of a load (`kneejax.mechanics.NAMED_LOADS`) -> its size in each row, `(n,)`.
            Empty for a motion without loads, counted from one of `WITHOUT_LOADS`.
        observed: free coordinates of each row, `(n, 5)`, degrees and mm; translations are those of
            Grood and Suntay; NaN where a coordinate was not measured or does not count.
        counted_from: one of `COUNTED_FROM`.
        constant: loads that acted throughout, also on the unloaded pose.
        point_mm: where forces acted, in the tibia's frame; of a left knee, in its right twin's.
        axes: along which loads acted, of `kneejax.mechanics.AXES`: `tibia` where they followed the
            tibia's own, like those of a device strapped to the shank.
        sd_mm: standard deviation of displacements; None where it is that of the study.
        sd_deg: of rotations; likewise.
        cut: ligaments or groups that had been cut.
        tensions: line of the knee -> tension in each row beside the line's own, `(n,)`, N; none on
            unloaded poses.
        readings: what was read of parts of the knee, `PART.KIND` of `READINGS` -> `(n,)`, e.g.
            `{"ACL.tension_N": ...}`, and of where the patella was, `{"patella_tilt_deg": ...}`;
            NaN where nothing was.
        sd_N: standard deviation of forces among them.
        sd_strain: of strains.
        weight: of each row's squared errors against those of the other rows, `(n,)`; all alike by
            default (`weights_by_load`).
        frames: when rows were seen and what moved, of a knee in motion; None where the knee was in
            balance in each row.
        within_deg: by which flexions of what counts as one flexion may differ, of a curve or of
            trials in opposite senses. Each row is computed at the flexion that it has.

    Raises:
        ValueError: what is missing or does not fit, with its row.

    Example:
        >>> rows = np.full((2, 5), np.nan)
        >>> rows[:, FREE_COORDINATES.index("anterior")] = 4.0, 6.0
        >>> test = MeasuredTest("drawer", [0.0, 30.0], {"anterior_N": [90.0, 90.0]}, rows)
        >>> test.driven_by, test.coordinates
        ('anterior_N', ('anterior',))
    """

    name: str
    flexion_deg: np.ndarray
    loads: Mapping[str, np.ndarray]
    observed: np.ndarray
    counted_from: str = "unloaded"
    constant: Mapping[str, float] = dataclasses.field(default_factory=dict)
    point_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: str = GROOD_SUNTAY
    sd_mm: float | None = None
    sd_deg: float | None = None
    cut: tuple[str, ...] = ()
    tensions: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    readings: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    sd_N: float | None = None
    sd_strain: float | None = None
    weight: np.ndarray | None = None
    frames: "Frames | None" = None
    within_deg: float = 1.0

    def __post_init__(self) -> None:
        flexion = np.atleast_1d(np.asarray(self.flexion_deg, float))
        observed = np.asarray(self.observed, float)
        loads, readings, tensions = (
            {name: np.asarray(sizes, float) for name, sizes in every.items()}
            for every in (self.loads, self.readings, self.tensions)
        )
        weight = None if self.weight is None else np.asarray(self.weight, float)
        self.__dict__.update(flexion_deg=flexion, loads=loads, observed=observed, weight=weight,
                             readings=readings, tensions=tensions, cut=tuple(self.cut))
        unknown = [name for name in (*loads, *self.constant) if name not in NAMED_LOADS]
        if unknown:
            raise WrongValue("loads", repr(unknown[0]), f"of {', '.join(NAMED_LOADS)}")
        self._check_loads(flexion, [*loads.values(), *tensions.values()])
        columns = {"loads": loads, "tensions": tensions, "readings": readings}
        rows = {f"{field}.{x}": y for field, every in columns.items() for x, y in every.items()}
        rows = {"observed": observed} | rows | ({} if weight is None else {"weight": weight})
        for name, sizes in rows.items():
            shape = (len(flexion), 5) if name == "observed" else flexion.shape
            if sizes.shape != shape:
                raise WrongValue(name, str(sizes.shape), str(shape))
        for field, known in (("axes", AXES), ("counted_from", COUNTED_FROM)):
            if (value := getattr(self, field)) not in known:
                raise WrongValue(field, repr(value), f"one of {', '.join(known)}")
        if all(np.isnan(own).all() for own in (observed, *readings.values())):
            raise WrongValue("observed", "nothing", "a number in some row")
        if self.counted_from == "intact" and not self.cut:
            raise WrongValue("counted_from", "intact", "cut too, or unloaded")
        self._check_readings()
        if weight is not None and not (weight.min() >= 0.0 and 0.0 < weight.max() < np.inf):
            raise WrongValue("weight", "not finite, negative or all zero", "0 or more")
        if self.frames is not None:
            seen = len(self.frames.time_s)
            if seen != len(flexion):
                raise WrongValue("frames", f"{seen} times", f"{len(flexion)}, one a row")
            for name in (*tensions, *readings):
                raise WrongValue("frames", f"{name} too", "loads and coordinates alone")
        self._check_information()

    def _check_readings(self) -> None:
        for name in self.readings:
            part, _, kind = name.rpartition(".")
            if name not in OTHER_COLUMNS and (not part or kind not in READINGS):
                known = ", ".join([*(f"PART.{kind}" for kind in READINGS), *OTHER_COLUMNS])
                raise WrongValue("readings", repr(name), f"of {known}")
            if np.isnan(self.sd_of(name)):
                sd = f"sd_{reading_unit(name) or 'strain'}"
                raise WrongValue(sd, "not stated", f"how well {name} is known")
            if name.endswith(".strain") and self.counted_from.startswith("offset"):
                raise WrongValue(
                    f"readings.{name}", f"counted from {self.counted_from}", "unloaded or "
                    "absolute, since unknown constants are of the bones' coordinates alone",
                )  # fmt: skip

    def _check_loads(self, flexion: np.ndarray, acting: Sequence[np.ndarray]) -> None:
        """Some load acts or something was read of the knee's parts, or the motion needs none; and
        without a load each row has a flexion of its own."""
        told = bool(self.readings) or any(sizes.any() for sizes in acting)
        if not told and self.counted_from not in WITHOUT_LOADS:
            raise WrongValue("loads", "none", "a load that is not zero in some row")
        angles, rows = np.unique(flexion, return_counts=True)
        if rows.max() > 1 and self.frames is None and not (self.loads and told):
            found = f"{angles[rows > 1][0]:g} degrees {rows.max()} times"
            raise WrongValue("flexion_deg", found, "each once, since no load acts")

    def _check_information(self) -> None:
        """Each unknown constant leaves something of the readings that share it, and so do the rows
        from which others are counted."""
        partner, groups = self.partner, self.groups
        weight = np.ones(len(partner)) if self.weight is None else self.weight
        seen = {name: x for name, x in zip(FREE_COORDINATES, self.observed.T, strict=True)}
        seen |= {name: x for name, x in self.readings.items() if name in OTHER_COLUMNS}
        acting = [*self.loads.values(), *self.tensions.values()]
        setting = np.column_stack([self.flexion_deg, *acting])
        for name, values in seen.items():
            counts = np.isfinite(values) & (weight > 0)
            constants = (groups >= 0) & counts & self.counted_from.startswith("offset")
            for group in np.unique(groups[constants]):
                rows = np.flatnonzero((groups == group) & counts)
                # What was read twice under the same load differs by noise alone.
                if self.frames is None and len(np.unique(setting[rows], axis=0)) < 2:
                    each = self.counted_from == "offset_each_flexion"
                    where = f" at {self.flexion_deg[rows[0]]:g} degrees" if each else ""
                    raise WrongValue(
                        "counted_from", f"{name} under one load{where}",
                        f"readings under two loads or more for each constant of "
                        f"{self.counted_from}, which otherwise absorbs them; flexions within "
                        f"{self.within_deg:g} degrees (within_deg) share one",
                    )  # fmt: skip
        left = partner != np.arange(len(partner))
        beside = any(name not in seen for name in self.readings)
        if not beside and all(np.isnan(values[left]).all() for values in seen.values()):
            found, expected = f"{self.counted_from} and no other row", "rows beside those"
            raise WrongValue("counted_from", found, f"{expected} that others are counted from")

    @property
    def bent_deg(self) -> np.ndarray:
        """Flexion of each row of a model's knee, `(n,)`: as measured, or as a motion is led."""
        return self.flexion_deg if self.frames is None else self.frames.led_deg

    @property
    def driven_by(self) -> str:
        """Name of the load over which curves are drawn: the one that changes most."""
        if not self.loads:
            raise WrongValue("loads", "none", "a load over which curves can be drawn")
        return max(self.loads, key=lambda name: change_of(name, np.r_[0.0, self.loads[name]]))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Free coordinates that were measured."""
        seen = np.isfinite(self.observed).any(axis=0)
        return tuple(name for name, own in zip(FREE_COORDINATES, seen, strict=True) if own)

    def sd_of(self, reading: str) -> float:
        """Standard deviation of a reading, in its unit; NaN if none is stated."""
        sd = getattr(self, f"sd_{reading_unit(reading) or 'strain'}")
        return np.nan if sd is None else sd

    @property
    def partner(self) -> np.ndarray:
        """Row from which each row is counted, `(n,)`: its own number where it is such a row
        itself, -1 where it is counted from none."""
        count = len(self.flexion_deg)
        if self.counted_from == "extension":
            return np.full(count, np.argmin(self.flexion_deg))
        if self.counted_from not in ("least_load", "opposite"):
            return np.full(count, -1)
        partner, driving = np.arange(count), self.loads[self.driven_by]
        if self.counted_from == "opposite":
            under = np.flatnonzero(driving > 0)
            partner[under] = [self._opposite(row, driving) for row in under]
            return partner
        for own in (np.flatnonzero(self.curve == k) for k in np.unique(self.curve)):
            partner[own] = self._least(own, driving)
        return partner

    @functools.cached_property
    def curve(self) -> np.ndarray:
        """Number of the curve that each row is of, from the least flexion, `(n,)`: of one are rows
        within `within_deg` of the least flexion among them."""
        angles, at = np.unique(self.flexion_deg, return_inverse=True)
        begins = [angles[0]]
        for angle in angles[1:]:
            begins.append(angle if angle - begins[-1] > self.within_deg + 1e-9 else begins[-1])
        return np.unique(begins, return_inverse=True)[1][at]

    @property
    def curve_deg(self) -> np.ndarray:
        """Flexion of the curve that each row is of, `(n,)`: what its rows have, or their mean to a
        tenth of a degree where they differ."""
        curves = [self.flexion_deg[self.curve == k] for k in range(self.curve.max() + 1)]
        at = [own[0] if not np.ptp(own) else np.round(own.mean(), 1) for own in curves]
        return np.array(at)[self.curve]

    @property
    def counts_from_rest(self) -> bool:
        """Whether rows are counted from an unloaded pose that has no row of its own."""
        return self.counted_from in ("unloaded", "intact")

    @property
    def groups(self) -> np.ndarray:
        """Rows that share unknown constants: a number each, `(n,)`, -1 where there are none."""
        # The error of a reading from which others are counted is in all of these.
        if self.counted_from in ("offset_each_flexion", "least_load"):
            return self.curve
        one = self.counted_from in ("offset", "extension")
        return np.full(len(self.flexion_deg), 0 if one else -1)

    @property
    def scatter(self) -> float:
        """Times the noise of a reading that what is compared has: the difference of two readings
        has more."""
        return float(np.sqrt(2.0)) if self.counted_from == "opposite" else 1.0

    def _opposite(self, row: int, driving: np.ndarray) -> int:
        """Row under the opposite load, at nearly the same flexion."""
        # Of both tolerances the part that each row takes up; robots repeat neither exactly.
        off = np.abs(driving + driving[row]) / (_PAIRED * driving[row])
        apart = np.abs(self.flexion_deg - self.flexion_deg[row]) / max(self.within_deg, 1e-9)
        fits = (off <= 1.0) & (apart <= 1.0)
        if fits.any():
            return int(np.argmin(np.where(fits, off + apart, np.inf)))
        near = int(np.argmin(np.where(driving < 0, np.maximum(off, apart), np.inf)))
        other = "no row has a load of the opposite sense"
        if driving[near] < 0:
            at = f"{driving[near]:g} at {self.flexion_deg[near]:g} degrees"
            other = f"the nearest is row {near + 1}, {at}"
        found = f"{self.driven_by} {driving[row]:g} at {self.flexion_deg[row]:g} degrees"
        raise WrongValue(
            f"row {row + 1}", found,
            f"a row under the opposite load, within {100 * _PAIRED:g} % of it and "
            f"{self.within_deg:g} degree{'s' * (self.within_deg != 1.0)} of its flexion "
            f"(within_deg), since it is counted from opposite; {other}",
        )  # fmt: skip

    def _least(self, own: np.ndarray, driving: np.ndarray) -> int:
        """Row of the neutral pose among the rows of one flexion."""
        zero, largest = own[np.argmin(np.abs(driving[own]))], np.abs(driving[own]).max()
        if abs(driving[zero]) > _NEARLY_ZERO * largest:
            load, at = f"{self.driven_by} {driving[zero]:g}", f"{self.flexion_deg[zero]:g}"
            expected = f"a row under less than a tenth of {largest:g}, since least_load is what"
            raise WrongValue(f"row {zero + 1}", f"{load} is the least load at {at} degrees",
                             f"{expected} others are counted from")  # fmt: skip
        return int(zero)

    @classmethod
    def of(cls, curves: "Curves", **given) -> "MeasuredTest":
        """What a laboratory would measure of a knee that answers with these curves.

        Args:
            curves: of one test.
            given: further attributes, for instance `sd_mm`; `cut` too where the curves are counted
                from the intact knee.

        Returns:
            The change of the test's coordinate at every step; a step without a load is left out.

        Raises:
            ValueError: a machine held a rotation, which data cannot say.
        """
        if curves.test.held:
            held = ", ".join(curves.test.held)
            raise WrongValue(curves.test.name, f"{held} is held", "what is free there")
        test, under = curves.test, np.asarray(curves.test.path) != 0.0
        flexion = np.repeat(test.flexion_deg, int(under.sum()))
        observed = np.full((len(flexion), 5), np.nan)
        moved = np.asarray(curves.displacement)[:, under].ravel()
        observed[:, FREE_COORDINATES.index(test.observed)] = moved
        loads = {
            name: np.asarray(curves.load(name))[:, under].ravel() - test.constant.get(name, 0.0)
            for name in test.full or (test.driven_by,)
        }
        return cls(
            test.name, flexion, loads, observed,
            constant=dict(test.constant), point_mm=test.point_mm,
            **{"counted_from": curves.counted_from} | given,
        )  # fmt: skip


def change_of(load: str, sizes: np.ndarray) -> float:
    """How much a load changes, N; moments, N m, count as if they acted 50 mm away."""
    return (20.0 if load.endswith("_Nm") else 1.0) * float(np.ptp(sizes))


def reading_unit(reading: str) -> str:
    """Unit of what was read of a part, or of a bone's coordinate; empty for a strain."""
    if reading in OTHER_COLUMNS:
        return OTHER_COLUMNS[reading].unit
    return "" if reading.endswith(".strain") else "N"


def counts_like_poses(reading: str) -> bool:
    """Whether a reading is counted from where its test counts from; forces are what they are."""
    return reading_unit(reading) != "N"


def weights_by_load(size: np.ndarray) -> np.ndarray:
    """Weights in proportion to the load's size, so that the end of a curve counts most.

    Args:
        size: of the load in each row, `(n,)`.

    Returns:
        `(n,)`, between 0 and 1.

    Source: paper 2, section 4.2, which weighs larger displacements more.

    Example:
        >>> weights_by_load(np.array([0.0, -50.0, 100.0])).tolist()
        [0.0, 0.5, 1.0]
    """
    size = np.abs(np.asarray(size, float))
    return size / max(float(size.max()), 1e-300)
