"""One ligament changed at a time: what changes, what it costs, and how it is scored."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.mechanics import Ring, add_lane_axis
from kneejax.numerics import compiled
from kneejax.papers.knee_comparison import (
    LIMITS,
    Change,
    OneAtATime,
    _outcomes,
    changes_of,
    common_step,
    compare_knees,
    differences,
    score,
    with_fibres,
)
from kneejax.papers.paper4 import synthetic_knee
from kneejax.papers.varus_valgus import VarusValgus, VarusValgusRamp, peak_pressure
from kneejax.parameters import UnknownParameter, UnsuitableData
from kneejax.statics import Equilibria, Guess, Status, solve_equilibrium
from tests.mechanics.contact.test_ring import rim

COARSE = OneAtATime(
    ("MCL", "LCL"), prestretch=(0.0,), modulus_MPa=(-50.0, 100.0), full_Nm=12.0, axial_steps=1,
    moment_steps=4,
)  # fmt: skip


def test_scores_change_at_the_limits_of_table_5():
    for outcome, limits in LIMITS.items():
        assert score(outcome, 0.0) == 0.0
        assert np.isnan(score(outcome, np.nan))
        for place, limit in enumerate(limits):
            assert score(outcome, limit) == 0.5 + 0.5 * place
            assert score(outcome, np.nextafter(limit, 99.0)) == 1.0 + 0.5 * place


@pytest.fixture
def grouped(small_knee):
    """A knee in which two fibres are one ligament."""
    return dataclasses.replace(small_knee, groups=(("CRUX", ("ACL", "PCL")),))


def varied(knee, ligaments, **changed):
    nothing = {"prestretch": (), "modulus_MPa": (), "horn_N_per_mm": ()}
    settings = OneAtATime(ligaments, **nothing | {"reference_modulus_MPa": 200.0} | changed)
    changes, fibres = changes_of(knee, settings)
    knees = [
        with_fibres(knee, jax.tree.map(lambda x, i=i: x[i], fibres))
        for i in range(len(changes) + 1)
    ]
    return changes, knees


def test_a_prestretch_adds_to_the_reference_strain_of_every_fibre(grouped):
    changes, (same, more, *_) = varied(grouped, ("CRUX",), prestretch=(0.04,))
    assert changes[0].parameter == "CRUX.prestretch"
    before, after = np.asarray(same.reference_strain()), np.asarray(more.reference_strain())
    assert after - before == pytest.approx([0.04, 0.04, 0.0, 0.0], abs=1e-12)


def test_a_modulus_scales_stiffness_in_proportion(grouped):
    _, (same, *softer) = varied(grouped, ("MCL",), modulus_MPa=(-50.0, 100.0))
    ratio = [np.asarray(k.ligaments.stiffness / same.ligaments.stiffness) for k in softer]
    assert ratio[0] == pytest.approx([1, 1, 0.75, 1])
    assert ratio[1] == pytest.approx([1, 1, 1.5, 1])


def test_halved_attachments_are_gathered_and_as_taut_as_before(grouped):
    changes, (same, *halved) = varied(grouped, ("CRUX", "MCL"))
    assert [c.label for c in changes] == ["femoral half", "tibial half", "both halves"]
    femoral, tibial, both = halved
    # Of two femoral ends the higher is kept, of two tibial ones the lower.
    top, low = np.asarray(same.ligaments.femoral_attachment)[0], [-22.0, -32.0, 0.0]
    for knee in (femoral, both):
        assert np.asarray(knee.ligaments.femoral_attachment)[:2] == pytest.approx(
            np.stack([top] * 2)
        )
    for knee in (tibial, both):
        assert np.asarray(knee.ligaments.tibial_attachment)[:2] == pytest.approx(
            np.array([low] * 2)
        )
    for knee in halved:
        assert np.asarray(knee.reference_strain()) == pytest.approx(
            np.asarray(same.reference_strain()), abs=1e-12
        )


def test_horns_of_menisci_change_together_and_keep_some_stiffness(small_knee):
    ring = Ring(120.0, 40.0, 180.0, 30.0, [0.0, 0.0], [0.5, 5.8])
    knee = dataclasses.replace(small_knee, contacts=(rim(ring), *small_knee.contacts[1:]))
    changes, knees = varied(knee, (), horn_N_per_mm=(-200.0, -90.0, 180.0))
    assert [change.label for change in changes] == ["-90 N/mm", "+180 N/mm"]
    assert {change.parameter for change in changes} == {"menisci.horn_stiffness"}
    assert [float(k.contacts[0].ring.horn_stiffness) for k in knees] == [180.0, 90.0, 360.0]
    # A knee without menisci has no horns.
    assert varied(small_knee, ("MCL",), horn_N_per_mm=(90.0,), prestretch=(0.1,))[0][-1] == Change(
        "MCL", "prestretch", 0.1
    )


def test_pressures_beside_other_horns_are_those_of_a_knee_that_has_them(small_knee):
    """At one pose, a ring with softer horns gives way farther."""
    knee = dataclasses.replace(small_knee, contacts=(rim(),), contact_names=("medial_meniscus",))
    changes, fibres = changes_of(knee, OneAtATime((), horn_N_per_mm=(-200.0, 400.0)))
    q, nothing = np.zeros((3, 2, 5)), np.zeros((3, 2))
    held = Equilibria(q, np.zeros((3, 2, 0, 2)), nothing.astype(int), nothing.astype(int),
                      nothing + 1.0, nothing.astype(int), nothing)  # fmt: skip
    run = VarusValgus(VarusValgusRamp("varus", 10.0, 100.0, 1, 1), held)
    found = _outcomes(knee, fibres, run, dict(enumerate(changes, 1)), 5.0)
    there, points = kj.Pose(*jnp.zeros((6, 1))), jnp.zeros((0, 2, 1))
    alone = [
        float(peak_pressure(add_lane_axis(with_fibres(knee, one)), there, points)[0][0, 0])
        for one in (jax.tree.map(lambda x, i=i: x[i], fibres) for i in range(3))
    ]
    assert alone[1] < alone[0] < alone[2]
    peaks = np.array([one.peak_MPa[:, 0] for one in found])
    assert peaks[:, 0] == pytest.approx(alone[1:], rel=1e-9)
    assert peaks[:, 1] == pytest.approx([alone[0]] * 2, rel=1e-9)


def test_a_made_up_knee_differs_as_stated_and_comes_again(small_knee):
    first, again, other = (synthetic_knee(small_knee, seed) for seed in (1, 1, 2))
    assert jax.tree.all(jax.tree.map(np.array_equal, first, again))
    assert not np.allclose(first.ligaments.stiffness, other.ligaments.stiffness)
    drawn = [synthetic_knee(small_knee, seed) for seed in range(40)]
    strain = np.array([k.reference_strain() - small_knee.reference_strain() for k in drawn])
    moved = np.array(
        [k.ligaments.tibial_attachment - small_knee.ligaments.tibial_attachment for k in drawn]
    )
    assert strain.std() == pytest.approx(0.02, rel=0.15)
    assert moved.std() == pytest.approx(2.0, rel=0.15)


def test_contacts_without_a_base_count_nowhere():
    peak = np.array([[2.0, 0.0], [3.0, 1.0], [0.0, 0.0]])
    center = np.zeros((3, 2, 3))
    center[0, 1], center[1, 0], center[2] = np.nan, [0.0, 3.0, 4.0], np.nan
    percent, moved = differences(peak, center)
    assert percent == pytest.approx([50.0, 100.0])
    assert moved[0] == 5.0 and np.isnan(moved[1])


class Reached:
    """As much of a run as the choice of a step looks at."""

    def __init__(self, *steps):
        ramp = VarusValgusRamp("valgus", 40.0, 600.0, 2, 8)
        self.reached = np.array(steps)
        self.moment_reached_Nm = np.r_[0.0, ramp.moment_Nm][self.reached]


def test_pressures_are_compared_where_all_that_get_far_enough_still_hold():
    step, far = common_step(Reached(10, 10, 5, 3), [1, 2, 3], 10.0)
    assert step == 4 and far.tolist() == [True, True, False]
    _, none = common_step(Reached(2, 10, 10, 10), [1, 2, 3], 10.0)
    assert not none.any()


@pytest.fixture(scope="module")
def compared():
    return compare_knees({"four": kj.load_knee("four_ligament")}, COARSE)


@pytest.mark.long
def test_a_change_of_nothing_scores_nothing(compared):
    knee = compared.knees[0]
    for ligament in ("MCL", "LCL"):
        for outcome in LIMITS:
            nothing = knee.scores(f"{ligament}.prestretch", outcome)
            assert nothing == {"varus": 0.0, "valgus": 0.0}
        assert knee.score(f"{ligament}.youngs_modulus", "rmse_deg") > 0.0


@compiled()
def settled_on_a_ramp(knee, load_cases):
    lanes = load_cases.load(add_lane_axis(knee))
    reference = lanes.at_reference.at(load_cases.free)
    q = jnp.broadcast_to(reference, (len(reference), len(load_cases)))
    nowhere = jnp.full((knee.patch_count, 2, len(load_cases)), jnp.nan)
    return solve_equilibrium(lanes, load_cases.prescribed, Guess(q, nowhere))


@pytest.mark.long
def test_the_error_of_rotation_is_that_of_direct_balances(compared):
    knee, ramp = kj.load_knee("four_ligament"), COARSE.ramp("varus")
    changes, knees = varied(knee, ("LCL",), modulus_MPa=(100.0,), reference_modulus_MPa=345.0)
    angles = []
    for one in knees:
        found = settled_on_a_ramp(one, ramp.load_cases)
        assert (np.asarray(found.status) == Status.BALANCED).all()
        angles.append(np.rad2deg(np.asarray(found.q[0])))
    direct = np.sqrt(np.mean((angles[1] - angles[0])[ramp.loaded] ** 2))
    own = next(
        one
        for one in compared.knees[0].outcomes
        if one.change == changes[0] and one.direction == "varus"
    )
    assert direct > 0.01
    assert own.rmse_deg == pytest.approx(direct, abs=1e-6)


@pytest.mark.long
def test_the_collaterals_tighten_on_their_sides(compared):
    tension = compared.knees[0].tension_N
    assert tension["varus"]["LCL"] > tension["valgus"]["LCL"]
    assert tension["valgus"]["MCL"] > tension["varus"]["MCL"]


def test_bad_input_says_what_is_wrong(small_knee):
    with pytest.raises(UnknownParameter, match="no ligament 'MLC'; did you mean 'MCL'"):
        compare_knees({"small": small_knee}, dataclasses.replace(COARSE, ligaments=("MLC",)))
    with pytest.raises(UnsuitableData, match="no knees"):
        compare_knees({})
    with pytest.raises(UnsuitableData, match="reference_modulus_MPa is 80; expected more than 100"):
        OneAtATime(reference_modulus_MPa=80.0)
    with pytest.raises(UnsuitableData, match="full_Nm is 5; expected at least"):
        OneAtATime(full_Nm=5.0)
    with pytest.raises(UnsuitableData, match="moment_steps is 0; expected more than 0"):
        OneAtATime(moment_steps=0)
