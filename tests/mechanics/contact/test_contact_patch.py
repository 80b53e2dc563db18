"""Where two surfaces meet, how deep, and how their curvatures combine."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.mechanics import OFF_SURFACE_MM, Contact
from kneejax.mechanics.contact import _patch

DOWN = (0.5 * np.pi, 0.0)


def at(y, x=0.0, z=0.0):
    """The tibia shifted, mm."""
    return geo.Placement(None, tuple(jnp.asarray(c, float) for c in (x, y, z)))


def compiled(function):
    return jax.jit(function, compiler_options={"xla_disable_hlo_passes": "fusion"})


@compiled
def gap(contact, tibia):
    return contact.gap(tibia, contact.contact_point(tibia))


@pytest.mark.parametrize("depth", [-2.0, 0.0, 1.5])
def test_a_sphere_on_a_plane_overlaps_by_its_depth_with_its_own_radius(depth):
    contact = Contact(geo.Sphere(30.0), geo.Plane())
    there = gap(contact, at(-(30.0 - depth), 3.0, -4.0))
    assert float(there.depth) == pytest.approx(depth, abs=1e-12)
    assert float(there.mean_radius) == pytest.approx(30.0, rel=1e-12)
    assert float(there.tilt) < 1e-12


def test_a_sphere_on_a_tilted_plane_meets_it_along_the_normal():
    plane = geo.Plane(geo.Frame([0.0, 0.0, 0.0], [0.2, 0.0, -0.1]))
    contact = Contact(geo.Sphere(30.0), plane)
    normal = np.array([float(c) for c in plane.frame.placement.turn((0.0, 1.0, 0.0))])
    tibia = at(*(-28.5 * normal)[[1, 0, 2]])
    there = gap(contact, tibia)
    assert float(there.depth) == pytest.approx(1.5, abs=1e-12)
    point = geo.Sphere(30.0).point(*contact.contact_point(tibia))
    np.testing.assert_allclose([float(c) for c in point], -30.0 * normal, atol=1e-9)


def test_an_ellipsoid_on_a_plane_has_the_mean_of_its_two_radii_of_curvature():
    a, b, c = 27.0, 22.0, 16.0
    there = gap(Contact(geo.Ellipsoid((a, b, c)), geo.Plane()), at(-(b - 0.7)))
    assert float(there.depth) == pytest.approx(0.7, abs=1e-12)
    radius = np.sqrt((a**2 / b) * (c**2 / b))
    assert float(there.mean_radius) == pytest.approx(radius, rel=1e-12)


def johnson(first, second, psi):
    """Mean relative radius from Johnson's A and B; curvatures of both bodies, angle between."""
    (ka, ka2), (kb, kb2) = first, second
    total = 0.5 * (ka + ka2 + kb + kb2)
    ca, cb = ka - ka2, kb - kb2
    difference = 0.5 * np.sqrt(ca**2 + cb**2 + 2 * ca * cb * np.cos(2 * psi))
    a, b = 0.5 * (total - difference), 0.5 * (total + difference)
    return np.sqrt(1 / (2 * a) * 1 / (2 * b))


