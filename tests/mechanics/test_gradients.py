"""Every smooth function of the mechanics against central differences, at random numbers.

Fibres stand at zero strain, at the transition strain or anywhere; contacts at zero depth or any.
"""

from functools import cache

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree

import kneejax.geometry as geo
from kneejax.mechanics import (
    BONES,
    FORMS,
    ConstantTensionLine,
    Contact,
    Knee,
    Ligaments,
    Load,
    cartilage_law,
    ligament_law,
)
from tests.derivatives import both_ways
from tests.mechanics import published_laws

seeds = st.integers(0, 2**31)
few = settings(max_examples=6)


def _fibre(rng):
    """Strain, stiffness, transition strain, width, slack length and a force of one fibre."""
    toe = rng.uniform(0.02, 0.08)
    strain = rng.choice([0.0, toe, rng.uniform(-0.1, 0.15)])
    return np.array(
        [strain, rng.uniform(1e3, 9e3), toe, rng.uniform(5e-4, 4e-3), 30.0, rng.uniform(5, 300)]
    )


def _spring(x):
    strain, k, toe, width, slack, force = x
    return jnp.stack(
        [
            ligament_law.energy(strain, k, toe, width, slack),
            ligament_law.tension(strain, k, toe, width),
            ligament_law.stiffness_at(strain, k, toe, width),
            ligament_law.largest_tension_error(k, toe, width),
            ligament_law.slack_length_from_strain(slack, strain),
            ligament_law.slack_length_from_force(slack, force, k, toe, width),
        ]
    )


def _published(x):
    strain, k, toe, _, slack, _ = x
    return jnp.stack(
        [
            published_laws.exact_energy(strain, k, toe, slack),
            ligament_law.exact_tension(strain, k, toe),
        ]
    )


spring, published = both_ways(_spring), both_ways(_published, 1e-7)


@given(seeds)
def test_the_smooth_spring_follows_all_its_numbers_at_its_corners_too(seed):
    x = _fibre(np.random.default_rng(seed))
    # A part of the rounding's width, so that the corners are resolved.
    error = spring(x, np.array([x[3], x[1], x[2] * x[3] * 10, 0.3 * x[3], 10.0, 0.3 * x[5]]))
    assert error.forward < 1e-6
    assert error.reverse < 1e-9


@given(seeds)
def test_the_published_spring_follows_all_its_numbers_at_its_corners_too(seed):
    x = _fibre(np.random.default_rng(seed))
    # Against a change of strain by 0.1 on the line: at a corner a difference is of first order.
    error = published(x, np.array([0.1, x[1], 0.1, 1.0, 10.0, 1.0]), smallest=0.1 * x[1])
    assert error.forward < 1e-6
    assert error.reverse < 1e-9


stiffness = both_ways(lambda x: published_laws.exact_stiffness(x[0], x[1], x[2])[None])


@pytest.mark.parametrize("part", [-0.5, 0.3, 0.9, 1.4])
def test_the_published_stiffness_follows_strain_and_transition_between_its_corners(part):
    error = stiffness(np.array([part * 0.05, 3000.0, 0.05]), np.array([0.01, 1e3, 0.01]))
    assert error.forward < 1e-6
    assert error.reverse < 1e-9


def _layer(law):
    return lambda s: jnp.concatenate(
        [
            cartilage_law.relative_pressure(law, s),
            cartilage_law.relative_energy(law, s),
            cartilage_law.patch_energy(law, s),
        ]
    )


def _resultant(law):
    return lambda s: published_laws.patch_force(law, s)


layers = {law: both_ways(_layer(law)) for law in cartilage_law.LAWS}
# The second derivative begins at first touch: a difference across it is of first order.
resultants = {law: both_ways(_resultant(law), 1e-6) for law in cartilage_law.LAWS}
depths = st.one_of(st.just(0.0), st.floats(1e-6, 0.9))


@pytest.mark.parametrize("law", cartilage_law.LAWS)
@given(s=depths)
def test_the_layers_laws_follow_depth_at_zero_depth_too(law, s):
    error = layers[law](np.array([s]), np.array([0.1 * (1.0 - s)]), smallest=1e-4)
    assert error.forward < 1e-6
    assert error.reverse < 1e-9
    error = resultants[law](np.array([s]), np.array([1.0]))
    assert error.forward < 1e-6
    assert error.reverse < 1e-9


