"""Bands of fibres: the neo-Hookean law against its energy, the quadrature, its order, its numbers."""

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
END = AttachmentArea(np.array([2.0, 5.0, -1.0]), np.array([[6.0, 1.0, 0.0], [0.0, 0.5, 3.0]]))


def test_the_exact_tension_is_that_of_an_incompressible_neo_hookean_bar():
    """From the energy of the three stretches, whose product is one: `mu/2 (a^2 + b^2 + c^2 - 3)`."""
    shear = K / 3.0
    slope = jax.vmap(jax.grad(lambda a: 0.5 * shear * (a**2 + 2.0 / a - 3.0)))
    taut = STRAINS[STRAINS > 0.0]
    np.testing.assert_allclose(law.exact_tension(taut, K), slope(1.0 + taut), rtol=1e-13)
    assert law.exact_tension(-0.1, K) == 0.0
    begins = jax.grad(law.exact_tension)(1e-9, K)
    assert float(begins) == pytest.approx(K, rel=1e-8)


def test_energy_tension_and_stiffness_are_derivatives_of_each_other():
    energy = jax.vmap(jax.grad(lambda e: law.energy(e, K, WIDTH, L0)))(STRAINS)
    np.testing.assert_allclose(energy / L0, law.tension(STRAINS, K, WIDTH), rtol=1e-8, atol=1e-9)
    slope = jax.vmap(jax.grad(lambda e: law.tension(e, K, WIDTH)))(STRAINS)
    np.testing.assert_allclose(slope, law.stiffness_at(STRAINS, K, WIDTH), rtol=1e-9)


def test_the_rounded_corner_is_as_far_from_the_sharp_one_as_is_said(slope_on_log_axes):
    widths, strains = np.array([4e-3, 2e-3, 1e-3]), np.linspace(-0.02, 0.02, 2001)
    far = [
        np.abs(law.tension(strains, K, w) - law.exact_tension(strains, K)).max() for w in widths
    ]
    assert np.all(np.array(far) <= 0.5 * K * widths * (1.0 + 1e-12))
    assert slope_on_log_axes(widths, far) == pytest.approx(1.0, abs=0.02)


@given(st.floats(-0.95, 3.0), st.floats(1e-7, 0.05))
def test_law_and_derivatives_are_numbers_at_every_strain(strain, width):
    for function in (law.tension, lambda e, k, w: law.energy(e, k, w, L0)):
        value, slope = jax.value_and_grad(function)(strain, K, width)
        assert np.isfinite([value, slope, jax.grad(jax.grad(function))(strain, K, width)]).all()


def test_a_slack_length_from_a_force_gives_that_force():
    for force in (1e-3, 1.0, 50.0, 2000.0):
        slack = law.slack_length_from_force(33.0, force, K, WIDTH)
        assert float(law.tension(33.0 / slack - 1.0, K, WIDTH)) == pytest.approx(force, rel=1e-12)
    rate = jax.grad(law.slack_length_from_force, 1)(33.0, 50.0, K, WIDTH)
    step = 1e-3
    up, down = (law.slack_length_from_force(33.0, 50.0 + s, K, WIDTH) for s in (step, -step))
    assert float(rate) == pytest.approx(float(up - down) / (2.0 * step), rel=1e-7)


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


def six_of(far, fibres, law_name, prestretch, pose=(8.0, 2.0, 5.0, 1.5, -0.5, 0.5)):
    """Force and moment of a band on the tibia, N and N mm."""
    field = fibre_field(END, far, 100.0, 45.0, prestretch, fibres)
    there = geo.State({"tibia": geo.Pose.from_table([0.0] * 6)})
    numbers = [np.full(fibres, x) for x in (0.06, 1e-5)]
    names = [f"f{row}" for row in range(fibres)]

    def ligaments(slack):
        return Ligaments(
            field.femoral, field.tibial, field.stiffness, slack, *numbers, names,
            area=field.area, laws=(law_name,) * fibres,
        )  # fmt: skip

    slack = ligaments(np.ones(fibres)).length(there) / field.prestretch
    pulls, _, _ = ligaments(slack).pull(geo.State({"tibia": geo.Pose.from_table(pose)}))
    total = Wrench.total(pulls.between[geo.FEMUR_AND_TIBIA])
    return np.array([*total.force, *total.moment])


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
    assert off[24] < 1e-5 and off[48] < 1e-8, off
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

    np.testing.assert_allclose(squares(half), squares(known), atol=0.05)
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
        np.testing.assert_allclose(found.half_axes.T @ found.half_axes, squares, rtol=1e-4, atol=1e-9)
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
    ends = jnp.array([[0.0, 0.0, 0.0]] * 2), jnp.array([[0.0, -31.0, 0.0]] * 2)
    numbers = [np.full(2, x) for x in (K, L0, 0.06, WIDTH)]
    both = Ligaments(*ends, *numbers, ["a", "b"], laws=("blankevoort", "neo_hookean"))
    there = geo.State({"tibia": geo.Pose.from_table([0.0] * 6)})
    alone = [
        Ligaments(*(x[:1] for x in (*ends, *numbers)), ["a"], laws=(one,)) for one in LIGAMENT_LAWS
    ]
    each = [float(one.tension(there)[0]) for one in alone]
    np.testing.assert_allclose(both.tension(there), each, rtol=1e-14)
    energy = sum(float(one.energy(there)) for one in alone)
    assert float(both.energy(there)) == pytest.approx(energy, rel=1e-14)


def test_a_band_without_area_pulls_nothing_and_has_derivatives():
    def force(area):
        return six_of_area(area)[1]

    def six_of_area(area):
        field = fibre_field(END, band(20.0), 100.0, 1.0, 1.05, 6)
        ligaments = Ligaments(
            field.femoral, field.tibial, field.stiffness * area, np.full(6, 31.0),
            np.full(6, 0.06), np.full(6, WIDTH), list("abcdef"), laws=("neo_hookean",) * 6,
        )  # fmt: skip
        pulls, _, _ = ligaments.pull(geo.State({"tibia": geo.Pose.from_table([0.0] * 6)}))
        return [*Wrench.total(pulls.between[geo.FEMUR_AND_TIBIA]).force]

    assert float(force(0.0)) == 0.0
    assert float(jax.grad(force)(0.0)) == pytest.approx(float(force(1.0)), rel=1e-12)
