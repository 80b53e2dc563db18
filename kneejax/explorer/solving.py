"""Where a knee balances at a setting, what holds it, and what would move it; curves over flexion.

Numbers of a setting are data: one compiled program serves every setting of a knee. A pose begins
near the last one and takes some milliseconds; at rest it is compared with the one that is reached
by bending and then loading the knee, as `passive_flexion` does.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from functools import cached_property

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.experiments import Mechanics, evaluate
from kneejax.explorer.setting import Setting, Subject
from kneejax.geometry import FREE_COORDINATES, State, scales, table_units
from kneejax.mechanics import QUADRICEPS, Knee, Load, add_lane_axis, load_of, pull_of
from kneejax.numerics import compiled
from kneejax.parameters import Selection, fibre_rows, prior_scales
from kneejax.statics import (
    Equilibria,
    LoadCases,
    Status,
    balance_many,
    balance_near,
    converged,
)

#: Flexions of the curves, degrees.
FLEXIONS = np.linspace(0.0, 120.0, 25)
#: Tests of laxity: load -> its size, both ways.
TESTS = {"anterior_N": 100.0, "varus_Nm": 10.0, "internal_Nm": 5.0}
#: The coordinate that each moves most.
MOVED = {"anterior_N": "anterior", "varus_Nm": "adduction", "internal_Nm": "internal_rotation"}
#: A pose that is farther than this from the curve through its flexion is on another branch, mm, a
#: rotation at 30 mm.
_BRANCH_MM = 1.0
#: A curve is torn where the second difference over flexion of its move is larger, degrees, mm.
_KINK = 5.0
#: Flexion from the last pose within which it is a beginning, degrees.
_NEAR_DEG = 12.0


@dataclasses.dataclass(frozen=True)
class _Varied:
    """Sets stiffnesses and attachments, changes reference strains, and takes away the stiffness of
    what is cut; steers compiled functions."""

    plain: Selection
    strains: Selection
    owners: tuple[int, ...]

    def __call__(self, knee: Knee, numbers) -> Knee:
        first, second = len(self.plain), len(self.plain) + len(self.strains)
        knee = self.plain.apply(knee, numbers[:first])
        if len(self.strains):
            knee = self.strains.apply(knee, self.strains.read(knee) + numbers[first:second])
        left = jnp.asarray(numbers)[second:][jnp.array(self.owners)]
        fibres = knee.ligaments
        torn = jnp.where(left > 0.0, fibres.failure_strain, jnp.inf)
        own = dataclasses.replace(fibres, stiffness=fibres.stiffness * left, failure_strain=torn)
        return dataclasses.replace(knee, ligaments=own)


@compiled(static_argnums=(0,), optimised=False)
def _varied(vary: _Varied, knee: Knee, numbers) -> Knee:
    return vary(knee, numbers)


@compiled()
def _mechanics(knee: Knee, state: State) -> Mechanics:
    """A program for one pose: `evaluate` computes many at once."""
    return evaluate(knee, state)


@compiled(optimised=False)
def _tension(knee: Knee, state: State):
    return add_lane_axis(knee.ligaments).tension(state)


@compiled(static_argnums=(0, 1), optimised=False)
def _slopes(vary: _Varied, free: tuple[str, ...], knee: Knee, numbers, prescribed, q, tangent):
    """Derivatives of the free coordinates and of each ligament's force by the numbers, at poses.

    The numbers act through the ligaments alone: by the implicit function theorem the coordinates
    move by the forces that a number changes, over the tangent stiffness.
    """
    owners, count = jnp.array(vary.owners), max(vary.owners) + 1

    def forces(prescribed, q, numbers):
        held = {name: jnp.atleast_1d(x) for name, x in prescribed.items()}
        state = State.of(held, q[:, None], knee.bodies)
        ligaments = add_lane_axis(vary(knee, numbers).ligaments)
        wrenches, _, _ = ligaments.pull(state)
        work = jnp.stack([jnp.broadcast_to(x, (1,)) for x in wrenches.work(state, free)])[:, 0]
        return work, jax.ops.segment_sum(ligaments.tension(state)[:, 0], owners, count)

    def of_pose(prescribed, q, tangent):
        work, tension = jax.jacrev(forces, 2)(prescribed, q, numbers)
        by_pose = jax.jacfwd(lambda q: forces(prescribed, q, numbers)[1])(q)
        coordinates = jnp.linalg.solve(tangent, work)
        return coordinates, tension + by_pose @ coordinates

    return jax.vmap(of_pose)(prescribed, q, tangent)


@dataclasses.dataclass(frozen=True)
class Answer:
    """A pose at a setting.

    Attributes:
        setting: that was asked for.
        knee: with its parameters.
        status: of the pose.
        coordinates: free coordinate -> degrees or mm; NaN where nothing balances.
        state: where the bones are, of shape `(1,)`; of the last pose that balanced where this one
            does not.
        found: forces, strains and contact there, of one pose.
        force_N: ligament -> force.
        strain: ligament -> largest strain of its fibres.
        peak_MPa: compartment -> largest pressure.
        derive: computes `slopes`.
    """

    setting: Setting
    knee: Knee
    status: Status
    coordinates: dict[str, float]
    state: State
    found: Mechanics
    force_N: dict[str, float]
    strain: dict[str, float]
    peak_MPa: dict[str, float]
    derive: Callable[[], dict[str, np.ndarray]]

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Coordinate or ligament -> exact derivative of its degrees, mm or N by the parameters,
        `(p,)`; nothing where nothing balances."""
        return self.derive()

    @property
    def sentence(self) -> str:
        """What is wrong with the pose and what to try; empty where nothing is."""
        if self.status == Status.BALANCED:
            return ""
        last = "" if self.status.converged else " The last pose that balanced is shown, grey."
        return f"{self.status.fault.capitalize()}: {self.status.advice}.{last}"


