"""Where a knee balances at a setting, what holds it, and what would move it; curves over flexion.

Numbers of a setting are data: one compiled program serves every pose of a knee, another one its
curves. A pose begins near the last one and takes some milliseconds; at rest it is compared with the
one that is reached by bending and then loading the knee, as `passive_flexion` does.
"""

__all__ = ["Solver"]

import dataclasses
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from kneejax.experiments import evaluate
from kneejax.explorer.setting import FLEXIONS, MOVED, TESTS, Answer, Curves, Setting, Subject
from kneejax.geometry import FREE_COORDINATES, State, scales, table_units
from kneejax.mechanics import QUADRICEPS, Knee, Load, add_lane_axis, load_of, pull_of
from kneejax.numerics import compiled
from kneejax.parameters import Selection, fibre_rows, prior_scales
from kneejax.statics import (
    Equilibria,
    Equilibrium,
    Guess,
    LoadCases,
    Progress,
    Status,
    balance_many,
    balance_near,
    converged,
    solve_equilibrium,
)

#: A pose that is farther than this from the curve through its flexion is on another branch, mm, a
#: rotation at 30 mm.
_BRANCH_MM = 1.0
#: A curve is torn where the second difference over flexion of its move is larger, degrees, mm.
_KINK = 5.0
#: Flexion from the last pose within which it is a beginning, degrees.
_NEAR_DEG = 12.0
#: The longest step that is extrapolated, for each that was made.
_AHEAD = 2.0


@dataclasses.dataclass(frozen=True)
class _Varied:
    """Sets, changes and cuts ligaments by the numbers of `Subject.numbers`."""

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


@compiled(static_argnums=(0,), effort="least")
def _varied(vary: _Varied, knee: Knee, numbers) -> Knee:
    return vary(knee, numbers)


@compiled()
def _sought(knee: Knee, cases: LoadCases, q, contact_points):
    """The balance near a pose, of one load case, with tension, strain and largest pressures.

    A path is followed in several lanes at once, which would all be computed for this one.
    """
    guess = Guess(q, contact_points)
    found = solve_equilibrium(cases.load(add_lane_axis(knee)), cases.prescribed, guess)
    held = evaluate(knee, found.state, found.contact_points)
    return found, held.tension[0], held.strain[0], held.max_pressure[0]


@compiled(effort="least")
def _tension(knee: Knee, state: State):
    return add_lane_axis(knee.ligaments).tension(state)


@compiled(static_argnums=(0, 1), effort="least")
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


