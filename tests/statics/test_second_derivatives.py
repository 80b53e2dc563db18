"""Second derivatives of balances against differences of exact Jacobians, in all four nestings."""

import dataclasses
from functools import cache, partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import Contact, Course, Knee, Ligaments, Load, add_lane_axis
from kneejax.statics import Guess, Status, differentiable, solve_equilibrium

OPTIONS = {"xla_disable_hlo_passes": "fusion", "xla_backend_optimization_level": 0}
MODES = {"forward": jax.jacfwd, "reverse": jax.jacrev}
TIBIA = geo.Pose.from_table([20.0, 1.0, 2.0, 1.0, -30.0, 0.5])
PATELLA = geo.Pose.from_table([15.0, 2.0, -3.0, 42.0, 5.0, 1.0])


def cage(pair, at, seed, obstacle=None):
    """Eight fibres all around a bone, of which the first may go around an obstacle."""
    rng = np.random.default_rng(seed)
    away = rng.normal(size=(8, 3))
    away = 40.0 * away / np.linalg.norm(away, axis=1)[:, None]
    near = 0.5 * away[rng.permutation(8)]
    first = np.stack(at[pair[1]].placement.translation) + away
    courses = []
    if obstacle is not None:
        # Across the first fibre, a third of its radius off.
        middle = 0.5 * (first[0] + np.stack(at[pair[1]].placement.apply(tuple(near[0]))))
        obstacle = dataclasses.replace(obstacle, frame=geo.Frame(middle + [1.0, 1.5, 2.0]))
        courses = [Course((0,), obstacle=obstacle, obstacle_bone=pair[0], bodies=pair)]
    names = [f"{pair[1]} {k}" for k in range(8)]
    fibres = Ligaments(first, near, np.linspace(2500.0, 4500.0, 8), np.ones(8), [0.03] * 8,
                       [2e-3] * 8, names, courses, bodies=(pair,) * 8)  # fmt: skip
    slack = fibres.length(geo.State(at)) / np.linspace(1.01, 1.04, 8)
    return dataclasses.replace(fibres, slack_length=slack)


def pressed(**form):
    """A ball that is pressed into a plane below the tibia's origin."""
    return Contact(
        geo.Sphere(21.0, geo.Frame([0.0, -10.0, 5.0])), geo.Plane(geo.Frame([0.0, 0.3, 0.0])),
        **form,
    )  # fmt: skip


def on_plateau(**form):
    """Surfaces without symmetry, of which the tibial one has an end."""
    c = [[22.0, 0.4, -1.6], [-1.5, 0.2, 0.0], [0.8, 0.0, 0.0]]
    height = [[0.0, 0.3, 0.9], [0.2, 0.1, 0.0], [0.8, 0.0, 0.0]]
    return Contact(
        geo.Condyle(c, (0.1, 3.0), (-12, 12), geo.Frame([0.0, -10.0, 5.0])),
        geo.Plateau(height, (-14, 14), (-12, 12), geo.Frame([0.0, 1.5, 5.0])),
        **form,
    )


def two_bones(contacts=(), obstacle=None):
    at = {"tibia": TIBIA}
    fibres = cage(geo.FEMUR_AND_TIBIA, at, 4, obstacle)
    load = Load([5.0, 60.0, -8.0], [50.0, -300.0, 200.0], [1.0, -30.0, 2.0], "tibia", "femur")
    return Knee(fibres, contacts, (load,), (), TIBIA, tuple(map(str, range(len(contacts)))))


def three_bones():
    at = {"tibia": TIBIA, "patella": PATELLA}
    parts = [cage(geo.FEMUR_AND_TIBIA, at, 4), cage(("femur", "patella"), at, 5)]
    fields = ("femoral_attachment", "tibial_attachment", "stiffness", "slack_length",
              "transition_strain", "transition_width")  # fmt: skip
    tendon = Ligaments([[0.0, -15.0, 2.0]], [[25.0, -10.0, 1.0]], [3000.0], [1.0], [0.03], [2e-3],
                       ["tendon"], bodies=(("patella", "tibia"),))  # fmt: skip
    length = tendon.length(geo.State(at))
    parts.append(dataclasses.replace(tendon, slack_length=length / 1.03))
    fibres = Ligaments(
        *(jnp.concatenate([getattr(one, field) for one in parts]) for field in fields),
        [name for one in parts for name in one.names],
        bodies=tuple(pair for one in parts for pair in one.bodies),
    )
    groove = Contact(
        geo.Sphere(40.0), geo.Plane(geo.Frame([-2.5, 0.0, 0.0], [0.0, 0.0, np.pi / 2])),
        bodies=("femur", "patella"),
    )  # fmt: skip
    return Knee(fibres, (groove,), (), (), TIBIA, ("groove",), other_bones={"patella": PATELLA})