@dataclasses.dataclass(frozen=True)
class Curves:
    """What a setting does over flexion.

    Attributes:
        setting: that was asked for.
        flexion_deg: of the poses, `(n,)`.
        status: `Status` values, `(n,)`.
        coordinates: free coordinate -> degrees or mm, `(n,)`; NaN where nothing balances.
        force_N: ligament -> force, `(n,)`.
        laxity: test -> degrees or mm between its two loads, `(n,)`, where one was asked for.
        own: free coordinates as they are solved, `(n, free)`; of a test those under both loads
            follow, `(3 n, free)`.
        contact_points: likewise, `(n, points, 2)`.
        derive: computes `slopes`.
    """

    setting: Setting
    flexion_deg: np.ndarray
    status: np.ndarray
    coordinates: dict[str, np.ndarray]
    force_N: dict[str, np.ndarray]
    laxity: dict[str, np.ndarray]
    own: np.ndarray
    contact_points: np.ndarray
    derive: Callable[[], dict[str, np.ndarray]]

    @cached_property
    def slopes(self) -> dict[str, np.ndarray]:
        """Coordinate or ligament -> exact derivative of its degrees, mm or N by the parameters,
        `(n, p)`; NaN where nothing balances."""
        return self.derive()

    @property
    def table(self) -> np.ndarray:
        """Poses in the order of `kneejax.geometry.COLUMNS`, `(n, 6)`, degrees and mm."""
        return np.column_stack([self.flexion_deg, *self.coordinates.values()])

    def at(self, flexion_deg: float) -> tuple[np.ndarray, np.ndarray]:
        """Free coordinates, `(free,)`, and contact points near a flexion."""
        flexion = self.flexion_deg
        q = np.array([np.interp(flexion_deg, flexion, x) for x in self.own[: len(flexion)].T])
        return q, self.contact_points[int(np.argmin(np.abs(flexion - flexion_deg)))]


