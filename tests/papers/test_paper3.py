"""Paper 3's claims: verdicts follow made-up curves whose answers are known."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

import kneejax.geometry as geo
from kneejax.papers.claims import CANNOT_BE_JUDGED, NOT_REPRODUCED, REPRODUCED
from kneejax.papers.paper3 import TORSION_DEG, LaxityStudy, claims, raised_leg_figure
from kneejax.papers.rigid_patella import RigidLeg
from kneejax.statics import Status

MOVED = np.linspace(-5.0, 5.0, 21)
DRAWER_DEG = np.array([0.0, 20.0, 30.0, 90.0])
TORSION = np.array(TORSION_DEG)


def study(**changed):
    """Cubic curves, stiffer at the ends; rotation that grows with flexion."""
    force = np.array([2.0, 1.0, 1.0, 2.0])[:, None] * MOVED**3
    loaded = np.abs(force) + 2.0
    turned = 5.0 + 0.1 * TORSION
    found = LaxityStudy(
        DRAWER_DEG, MOVED, force, {"ACL": loaded, "PCL": loaded}, TORSION, turned, -turned,
        np.tile([-3.0, 3.0], (len(TORSION), 1)), 3.0, dict.fromkeys(DRAWER_DEG, Status.BALANCED),
    )  # fmt: skip
    return dataclasses.replace(found, **changed)


X = np.arange(0.0, 91.0, 5.0)


def leg(**changed):
    """Its curves are those of the paper's words; keywords replace some."""
    pull = np.interp(X, [0, 20, 60, 85, 90], [280.0, 230.0, 225.0, 20.0, 1.0])
    tendon = pull * np.interp(X, [0, 20, 90], [1.05, 1.1, 0.5])
    contact = pull * np.interp(X, [0, 90], [0.5, 1.05])
    patella = np.c_[0.72 * X, np.zeros((len(X), 5))]
    tibia = np.c_[X, X / 30.0, X / 5.0, X / 13.0, 0 * X, 0 * X]
    parts = {
        "quadriceps_N": pull, "tendon_N": tendon, "patellofemoral_N": contact, "patella": patella,
        "arm_mm": 50.0 - 0.01 * (X - 35.0) ** 2, "tibia": geo.Pose.from_table(jnp.asarray(tibia)),
        "contact_N": np.stack([0.4 * contact, 0.6 * contact], axis=1),
        "shear": {"patellar tendon": tendon, "weight": -tendon},
        "tension": {"ACL": np.interp(X, [0, 60, 65], [90.0, 5.0, 0.0]),
                    "PCL": np.interp(X, [50, 55, 90], [0.0, 5.0, 80.0])},
        "unknowns": np.zeros((len(X), 19)),
    }  # fmt: skip
    return RigidLeg(X, **(parts | changed))


def failing(found, raised=None):
    judged = claims(found, leg() if raised is None else raised)
    return {c.number for c in judged if c.verdict == NOT_REPRODUCED}


def test_a_knee_as_the_paper_describes_it_reproduces_every_claim_that_is_judged():
    found = {claim.number: claim.verdict for claim in claims(study(), leg())}
    assert [found[f"3.{k}"] for k in range(1, 14)] == [REPRODUCED] * 13
    assert [found[f"3.{k}"] for k in range(14, 16)] == [CANNOT_BE_JUDGED] * 2


PULL = leg().quadriceps_N


@pytest.mark.parametrize(
    ("changed", "number"),
    [
        ({"quadriceps_N": PULL[::-1]}, "3.6"),
        ({"quadriceps_N": np.where(X > 40.0, 0.7, 1.0) * PULL}, "3.6"),
        ({"tendon_N": 0.95 * PULL}, "3.7"),
        ({"patellofemoral_N": 0.9 * PULL}, "3.8"),
        ({"patella": np.c_[X, np.zeros((len(X), 5))]}, "3.9"),
        ({"arm_mm": 50.0 - 0.2 * X}, "3.10"),
        ({"tension": {"ACL": 0 * X, "PCL": 0 * X}}, "3.11"),
        ({"tension": {"ACL": 9 + 0 * X, "PCL": 9 + 0 * X}}, "3.11"),
        ({"tibia": leg().tibia.from_table(np.c_[X, np.zeros((len(X), 5))])}, "3.12"),
        ({"shear": {"patellar tendon": 1 + X, "weight": -X}}, "3.13"),
    ],
)  # fmt: skip
def test_a_leg_that_is_otherwise_is_found_out(changed, number):
    assert number in failing(study(), leg(**changed))


def test_a_leg_is_drawn_with_all_of_its_curves():
    figure = raised_leg_figure(leg())
    assert [axes.get_ylabel() for axes in figure.axes][3] == "Patella, deg"
    total = next(x for x in figure.axes[5].get_lines() if x.get_label() == "sum")
    np.testing.assert_allclose(total.get_ydata(), 0.0, atol=1e-9)


def test_a_cubic_curve_is_as_much_softer_in_the_middle_as_written_out():
    # Slope of x^3 within 1.5 mm: 1.5^2; between 3.5 and 5 mm: (5^3 - 3.5^3) / 1.5.
    assert study().stiffness_ratio(20.0) == pytest.approx(2.25 / ((125.0 - 42.875) / 1.5))


def test_a_straight_curve_has_no_lax_region():
    force = np.array([2.0, 1.0, 1.0, 2.0])[:, None] * MOVED
    assert failing(study(force_N=force)) == {"3.2"}


@pytest.mark.parametrize("soft", [0, 3])
def test_a_knee_that_is_soft_at_an_end_of_flexion_is_found_out(soft):
    force = study().force_N.copy()
    force[soft] *= 0.4
    assert failing(study(force_N=force)) == {"3.1"}
    (claim,) = [c for c in claims(study(force_N=force), leg()) if c.number == "3.1"]
    assert f"not at {DRAWER_DEG[soft]:g} degrees" in claim.reason


def test_cruciates_that_are_slack_in_a_third_of_the_drawer_are_found_out():
    slack = np.where(np.abs(MOVED) < 1.7, 0.0, 10.0) * np.ones((4, 1))
    assert failing(study(tension={"ACL": slack, "PCL": slack})) == {"3.3"}


def test_torsion_that_is_not_held_is_larger_than_any_and_does_not_grow():
    lost = np.where(TORSION > 30.0, np.nan, 5.0 + 0.1 * TORSION)
    held = np.where(np.isnan(lost)[:, None], [-3.0, 1.5], [-3.0, 3.0])
    found = study(internal_deg=lost, held_Nm=held)
    assert failing(found) == {"3.5"}
    reason = next(c.reason for c in claims(found, leg()) if c.number == "3.5")
    assert "45 degrees -3.0 to 1.5" in reason
    falling = 15.0 - 0.1 * TORSION
    assert failing(study(internal_deg=falling, external_deg=-falling)) == {"3.4", "3.5"}


def test_every_claim_that_is_not_reproduced_has_a_reason():
    flat = study(force_N=np.ones((4, 1)) * MOVED, tension=dict.fromkeys(
        ("ACL", "PCL"), np.zeros((4, len(MOVED)))), internal_deg=-TORSION)  # fmt: skip
    for claim in claims(flat, leg()):
        assert claim.criterion and claim.printed
        assert claim.verdict == REPRODUCED or claim.reason