@dataclasses.dataclass(frozen=True)
class Case:
    """A knee, which coordinates of the tibia are prescribed, and what of its numbers varies."""

    knee: Knee
    held: tuple[str, ...] = ("flexion",)
    only_ligaments: bool = False

    @property
    def size(self) -> int:
        return 2 if self.only_ligaments else 7

    def __call__(self, x):
        """The knee in lanes, and what is prescribed, of numbers `(size, lanes)` near zero."""
        knee, fibres = add_lane_axis(self.knee), add_lane_axis(self.knee).ligaments
        stiffness = fibres.stiffness * jnp.ones_like(x[0])
        slack = fibres.slack_length * jnp.ones_like(x[0])
        changed = [
            stiffness.at[0].multiply(1.0 + x[0]),
            slack.at[1].multiply(1.0 + 0.1 * x[1]),
        ]
        lanes = eqx.tree_at(lambda k: (k.ligaments.stiffness, k.ligaments.slack_length),
                            knee, changed)  # fmt: skip
        held = {name: getattr(TIBIA, name) + jnp.zeros_like(x[0]) for name in self.held}
        if self.only_ligaments:
            return lanes, held
        at = lanes.ligaments.femoral_attachment * jnp.ones_like(x[0])
        lanes = eqx.tree_at(lambda k: k.ligaments.femoral_attachment, lanes,
                            at.at[0, 1].add(5.0 * x[2]))  # fmt: skip
        if lanes.contacts:
            lanes = eqx.tree_at(
                lambda k: (k.contacts[0].youngs_modulus, k.contacts[0].femoral.frame.origin),
                lanes,
                (lanes.contacts[0].youngs_modulus * (1.0 + x[3]),
                 lanes.contacts[0].femoral.frame.origin + jnp.stack([0 * x[4], x[4], 0 * x[4]])),
            )  # fmt: skip
        if lanes.ligaments.courses:
            sizes = jax.tree.leaves(lanes.ligaments.courses[0].obstacle)[0] * (1.0 + x[6])
            lanes = eqx.tree_at(
                lambda k: jax.tree.leaves(k.ligaments.courses[0].obstacle)[0], lanes, sizes
            )
        return lanes, held | {self.held[-1]: held[self.held[-1]] * (1.0 + 0.3 * x[5])}


CASES = {
    "straight": Case(two_bones()),
    "around a sphere, pressed, by a machine": Case(
        two_bones((pressed(),), geo.WrapSphere(6.0)), held=("flexion", "anterior", "adduction")
    ),
    "points": Case(two_bones((on_plateau(form="quadrature", points=(7, 6)),))),
    "three bones": Case(three_bones(), only_ligaments=True),
}


@cache
def at_differences(name):
    """Balances where nothing is changed and around there, and the differences of their exact
    Jacobians, `(free, size, size)`."""
    case, steps = CASES[name], np.array([-1.0, -0.5, 0.5, 1.0]) * 2e-3
    moved = np.einsum("k,ij->ikj", steps, np.eye(case.size)).reshape(-1, case.size)
    x = np.concatenate([np.zeros((1, case.size)), moved]).T
    lanes, held = case(jnp.asarray(x))
    reference = case.knee.at_reference.at(geo.free_of(held, case.knee.bodies))
    q = jnp.broadcast_to(reference[:, None], (len(reference), x.shape[1]))
    nowhere = jnp.full((case.knee.patch_count, 2, x.shape[1]), jnp.nan)
    found = solve_equilibrium(lanes, held, Guess(q, nowhere))
    assert bool(found.stable.all()), np.asarray(found.status)

    @partial(jax.jit, compiler_options=OPTIONS)
    def jacobians(x):
        _, push = jax.linearize(partial(poses, case, found), x)
        # Lanes do not touch each other: one direction moves the same number of all of them.
        units = jnp.broadcast_to(jnp.eye(case.size)[..., None], (case.size, *x.shape))
        return jax.vmap(push, out_axes=-1)(units)

    exact = jacobians(jnp.asarray(x))
    near = np.asarray(exact)[:, 1:].reshape(len(q), case.size, 4, case.size)
    a, b, c, d = np.moveaxis(near, 2, 0)
    differences = (8.0 * (c - b) - (d - a)) / (6.0 * 2e-3)
    return jax.tree.map(lambda y: y[..., :1], found), np.moveaxis(differences, 1, 2)