class Solver:
    """Answers of one knee; it remembers the last pose that balanced, and nothing else.

    Attributes:
        subject: the knee and what can be set of it.
        names: parameters by which there are derivatives.
        owner: fibre -> the ligament that it is set with.

    Example:
        >>> import kneejax as kj
        >>> solver = Solver(Subject.of(kj.load_knee("four_ligament")))
        >>> answer = solver.answer(Setting.of({"flexion_deg": 30.0}))  # doctest: +SKIP
        >>> answer.status.word, sorted(answer.force_N)  # doctest: +SKIP
        ('balanced', ['ACL', 'LCL', 'MCL', 'PCL'])
    """

    def __init__(
        self, subject: Subject, flexion_deg: np.ndarray = FLEXIONS, constant: Sequence[Load] = ()
    ):
        """Begin without a pose.

        Args:
            subject: the knee and what can be set of it.
            flexion_deg: of the curves, `(n,)`.
            constant: loads that act beside those of a setting.
        """
        self.subject, knee = subject, subject.knee
        self.flexion_deg, self._constant = np.asarray(flexion_deg, float), tuple(constant)
        rows = [fibre_rows(knee, one) for one in subject.ligaments]
        owner = {row: i for i, some in enumerate(rows) for row in some}
        self._owners = tuple(owner[row] for row in range(len(knee.ligaments.names)))
        owners = (subject.ligaments[i] for i in self._owners)
        self.owner = dict(zip(knee.ligaments.names, owners, strict=True))
        self._vary = _Varied(subject.plain, subject.strains, self._owners)
        self.names = subject.selection.names
        self._last: tuple[float, np.ndarray, np.ndarray, State] | None = None

    @cached_property
    def unknown(self) -> np.ndarray:
        """What is not known of each parameter before it is measured, `(p,)`."""
        return prior_scales(self.subject.selection, self.subject.own)

    def answer(self, setting: Setting, near: Curves | None = None, sure: bool = False) -> Answer:
        """The pose at a setting.

        Args:
            setting: within the limits of the knee.
            near: curves from which the pose is sought, where it is far from the last one.
            sure: whether to bend and then load the knee from its reference pose, as
                `passive_flexion` does, which takes longer: the last pose may be on another branch.
        """
        own, numbers = self.subject.numbers(setting)
        flexion = self.subject.value(setting, "flexion_deg")
        cases = self._cases([flexion], setting)
        found = self._balanced(own, numbers[None], cases, flexion, near, sure)
        bodies = self.subject.knee.bodies
        state = State.of(cases.prescribed, jnp.asarray(found.q[0].T), bodies)
        if converged(found.status).all():
            self._last = flexion, found.q, found.contact_points, state
        elif self._last is not None:
            state = self._last[3]
        else:
            state = jax.tree.map(jnp.atleast_1d, self.subject.knee.at_reference)
        return self._described(setting, own, found, state, numbers, cases)

    def _balanced(
        self, knee: Knee, numbers, cases: LoadCases, flexion: float, near: Curves | None, sure: bool
    ) -> Equilibria:
        begin = None
        if not sure and self._last is not None and abs(flexion - self._last[0]) < _NEAR_DEG:
            begin = self._last[1:3]
        elif not sure and near is not None:
            q, points = near.at(flexion)
            begin = q[None, None], points[None, None]
        if begin is not None and np.isfinite(begin[0]).all():
            found = balance_near(knee, self._vary, numbers, cases, *begin)
            if converged(found.status).all():
                return found
        return balance_many(knee, self._vary, numbers, cases, holding=True)

    def differs(self, one: Answer, other: Answer) -> bool:
        """Whether two answers are different balances."""
        if one.status.converged != other.status.converged:
            return True
        own, its = (np.asarray(x.state.at(self._free))[:, 0] for x in (one, other))
        return bool(np.max(np.abs(own - its) / np.array(scales(self._free))) > _BRANCH_MM)

    @cached_property
    def _free(self) -> tuple[str, ...]:
        return self._cases([0.0], Setting()).free

    def _cases(self, flexion_deg, setting: Setting, extra: dict | None = None) -> LoadCases:
        """Load cases of one structure, whatever acts."""
        sizes = {k: x + np.asarray((extra or {}).get(k, 0.0))
                 for k, x in self.subject.loads(setting).items()}  # fmt: skip
        loads = [load_of(**sizes), *self._constant]
        if "quadriceps_N" in self.subject.limits:
            loads.append(pull_of(QUADRICEPS, self.subject.value(setting, "quadriceps_N")))
        return LoadCases.at(np.asarray(flexion_deg, float), loads).of(self.subject.knee)

    def _described(
        self,
        setting: Setting,
        own: Knee,
        found: Equilibria,
        state: State,
        numbers: np.ndarray,
        cases: LoadCases,
    ) -> Answer:
        knee = _varied(self._vary, own, numbers)
        held = jax.tree.map(np.asarray, _mechanics(knee, state))
        names, owners = self.subject.ligaments, np.array(self._owners)
        q = found.q[0, 0] * table_units(self._free)
        shown = {k: x for k, x in zip(self._free, q.tolist(), strict=True) if k in FREE_COORDINATES}
        tension, strain = held.tension[0], held.strain[0]
        return Answer(
            setting, knee, Status(int(found.status[0, 0])), shown, state, held,
            {one: float(tension[owners == i].sum()) for i, one in enumerate(names)},
            {one: float(strain[owners == i].max()) for i, one in enumerate(names)},
            dict(zip(knee.contact_names, held.max_pressure[0].tolist(), strict=True)),
            lambda: {name: x[0] for name, x in self._derived(own, found, numbers, cases).items()
                     if converged(found.status).all()},
        )  # fmt: skip

    def _derived(
        self, knee: Knee, found: Equilibria, numbers: np.ndarray, cases: LoadCases, count: int = 1
    ) -> dict[str, np.ndarray]:
        """Derivatives at the first poses, `(poses, parameters)`; NaN by what is no ligament's."""
        good = converged(found.status)[0, :count]
        held_at = {name: x[:count] for name, x in dict(cases.prescribed).items()}
        q, tangent = found.q[0, :count], found.holding["tangent"][0, :count]
        tangent = np.where(good[:, None, None], tangent, np.eye(tangent.shape[-1]))
        moved, pulled = map(np.asarray, _slopes(
            self._vary, self._free, knee, numbers, held_at, q, tangent))  # fmt: skip
        names, size = self.subject.ligaments, len(self.names)
        moved = moved * table_units(self._free)[:, None]
        each = np.moveaxis(np.concatenate([moved, pulled], axis=1), 1, 0)[..., :size]
        by_force = [self.subject.selection.leaf(i) is None for i in range(size)]
        each = np.where(good[:, None] & by_force, each, np.nan)
        every = dict(zip((*self._free, *names), each, strict=True))
        return {name: every[name] for name in (*FREE_COORDINATES, *names)}

    def curves(self, setting: Setting, test: str = "", near: Curves | None = None) -> Curves:
        """What a setting does over flexion.

        Args:
            setting: within the limits of the knee.
            test: one of `TESTS`, whose laxity is asked for.
            near: curves of a setting like this one, from which poses are sought; where one is not
                found, and by default, each is followed from the reference pose.
        """
        count, extra, loads = len(self.flexion_deg), {}, 1
        if test:
            size, loads = TESTS[test], 3
            extra = {test: np.repeat([0.0, size, -size], count)}
        cases = self._cases(np.tile(self.flexion_deg, loads), setting, extra)
        own, numbers = self.subject.numbers(setting)
        found = self._along(own, numbers[None], cases, near)
        q = np.where(converged(found.status)[0][:, None], found.q[0], np.nan)
        table = dict(zip(self._free, (q * table_units(self._free)).T, strict=True))
        prescribed = {k: x[:count] for k, x in cases.prescribed.items()}
        state = State.of(prescribed, jnp.asarray(q[:count].T), self.subject.knee.bodies)
        knee = _varied(self._vary, own, numbers)
        tension = np.asarray(_tension(knee, state))
        owners, laxity = np.array(self._owners), {}
        if test:
            one, other = (table[MOVED[test]][i * count : (i + 1) * count] for i in (1, 2))
            laxity[test] = one - other
        return Curves(
            setting, self.flexion_deg, found.status[0, :count],
            {k: table[k][:count] for k in FREE_COORDINATES},
            {one: tension[owners == i].sum(axis=0) for i, one in enumerate(self.subject.ligaments)},
            laxity, q, found.contact_points[0],
            lambda: self._derived(own, found, numbers, cases, count),
        )  # fmt: skip

    def _along(
        self, knee: Knee, numbers: np.ndarray, cases: LoadCases, near: Curves | None
    ) -> Equilibria:
        """Balances of curves: near other ones if every pose of those is found again and none has
        left its neighbours."""
        if near is not None and len(near.own) == len(cases) and np.isfinite(near.own).all():
            found = balance_near(knee, self._vary, numbers, cases, near.own[None],
                                 near.contact_points[None])  # fmt: skip
            if converged(found.status).all() and not self._torn(found.q[0], near):
                return found
        return balance_many(knee, self._vary, numbers, cases, holding=True)

    def _torn(self, q: np.ndarray, near: Curves) -> bool:
        """Whether a curve has a kink over flexion that the one before had not: another branch."""
        order = np.argsort(self.flexion_deg, kind="stable")
        parts = (q - near.own).reshape(-1, len(order), q.shape[-1])[:, order]
        kinks = np.abs(np.diff(parts, 2, axis=1)) * table_units(self._free)
        return bool((kinks > _KINK).any())
