"""Loads are followed from the unloaded balance, and a knee that gives way says where."""

import numpy as np
import pytest

import kneejax as kj
from kneejax.mechanics import load_of
from kneejax.statics import LoadCases, Status, balance_many, balance_one

pytestmark = pytest.mark.usefixtures("optimised_code")

UNITS = np.array([1 / 30, 1 / 30, 1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def variants(base):
    draw = np.random.default_rng(5)
    stiffness = base[:4] * draw.uniform(0.5, 1.5, (12, 4))
    return np.hstack([stiffness, base[4:] + draw.uniform(-0.04, 0.04, (12, 4))])


def drawer(sizes, angle=25.0):
    return LoadCases.at(np.full(len(sizes), angle), [load_of(anterior_N=np.asarray(sizes, float))])


def moved(found, other):
    return np.abs((found - other) / UNITS)


def test_a_ramp_in_tenth_steps_is_the_same_curve(knee, chosen, base, variants):
    coarse = balance_many(knee, chosen.apply, variants, drawer(np.linspace(20, 200, 4)))
    fine = balance_many(knee, chosen.apply, variants, drawer(np.linspace(6, 200, 98)))
    there = np.searchsorted(np.linspace(6, 200, 98), np.linspace(20, 200, 4) - 1e-6)
    both = coarse.converged & fine.converged[:, there]
    assert both.mean() > 0.9
    assert moved(coarse.q, fine.q[:, there])[both].max() < 1e-6
    jumps = moved(fine.q[:, 1:], fine.q[:, :-1]).max(axis=-1)
    assert np.nanmax(jumps) < 2.0


def test_the_order_of_a_ramp_does_not_matter_nor_who_is_beside(knee, chosen, base, variants):
    sizes = np.array([150.0, -80.0, 40.0, 0.0, -200.0])
    together = balance_many(knee, chosen.apply, variants, drawer(sizes))
    for rows in ([4, 3, 2, 1, 0], [0], [1, 2]):
        few = balance_many(knee, chosen.apply, variants, drawer(sizes[rows]))
        np.testing.assert_array_equal(few.status, together.status[:, rows])
        both = few.converged
        assert moved(few.q, together.q[:, rows])[both].max() < 2e-6


@pytest.mark.parametrize("seed", [0, 1])
def test_a_pose_does_not_depend_on_the_other_angles(knee, chosen, base, seed):
    """20 degrees was lost in 0:120:5 and found in 0:40:10; strides were counted by the farthest."""
    draw = np.random.default_rng(seed)
    strains = base[4:] + draw.uniform(-0.1, 0.1, (8, 4))
    variants = np.hstack([base[:4] * draw.uniform(0.2, 1.8, (8, 4)), strains])
    angles = np.sort(draw.choice(np.arange(0.0, 121.0, 2.5), 9, replace=False))
    together = balance_many(knee, chosen.apply, variants, LoadCases.at(angles))
    some = np.sort(draw.choice(9, 3, replace=False))
    few = balance_many(knee, chosen.apply, variants, LoadCases.at(angles[some]))
    np.testing.assert_array_equal(few.status, together.status[:, some])
    assert np.nanmax(moved(few.q, together.q[:, some])) < 2e-6
    alone = kj.passive_flexion(chosen.apply(knee, variants[0]), angles)
    one = kj.passive_flexion(chosen.apply(knee, variants[0]), angles[some])
    np.testing.assert_array_equal(np.asarray(one.status), np.asarray(alone.status)[some])


def test_a_lax_mcl_is_balanced_in_either_range(knee):
    lax = knee.replace({"MCL.reference_strain": -0.1})
    fine, coarse = (kj.passive_flexion(lax, np.arange(0.0, last, step))
                    for last, step in ((121.0, 5.0), (41.0, 10.0)))  # fmt: skip
    np.testing.assert_array_equal(np.asarray(fine.status)[:9:2], np.asarray(coarse.status))


def test_a_heavy_load_is_reached_through_lighter_ones(knee, chosen, base):
    """5 kN along the tibia at once: the search from the unloaded pose alone would end anywhere."""
    heavy = LoadCases.at([0.0], [load_of(compression_N=5000.0)])
    ramp = LoadCases.at(np.zeros(20), [load_of(compression_N=np.linspace(250.0, 5000.0, 20))])
    once = balance_one(knee, heavy)
    followed = balance_one(knee, ramp)
    assert once.converged.all() and followed.converged.all()
    assert moved(once.q[0, 0], followed.q[0, -1]).max() < 1e-6


def test_a_knee_that_nothing_holds_gives_way_and_says_at_which_load(knee):
    """Without MCL and LCL the anterior drawer of the extended knee turns at a third of 100 N."""
    torn = kj.cut(knee, ["MCL", "LCL"])
    sizes = np.array([20.0, 100.0, 200.0])
    motion = kj.passive_flexion(torn, np.zeros(3), [load_of(anterior_N=sizes)])
    status, reached = np.asarray(motion.status), np.asarray(motion.reached)
    assert Status(int(status[0])).converged and reached[0] == 1.0
    assert status[1:].tolist() == [Status.GIVES_WAY] * 2
    assert np.isnan(np.asarray(motion.to_table())[1:, 1:]).all()
    # The same force, whichever load was asked for.
    assert 20.0 < reached[1] * 100.0 < 50.0
    assert reached[2] * 200.0 == pytest.approx(reached[1] * 100.0, abs=0.1)


def test_a_variant_gives_way_where_the_same_knee_by_itself_does(knee):
    """Two knees without an ACL that a posterior drawer turns over, beside one that it does not: it
    carried them across their turning point, in one stride of 134 N and 14 mm."""
    torn = kj.cut(knee, ["ACL"])
    selection = kj.select(torn, ("*.stiffness", "*.slack_length"))
    values = np.array(
        [[0.0, 8305, 8706, 3520, 26.57, 35.24, 76.94, 52.78],
         [0.0, 5173, 2997, 4104, 25.96, 34.54, 75.87, 52.45]]
    )  # fmt: skip
    posterior = drawer([-134.0], 90.0)
    beside = balance_many(torn, selection.apply, values, posterior)
    for row, value in enumerate(values):
        alone = kj.passive_flexion(selection.apply(torn, value), [90.0], posterior.loads)
        assert beside.status[row, 0] == int(alone.status[0])
        assert beside.reached[row, 0] == pytest.approx(float(alone.reached[0]), abs=1e-3)
        np.testing.assert_allclose(beside.q[row], alone.equilibrium.q.T, atol=1e-6)
    assert beside.status[0, 0] == Status.GIVES_WAY


def test_a_knee_that_turns_and_slides_at_once_gives_way():
    """The least pivot of its stiffness is a fifth of the unloaded one; the least eigenvalue is
    nearly zero."""
    knee = kj.load_knee("four_ligament")
    motion = kj.passive_flexion(knee, [120.0], [load_of(compression_N=5000.0)])
    assert int(motion.status[0]) == Status.GIVES_WAY
    assert 0.2 < float(motion.reached[0]) < 0.3


@pytest.mark.long
def test_a_knee_gives_way_at_one_load_whatever_the_steps():
    """Without its ACL the knee snaps over at a third of the load, by more than a millimetre."""
    loose = kj.cut(kj.load_knee("twelve_bundle"), ["ACL"])
    limits = []
    for steps in (8, 40):
        (curves,) = kj.load_curves(loose, kj.lab_tests("drawer", [30.0], steps=steps))
        lost = np.flatnonzero((curves.part > 0) & (curves.motion.status == Status.GIVES_WAY))[0]
        limits.append(float(curves.motion.reached[lost] * curves.part[lost]))
    assert limits[0] == pytest.approx(limits[1], rel=1e-3)


def test_cut_names_the_nearest_ligament(knee):
    with pytest.raises(ValueError, match="did you mean 'ACL'"):
        kj.cut(knee, ["ACLL"])