modulus = both_ways(lambda x: cartilage_law.confined_modulus(x[0], x[1])[None])


@given(st.floats(1.0, 20.0), st.floats(0.0, 0.48))
def test_the_confined_modulus_follows_both_elastic_numbers(e, nu):
    error = modulus(np.array([e, nu]), np.array([1.0, 0.1 * (0.5 - nu)]))
    assert error.forward < 1e-6
    assert error.reverse < 1e-9


def _pose(rng):
    return np.r_[rng.uniform(0.0, 2.0), rng.uniform(-0.1, 0.1, 2), rng.uniform(-3.0, 3.0, 3)]


POSE_SIZE = np.array([0.03, 0.03, 0.03, 1.0, 1.0, 1.0])


def _fibres(rng):
    """Three fibres at a pose: slack or taut, at zero strain, and at the transition strain."""
    c = _pose(rng)
    width, toe = 0.01, rng.uniform(0.03, 0.06, size=3)
    femoral, tibial = rng.uniform(-20, 20, size=(2, 3, 3)) + [[[0, 15, 0]], [[0, -35, 0]]]
    fibres = Ligaments(
        femoral, tibial, [3e3, 4e3, 5e3], [1.0] * 3, toe, [width] * 3, ["A", "B", "C"]
    )
    strain = np.array([rng.uniform(-0.05, 0.1), 0.0, toe[2]])
    length = np.asarray(fibres.length(geo.State({"tibia": geo.Pose(*c)})))
    fibres = eqx.tree_at(lambda f: f.slack_length, fibres, jnp.asarray(length / (1.0 + strain)))
    return fibres, geo.Pose(*jnp.asarray(c))


def _wires(rng):
    loads = tuple(
        Load(*(rng.uniform(-n, n, 3) for n in (50, 900, 40)), axes, where)
        for axes in BONES
        for where in BONES
    )
    line = ConstantTensionLine(20.0, rng.uniform(-9, 9, (3, 3)) + [[30], [0], [0]], [9.0, -50, 3])
    return (loads, line), geo.Pose(*jnp.asarray(_pose(rng)))


def _reference(rng):
    fibres, pose = _fibres(rng)
    return Knee(fibres, (), (), (), pose, ()), pose


def _of_fibres(fibres, pose):
    state = geo.State({"tibia": pose})
    answers = fibres.length(state), fibres.strain(state), fibres.tension(state)
    return jnp.concatenate([*answers, fibres.energy(state)[None]])


def _of_wires(wires, pose):
    loads, line = wires
    state = geo.State({"tibia": pose})
    work = [jnp.stack(load.work(state, tuple(geo.COORDINATES))) for load in loads]
    return jnp.concatenate([*work, line.energy(state)[None]])


def _of_reference(knee, pose):
    whole = knee.energy(geo.State({"tibia": pose}))[None]
    return jnp.concatenate([knee.reference_length(), knee.reference_strain(), whole])


def _of_contact(contact, pose):
    """Energy, and for a patch all that is known of the gap; sampled depths for the other form."""
    tibia = pose.placement
    if not contact.has_patch:
        sampled = contact.foundation.sample(tibia)
        numbers = [jnp.sum(sampled.points.area), *sampled.depth[5:7], sampled.points.point[1][3]]
        depth = sampled.depth[5]
    else:
        contact_points = contact.contact_point(tibia)
        gap = contact.gap(tibia, contact_points)
        depth = gap.depth
        numbers = [
            *contact_points, gap.value, gap.aa, gap.ab, gap.bb, gap.steepness, gap.metric,
            *gap.stretch,
            *geo.Vector.of(jnp.stack(jnp.broadcast_arrays(*gap.point))), gap.determinant,
            gap.curvature, gap.mean_radius, depth, contact.patch_energy(gap),
        ]  # fmt: skip
    return jnp.stack([contact.energy(tibia), contact.modulus, contact.pressure(depth), *numbers])