def poses(case, found, x):
    """Coordinates of known balances as a function of numbers."""
    return differentiable(*case(x), found).q


def second(name, outer, inner):
    """Second derivatives of the coordinates, in one nesting, and by differences."""
    case = CASES[name]
    found, expected = at_differences(name)

    def of(x):
        return poses(case, found, x[:, None])[:, 0]

    return jax.jit(MODES[outer](MODES[inner](of)), compiler_options=OPTIONS), expected


def check(name, outer, inner):
    nested, expected = second(name, outer, inner)
    exact = np.asarray(nested(np.zeros(CASES[name].size)))
    scale = np.abs(expected).max(axis=(1, 2), keepdims=True)
    assert np.all(scale > 1e-6)
    assert (np.abs(exact - expected) / scale).max() < 1e-6


def test_a_hessian_of_straight_fibres():
    check("straight", "forward", "reverse")


@pytest.mark.long
@pytest.mark.parametrize(
    ("outer", "inner"), [("forward", "forward"), ("reverse", "forward"), ("reverse", "reverse")]
)
def test_the_other_nestings(outer, inner):
    check("straight", outer, inner)


@pytest.mark.long
@pytest.mark.parametrize(
    ("name", "outer", "inner"),
    [
        ("around a sphere, pressed, by a machine", "forward", "forward"),
        ("points", "forward", "forward"),
        ("three bones", "reverse", "reverse"),
    ],
)
def test_every_part_of_a_knee(name, outer, inner):
    """Each in one nesting: the rule of a balance, which all share, is tested in all four above.

    The second derivatives of every obstacle by itself are tested in
    tests/geometry/paths/test_wrapping.py.
    """
    check(name, outer, inner)


def test_what_has_no_equilibrium_is_nan_in_both_modes_and_spoils_nothing_else():
    case, (found, _) = CASES["straight"], at_differences("straight")
    both = jax.tree.map(lambda y: jnp.concatenate([y, y], axis=-1), found)
    status = both.status.at[1].set(int(Status.NOT_CONVERGED))
    lost = dataclasses.replace(both, status=status, q=both.q.at[:, 1].set(jnp.nan))

    def of(x):
        return poses(case, lost, jnp.stack([x, x], axis=1))

    def found_only(x):
        return jnp.sum(jnp.where(jnp.array([True, False]), of(x), 0.0) ** 2)

    zero = np.zeros(case.size)

    @partial(jax.jit, compiler_options=OPTIONS)
    def every():
        table = jax.jacfwd(of)(zero), jax.jacrev(of)(zero)
        alone = jax.grad(found_only)(zero), jax.hessian(found_only)(zero)
        return table, jax.grad(lambda x: of(x)[2, 1])(zero), alone

    (forward, reverse), of_lost, (slope, hessian) = every()
    # Without contacts and obstacles three of the numbers are nowhere in the knee.
    there = [0, 1, 2, 5]
    assert np.isnan(forward[:, 1]).all() and np.isnan(reverse[:, 1, there]).all()
    assert np.isfinite(forward[:, 0]).all() and np.isfinite(reverse[:, 0]).all()
    np.testing.assert_allclose(reverse[:, 0], forward[:, 0], rtol=1e-9, atol=1e-12)
    assert np.isnan(of_lost[np.array(there)]).all()
    assert np.isfinite(slope).all() and np.isfinite(hessian).all() and np.abs(hessian).max() > 0.0
