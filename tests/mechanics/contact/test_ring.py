"""A meniscus: a rim that gives way against its hoop tension, by closed forms and differences."""

import dataclasses

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import Contact, Ring

SPAN = np.deg2rad(300.0)
RING = Ring(100.0, 25.0, 400.0, 8.0, [0.0, 0.0], [-0.5 * SPAN, 0.5 * SPAN], sections=6)
TURNS = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


def rim(ring=RING, depth=0.4, points=(24, 24), rise=0.02):
    """A bowl, higher outside, of which a ring between radii of 8 and 16 mm is covered, under a
    sphere that touches it where it is 12 mm wide."""
    table = np.zeros((3, 3))
    table[2, 0] = table[0, 2] = rise * 16.0**2
    outer, inner = (np.stack([r * np.cos(TURNS), r * np.sin(TURNS)], axis=1) for r in (16.0, 8.0))
    outline = np.concatenate([outer, outer[:1], inner[:1], inner[::-1]])
    bowl = geo.Plateau(table, [-16.5, 16.5], [-16.5, 16.5], outline=outline)
    slope = 2.0 * rise * 12.0
    radius = 12.0 * np.sqrt(1.0 + slope**2) / slope
    centre = rise * 144.0 + radius / np.sqrt(1.0 + slope**2)
    sphere = geo.Sphere(radius, geo.Frame([0.0, centre - depth, 0.0]))
    return Contact(sphere, bowl, 20.0, 0.2, 5.0, law="linear", form="quadrature", points=points,
                   onset_width=0.05, ring=ring)  # fmt: skip


def there(pose):
    return geo.State({"tibia": geo.Pose(*pose)}).tibia.placement


@eqx.filter_jit
def outward_and_tension(contact):
    foundation = contact.foundation
    still = dataclasses.replace(foundation, hoops=None)
    depth = still.sample(there(jnp.zeros(6))).depth
    outward = foundation.hoops.settled(foundation.points, depth)
    force = foundation.points.force(depth - foundation.hoops.given_way(depth, outward))
    return outward, foundation.hoops.tension(outward), foundation.hoops.pushed(force)


energy = eqx.filter_jit(lambda contact, pose: contact.energy(there(pose)))
slope_of_energy = eqx.filter_jit(
    lambda contact, pose: jax.grad(lambda x: contact.energy(there(x)))(pose)
)


@eqx.filter_jit
def wrench_and_rates(contact, pose):
    """Force and moment on the tibia, and their derivative by its six coordinates."""

    def force(x):
        wrench = contact.wrench(there(x))
        return jnp.stack([*wrench.force, *wrench.moment])

    return force(pose), jax.jacfwd(force)(pose)


def test_a_ring_under_even_pressure_has_the_tension_of_the_closed_form():
    """Radial equilibrium of a thin ring: what pushes a section is tension times its angle, and the
    tension is the stretch times E A, its horns in series."""
    free = eqx.tree_at(lambda r: r.coronary_stiffness, RING, 1e-9)
    outward, tension, pushed = map(np.asarray, outward_and_tension(rim(free)))
    angle = SPAN / 6
    np.testing.assert_allclose(pushed, np.full(6, tension[0] * angle), rtol=1e-9)
    assert np.all(outward > 0.0) and tension[0] > 1.0
    longer = angle * outward.sum()
    hoop = longer - 2.0 * tension[0] / 400.0
    # The middle of what is covered and weighs: nearly the middle radius of the ring's area.
    radius = 100.0 * 25.0 * hoop / (tension[0] * SPAN)
    middle = (2.0 / 3.0) * (16.0**3 - 8.0**3) / (16.0**2 - 8.0**2)
    assert radius == pytest.approx(middle, rel=0.02)


def test_a_symmetric_ring_moves_symmetrically():
    outward, _, _ = map(np.asarray, outward_and_tension(rim()))
    np.testing.assert_allclose(outward, outward[::-1], rtol=1e-9)
    # The outline is a polygon of corners that do not fall on the ends of sections.
    assert np.ptp(outward) < 0.002 * outward.mean()


def test_the_area_of_a_ring_is_exact_and_its_load_converges_with_the_square_of_the_pieces():
    """Of an annulus of 48 corners on a nearly flat plateau: the area between two polygons."""
    area = eqx.filter_jit(lambda contact: jnp.sum(contact.foundation.points.area))
    polygon = 0.5 * 48 * np.sin(2.0 * np.pi / 48) * (16.0**2 - 8.0**2) * 300.0 / 360.0
    assert float(area(rim(rise=1e-9))) == pytest.approx(polygon, rel=2e-3)
    pose = jnp.array([0.0, 0.0, 0.02, 0.0, -0.5, 0.0])
    soft = eqx.tree_at(lambda r: r.coronary_stiffness, RING, 2.0)
    load = [float(energy(rim(soft, points=(n, n)), pose)) for n in (12, 24, 48, 96)]
    steps = np.abs(np.diff(load))
    assert steps[1] < 0.35 * steps[0] and steps[2] < 0.35 * steps[1]


