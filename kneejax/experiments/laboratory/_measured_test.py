"""A test under load as somebody measured it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from kneejax.experiments.laboratory._curves import Curves
from kneejax.geometry import FREE_COORDINATES
from kneejax.mechanics import NAMED_LOADS

#: What measured numbers are counted from -> what that means.
COUNTED_FROM = {
    "unloaded": "changes from the unloaded pose of the same flexion",
    "least_load": "poses; the one under the least load of the same flexion counts as zero",
    "opposite": "poses; each under a positive load less the one under the opposite load",
    "offset": "poses; each coordinate is off by an unknown constant, the same in all of the test",
    "offset_each_flexion": "the same, with constants of its own at each flexion",
    "absolute": "poses in the model's own frame",
    "extension": "changes from the pose at the least flexion, all under the same loads",
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
        point_mm: where forces acted, in the tibia's frame.
        sd_mm: standard deviation of displacements; None where it is that of the study.
        sd_deg: of rotations; likewise.

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
    sd_mm: float | None = None
    sd_deg: float | None = None

    def __post_init__(self) -> None:
        flexion = np.atleast_1d(np.asarray(self.flexion_deg, float))
        loads = {name: np.asarray(sizes, float) for name, sizes in self.loads.items()}
        observed = np.asarray(self.observed, float)
        for name, value in (("flexion_deg", flexion), ("loads", loads), ("observed", observed)):
            object.__setattr__(self, name, value)
        unknown = [name for name in (*loads, *self.constant) if name not in NAMED_LOADS]
        if unknown:
            raise ValueError(f"loads: {unknown[0]!r}; expected of {', '.join(NAMED_LOADS)}")
        self._check_loads(flexion, loads)
        shape = len(flexion), 5
        if observed.shape != shape:
            raise ValueError(f"observed: {observed.shape}; expected {shape}")
        for name, sizes in loads.items():
            if sizes.shape != shape[:1]:
                raise ValueError(f"loads.{name}: {sizes.shape}; expected {shape[:1]}")
        if self.counted_from not in COUNTED_FROM:
            known = ", ".join(COUNTED_FROM)
            raise ValueError(f"counted_from: {self.counted_from!r}; expected one of {known}")
        if np.isnan(observed).all():
            raise ValueError("observed: nothing; expected a number in some row")
        self.partner  # noqa: B018 - says what does not fit

    def _check_loads(self, flexion: np.ndarray, loads: Mapping[str, np.ndarray]) -> None:
        """Some load acts, or each row of a motion without loads has a flexion of its own."""
        if any(sizes.any() for sizes in loads.values()):
            return
        if self.counted_from not in WITHOUT_LOADS:
            raise ValueError("loads: none; expected a load that is not zero in some row")
        angles, rows = np.unique(flexion, return_counts=True)
        if rows.max() > 1:
            found = f"{angles[rows > 1][0]:g} degrees {rows.max()} times"
            raise ValueError(f"flexion_deg: {found}; expected each once, since no load acts")

    @property
    def driven_by(self) -> str:
        """Name of the load over which curves are drawn: the one that changes most."""
        if not self.loads:
            raise ValueError("loads: none; expected a load over which curves can be drawn")
        # Moments in N m are compared with forces as if they acted 50 mm away.
        arm = {name: 20.0 if name.endswith("_Nm") else 1.0 for name in self.loads}
        return max(self.loads, key=lambda name: arm[name] * np.ptp(np.r_[0.0, self.loads[name]]))

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Free coordinates that were measured."""
        seen = np.isfinite(self.observed).any(axis=0)
        return tuple(name for name, own in zip(FREE_COORDINATES, seen, strict=True) if own)

    @property
    def partner(self) -> np.ndarray:
        """Row from which each row is counted, `(n,)`: its own number where it is such a row
        itself, -1 where it is counted from none."""
        rows = np.arange(len(self.flexion_deg))
        if self.counted_from == "extension":
            return np.full(len(rows), np.argmin(self.flexion_deg))
        if self.counted_from not in ("least_load", "opposite"):
            return np.full(len(rows), -1)
        partner, driving = rows.copy(), self.loads[self.driven_by]
        for flexion in np.unique(self.flexion_deg):
            own = np.flatnonzero(self.flexion_deg == flexion)
            if self.counted_from == "least_load":
                partner[own] = self._least(own, driving)
                continue
            for row in own[driving[own] > 0]:
                near = own[np.argmin(np.abs(driving[own] + driving[row]))]
                if abs(driving[near] + driving[row]) > _PAIRED * driving[row]:
                    raise ValueError(
                        f"row {row + 1}: {self.driven_by} {driving[row]:g} at {flexion:g} degrees; "
                        "expected a row under the opposite load, since opposite is what it is "
                        "counted from"
                    )
                partner[row] = near
        return partner

    @property
    def groups(self) -> np.ndarray:
        """Rows that share unknown constants: a number each, `(n,)`, -1 where there are none."""
        if self.counted_from == "offset_each_flexion":
            return np.unique(self.flexion_deg, return_inverse=True)[1]
        return np.full(len(self.flexion_deg), 0 if self.counted_from == "offset" else -1)

    def _least(self, own: np.ndarray, driving: np.ndarray) -> int:
        """Row of the neutral pose among the rows of one flexion."""
        zero, largest = own[np.argmin(np.abs(driving[own]))], np.abs(driving[own]).max()
        if abs(driving[zero]) > _NEARLY_ZERO * largest:
            raise ValueError(
                f"row {zero + 1}: {self.driven_by} {driving[zero]:g} is the least load at "
                f"{self.flexion_deg[zero]:g} degrees; expected a row under less than a tenth of "
                f"{largest:g}, since least_load is what others are counted from"
            )
        return int(zero)

    @classmethod
    def of(cls, curves: Curves, **given) -> MeasuredTest:
        """What a laboratory would measure of a knee that answers with these curves.

        Args:
            curves: of one test.
            given: further attributes, for instance `sd_mm`.

        Returns:
            The change of the test's coordinate at every step; a step without a load is left out.

        Raises:
            ValueError: a machine held a rotation, which data cannot say.
        """
        if curves.test.held:
            held = ", ".join(curves.test.held)
            raise ValueError(f"{curves.test.name}: {held} is held; expected what is free there")
        test, moved = curves.test, np.asarray(curves.displacement)
        path = np.asarray(test.path)
        under = path != 0.0
        flexions = len(test.flexion_deg)
        observed = np.full((flexions * int(under.sum()), 5), np.nan)
        observed[:, FREE_COORDINATES.index(test.observed)] = moved[:, under].ravel()
        loads = {
            name: np.asarray(curves.load(name))[:, under].ravel() - test.constant.get(name, 0.0)
            for name in test.full or (test.driven_by,)
        }
        return cls(
            test.name,
            np.repeat(test.flexion_deg, int(under.sum())),
            loads,
            observed,
            constant=dict(test.constant),
            point_mm=test.point_mm,
            **given,
        )
