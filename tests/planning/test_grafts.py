"""A graft that is fixed under a tension: the force that it carries, and what that depends on."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.experiments import passive_flexion
from kneejax.geometry import TIBIA
from kneejax.mechanics import add_lane_axis, ligament_law
from kneejax.parameters import cut
from kneejax.planning import (
    GRAFTS,
    fix,
    fixed_knee,
    follow,
    footprint_of,
    reconstruction_of,
    slack_length,
)
from kneejax.planning import Protocol as Through

FLEXION, TENSION = 20.0, 80.0


@pytest.fixture(scope="module")
def knee(hinged_knee):
    return hinged_knee


@pytest.fixture(scope="module")
def plan(knee):
    return reconstruction_of(knee)


@pytest.fixture(scope="module")
def ends(knee):
    own = knee.ligaments
    return np.hstack([own.femoral_attachment[0], own.tibial_attachment[0]])[None]


def pull_of_graft(plan, knee, flexion):
    motion = passive_flexion(knee, [flexion])
    assert motion.status[0] == 0
    lanes = add_lane_axis(knee.ligaments)
    return lanes.tension(motion.equilibrium.state)[plan.vary.grafts[0], 0]


@pytest.mark.long
@pytest.mark.parametrize("tension", [30.0, 80.0, 140.0])
def test_the_balanced_knee_carries_the_stated_force_where_the_graft_was_fixed(plan, ends, tension):
    knee = fixed_knee(plan, ends, [tension], FLEXION)
    assert float(pull_of_graft(plan, knee, FLEXION)) == pytest.approx(tension, abs=1e-6)


@pytest.mark.long
def test_lanes_and_one_knee_give_the_same_slack_length(plan, ends):
    found = fix(plan, ends[None], np.array([[TENSION]]), FLEXION, slopes=True)
    one = fixed_knee(plan, ends, [TENSION], FLEXION).ligaments.slack_length[plan.vary.grafts[0]]
    assert found.slack_mm[0, 0] == pytest.approx(float(one), abs=1e-9)
    assert found.status[0] == 0


@pytest.mark.long
def test_slack_length_follows_force_and_ends_as_central_differences_say(plan, ends):
    at = fix(plan, ends[None], np.array([[TENSION]]), FLEXION, slopes=True)
    numbers = plan.value(ends[None], tension_N=TENSION, elastic=False).shape[1]
    assert at.slope.shape == (1, 1, numbers)
    places = [*range(1, 7), 9]  # the ends, and the tension
    for column, h in zip(places, [*[1e-3] * 6, 0.1], strict=True):
        away, more = np.zeros((1, 1, 6)), 0.0
        if column == 9:
            more = h
        else:
            away[..., column - 1] = h
        up, down = (
            fix(plan, ends[None] + way * away, np.array([[TENSION + way * more]]), FLEXION,
                slopes=True, near=at.near).slack_mm[0, 0]
            for way in (1.0, -1.0)
        )  # fmt: skip
        rise = (up - down) / (2.0 * h)
        assert at.slope[0, 0, column] == pytest.approx(rise, rel=1e-6, abs=1e-8), column


@pytest.mark.slow
def test_slack_length_follows_force_pose_and_ends_as_central_differences_say(plan, ends):
    def slack(numbers):
        knee = fixed_knee(plan, ends + numbers[2:8], numbers[:1], numbers[1])
        return knee.ligaments.slack_length[plan.vary.grafts[0]]

    at = jnp.array([TENSION, FLEXION, *np.zeros(6)])
    exact = jax.jacfwd(slack)(at)
    step = np.array([0.1, 0.01, *np.full(6, 1e-3)])
    for k, h in enumerate(step):
        away = np.zeros(len(step))
        away[k] = h
        rise = float(slack(at + away) - slack(at - away)) / (2.0 * h)
        assert float(exact[k]) == pytest.approx(rise, rel=1e-6, abs=1e-7), k


def test_a_longer_pull_leaves_a_shorter_graft_by_the_law_alone():
    short, long = (float(slack_length(30.0, f, 7140.0)) for f in (150.0, 20.0))
    assert short < long < 30.0
    for tension, length in ((150.0, short), (20.0, long)):
        strain = 30.0 / length - 1.0
        assert float(ligament_law.exact_tension(strain, 7140.0, 0.06)) == pytest.approx(
            tension, abs=0.05
        )


@pytest.mark.slow
def test_a_structure_with_grafts_is_the_knee_itself_where_nothing_is_torn(knee, plan, ends):
    angles = np.array([60.0, 30.0, 0.0])
    through = Through(angles, (), 0.0)
    states = [plan.value(ends[None], elastic=False, torn=torn) for torn in (False, True)]
    found = follow(plan, np.vstack(states), through)
    for row, own in enumerate((knee, cut(knee, ["ACL"]))):
        motion = passive_flexion(own, angles)
        alone = add_lane_axis(own.ligaments).strain(motion.equilibrium.state).T
        assert found.strain[row][:, :-1] == pytest.approx(np.asarray(alone), abs=1e-7)


def test_a_graft_that_is_the_ligament_makes_the_knee_what_it_was(knee, ends):
    own = knee.ligaments
    plan = reconstruction_of(knee, stiffness_N=float(own.stiffness[0]))
    intact = passive_flexion(knee, [FLEXION])
    pull = float(intact.tension("ACL")[0])
    fixed = fix(plan, ends[None], np.array([[pull]]), FLEXION)
    # Their toes differ: the same force at the same length, and nearly the same length without.
    law = float(own.transition_strain[0]), float(own.transition_width[0])
    length = float(add_lane_axis(own).length(intact.equilibrium.state)[0, 0])
    strain = length / fixed.slack_mm[0, 0] - 1.0
    graft = ligament_law.tension(strain, float(own.stiffness[0]), 0.06, 0.0001)
    assert float(graft) == pytest.approx(pull, abs=1e-6)
    assert law[0] > 0.0


def test_several_bundles_share_stiffness_and_strength(knee):
    two = reconstruction_of(knee, bundles=2, stiffness_N=6000.0, failure_N=2000.0)
    assert two.bundles == ("graft1", "graft2")
    assert two.stiffness_N == (3000.0, 3000.0) and two.failure_N == (1000.0, 1000.0)
    assert dict(two.knee.groups)["graft"] == two.bundles


def test_a_graft_tears_at_its_failure_load(plan):
    row, kind = plan.vary.grafts[0], GRAFTS["hamstring"]
    tears = float(plan.knee.ligaments.failure_strain[row])
    pull = ligament_law.exact_tension(tears, kind.stiffness_N, 0.06)
    assert float(pull) == pytest.approx(kind.failure_N)
    assert all(graft.source for graft in GRAFTS.values())


def test_the_table_of_grafts_is_what_was_published():
    printed = {
        "hamstring": (238.0, 2422.0), "patellar_tendon": (210.0, 1784.0),
        "quadriceps_tendon": (466.0, 2186.0), "native": (242.0, 2160.0),
    }  # fmt: skip
    told = {name: (x.stiffness_N_per_mm, x.failure_N) for name, x in GRAFTS.items()}
    assert told == printed


def test_footprints_are_longer_from_front_to_back_and_along_the_femur(knee):
    tibia, femur = (footprint_of(knee, "ACL", bone).semi_axes_mm for bone in ("tibia", "femur"))
    assert (tibia, femur) == ((7.0, 5.0), (4.0, 7.5))


def test_a_footprint_is_read_from_the_fibres(knee):
    many = kj.load_knee("lenhart2015")
    tibia = footprint_of(many, "ACL", TIBIA)
    assert tibia.names == ("anterior", "medial")
    assert tibia.axes @ tibia.axes.T == pytest.approx(np.eye(2), abs=1e-12)
    assert tibia.axes[0, 0] > 0.8 and tibia.axes[1, 2] < -0.8
    points, slope = tibia.place(np.array([[0.0, 0.0], [2.0, -1.0]]))
    assert points[0] == pytest.approx(tibia.middle)
    assert slope[1] @ [2.0, -1.0] == pytest.approx(points[1] - points[0])
    assert tibia.outside(np.array([[7.0, 0.0], [0.0, 2.5]])) == pytest.approx([1.0, 0.5])