class Solver:
    """Answers of one knee; it remembers the last two poses that balanced, and nothing else.

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
        self._trail: list[tuple[Answer, Equilibrium]] = []
        self._known: tuple[Any, Any] = None, None

    @cached_property
    def unknown(self) -> np.ndarray:
        """What is not known of each parameter before it is measured, `(p,)`."""
        return prior_scales(self.subject.selection, self.subject.own)

    def answer(
        self, setting: Setting, near: Curves | None = None, sure: bool = False,
        progress: Progress | None = None,
    ) -> Answer:  # fmt: skip
        """The pose at a setting.

        Args:
            setting: within the limits of the knee.
            near: curves from which the pose is sought, where it is far from the last one.
            sure: whether to bend and then load the knee from its reference pose, as
                `passive_flexion` does, which takes longer: the last pose may be on another branch.
                The next pose does not begin there, see `go_on_from`.
            progress: see `curves`.
        """
        own, numbers, knee = self._knees(setting)
        cases = self._cases([self.subject.value(setting, "flexion_deg")], setting)
        begin, found = None if sure else self._begin(setting, near), None
        if begin is not None:
            found, *held = _sought(knee, cases, *begin)
        if found is None or not found.converged[0]:
            path = balance_many(own, self._vary, numbers[None], cases, progress=progress)
            status = Status(int(path.status[0, 0]))
            if not status.converged:
                return self._lost(setting, knee, status)
            points = np.moveaxis(path.contact_points[0], 0, -1)
            found, *held = _sought(knee, cases, path.q[0].T, points)
        found = jax.tree.map(np.asarray, found)
        status, q = Status(int(found.status[0])), found.q
        if not status.converged:
            return self._lost(setting, knee, status)
        tension, strain, pressure = map(np.asarray, held)
        owners, ligaments = np.array(self._owners), self.subject.ligaments
        shown = zip(self._free, (q[:, 0] * table_units(self._free)).tolist(), strict=True)
        answer = Answer(
            setting, knee, status, {name: x for name, x in shown if name in FREE_COORDINATES},
            jax.tree.map(np.asarray, found.state), found,
            {one: float(tension[owners == i].sum()) for i, one in enumerate(ligaments)},
            {one: float(strain[owners == i].max()) for i, one in enumerate(ligaments)},
            dict(zip(knee.contact_names, pressure.tolist(), strict=True)),
            lambda: {name: x[0] for name, x in self._derived(
                own, found.status, q.T, np.moveaxis(found.tangent, -1, 0), numbers, cases).items()},
        )  # fmt: skip
        if not sure:
            self.go_on_from(answer)
        return answer

    def go_on_from(self, answer: Answer) -> None:
        """Begin the next pose at an answer, if it balances."""
        if answer.found is not None:
            self._trail = [*self._trail[-1:], (answer, answer.found)]

    def unsolved(self) -> Answer:
        """The knee as it was read, before anything is known of it."""
        return self._lost(Setting(), self.subject.knee, None)

    def ready(self) -> None:
        """Have the program of a pose, which is compiled while others are."""
        _, _, knee = self._knees(Setting())
        nothing = np.full((len(self._free), 1), np.nan), np.full((knee.patch_count, 2, 1), np.nan)
        _sought(knee, self._cases([0.0], Setting()), *nothing)

    def _knees(self, setting: Setting) -> tuple[Knee, np.ndarray, Knee]:
        """`Subject.numbers`, and the knee that they vary, kept for other flexions and loads."""
        parts, known = tuple(x for x in setting.numbers if "." in x[0]), self._known
        if known[0] != parts:
            own, numbers = self.subject.numbers(Setting(parts))
            knee = _varied(self._vary, own, numbers).for_many_poses()
            self._known = known = parts, (own, numbers, knee)
        return known[1]

    def _begin(self, setting: Setting, near: Curves | None) -> tuple[np.ndarray, np.ndarray] | None:
        """Where a pose is sought: beyond the last two poses, at the last one, or on curves."""
        flexion = self.subject.value(setting, "flexion_deg")
        for last, found in self._trail[-1:]:
            if abs(flexion - self.subject.value(last.setting, "flexion_deg")) < _NEAR_DEG:
                (before, old), q = self._trail[0], found.q
                name, step = self._moved(last.setting, setting)
                same, made = self._moved(before.setting, last.setting)
                if same == name and 0.0 < abs(step) <= _AHEAD * abs(made):
                    q = q + (q - old.q) * step / made
                return q, found.contact_points
        if near is None:
            return None
        q, points = near.at(flexion)
        return (q[:, None], points[..., None]) if np.isfinite(q).all() else None

    def differs(self, one: Answer, other: Answer) -> bool:
        """Whether two answers are different balances."""
        if (one.found is None) != (other.found is None):
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

    def _moved(self, one: Setting, other: Setting) -> tuple[str, float]:
        """The one number that differs between two settings, if it is one, and by how much."""
        names = {name for name, _ in {*one.numbers} ^ {*other.numbers}}
        if len(names) != 1:
            return "", 0.0
        (name,) = names
        return name, self.subject.value(other, name) - self.subject.value(one, name)

    def _lost(self, setting: Setting, knee: Knee, status: Status | None) -> Answer:
        """What is shown where nothing balances: the last pose that did, without coordinates."""
        nowhere = dict.fromkeys(FREE_COORDINATES, np.nan)
        if not self._trail:
            state = jax.tree.map(np.atleast_1d, self.subject.knee.at_reference)
            return Answer(setting, knee, status, nowhere, state, None, {}, {}, {}, dict)
        last, _ = self._trail[-1]
        return dataclasses.replace(last, setting=setting, knee=knee, status=status,
                                   coordinates=nowhere, found=None, derive=dict)  # fmt: skip

    def _derived(
        self, knee: Knee, status: np.ndarray, q: np.ndarray, tangent: np.ndarray,
        numbers: np.ndarray, cases: LoadCases,
    ) -> dict[str, np.ndarray]:  # fmt: skip
        """Derivatives at the first poses, `(poses, parameters)`; NaN by what is no ligament's."""
        good, count = converged(status), len(q)
        held_at = {name: x[:count] for name, x in dict(cases.prescribed).items()}
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

    def curves(
        self, setting: Setting, test: str = "", near: Curves | None = None,
        progress: Progress | None = None,
    ) -> Curves:  # fmt: skip
        """What a setting does over flexion.

        Args:
            setting: within the limits of the knee.
            test: one of `TESTS`, whose laxity is asked for.
            near: curves of a setting like this one, from which poses are sought; where one is not
                found, and by default, each is followed from the reference pose.
            progress: see `kneejax.statics.balance_many`; what it raises ends the search.
        """
        if near is not None and [*near.laxity] == [test][: len(test)]:
            if self._moved(near.setting, setting)[0] == "flexion_deg":
                return dataclasses.replace(near, setting=setting)
        count, extra, loads = len(self.flexion_deg), {}, 1
        if test:
            size, loads = TESTS[test], 3
            extra = {test: np.repeat([0.0, size, -size], count)}
        cases = self._cases(np.tile(self.flexion_deg, loads), setting, extra)
        own, numbers, knee = self._knees(setting)
        found = self._along(own, numbers[None], cases, near, progress)
        q = np.where(converged(found.status)[0][:, None], found.q[0], np.nan)
        table = dict(zip(self._free, (q * table_units(self._free)).T, strict=True))
        prescribed = {k: x[:count] for k, x in cases.prescribed.items()}
        state = State.of(prescribed, jnp.asarray(q[:count].T), self.subject.knee.bodies)
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
            lambda: self._derived(own, found.status[0, :count], found.q[0, :count],
                                  found.forces["tangent"][0, :count], numbers, cases),
        )  # fmt: skip

    def _along(
        self, knee: Knee, numbers: np.ndarray, cases: LoadCases, near: Curves | None,
        progress: Progress | None,
    ) -> Equilibria:  # fmt: skip
        """Balances of curves: near other ones if all poses are found again and none has jumped."""
        if near is not None and len(near.own) == len(cases) and np.isfinite(near.own).all():
            found = balance_near(knee, self._vary, numbers, cases, near.own[None],
                                 near.contact_points[None], progress)  # fmt: skip
            if converged(found.status).all() and not self._torn(found.q[0], near):
                return found
        return balance_many(knee, self._vary, numbers, cases, forces=True, progress=progress)

    def _torn(self, q: np.ndarray, near: Curves) -> bool:
        """Whether a curve has a kink over flexion that the one before had not: another branch."""
        order = np.argsort(self.flexion_deg, kind="stable")
        parts = (q - near.own).reshape(-1, len(order), q.shape[-1])[:, order]
        kinks = np.abs(np.diff(parts, 2, axis=1)) * table_units(self._free)
        return bool((kinks > _KINK).any())
