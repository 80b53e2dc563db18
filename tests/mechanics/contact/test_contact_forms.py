"""The closed form over a patch and the sum over points, against exact integrals."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad

import kneejax.geometry as geo
from kneejax.mechanics import Contact, cartilage_law

E = 5.0
K = E * 0.55 / (1.45 * 0.1)
ROUNDING = 1e-9
# Semi-axes whose radii of curvature at the lower pole are 30 and 20 mm.
EGG = (np.sqrt(750.0), 25.0, np.sqrt(500.0))
BALL = (30.0, 30.0, 30.0)
TABLE = {
    0.1: (2.432, 2.446, 2.460),
    0.5: (60.811, 62.574, 64.415),
    1.0: (243.242, 258.009, 274.171),
    2.0: (972.97, 1103.75, 1263.28),
}
PRESSURE = {
    "linear": lambda s: s,
    "log": lambda s: -np.log1p(-s),
    "ratio": lambda s: s / (1 - s),
}
SLOPE = {"linear": lambda s: 1.0, "log": lambda s: 1 / (1 - s), "ratio": lambda s: (1 - s) ** -2}
every_law = pytest.mark.parametrize("law", cartilage_law.LAWS)


@jax.jit
def energy_and_force(contact, y):
    """Energy, and the force that lifts the femur (N), of a tibia shifted to height `y`."""
    return jax.value_and_grad(
        lambda h: contact.energy(geo.Placement(None, geo.Vector(jnp.zeros(()), h, jnp.zeros(()))))
    )(y)


def at(translation):
    """The tibia shifted, mm."""
    return geo.Placement(None, tuple(np.asarray(translation, float)))


def exact_energy_and_force(law, semi, depth, layer):
    """Of an ellipsoid pressed into a plane: layers of depth times their elliptical areas."""
    a, c, b = semi

    def area(y):
        return np.pi * a * b * (2 * y / c - (y / c) ** 2)

    def integral(f):
        return K * quad(lambda v: f(v / layer) * area(depth - v), 0, depth, epsabs=0)[0]

    return integral(PRESSURE[law]), integral(SLOPE[law]) / layer


def ellipsoid_on_plane(semi, depth, law, points=None, layer=6.0, margin=1.05):
    half = [margin * np.sqrt(2 * depth * s**2 / semi[1]) for s in (semi[0], semi[2])]
    form = {} if points is None else {"form": "quadrature", "points": (points, points)}
    contact = Contact(
        geo.Ellipsoid(semi), geo.Plane(half_extent=half), youngs_modulus=E, law=law,
        layer_thickness=layer, onset_width=ROUNDING * depth, **form,
    )
    energy, force = energy_and_force(contact, -(semi[1] - depth))
    return float(energy), float(force)


@every_law
@pytest.mark.parametrize("depth", TABLE)
def test_the_closed_form_has_the_tabulated_resultants(law, depth):
    expected = TABLE[depth][cartilage_law.LAWS.index(law)]
    _, force = ellipsoid_on_plane(EGG, depth, law)
    assert force == pytest.approx(expected, abs=5.1e-4 if expected < 900 else 5.1e-3)


@pytest.mark.long
def test_the_sum_over_points_reaches_the_spherical_cap_with_its_order(slope_on_log_axes):
    radius, depth, layer = 30.0, 1.0, 6.0
    cap = np.pi * K / layer * (radius * depth**2 - depth**3 / 3)
    energy, force = exact_energy_and_force("linear", BALL, depth, layer)
    assert force == pytest.approx(cap, rel=1e-10)
    counts = (8, 36, 144)
    answers = [ellipsoid_on_plane(BALL, depth, "linear", n, margin=1.1) for n in counts]
    errors = np.abs(np.array(answers) / [energy, force] - 1.0)
    # The force has a kink at the rim of the patch, the energy only in its second derivative.
    assert slope_on_log_axes(counts, errors[:, 0]) < -2.5
    assert slope_on_log_axes(counts, errors[:, 1]) < -2.0
    assert errors[-1, 0] < 1e-6 and errors[-1, 1] < 3e-5


@every_law
@pytest.mark.parametrize("semi", [BALL, EGG], ids=["sphere", "ellipsoid"])
def test_the_closed_form_is_wrong_by_depth_over_radius(law, semi, slope_on_log_axes):
    depths = np.array([3e-3, 3e-2, 3e-1])
    errors = []
    for depth in depths:
        exact = exact_energy_and_force(law, semi, depth, 3 * depth)
        errors.append(np.array(ellipsoid_on_plane(semi, depth, law, layer=3 * depth)) / exact - 1)
    errors = np.array(errors)
    assert slope_on_log_axes(depths, errors[:, 0]) == pytest.approx(1.0, abs=0.01)
    assert slope_on_log_axes(depths, errors[:, 1]) == pytest.approx(1.0, abs=0.01)
    assert (0 < errors).all() and (errors < 0.4 * depths[:, None] / semi[1]).all()


@pytest.mark.long
@pytest.mark.parametrize(
    ("semi", "law"),
    [
        (EGG, "linear"),
        (EGG, "ratio"),
        *(pytest.param(BALL, law, marks=pytest.mark.long) for law in ("linear", "ratio", "log")),
        pytest.param(EGG, "log", marks=pytest.mark.long),
    ],
)
def test_closed_form_and_sum_agree_when_the_patch_is_small(semi, law):
    depth = 1e-5
    patch = ellipsoid_on_plane(semi, depth, law, layer=3 * depth)
    summed = ellipsoid_on_plane(semi, depth, law, 144, layer=3 * depth, margin=1.02)
    exact = exact_energy_and_force(law, semi, depth, 3 * depth)
    assert patch[0] == pytest.approx(summed[0], rel=1e-6)
    np.testing.assert_allclose(patch, exact, rtol=1e-6)
    # The kink at the rim leaves the force of the sum one order behind its energy.
    assert patch[1] == pytest.approx(summed[1], rel=3e-5)


@pytest.mark.long
@pytest.mark.parametrize("semi", [BALL, EGG], ids=["sphere", "ellipsoid"])
def test_force_and_energy_of_both_forms_agree_to_a_millionth_with_enough_points(
    semi, slope_on_log_axes
):
    depth, counts = 1e-6, (96, 768)
    patch = ellipsoid_on_plane(semi, depth, "linear", layer=3 * depth)
    summed = [
        ellipsoid_on_plane(semi, depth, "linear", n, layer=3 * depth, margin=1.02) for n in counts
    ]
    errors = np.abs(np.array(summed) / patch - 1.0)
    assert (errors[-1] < 1e-6).all()
    assert slope_on_log_axes(counts, errors[:, 1]) < -1.8


@pytest.mark.long
@pytest.mark.parametrize("law", ["linear", pytest.param("log", marks=pytest.mark.long)])
def test_the_closed_form_is_exact_for_a_paraboloid_on_a_plane(law):
    # An upturned paraboloid, y = -x^2 / 60 - z^2 / 40, above a plane: radii 30 and 20 mm.
    bowl = [[0, 0, -(40**2) / 40], [0, 0, 0], [-(40**2) / 60, 0, 0]]
    femoral = geo.Plateau(bowl, (-40, 40), (-40, 40), geo.Frame(rotation=[np.pi, 0, 0]))
    depth = 2.0
    half = [1.02 * np.sqrt(60 * depth), 1.02 * np.sqrt(40 * depth)]
    common = dict(youngs_modulus=E, law=law, onset_width=ROUNDING)
    patch = Contact(femoral, geo.Plane(), **common)
    summed = Contact(
        femoral, geo.Plane(half_extent=half), form="quadrature", points=(144, 144), **common
    )
    (energy, force), (sum_energy, sum_force) = (
        energy_and_force(contact, depth) for contact in (patch, summed)
    )
    assert float(sum_energy) == pytest.approx(float(energy), rel=1e-6)
    assert float(sum_force) == pytest.approx(float(force), rel=5e-5)
    expected = TABLE[depth][cartilage_law.LAWS.index(law)]
    assert float(force) == pytest.approx(expected, abs=5.1e-3)


def test_sampled_points_cover_the_plateau_with_its_area_and_measure_depth_along_its_normal():
    plane = geo.Plane(half_extent=(10.0, 8.0))
    contact = Contact(geo.Sphere(30.0), plane, form="quadrature", points=(12, 9))
    sampled = jax.jit(lambda c, tibia: c.foundation.sample(tibia))(contact, at([0.0, -29.0, 0.0]))
    assert sampled.depth.shape == (108,)
    assert float(sampled.points.area.sum()) == pytest.approx(4 * 10 * 8, rel=1e-12)
    x, _, z = (np.asarray(c) for c in sampled.points.point)
    expected = np.sqrt(30.0**2 - x**2 - z**2) - 29.0
    np.testing.assert_allclose(np.asarray(sampled.depth), expected, atol=2e-6)


@jax.jit
def told(contact, tibia):
    """Faults, and depth, pressure, energy and wrench with its derivative by the translation."""
    sampled = contact.foundation.sample(tibia)
    faults = contact.foundation.faults(tibia, sampled)
    wrench = jax.jacfwd(lambda t: contact.wrench(geo.Placement(None, t)))(tibia.translation)
    peak = jnp.max(sampled.points.pressure(sampled.depth))
    numbers = sampled.depth.max(), peak, contact.energy(tibia), wrench
    return faults.too_deep | faults.outside | faults.lost, jax.tree.leaves(numbers)


@pytest.mark.long
@pytest.mark.parametrize(
    "law", ["ratio", *(pytest.param(law, marks=pytest.mark.long) for law in ("linear", "log"))]
)
def test_off_the_cartilage_nothing_is_pressed_however_deep(law):
    """A ball over the rim: 7 mm deep where the fitted surface goes on, up to 5 mm on cartilage."""
    common = dict(law=law, form="quadrature", layer_thickness=6.0)
    rim = np.array([[-21.0, -12.0], [0.0, -12.0], [0.0, 12.0], [-21.0, 12.0]])
    beyond = Contact(
        geo.Sphere(10.0), geo.Plateau([[0.0]], (-20, 20), (-10, 10), outline=rim),
        points=(40, 20), **common,
    )  # fmt: skip
    ends_there = Contact(
        geo.Sphere(10.0), geo.Plateau([[0.0]], (-20, 0), (-10, 10)), points=(20, 20), **common
    )
    tibia = at([-6.0, -3.0, 0.0])
    (faulty, numbers), (faulty_there, expected) = told(beyond, tibia), told(ends_there, tibia)
    assert not faulty and not faulty_there
    # The rounded onset leaves 1e-5 mm of contact where the surfaces are apart.
    np.testing.assert_allclose(numbers, expected, rtol=1e-9, atol=1e-6)


def test_what_is_far_apart_carries_nothing_beyond_a_border():
    contact = Contact(geo.Sphere(10.0), geo.Plane(half_extent=(10.0, 8.0)), form="quadrature")
    bed = contact.foundation
    border = jax.jit(lambda tibia: bed.border(tibia, bed.sample(tibia)))(at([0, -20, 0]))
    assert float(border.share[0]) == float(border.beyond_mm[0]) == 0.0


@jax.jit
def faults_and_border(contact, tibia):
    bed = contact.foundation
    sampled = bed.sample(tibia)
    return bed.faults(tibia, sampled).outside, bed.border(tibia, sampled)


@pytest.mark.parametrize(("mm", "doubted"), [(0.8, False), (2.0, True)])
def test_points_are_in_doubt_from_a_millimetre_off_the_femurs_cartilage(mm, doubted):
    """A roller whose cartilage is 20 mm wide, on a wider plane."""
    roller = geo.Condyle([[25.0]], np.deg2rad([0.0, 180.0]), (-10.0, 10.0))
    plane = geo.Plane(half_extent=(4.0, 10.0 + mm))
    contact = Contact(roller, plane, form="quadrature", points=(4, 80))
    outside, border = faults_and_border(contact, at([0.0, -24.5, 0.0]))
    assert bool(outside[0]) is doubted
    assert mm - 0.3 < float(border.beyond_mm[0]) <= mm
    assert float(border.share[0]) == pytest.approx(mm / (10.0 + mm), abs=0.03)


def test_pressure_has_the_rounded_onset_of_the_energy():
    contact = Contact(geo.Sphere(30.0), geo.Plane(), law="log", onset_width=0.02)
    assert float(contact.pressure(1.0)) == pytest.approx(-K * np.log1p(-1.0001 / 6), rel=1e-6)
    assert 0 < float(contact.pressure(-1.0)) < 1e-3
    assert float(contact.modulus) == pytest.approx(K, rel=1e-14)
