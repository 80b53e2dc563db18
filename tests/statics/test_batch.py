"""Many balances: each is the balance of its own knee, whatever stands beside it."""

import equinox as eqx
import jax
import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import State
from kneejax.mechanics import add_lane_axis, load_of
from kneejax.statics import (
    LoadCases,
    Status,
    balance_lines,
    balance_many,
    balance_near,
    balance_one,
    balance_with_slopes,
    in_lanes,
)
from kneejax.statics._batch import Batch
from kneejax.statics._flexion_paths import Chain
from kneejax.statics._load_cases import Variants

pytestmark = pytest.mark.usefixtures("optimised_code")

FLEXION = np.array([0.0, 30.0, 75.0, 120.0])
UNITS = np.array([1 / 30, 1 / 30, 1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def values(base):
    """Knees within a third of the stiffness and 0.02 of the strain."""
    draw = np.random.default_rng(3)
    stiffness = base[:4] * draw.uniform(0.7, 1.3, (40, 4))
    return np.hstack([stiffness, base[4:] + draw.uniform(-0.02, 0.02, (40, 4))])


@pytest.fixture(scope="module")
def found(knee, chosen, base, values):
    return balance_many(knee, chosen.apply, values, LoadCases.at(FLEXION))


def test_one_compiled_search_serves_every_choice_of_ligament_numbers(knee, found, caplog):
    other = kj.select(knee, ("MCL.reference_strain", "PCL.stiffness"))
    start = np.asarray(other.read(knee))
    with jax.log_compiles():
        moved = balance_many(knee, other.apply, start * [[1.1, 0.9]], LoadCases.at(FLEXION))
    compiled = [r.getMessage() for r in caplog.records if "Compiling" in r.getMessage()]
    assert any("numbers" in message for message in compiled), "what the choice changes"
    assert not any("jit(follow)" in message for message in compiled)
    alone = kj.passive_flexion(other.apply(knee, start * [1.1, 0.9]), FLEXION)
    np.testing.assert_allclose(moved.table[0], np.asarray(alone.to_table())[:, 1:], atol=1e-4)


@pytest.mark.parametrize(
    "strain",
    [[-0.0671, -0.0134, -0.0128, 0.139], [-0.0405, -0.0218, -0.006, 0.1169]],
    ids=["balanced from 10 degrees on", "balanced from 5 degrees on"],
)
def test_a_knee_lost_at_the_reference_stays_on_the_branch_where_it_is_found(
    knee, chosen, base, strain
):
    """Towards the reference its branch ends, and another one lies 4 to 8 mm away: that is neither
    laid over the one which searches find at every flexion, nor taken for its continuation."""
    flexion, value = LoadCases.at([0.0, 15.0, 30.0, 60.0, 90.0]), np.r_[base[:4], strain][None]
    found = balance_many(knee, chosen.apply, value, flexion)
    nowhere = np.full((1, 5, 5), np.nan), np.full((1, 5, knee.patch_count, 2), np.nan)
    alone = balance_near(knee, chosen.apply, value, flexion, *nowhere)
    assert alone.converged.tolist() == found.converged.tolist() == [[False, *4 * [True]]]
    assert (np.abs(found.q - alone.q) / UNITS)[:, 1:].max() < 1e-6


def test_one_compiled_search_serves_motions_and_lines_of_any_length(
    knee, chosen, base, values, found, caplog
):
    with jax.log_compiles():
        for count in (1, 7, 23):
            angles = LoadCases.at(np.linspace(0.0, 60.0, count))
            balance_many(knee, chosen.apply, values[:2], angles)
            line = base + np.linspace(0.0, 1e-3, count)[None, :, None]
            balance_lines(knee, chosen.apply, line, angles, np.array([0]))
    compiled = [r.getMessage() for r in caplog.records if "Compiling" in r.getMessage()]
    assert not any("jit(follow)" in message for message in compiled)


def test_the_program_for_many_balances_finds_what_the_one_for_few_does(
    knee, chosen, values, found, monkeypatch, caplog
):
    monkeypatch.setattr("kneejax.statics._batch._MANY", found.status.size)
    with jax.log_compiles():
        many = balance_many(knee, chosen.apply, values, LoadCases.at(FLEXION))
    assert any("jit(follow)" in record.getMessage() for record in caplog.records)
    np.testing.assert_array_equal(many.status, found.status)
    np.testing.assert_allclose(many.q / UNITS, found.q / UNITS, rtol=0, atol=1e-8)


def test_no_variants_have_no_balances(knee, chosen, base):
    nothing = balance_many(knee, chosen.apply, np.zeros((0, 8)), LoadCases.at(FLEXION))
    assert nothing.q.shape == (0, 4, 5) and nothing.status.shape == (0, 4)


def test_each_variant_has_the_motion_of_its_own_knee(knee, chosen, values, found):
    assert found.q.shape == (40, 4, 5)
    assert found.converged.all()
    for row in (0, 17, 39):
        alone = kj.passive_flexion(chosen.apply(knee, values[row]), FLEXION)
        np.testing.assert_allclose(found.q[row] / UNITS, np.asarray(alone.equilibrium.q).T / UNITS,
                                   atol=2e-6)  # fmt: skip
        np.testing.assert_array_equal(found.status[row], np.asarray(alone.status))
        np.testing.assert_allclose(found.table[row], np.asarray(alone.to_table())[:, 1:], atol=1e-4)


def test_answers_stand_in_the_order_of_the_values(knee, chosen, base, values, found):
    order = np.random.default_rng(0).permutation(len(values))
    again = balance_many(knee, chosen.apply, values[order], LoadCases.at(FLEXION))
    np.testing.assert_allclose(again.q / UNITS, found.q[order] / UNITS, atol=2e-6)


def test_the_same_call_gives_the_same_bits(knee, chosen, base, values, found):
    again = balance_many(knee, chosen.apply, values, LoadCases.at(FLEXION))
    np.testing.assert_array_equal(again.q, found.q)
    np.testing.assert_array_equal(again.steps, found.steps)


def test_one_knee_that_nothing_can_balance_fails_alone(knee, chosen, base, values, found):
    spoilt = values.copy()
    spoilt[5, 4] = np.nan
    again = balance_many(knee, chosen.apply, spoilt, LoadCases.at(FLEXION))
    assert (again.status[5] == Status.NOT_CONVERGED).all()
    assert np.isnan(again.q[5]).all()
    others = np.arange(40) != 5
    assert again.converged[others].all()
    np.testing.assert_allclose(again.q[others] / UNITS, found.q[others] / UNITS, atol=2e-6)


def test_lines_walk_to_the_same_balances(knee, chosen, base):
    """Two lines of nine points, from their middle and from one end."""
    lines = np.tile(base, (2, 9, 1))
    lines[0, :, 0], lines[1, :, 5] = np.linspace(300, 9000, 9), np.linspace(-0.15, -0.05, 9)
    begin = np.array([4, 0])
    walked = balance_lines(knee, chosen.apply, lines, LoadCases.at(FLEXION), begin)
    alone = balance_many(
        knee, chosen.apply, lines.reshape(18, 8), LoadCases.at(FLEXION)
    )
    assert walked.q.shape == (2, 9, 4, 5)
    assert walked.converged.all()
    np.testing.assert_allclose(walked.q.reshape(alone.q.shape) / UNITS, alone.q / UNITS, atol=2e-6)


def test_what_a_knee_reaches_depends_neither_on_lanes_nor_on_stretches(knee, chosen, base):
    """More variants than lanes, more load cases than a stretch has nodes, and an MCL so lax that
    the knee hardly hangs together in extension.

    A search that begins far from a balance once found another branch, 8 degrees and 5 mm away, and
    all of the motion with it. Where the surfaces are nearly flat against each other, searches that
    judged poses off their contact points found no balance in extension below a strain of 0.011.
    """
    values = np.tile(base, (70, 1))
    values[:, 6] = np.linspace(-0.02, 0.06, 70)
    load_cases = LoadCases.at(np.linspace(0.0, 120.0, 41))
    together = balance_many(knee, chosen.apply, values, load_cases)
    assert together.converged[:, 5:].all() and together.converged[40:].all()
    assert together.converged[20:, 0].all()
    # In extension, from one strain to the next: the branch that all these balances are on.
    down = np.tile(base, (1, 280, 1))
    down[0, :, 6] = np.interp(np.arange(280) / 4, np.arange(70), values[:, 6])
    walked = balance_lines(knee, chosen.apply, down, load_cases.take([0]), np.array([279]))
    assert walked.converged.all()
    found = together.converged[:, 0]
    np.testing.assert_allclose(
        together.q[found, 0] / UNITS, walked.q[0, ::4, 0][found] / UNITS, atol=2e-6
    )
    stride = np.abs(np.diff(together.q / UNITS, axis=1)).max(axis=2)
    assert np.nanmax(stride) < 3.0
    for contact, at in zip(knee.contacts, range(2), strict=True):
        bent = {"flexion": load_cases.flexion[5:]}
        pose = State.of(bent, np.moveaxis(together.q[:, 5:], -1, 0)).tibia
        contact_points = np.moveaxis(together.contact_points[:, 5:, at], -1, 0)
        lanes = add_lane_axis(add_lane_axis(contact))
        # A tilt of 1e-6 rad had tilted forces, and poses by 3e-5 mm.
        assert float(np.max(lanes.gap(pose.placement, contact_points).tilt)) < 1e-8
    few = [0, 9, 23, 69]
    apart = balance_many(knee, chosen.apply, values[few], load_cases)
    np.testing.assert_array_equal(apart.status, together.status[few])
    np.testing.assert_array_equal(apart.steps, together.steps[few])
    np.testing.assert_allclose(apart.q / UNITS, together.q[few] / UNITS, atol=2e-6)


def test_paths_that_stop_to_let_others_end_go_on_as_if_they_had_not(knee, chosen, base):
    """Where a call ended on the way to a load case, halved steps began whole again: the reduced
    knee without ACL and LCL was lost beside four other knees, and was not beside three."""
    values = np.tile(base, (32, 1))
    values[:, 4:] += np.random.default_rng(3).uniform(-0.1, 0.1, (32, 4))
    load_cases = LoadCases.at(np.linspace(0.0, 120.0, 9), [load_of(anterior_N=100.0)])
    together = balance_many(knee, chosen.apply, values, load_cases)
    for row in range(0, 32, 4):
        alone = balance_many(knee, chosen.apply, values[row : row + 1], load_cases)
        np.testing.assert_array_equal(alone.steps[0], together.steps[row])
        np.testing.assert_allclose(alone.q[0] / UNITS, together.q[row] / UNITS, atol=1e-9)


@pytest.mark.long
def test_loads_of_stations_are_loads_of_the_knee(knee, chosen, base):
    """A drawer at two flexions, against a knee that carries the same load always."""
    forces = [100.0, -100.0, 100.0]
    load_cases = LoadCases.at([20.0, 20.0, 90.0], (load_of(anterior_N=np.array(forces)),))
    found = balance_many(knee, chosen.apply, base[None], load_cases)
    assert found.converged.all()
    assert found.table[0, 0, 2] > found.table[0, 1, 2] + 1.0
    for row, (flexion, force) in enumerate(zip([20.0, 20.0, 90.0], forces, strict=True)):
        loaded = eqx.tree_at(lambda k: k.loads, knee, (*knee.loads, load_of(anterior_N=force)))
        alone = kj.passive_flexion(loaded, [flexion])
        q = np.asarray(alone.equilibrium.q)[:, 0]
        np.testing.assert_allclose(found.q[0, row], q, atol=1e-6)


def test_a_pose_that_nothing_can_balance_holds_up_no_other(knee, chosen, base):
    """Bent backwards the bones meet where nobody has fitted their surfaces; its lane, and all that
    repeat it, once kept the other one waiting for a new tangent until it was given up."""
    load_cases = LoadCases.at([-60.0, 50.0])
    found = balance_one(knee, load_cases)
    assert found.converged[0].tolist() == [False, True]
    alone = kj.passive_flexion(knee, [50.0])
    np.testing.assert_allclose(found.table[0, 1], np.asarray(alone.to_table())[0, 1:], atol=1e-6)


def test_the_own_motion_is_that_of_any_other_stations(knee, chosen, base):
    """A knee that is bent the wrong way moves fast: with strides of 5 degrees, or whatever the
    load cases happened to give, it was lost at -3 degrees, or was not."""

    def motion(*angles):
        return balance_one(knee, LoadCases.at(angles))

    many = motion(-60.0, -5.0, -3.0, 0.0, 47.0, 60.0, 130.0)
    # At -3 degrees contact reaches 0.2 mm off the fitted surfaces, which is no doubt yet.
    lost = [Status.NOT_CONVERGED, Status.OUTSIDE_REGION]
    assert many.status[0].tolist() == [*lost, 0, 0, 0, 0, 0]
    for place, angle in ((1, -5.0), (2, -3.0), (4, 47.0), (6, 130.0)):
        one = motion(angle)
        assert one.status[0, 0] == many.status[0, place]
        np.testing.assert_allclose(one.q[0, 0] / UNITS, many.q[0, place] / UNITS, atol=2e-6)


def test_no_chain_begins_beside_a_station_that_is_not_balanced(knee, chosen, base):
    """A search from farther away ended in a balance of `lenhart2015_reduced` at -84 degrees, to
    which no bending leads."""
    load_cases = LoadCases.at(np.arange(4.0)).plain()
    ended, one = [], np.zeros(1, int)
    variants = Variants.of(knee, chosen.apply, base[None])
    batch = Batch(variants, load_cases, False, ended.append)
    batch.follow_chains([Chain(1, (1,))], one, 1, from_reference=True)
    batch.found.status[0, 3] = Status.NOT_CONVERGED
    batch.follow_chains([Chain(1, (2,)), Chain(3, (0,))], one, 1)
    assert ended == [1, 1]
    assert batch.found.converged[0].tolist() == [False, True, True, False]


def test_single_precision_is_refused(knee, chosen, base):
    """It once lost half of the lax knees, silently: a step's energy is rounded to 1e-4 N mm."""
    load_cases = LoadCases.at(FLEXION)
    with jax.enable_x64(False), pytest.raises(RuntimeError, match="needs float64"):
        balance_many(knee, chosen.apply, base[None], load_cases)
    with jax.enable_x64(False), pytest.raises(RuntimeError, match="needs float64"):
        kj.passive_flexion(knee, FLEXION)


def test_lax_knees_are_found_where_surfaces_are_nearly_flat_against_each_other(knee, chosen, base):
    """Energies change much along such surfaces, and a step that looks downhill off the meeting
    points may lead over the edge where there are none. At 0.01 mm off some were lost."""
    load_cases = LoadCases.at(np.linspace(0.0, 120.0, 25))
    for count, highest in ((70, 0.02), (50, 0.015)):
        values = np.tile(base, (count, 1))
        values[:, 6] = np.linspace(-0.02, highest, count)
        found = balance_many(knee, chosen.apply, values, load_cases)
        assert found.converged.all()


def test_progress_counts_to_the_end(knee, chosen, base, values):
    seen = []
    balance_many(knee, chosen.apply, values, LoadCases.at(FLEXION),
                 progress=lambda done, total: seen.append((done, total)))  # fmt: skip
    done = [d for d, _ in seen]
    assert done == sorted(done)
    assert seen[-1] == (160, 160)


def test_only_what_varies_gets_lanes_of_its_own(knee, chosen, values):
    lanes = in_lanes(knee, chosen.apply, values)
    assert lanes.ligaments.stiffness.shape == (4, 40)
    assert lanes.ligaments.slack_length.shape == (4, 40)
    assert lanes.ligaments.femoral_attachment.shape == (4, 3, 1)
    own = chosen.apply(knee, values[7])
    np.testing.assert_allclose(lanes.ligaments.slack_length[:, 7], own.ligaments.slack_length)


@pytest.mark.slow
def test_slopes_are_those_of_neighbouring_balances(knee, chosen, base):
    load_cases = LoadCases.at(FLEXION)
    exact = balance_with_slopes(knee, chosen.apply, base[None], load_cases)
    # Strains by less than the rounding of the law's corners, 0.001.
    step = np.r_[2e-3 * base[:4], np.full(4, 3e-4)]
    moves = np.array([-2.0, -1.0, 1.0, 2.0])[:, None, None] * np.diag(step)
    moved = (base + moves).reshape(32, 8)
    near = exact.take(np.zeros(32, int))
    far, close, right, farther = balance_with_slopes(
        knee, chosen.apply, moved, load_cases, near
    ).q.reshape(4, 8, 4, 5)
    numeric = (8.0 * (right - close) - (farther - far)) / (12.0 * step[:, None, None])
    slopes = np.moveaxis(exact.jacobian[0], -1, 0)
    largest = np.abs(slopes).max(axis=(0, 1))
    scale = np.abs(slopes).max(axis=1, keepdims=True) + 1e-6 * largest
    np.testing.assert_array_less(np.abs(numeric - slopes) / scale, 1e-6)


def test_a_variant_beyond_a_linear_guess_says_so(knee, chosen, base):
    exact = balance_with_slopes(knee, chosen.apply, base[None], LoadCases.at(FLEXION))
    lost = base.copy()
    lost[4] = np.nan
    both = balance_with_slopes(
        knee, chosen.apply, np.stack([lost, base]), LoadCases.at(FLEXION), exact.take([0, 0])
    )
    assert np.isnan(both.q[0]).all() and (both.status[0] == Status.NOT_CONVERGED).all()
    np.testing.assert_allclose(both.q[1], exact.q[0], atol=1e-9)
    assert np.isfinite(both.jacobian[1]).all()
