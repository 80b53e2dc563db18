"""Several bones in balance: a patella beside the tibia, joined by fibres, contact and lines."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import (
    ConstantTensionLine,
    Contact,
    Course,
    Knee,
    Ligaments,
    Load,
    Muscles,
    add_lane_axis,
)
from kneejax.statics import Guess, differentiable, solve_equilibrium

BODIES = ("tibia", "patella")
EVERY = geo.coordinates_of(BODIES)
AT_REFERENCE = {
    "tibia": geo.Pose.from_table([20.0, 1.0, 2.0, 1.0, -30.0, 0.5]),
    "patella": geo.Pose.from_table([15.0, 2.0, -3.0, 42.0, 5.0, 1.0]),
}


def bundle(first, second, pair, stiffness, strain, at=AT_REFERENCE, courses=()):
    """Fibres between two bones, each with a strain at the reference poses."""
    count = len(first)
    names = [f"{pair[0]}-{pair[1]} {k}" for k in range(count)]
    fibres = Ligaments(first, second, [stiffness] * count, [1.0] * count, [0.03] * count,
                       [1e-3] * count, names, courses, bodies=(pair,) * count)  # fmt: skip
    slack = fibres.length(geo.State(at)) / (1.0 + strain)
    return dataclasses.replace(fibres, slack_length=slack)


def joined(*bundles):
    """Fibres of several bundles in one set; courses keep their fibres."""
    first, courses, row = bundles[0], [], 0
    for one in bundles:
        moved = (tuple(r + row for r in course.rows) for course in one.courses)
        courses += [dataclasses.replace(c, rows=r) for c, r in zip(one.courses, moved, strict=True)]
        row += len(one.names)
    fields = ("femoral_attachment", "tibial_attachment", "stiffness", "slack_length",
              "transition_strain", "transition_width")  # fmt: skip
    arrays = (jnp.concatenate([getattr(one, f) for one in bundles]) for f in fields)
    names = [name for one in bundles for name in one.names]
    pairs = tuple(pair for one in bundles for pair in one.bodies)
    return Ligaments(*arrays, names, courses, bodies=pairs) if len(bundles) > 1 else first


def cage(rng, pair, stiffness=4000.0):
    """Twelve fibres all around a bone, which hold it whatever pulls."""
    away = rng.normal(size=(12, 3))
    away = 40.0 * away / np.linalg.norm(away, axis=1)[:, None]
    near = 0.5 * away[rng.permutation(12)]
    there = AT_REFERENCE[pair[1]].placement
    if pair[0] != "femur":
        there = geo.State(AT_REFERENCE).between(pair)
    around = np.stack(there.translation) + away
    return bundle(around, near, pair, stiffness, 0.02)


def vice(pair, stiffness):
    """Three points of a bone held in six directions, from both sides: no tension moves it."""
    there, axes = geo.State(AT_REFERENCE).between(pair), np.eye(3)
    points = np.array([[15.0, 0.0, 0.0]] * 3 + [[-10.0, 12.0, 0.0]] * 2 + [[0.0, -5.0, 14.0]])
    along = axes[[0, 1, 2, 1, 2, 0]]
    placed = np.stack(there.apply(tuple(points.T)), axis=-1)
    away = np.concatenate([placed + 30.0 * along, placed - 30.0 * along])
    return bundle(away, np.concatenate([points, points]), pair, stiffness, 0.02)


def knee_of(fibres, **parts):
    of = dict(contacts=(), loads=(), lines=(), muscles=None) | parts
    names = tuple(str(k) for k in range(len(of["contacts"])))
    return Knee(
        fibres, of["contacts"], of["loads"], of["lines"], AT_REFERENCE["tibia"], names,
        other_bones={"patella": AT_REFERENCE["patella"]}, muscles=of["muscles"],
    )  # fmt: skip


@pytest.fixture(scope="module")
def full_knee():
    """Parts of every kind between the three bones."""
    rng = np.random.default_rng(4)
    tendon = bundle(
        [[0.0, -15.0, 2.0], [1.0, -14.0, -2.0]], [[25.0, -10.0, 1.0], [24.0, -12.0, 0.0]],
        ("patella", "tibia"), 3000.0, 0.02,
        courses=[Course((1,), [[[4.0, -18.0, -1.0]]], ("patella",),
                        geo.WrapSphere(9.0, geo.Frame([-6.0, -12.0, 0.0])), "patella",
                        ("patella", "tibia"))],
    )  # fmt: skip
    fibres = joined(
        cage(rng, geo.FEMUR_AND_TIBIA), tendon, cage(rng, ("femur", "patella"), 800.0)
    )
    groove = Contact(
        geo.Sphere(40.0), geo.Plane(geo.Frame([-2.5, 0.0, 0.0], [0.0, 0.0, np.pi / 2])),
        bodies=("femur", "patella"),
    )  # fmt: skip
    plateau = Contact(
        geo.Sphere(21.0, geo.Frame([0.0, -10.0, 5.0])), geo.Plane(geo.Frame([0.0, 0.5, 0.0]))
    )
    around = Course((1,), [[[18.0, 55.0, -3.0]]], ("femur",),
                    geo.WrapCylinder(15.0, 200.0, geo.Frame([8.0, 25.0, 0.0])), "femur",
                    ("femur", "patella"))  # fmt: skip
    heads = Muscles(
        [[20.0, 120.0, 8.0], [14.0, 110.0, -9.0], [-15.0, 90.0, 20.0]],
        [[-1.0, 17.0, 4.0], [0.0, 16.0, -6.0], [-20.0, -40.0, 18.0]],
        [70.0, 45.0, 20.0], ["vasint", "recfem", "biceps"], [around],
        (("femur", "patella"),) * 2 + (geo.FEMUR_AND_TIBIA,),
    )  # fmt: skip
    return knee_of(
        fibres, muscles=heads, contacts=(groove, plateau),
        lines=(ConstantTensionLine(60.0, [[30.0, 70.0, 4.0]], [2.0, 18.0, 1.0], bone="patella"),),
        loads=(Load([20.0, 0.0, 0.0], [0.0, 300.0, 0.0]),
               Load([0.0, 15.0, 5.0], axes="patella", bone="patella")),
    )  # fmt: skip



@pytest.mark.long
def test_what_the_parts_do_to_every_bone_is_what_the_energy_loses(full_knee, central_difference):
    """A part between patella and tibia pulls on both, each about its own origin."""
    knee = add_lane_axis(full_knee)
    here = full_knee.at_reference.at(EVERY) + np.linspace(-0.01, 0.012, 12)

    @jax.jit
    def energy(x):
        return knee.energy(geo.State.of({}, x[:, None], BODIES))[0]

    @jax.jit
    def work(x):
        state = geo.State.of({}, x[:, None], BODIES)
        held = knee.press(state)
        return jnp.stack(knee.work_of(held.wrenches, state, EVERY))[:, 0], held.energy[0]

    found, at_contact_points = work(here)
    assert float(at_contact_points) == pytest.approx(float(energy(here)), rel=1e-12)
    # Shifts of a rotation move what counts 30 times as far as those of a translation.
    scale = np.array(geo.scales(EVERY))
    slope = central_difference(lambda x: energy(here + x * scale), np.zeros(12), 1e-3)
    np.testing.assert_allclose(found * scale, -slope, rtol=1e-6, atol=1e-6 * np.abs(slope).max())


def equilibrium(knee, prescribed, nudge=0.0):
    lanes = add_lane_axis(knee)
    held = {name: jnp.atleast_1d(x) for name, x in prescribed.items()}
    q = knee.at_reference.at(geo.free_of(held, knee.bodies))[:, None] + nudge
    nowhere = jnp.full((knee.patch_count, 2, 1), jnp.nan)
    return solve_equilibrium(lanes, held, Guess(q, nowhere))


FLEXION = {"flexion": np.deg2rad(22.0)}


@pytest.mark.long
def test_a_patella_balances_beside_the_tibia_in_eleven_unknowns(full_knee):
    found = equilibrium(full_knee, FLEXION)
    assert found.q.shape == (11, 1) and bool(found.stable[0])
    scale = np.array(geo.scales(geo.free_of(FLEXION, BODIES)))
    assert np.abs(found.residual[:, 0] * scale).max() < 1e-6
    tangent = np.asarray(found.tangent)[..., 0]
    np.testing.assert_allclose(np.linalg.norm(tangent - tangent.T, 2), 0.0,
                               atol=2e-2 * np.linalg.norm(tangent, 2))  # fmt: skip


@pytest.mark.long
def test_its_derivatives_are_those_of_differences(full_knee, central_difference):
    """By the stiffness of all fibres, the radius of the groove, the pull of the muscles, and the
    flexion prescribed."""

    def changed(x):
        fibres, groove = full_knee.ligaments.stiffness, full_knee.contacts[0].femoral.radius
        pull = full_knee.muscles.tension
        knee = eqx.tree_at(
            lambda k: (k.ligaments.stiffness, k.contacts[0].femoral.radius, k.muscles.tension),
            full_knee,
            (fibres * (1.0 + 0.01 * x[0]), groove * (1.0 + 0.01 * x[1]), pull * (1.0 + 0.1 * x[3])),
        )
        return knee, {"flexion": FLEXION["flexion"] + 0.01 * x[2]}

    def state(x):
        return equilibrium(*changed(x)).q[:, 0]

    there = equilibrium(full_knee, FLEXION)

    # The derivative needs no search: it is compiled without one.
    @jax.jit
    @jax.jacfwd
    def exactly(x):
        knee, held = changed(x)
        held = {name: jnp.atleast_1d(value) for name, value in held.items()}
        return differentiable(add_lane_axis(knee), held, there).q[:, 0]

    exact = exactly(jnp.zeros(4))
    numeric = central_difference(state, np.zeros(4), 2e-2)
    largest = np.abs(numeric).max(axis=0)
    assert largest.min() > 1e-6
    np.testing.assert_allclose(exact / largest, numeric / largest, atol=1e-6)


@pytest.mark.long
def test_a_patella_bound_ever_stiffer_to_the_tibia_becomes_part_of_it(slope_on_log_axes):
    """A fibre to the patella then is one to the tibia, and the misfit falls like the stiffness."""
    rng = np.random.default_rng(8)
    between = geo.State(AT_REFERENCE).between(("tibia", "patella"))
    tip = [1.0, -3.0, 2.0]
    on_tibia = [[float(x) for x in between.apply(tuple(tip))]]
    held = cage(rng, geo.FEMUR_AND_TIBIA, 2000.0)
    pulled = [[55.0, 40.0, 10.0]]
    to_patella = bundle(pulled, [tip], ("femur", "patella"), 3000.0, 0.04)
    to_tibia = dataclasses.replace(to_patella, bodies=(geo.FEMUR_AND_TIBIA,),
                                   tibial_attachment=jnp.asarray(on_tibia))  # fmt: skip
    alone = Knee(joined(held, to_tibia), (), (), (), AT_REFERENCE["tibia"], ())
    expected = equilibrium(alone, FLEXION)
    assert bool(expected.stable[0])
    stiffness, misfit = [1e5, 1e6, 1e7], []
    for size in stiffness:
        bound = vice(("tibia", "patella"), size)
        found = equilibrium(knee_of(joined(held, bound, to_patella)), FLEXION)
        assert bool(found.stable[0])
        misfit.append(float(np.abs(np.asarray(found.q[:5] - expected.q)[2:]).max()))
    assert slope_on_log_axes(stiffness, misfit) == pytest.approx(-1.0, abs=0.05)


def test_a_part_that_joins_a_bone_which_the_knee_lacks_is_refused():
    rng = np.random.default_rng(1)
    with pytest.raises(ValueError, match="a part joins 'patella'; the knee's bones are"):
        Knee(cage(rng, ("femur", "patella")), (), (), (), AT_REFERENCE["tibia"], ())