def test_what_holds_endlessly_stands_still_and_what_holds_nothing_carries_less():
    pose = jnp.zeros(6)
    still = eqx.filter_jit(
        lambda contact: dataclasses.replace(contact.foundation, hoops=None).energy(there(pose))
    )
    stands, gives = float(still(rim())), float(energy(rim(), pose))
    firm = dataclasses.replace(RING, coronary_stiffness=jnp.asarray(1e12))
    assert float(energy(rim(firm), pose)) == pytest.approx(stands, rel=1e-6)
    soft = dataclasses.replace(RING, youngs_modulus=jnp.asarray(1.0))
    assert float(energy(rim(soft), pose)) < gives < stands


@pytest.mark.parametrize("number", ["coronary_stiffness", "youngs_modulus", "horns"])
def test_rings_that_differ_in_one_number_side_by_side_move_as_each_alone(number):
    """As in a calibration of that number: every other one is the same of all knees."""
    value = getattr(RING, number)
    both = [dataclasses.replace(RING, **{number: part * value}) for part in (1.0, 0.9)]
    lanes = jax.tree.map(lambda x: x[..., None], rim())
    values = jnp.stack([getattr(ring, number) for ring in both], axis=-1)
    found = outward_and_tension(eqx.tree_at(lambda x: getattr(x.ring, number), lanes, values))
    for lane, ring in enumerate(both):
        for together, alone in zip(found, outward_and_tension(rim(ring)), strict=True):
            np.testing.assert_allclose(together[..., lane], alone, rtol=1e-9)


def test_a_ring_that_was_removed_does_nothing():
    gone = eqx.tree_at(lambda x: x.tibial.outline, rim(), jnp.full_like(rim().tibial.outline, 1e4))
    force, rates = wrench_and_rates(gone, jnp.zeros(6))
    np.testing.assert_array_equal(force, 0.0)
    np.testing.assert_array_equal(rates, 0.0)


def test_a_ring_needs_an_outline():
    with pytest.raises(ValueError, match="outline"):
        Contact(geo.Sphere(20.0), geo.Plane(), form="quadrature", ring=RING)


@pytest.mark.parametrize("rise", [0.02, 0.001])
def test_the_forces_on_every_section_balance_however_far_it_gives_way(rise):
    """Nearly flat, it hardly holds back what presses it: sections go farther than it is wide."""
    soft = eqx.tree_at(lambda r: (r.coronary_stiffness, r.youngs_modulus), RING, (0.1, 0.1))
    outward, tension, pushed = map(np.asarray, outward_and_tension(rim(soft, 2.0, rise=rise)))
    held = tension[0] * SPAN / 6 + 0.1 / 6 * outward
    np.testing.assert_allclose(pushed, held, rtol=1e-8)
    assert (outward.max() > 40.0) == (rise < 0.01)


POSES = [np.zeros(6), np.array([0.02, -0.03, 0.05, 0.6, -0.1, 0.4])]


