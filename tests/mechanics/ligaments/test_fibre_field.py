"""Bands of fibres: the neo-Hookean law against its energy, the quadrature and its order."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kneejax.geometry as geo
from kneejax.mechanics import (
    LIGAMENT_LAWS,
    AttachmentArea,
    Ligaments,
    Wrench,
    disc_quadrature,
    fibre_field,
    untwisted,
)
from kneejax.mechanics import neo_hookean_law as law

K, WIDTH, L0 = 3000.0, 1e-3, 30.0
STRAINS = np.array([-0.9, -0.1, -1e-3, 0.0, 1e-3, 0.02, 0.1, 0.5])
exact_tension, tension = jax.jit(law.exact_tension), jax.jit(law.tension)
END = AttachmentArea(np.array([2.0, 5.0, -1.0]), np.array([[6.0, 1.0, 0.0], [0.0, 0.5, 3.0]]))


def test_the_exact_tension_is_that_of_an_incompressible_neo_hookean_bar():
    """From the energy of the three stretches, whose product is one: `mu/2 (a^2 + 2/a - 3)`."""
    shear, taut = K / 3.0, STRAINS[STRAINS > 0.0]
    slope = jax.jit(jax.vmap(jax.grad(lambda a: 0.5 * shear * (a**2 + 2.0 / a - 3.0))))
    found = exact_tension(STRAINS, K)
    np.testing.assert_allclose(found[STRAINS > 0.0], slope(1.0 + taut), rtol=1e-13)
    assert np.all(found[STRAINS <= 0.0] == 0.0)
    begins = jax.jit(jax.grad(law.exact_tension))(1e-9, K)
    assert float(begins) == pytest.approx(K, rel=1e-8)


def test_energy_tension_and_stiffness_are_derivatives_of_each_other():
    per_strain = jax.jit(jax.vmap(jax.grad(law.energy), (0, None, None, None)))
    energy = np.asarray(per_strain(STRAINS, K, WIDTH, L0))
    np.testing.assert_allclose(energy / L0, tension(STRAINS, K, WIDTH), rtol=1e-8, atol=1e-9)
    slope = jax.jit(jax.vmap(jax.grad(law.tension), (0, None, None)))(STRAINS, K, WIDTH)
    stiffness = jax.jit(law.stiffness_at)(STRAINS, K, WIDTH)
    np.testing.assert_allclose(slope, stiffness, rtol=1e-9)


def test_the_rounded_corner_is_as_far_from_the_sharp_one_as_is_said(slope_on_log_axes):
    widths, strains = np.array([4e-3, 2e-3, 1e-3]), np.linspace(-0.02, 0.02, 2001)
    far = [
        np.abs(np.subtract(tension(strains, K, w), exact_tension(strains, K))).max()
        for w in widths
    ]
    assert np.all(np.array(far) <= 0.5 * K * widths * (1.0 + 1e-12))
    assert slope_on_log_axes(widths, far) == pytest.approx(1.0, abs=0.02)


@jax.jit
def every_derivative(strain, stiffness, width):
    """Tension and energy with two derivatives by the strain."""
    found = []
    for function in (law.tension, lambda *numbers: law.energy(*numbers, L0)):
        found += [function(strain, stiffness, width), jax.grad(function)(strain, stiffness, width),
                  jax.grad(jax.grad(function))(strain, stiffness, width)]  # fmt: skip
    return jnp.stack(found)


@given(st.floats(-0.95, 3.0), st.floats(1e-7, 0.05))
def test_law_and_derivatives_are_numbers_at_every_strain(strain, width):
    assert np.isfinite(every_derivative(strain, K, width)).all()


def test_a_slack_length_from_a_force_gives_that_force():
    slack_and_rate = jax.jit(jax.value_and_grad(law.slack_length_from_force, 1))
    for force in (1e-3, 1.0, 50.0, 2000.0):
        strain = 33.0 / float(slack_and_rate(33.0, force, K, WIDTH)[0]) - 1.0
        assert float(tension(strain, K, WIDTH)) == pytest.approx(force, rel=1e-12)
    rate, step = slack_and_rate(33.0, 50.0, K, WIDTH)[1], 1e-3
    up, down = (float(slack_and_rate(33.0, 50.0 + s, K, WIDTH)[0]) for s in (step, -step))
    assert float(rate) == pytest.approx((up - down) / (2.0 * step), rel=1e-7)


@pytest.mark.parametrize("fibres", [1, 6, 7, 12, 24, 48])
def test_the_quadrature_is_exact_for_polynomials(fibres):
    """Mean of `x^i y^j` over the disc: `(i-1)!! (j-1)!! / ((i+j+2) (i+j)!!) * 2` for even ones."""
    points, weights = disc_quadrature(fibres)
    assert len(points) == fibres and weights.sum() == pytest.approx(1.0)
    assert np.all(weights > 0.0) and np.all(np.linalg.norm(points, axis=1) < 1.0)
    means = {(1, 0): 0.0, (0, 1): 0.0}
    if fibres >= 6:
        means |= {(2, 0): 0.25, (0, 2): 0.25, (1, 1): 0.0}
    if fibres >= 12:
        means |= {(4, 0): 0.125, (2, 2): 1.0 / 24.0, (3, 1): 0.0}
    for (i, j), mean in means.items():
        found = weights @ (points[:, 0] ** i * points[:, 1] ** j)
        assert found == pytest.approx(mean, abs=1e-14), (fibres, i, j)


def ligaments_of(femoral, tibial, stiffness, slack, law_name):
    count = len(stiffness)
    numbers = [np.full(count, x) for x in (0.06, 1e-5)]
    names = [f"f{row}" for row in range(count)]
    return Ligaments(femoral, tibial, stiffness, slack, *numbers, names, laws=(law_name,) * count)


@functools.partial(jax.jit, static_argnames="law_name")
def six_of_fibres(femoral, tibial, stiffness, prestretch, pose, law_name):
    """Force and moment on the tibia, N and N mm, of fibres with a stretch where nothing moved."""
    there = geo.State({"tibia": geo.Pose.from_table(jnp.zeros(6))})
    unstretched = ligaments_of(femoral, tibial, stiffness, jnp.ones(len(stiffness)), law_name)
    slack = unstretched.length(there) / prestretch
    fibres = ligaments_of(femoral, tibial, stiffness, slack, law_name)
    pulls, _, _ = fibres.pull(geo.State({"tibia": geo.Pose.from_table(pose)}))
    total = Wrench.total(pulls.between[geo.FEMUR_AND_TIBIA])
    return jnp.stack([*total.force, *total.moment])


def six_of(far, fibres, law_name, prestretch):
    """Of a band."""
    field = fibre_field(END, far, 100.0, 45.0, prestretch, fibres)
    numbers = field.femoral, field.tibial, field.stiffness, field.prestretch
    pose = np.array([8.0, 2.0, 5.0, 1.5, -0.5, 0.5])
    return np.asarray(six_of_fibres(*numbers, pose, law_name))


def band(turned_deg, wider=1.0):
    """The far end of a band 32 mm long, turned about its length, wider by a factor."""
    c, s = np.cos(np.deg2rad(turned_deg)), np.sin(np.deg2rad(turned_deg))
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    return AttachmentArea(np.array([6.0, -27.0, 2.0]), wider * END.half_axes @ turn.T)


BANDS = {"straight": band(0.0), "twisted": band(70.0), "fan": band(0.0, 2.2)}


@pytest.mark.parametrize("law_name", LIGAMENT_LAWS)
@pytest.mark.parametrize("shape", BANDS)
def test_force_and_moment_of_a_taut_band_converge_faster_than_any_power(shape, law_name):
    stretch = [1.05, 1.09] if law_name == "neo_hookean" else [1.08, 1.12]
    found = {n: six_of(BANDS[shape], n, law_name, stretch) for n in (6, 12, 24, 48, 192)}
    limit = found.pop(192)
    size = np.repeat([np.linalg.norm(limit[:3]), np.linalg.norm(limit[3:])], 3)
    off = {n: np.abs((six - limit) / size).max() for n, six in found.items()}
    assert off[24] < 1e-6 and off[48] < 1e-10, off
    assert off[6] > 5.0 * off[12] > 25.0 * off[24], off


@pytest.mark.parametrize("law_name", LIGAMENT_LAWS)
@pytest.mark.parametrize("shape", BANDS)
def test_a_band_that_is_partly_slack_is_within_a_percent_at_24_fibres(
    shape, law_name, slope_on_log_axes
):
    counts = np.array([24, 96, 384])
    found = {n: six_of(BANDS[shape], n, law_name, [0.97, 1.05]) for n in (*counts, 3 * 48**2)}
    limit = found[3 * 48**2]
    size = np.repeat([np.linalg.norm(limit[:3]), np.linalg.norm(limit[3:])], 3)
    off = np.array([np.abs((found[n] - limit) / size).max() for n in counts])
    assert off[0] < 0.01, off
    assert slope_on_log_axes(counts, off) < -0.9, off


def test_one_fibre_is_the_middle_of_the_band():
    field = fibre_field(END, band(0.0), 100.0, 45.0, [1.02, 1.06], 1)
    np.testing.assert_allclose(field.femoral[0], END.centre)
    assert field.stiffness.tolist() == [4500.0] and field.prestretch[0] == pytest.approx(1.04)


def test_half_an_area_has_the_moments_of_half_the_ellipse():
    """Against points spread over the half itself."""
    rings = np.sqrt((np.arange(400) + 0.5) / 400)
    angles = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    disc = np.stack([np.outer(rings, np.cos(angles)), np.outer(rings, np.sin(angles))], -1)
    towards = np.array([0.4, 0.1, 1.0])
    points = END.at(disc.reshape(-1, 2))
    upper = points[(points - END.centre) @ towards > 0.0]
    half, known = END.half(towards), AttachmentArea.of_points(upper)
    np.testing.assert_allclose(half.centre, known.centre, atol=1e-2)

    def squares(area):
        return area.half_axes.T @ area.half_axes

    np.testing.assert_allclose(squares(half), squares(known), atol=0.1)
    with pytest.raises(ValueError, match="a direction across the area"):
        END.half(np.cross(*END.half_axes))


@pytest.mark.parametrize("turn_deg", [0.0, 40.0, 180.0])
def test_an_outline_has_the_moments_of_what_it_surrounds_whatever_its_beginning(turn_deg):
    angles = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False) + np.deg2rad(turn_deg)
    for one in (angles, angles[::-1]):
        corners = END.at(np.stack([np.cos(one), np.sin(one)], axis=1))
        found = AttachmentArea.of_outline(corners)
        np.testing.assert_allclose(found.centre, END.centre, atol=1e-9)
        squares = END.half_axes.T @ END.half_axes
        ours = found.half_axes.T @ found.half_axes
        np.testing.assert_allclose(ours, squares, rtol=1e-4, atol=1e-9)
    with pytest.raises(ValueError, match="on a line"):
        AttachmentArea.of_outline(np.outer(np.arange(5), [1.0, 2.0, 3.0]))


def test_an_untwisted_band_has_fibres_of_least_squared_length(rng):
    far = band(70.0)
    least = untwisted(END, far)
    np.testing.assert_allclose(
        least.half_axes.T @ least.half_axes, far.half_axes.T @ far.half_axes, atol=1e-12
    )

    def squared(other):
        disc, weights = disc_quadrature(48)
        return weights @ np.sum((END.at(disc) - other.at(disc)) ** 2, axis=1)

    for angle in rng.uniform(0.0, 2.0 * np.pi, 20):
        c, s = np.cos(angle), np.sin(angle)
        for turn in ([[c, s], [-s, c]], [[c, s], [s, -c]]):
            other = AttachmentArea(far.centre, np.array(turn) @ far.half_axes)
            assert squared(least) <= squared(other) + 1e-9


def test_two_laws_side_by_side_are_each_its_own():
    @functools.partial(jax.jit, static_argnames="laws")
    def tension_and_energy(laws):
        count = len(laws)
        numbers = [jnp.full(count, x) for x in (K, L0, 0.06, WIDTH)]
        ends = jnp.zeros((count, 3)), jnp.tile(jnp.array([0.0, -31.0, 0.0]), (count, 1))
        fibres = Ligaments(*ends, *numbers, [f"f{row}" for row in range(count)], laws=laws)
        there = geo.State({"tibia": geo.Pose.from_table(jnp.zeros(6))})
        return fibres.tension(there), fibres.energy(there)

    both = tension_and_energy(LIGAMENT_LAWS)
    each = [tension_and_energy((one,)) for one in LIGAMENT_LAWS]
    np.testing.assert_allclose(both[0], np.concatenate([one[0] for one in each]), rtol=1e-14)
    assert float(both[1]) == pytest.approx(sum(float(one[1]) for one in each), rel=1e-14)
    assert abs(float(both[0][0] - both[0][1])) > 1.0


def test_a_band_without_area_pulls_nothing_and_has_derivatives():
    field = fibre_field(END, band(20.0), 100.0, 1.0, 1.05, 6)

    @jax.jit
    @jax.value_and_grad
    def upwards(area):
        numbers = field.stiffness * area, field.prestretch, np.zeros(6), "neo_hookean"
        return six_of_fibres(field.femoral, field.tibial, *numbers)[1]

    (nothing, rate), (some, _) = upwards(0.0), upwards(1.0)
    assert float(nothing) == 0.0 and float(rate) == pytest.approx(float(some), rel=1e-12)