def _condyle_on_plateau(form):
    def anywhere(rng):
        c = rng.normal(size=(3, 3)) * [[0.0], [0.5], [0.5]]
        c[0] = [23.0, 0.4, -1.6]
        h = np.array([[0.1, 0.3, 0.9], [0.2, 0.1, 0.0], [0.8, 0.0, 0.0]])
        turn = rng.uniform(-0.05, 0.05, size=(2, 3))
        femoral = geo.Condyle(c, (0.1, 3.0), (-12, 12), geo.Frame([0, 0, 22], turn[0]))
        h = h + rng.normal(size=(3, 3)) * 0.05
        tibial = geo.Plateau(h, (-20, 20), (-13, 13), geo.Frame([0, -25, 22], turn[1]))
        law = {"elliptical_patch": "log", "quadrature": "ratio"}[form]
        contact = Contact(femoral, tibial, onset_width=0.1, law=law, form=form, points=(4, 4))
        spread = [0.6, 0.04, 0.08, 2.0, 0.5, 0.6]
        pose = geo.Pose(*jnp.asarray([0.7, 0, 0, 0, 0.5, 0] + rng.uniform(-1, 1, 6) * spread))
        # Zero depth once in two times.
        tibia = pose.placement
        depth = rng.choice([0.0, rng.uniform(-0.2, 1.5)])
        return press(contact, tibia, depth), pose

    def draw(rng):
        # Held at the border of its surface, a point follows nothing: redrawn until they meet.
        contact, pose = anywhere(rng)
        while tilt(contact, pose.placement) > 1e-9:
            contact, pose = anywhere(rng)
        return contact, pose

    return draw


@jax.jit
def press(contact, tibia, depth):
    """Lift the plateau until it overlaps by a depth."""

    def lift(_, contact):
        missing = depth - contact.gap(tibia, contact.contact_point(tibia)).depth
        origin = contact.tibial.frame.origin
        return eqx.tree_at(lambda c: c.tibial.frame.origin, contact, origin.at[1].add(missing))

    return jax.lax.fori_loop(0, 15, lift, contact)


@jax.jit
def tilt(contact, tibia):
    """Slope that is left where the search for the smallest gap ended."""
    return contact.gap(tibia, contact.contact_point(tibia)).tilt


#: Sizes of a change by the leaf's name: what bends a law or a surface by a small part.
SIZES = {
    "femoral_attachment": 0.3, "tibial_attachment": 0.3, "slack_length": 0.3, "stiffness": 1e3,
    "transition_strain": 0.01, "transition_width": 0.003, "poisson_ratio": 0.01,
    "onset_width": 0.03, "origin": 0.1, "rotation": 0.01, "coefficients": 0.1, "angle": 0.03,
    "width": 0.3, "x": 0.3, "z": 0.3,
}  # fmt: skip


def _sizes(tree):
    paths = jax.tree_util.tree_flatten_with_path(tree)[0]
    sizes = [
        np.full(leaf.size, SIZES.get(jax.tree_util.keystr(path).split(".")[-1], 1.0))
        for path, leaf in paths
    ]
    return np.concatenate(sizes)


PARTS = {
    "fibres": (_fibres, _of_fibres),
    "loads and lines": (_wires, _of_wires),
    "reference pose": (_reference, _of_reference),
} | {form: (_condyle_on_plateau(form), _of_contact) for form in FORMS}


@cache
def _of_part(part):
    draw, answers = PARTS[part]
    first, _ = draw(np.random.default_rng(0))
    _, structure = ravel_pytree(first)
    compare = both_ways(lambda x: answers(structure(x[:-6]), geo.Pose(*x[-6:])))
    return compare, np.r_[_sizes(first), 0.1 * POSE_SIZE]


@pytest.mark.long
@pytest.mark.parametrize("part", PARTS)
@few
@given(seed=seeds)
def test_each_part_follows_all_its_numbers_and_the_pose(part, seed):
    compare, size = _of_part(part)
    thing, pose = PARTS[part][0](np.random.default_rng(seed))
    x = np.r_[ravel_pytree(thing)[0], ravel_pytree(pose)[0]]
    assert x.size == size.size
    error = compare(x, size)
    assert error.forward < 1e-6
    assert error.reverse < 1e-9