@pytest.mark.parametrize("pose", POSES)
def test_the_force_is_the_derivative_of_the_least_energy(pose, central_difference):
    contact = rim()
    slope = central_difference(lambda x: float(energy(contact, jnp.asarray(x))), pose, 2e-4)
    found = np.asarray(slope_of_energy(contact, jnp.asarray(pose)))
    np.testing.assert_allclose(found, slope, rtol=1e-6, atol=1e-5 * np.abs(slope).max())
    # Of translations, in the femur's axes: minus what the wrench says.
    force, _ = wrench_and_rates(contact, jnp.asarray(pose))
    np.testing.assert_allclose(-np.asarray(force)[:3], slope[3:], rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("pose", POSES)
def test_the_stiffness_by_elimination_is_that_of_differences(pose, central_difference):
    contact = rim()

    def force(x):
        return np.asarray(wrench_and_rates(contact, jnp.asarray(x))[0])

    slopes = central_difference(force, pose, 1e-4)
    found = np.asarray(wrench_and_rates(contact, jnp.asarray(pose))[1])
    np.testing.assert_allclose(found, slopes, rtol=1e-6, atol=1e-6 * np.abs(slopes).max())


def test_forces_follow_the_numbers_of_a_ring(central_difference):
    names = "youngs_modulus", "cross_section", "horn_stiffness", "coronary_stiffness"
    at = np.array([getattr(RING, name) for name in names])

    @jax.jit
    def up_and_slope(parts):
        def up(parts):
            ring = dataclasses.replace(RING, **dict(zip(names, parts * at, strict=True)))
            return rim(ring).wrench(there(jnp.zeros(6))).force.y

        return jax.value_and_grad(up)(parts)

    expected = central_difference(lambda x: float(up_and_slope(x)[0]), np.ones(4), 1e-3)
    found = np.asarray(up_and_slope(np.ones(4))[1])
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    assert (np.abs(found) > 0.0).all()


def annulus(count=24):
    turns = np.linspace(*np.asarray(RING.horns), count)
    arcs = [np.stack([r * np.cos(turns), r * np.sin(turns)], axis=1) for r in (16.0, 8.0)]
    return np.concatenate([arcs[0], arcs[1][::-1]])


def area_of(corners):
    x, y = np.moveaxis(np.stack([corners, np.roll(corners, -1, axis=0)]), -1, 0)
    return abs(0.5 * np.sum(x[0] * y[1] - x[1] * y[0]))


@pytest.mark.parametrize("count", [24, 25, 37])
def test_rays_through_corners_of_an_outline_see_both_its_edges(count):
    """At regular angles rays pass through corners, which belong to two edges each."""
    outline = annulus(count)

    @jax.jit
    def area(outline):
        flat = geo.Plateau(np.zeros((1, 1)), [-17.0, 17.0], [-17.0, 17.0], outline=outline)
        return jnp.sum(RING.midpoints(flat, (36, 4), 0)[2])

    assert float(area(outline)) == pytest.approx(area_of(outline), rel=5e-3)
    _, left = RING.resected(outline, 0.5, 0.0, 0.4)
    assert np.linalg.norm(left, axis=1).min() > 7.9


@pytest.mark.parametrize(
    ("width", "anterior", "posterior", "left", "hoop"),
    [
        # Of an annulus of radii 8 and 16 mm; of a wedge's cross-section 1 - width^2 is left.
        (0.5, 1.0, 0.0, (16**2 - 12**2) / (16**2 - 8**2), 0.75),
        (0.5, 0.3, 0.0, 1.0 - 0.3 * (12**2 - 8**2) / (16**2 - 8**2), 1.0 / (0.7 + 0.3 / 0.75)),
        (1.0, 0.0, 0.4, 0.6, 0.0),
        (1.0, 0.25, 0.25, 0.5, 0.0),
    ],
)
def test_what_a_partial_meniscectomy_leaves(width, anterior, posterior, left, hoop):
    outline = annulus(48)
    ring, corners = RING.resected(outline, width, anterior, posterior)
    assert corners.shape == outline.shape
    assert area_of(corners) / area_of(outline) == pytest.approx(left, abs=0.01)
    assert float(ring.hoop_left) == pytest.approx(hoop)
    if 0.0 < anterior < 1.0 > posterior == 0.0:
        ring = dataclasses.replace(RING, horns=RING.horns + np.pi)  # begins behind
        ends = (anterior, 0.0), (0.0, anterior)
        turned = [ring.resected(-outline, width, *one)[1] for one in ends]
        assert area_of(turned[0]) == pytest.approx(area_of(turned[1]), rel=1e-6)


def test_mirrored_menisci_carry_alike():
    """Of two compartments side by side that are mirrored: forces, tension and extrusion."""
    right = dataclasses.replace(RING, horns=jnp.asarray(np.deg2rad([-30.0, 210.0])))
    left = dataclasses.replace(RING, horns=jnp.asarray(np.deg2rad([-210.0, 30.0])))
    pair = rim(right), rim(left)
    pose = jnp.array([0.0, 0.0, 0.01, 0.0, -0.1, 0.0]), jnp.array([0.0, 0.0, -0.01, 0.0, -0.1, 0.0])

    @eqx.filter_jit
    def pressed(contact, pose):
        foundation, tibia = contact.foundation, there(pose)
        sampled = foundation.sample(tibia)
        wrench = foundation.wrenches(tibia, sampled)
        return jnp.stack([x[0] for x in (*wrench.force, *wrench.moment)]), jnp.max(
            sampled.points.given_way
        )

    (one, most), (other, as_much) = (pressed(*x) for x in zip(pair, pose, strict=True))
    mirror = np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    np.testing.assert_allclose(one, mirror * np.asarray(other), atol=1e-7 * abs(float(one[1])))
    assert float(most) == pytest.approx(float(as_much), rel=1e-9)


def test_a_ring_that_is_cut_through_has_no_tension():
    outward, tension, pushed = outward_and_tension(
        rim(dataclasses.replace(RING, hoop_left=jnp.asarray(0.0)))
    )
    assert float(tension[0]) == 0.0
    np.testing.assert_allclose(np.asarray(pushed), 8.0 / 6 * np.asarray(outward), rtol=1e-9)