@pytest.mark.parametrize("psi", [0.0, 0.4, 0.9, 0.5 * np.pi])
def test_crossed_ellipsoids_have_johnsons_relative_curvature(psi):
    first, second = (26.0, 21.0, 14.0), (30.0, 18.0, 24.0)
    tibial = geo.Ellipsoid(second, geo.Frame(rotation=[0.0, psi, 0.0]))
    there = gap(Contact(geo.Ellipsoid(first), tibial), at(-(21.0 + 18.0)))
    a, b = ([semi[1] / semi[0] ** 2, semi[1] / semi[2] ** 2] for semi in (first, second))
    assert float(there.depth) == pytest.approx(0.0, abs=1e-11)
    assert float(there.mean_radius) == pytest.approx(johnson(a, b, psi), rel=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("psi", [0.5, 1.0, 0.5 * np.pi])
def test_crossed_cylindrical_condyles_have_johnsons_relative_curvature(psi):
    def cylinder(radius, rotation):
        limits = np.deg2rad([0.0, 180.0])
        return geo.Condyle([[radius]], limits, (-20.0, 20.0), geo.Frame(rotation=rotation))

    upper, lower = cylinder(24.0, None), cylinder(32.0, [np.pi, psi, 0.0])
    there = gap(Contact(upper, lower), at(-56.0))
    assert float(there.depth) == pytest.approx(0.0, abs=1e-10)
    expected = johnson((1 / 24, 0.0), (1 / 32, 0.0), psi)
    assert float(there.mean_radius) == pytest.approx(expected, rel=1e-9)
    assert float(there.mean_radius) == pytest.approx(np.sqrt(24 * 32) / np.sin(psi), rel=1e-9)


def test_a_ball_in_a_hollow_plateau_has_the_difference_of_curvatures():
    # y = x^2 / 120 + z^2 / 80: hollow with radii 60 and 40 mm.
    plateau = geo.Plateau(
        [[0, 0, 100 / 80], [0, 0, 0], [100 / 120, 0, 0]], (-10.0, 10.0), (-10.0, 10.0)
    )
    there = gap(Contact(geo.Sphere(25.0), plateau), at(-25.0))
    expected = ((1 / 25 - 1 / 60) * (1 / 25 - 1 / 40)) ** -0.5
    assert float(there.mean_radius) == pytest.approx(expected, rel=1e-9)


def test_a_gap_without_an_ellipse_is_said_and_keeps_a_large_radius():
    cylinder = geo.Condyle([[24.0]], np.deg2rad([0.0, 180.0]), (-20.0, 20.0))
    contact = Contact(cylinder, geo.Plane())
    there = contact.gap(at(-23.5), jnp.array(DOWN))
    assert float(there.mean_radius) == pytest.approx(200.0, rel=1e-12)
    assert not bool(there.has_ellipse) and bool(contact.has_no_patch(there))
    assert np.isfinite(np.asarray(there.newton(*there.slope))).all()


@pytest.mark.parametrize("part", [-0.4, 0.1, 0.5, 0.9, 1.3])
def test_slopes_of_the_raised_curvature_are_the_stated_ones(part, central_difference):
    flat = _patch._NEARLY_FLAT

    def raised(x):
        return _patch._raised(x * flat) / flat

    for function in (raised, jax.grad(raised), jax.grad(jax.grad(raised))):
        numeric = central_difference(function, part, 1e-3)
        assert float(jax.grad(function)(part)) == pytest.approx(float(numeric), abs=1e-6)
    assert float(_patch._raising(part * flat)) == pytest.approx(float(jax.grad(raised)(part)))


@compiled
def lift(bend):
    """Force and stiffness of a cylinder of 24 mm on a plane whose lowest line bends, 1/mm."""
    c = jnp.zeros((1, 3)).at[0, 0].set(24.0).at[0, 2].set(-0.5 * bend * 20.0**2)
    contact = Contact(geo.Condyle(c, np.deg2rad([0.0, 180.0]), (-20.0, 20.0)), geo.Plane())

    def energy(height):
        return contact.patch_energy(contact.gap(at(height), jnp.array(DOWN)))

    return jnp.stack([jax.grad(energy)(-23.0), jax.grad(jax.grad(energy))(-23.0)])


def test_force_and_stiffness_go_through_a_curvature_that_changes_its_sign():
    """From a barrel over a cylinder to a waist: the radius grows, rests, and nothing jumps."""
    bends = np.linspace(0.004, -0.002, 601)
    force, stiffness = np.array([lift(b) for b in bends]).T
    sure = bends > 24.0 * 5e-5
    np.testing.assert_allclose(force[sure], force[0] * np.sqrt(bends[0] / bends[sure]), rtol=1e-9)
    np.testing.assert_allclose(force[bends < 0], force[-1], rtol=1e-12)
    for y in (force, stiffness):
        assert np.abs(np.diff(y)).max() < 0.02 * abs(y).max()
        assert np.abs(np.diff(y, 2)).max() < 2e-3 * abs(y).max()


def test_semi_axes_are_those_of_the_overlap_of_a_paraboloid():
    a, b, c = 27.0, 22.0, 16.0
    there = gap(Contact(geo.Ellipsoid((a, b, c)), geo.Plane()), at(-(b - 0.7)))
    expected = [np.sqrt(2 * 0.7 * r) for r in (a**2 / b, c**2 / b)]
    np.testing.assert_allclose(np.array(there.semi_axes), expected, rtol=1e-9)


@pytest.mark.parametrize("form", ["elliptical_patch", "quadrature"])
def test_a_tibia_that_has_passed_through_the_femur_is_seen_at_any_depth(form):
    contact = condyle_on_plateau()
    contact = Contact(contact.femoral, contact.tibial, form=form)

    @compiled
    def passed_through(contact, coordinates):
        tibia = placement(coordinates)
        if contact.has_patch:
            return contact.passed_through(tibia)
        return contact.foundation.passed_through(tibia)[0]

    for up, expected in ((-5.0, False), (0.0, False), (3.0, False), (30.0, True), (80.0, True)):
        assert bool(passed_through(contact, POSE + up * np.eye(6)[4])) is expected


@compiled
def border_of(contact, tibia):
    contact_point = contact.contact_point(tibia)
    gap = contact.gap(tibia, contact_point)
    return contact.border(gap, contact_point, contact.rim_off(gap, contact_point))


def test_a_patch_on_the_border_carries_half_its_force_beyond_it():
    plane = geo.Plane(half_extent=(10.0, 10.0))
    contact, reach = Contact(geo.Sphere(30.0), plane), np.sqrt(2 * 30.0 * 0.5)
    for shift, mm, share in ((0.0, 0.0, 0.0), (10.0, reach, 0.5), (25.0, 15.0 + reach, 1.0)):
        border = border_of(contact, at(-29.5, -shift))
        assert float(border.beyond_mm) == pytest.approx(mm, abs=1e-6)
        assert float(border.share) == pytest.approx(share, abs=0.05)


@compiled
def pressed_and_border(contact, tibia):
    contact_point = contact.contact_point(tibia)
    found = contact.press(tibia, contact_point)
    return found.off <= OFF_SURFACE_MM, contact.border(found.gap, contact_point, found.off)


@pytest.mark.parametrize("mm", [0.1, 0.9, 1.1, 3.0])
def test_a_patch_is_in_doubt_where_its_rim_is_a_millimetre_off_and_carries_little_up_to_there(mm):
    plane, reach = geo.Plane(half_extent=(10.0, 10.0)), np.sqrt(2 * 30.0 * 0.5)
    tibia = at(-29.5, -(10.0 - reach + mm))
    known, border = pressed_and_border(Contact(geo.Sphere(30.0), plane), tibia)
    assert bool(known) is (mm < OFF_SURFACE_MM)
    assert float(border.beyond_mm) == pytest.approx(mm, abs=1e-6)
    if mm < OFF_SURFACE_MM:
        assert float(border.share) < 0.015


def condyle_on_plateau():
    c = np.zeros((4, 3))
    c[:, 0], c[0], c[1, 1] = [23.0, -1.5, 0.8, 0.3], [23.0, 0.4, -1.6], 0.2
    h = [[0.1, 0.3, 0.9], [0.2, 0.1, 0.0], [0.8, 0.0, 0.0]]
    frame = geo.Frame([0, 0, 22], [0.02, 0.05, 0])
    femoral = geo.Condyle(c, np.deg2rad([10, 170]), (-12, 12), frame)
    tibial = geo.Plateau(h, (-20, 20), (-13, 13), geo.Frame([0, -25, 22], [0.03, 0, -0.08]))
    return Contact(femoral, tibial)


def ellipsoid_on_ellipsoid():
    femoral = geo.Ellipsoid((27.0, 22.0, 15.0), geo.Frame([0, 0, 20], [0.1, -0.1, 0.0]))
    return Contact(femoral, geo.Ellipsoid((40.0, 30.0, 45.0), geo.Frame([1.0, -51.0, 21.0])))


CONTACTS = {"condyle on plateau": condyle_on_plateau(), "ellipsoids": ellipsoid_on_ellipsoid()}
POSE = np.array([0.35, 0.03, -0.08, 1.0, 0.5, 0.6])


def placement(c):
    return geo.Pose(*c).placement


gap_of = compiled(
    lambda contact, c: contact.gap(placement(c), contact.contact_point(placement(c)))
)
contact_point = compiled(lambda contact, c: contact.contact_point(placement(c)))

contact_point_slope = compiled(
    jax.jacfwd(lambda contact, c: contact.contact_point(placement(c)), 1)
)


def touching(contact, c):
    """The same pose, shifted so that the surfaces just touch."""
    c, slope = np.array(c), 1.0
    for _ in range(8):
        depth = float(gap_of(contact, c).depth)
        step = 1e-5
        moved = c + step * np.eye(6)[4]
        slope = (float(gap_of(contact, moved).depth) - depth) / step
        c[4] -= depth / slope
    return c


@pytest.fixture(params=CONTACTS, scope="module")
def contact(request):
    return CONTACTS[request.param]


@pytest.fixture(params=["deep", "touching"], scope="module")
def pose(request, contact):
    touch = touching(contact, POSE)
    assert abs(float(gap_of(contact, touch).depth)) < 1e-10
    return touch if request.param == "touching" else touch + 0.8 * np.eye(6)[4]


@compiled
def normal_and_tangents(contact, m, c):
    """Of the tibial surface and of the femoral one, in the tibial surface's frame."""
    place, jet = contact.femur_to_plateau(placement(c)), contact.femoral.jet(m[0], m[1])
    gradient = contact.tibial.height(place.apply(jet.vector(jet.point))).gradient
    tangents = [place.turn(jet.vector(tangent)) for tangent in (jet.a, jet.b)]
    return jnp.stack(jnp.broadcast_arrays(*gradient)), [jnp.stack(t) for t in tangents]


@pytest.mark.long
def test_at_the_contact_point_both_tangents_are_normal_to_the_other_surfaces_normal(contact, pose):
    normal, tangents = normal_and_tangents(contact, contact_point(contact, pose), pose)
    normal /= np.linalg.norm(normal)
    for tangent in tangents:
        assert abs(tangent @ normal) / np.linalg.norm(tangent) < 1e-9


@pytest.mark.long
def test_the_contact_point_has_the_derivative_of_central_differences(
    contact, pose, central_difference
):
    exact = np.asarray(contact_point_slope(contact, jnp.asarray(pose)))
    numeric = central_difference(lambda c: contact_point(contact, c), pose)
    np.testing.assert_allclose(exact, numeric, atol=1e-6)


@pytest.mark.long
def test_the_contact_point_follows_the_numbers_of_both_surfaces(contact, central_difference):
    leaves, structure = jax.tree.flatten(contact)
    rng = np.random.default_rng(11)
    tangents = [jnp.asarray(rng.normal(size=x.shape)) * 0.01 for x in leaves]
    bend = jax.tree.unflatten(structure, tangents)
    _, exact = jax.jvp(lambda k: contact_point(k, POSE), (contact,), (bend,))
    numeric = central_difference(
        lambda e: contact_point(jax.tree.map(lambda x, t: x + e * t, contact, bend), POSE),
        0.0,
        1e-2,
    )
    np.testing.assert_allclose(np.asarray(exact), numeric, atol=1e-6)


@pytest.mark.long
def test_second_derivatives_of_the_contact_point_equal_central_differences_of_the_first(
    central_difference,
):
    plane = geo.Plane(geo.Frame([0, -25, 22], [0.03, 0, -0.08]))
    contact, pose = Contact(CONTACTS["condyle on plateau"].femoral, plane), POSE
    direction = jnp.asarray(np.array([0.3, -0.2, 0.5, 0.7, -0.4, 0.6]))

    def along(x):
        return jax.jvp(lambda c: contact.contact_point(placement(c)), (x,), (direction,))[1]

    _, exact = compiled(lambda c: jax.jvp(along, (c,), (direction,)))(jnp.asarray(pose))
    assert np.isfinite(np.asarray(exact)).all()

    def slope(e):
        return (
            np.asarray(contact_point_slope(contact, pose + e * np.asarray(direction))) @ direction
        )

    np.testing.assert_allclose(np.asarray(exact), central_difference(slope, 0.0), atol=1e-6)


@compiled
def pressed(contact, c):
    return contact.press(placement(c), contact.contact_point(placement(c)))


@pytest.mark.long
def test_a_patch_inside_both_regions_is_known_and_beyond_them_is_not():
    contact = CONTACTS["condyle on plateau"]
    for shift, known in ((0.0, True), (40.0, False)):
        off = float(pressed(contact, POSE + shift * np.eye(6)[3]).off)
        assert (off <= OFF_SURFACE_MM) is known


def test_unknown_laws_and_forms_are_errors_that_list_the_known_ones():
    with pytest.raises(ValueError, match=r"Contact.law is 'cubic'; expected one of .*linear"):
        Contact(geo.Sphere(30.0), geo.Plane(), law="cubic")
    with pytest.raises(ValueError, match=r"Contact.form is 'mesh'; expected one of .*quadrature"):
        Contact(geo.Sphere(30.0), geo.Plane(), form="mesh")
