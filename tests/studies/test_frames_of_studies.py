"""`in_time` of a test: what a study says of a knee in motion, and what is refused."""

import json

import numpy as np
import pytest

from kneejax.dynamics import gravity_of
from kneejax.experiments import leg_of_person
from kneejax.files import InputProblem
from kneejax.studies import Map, fingerprint, plain_test
from tests.studies.test_lab_tests import study, table

TIMES = np.arange(12) / 12 * 2.0
BENT = 30.0 - 20.0 * np.cos(np.pi * TIMES)
HEADER = ("time_s", "flexion_deg", "anterior_N", "anterior_mm")
CINE = {
    "name": "cine", "file": "cine.csv", "counted_from": "offset", "axes": "tibia",
    "point_mm": [0, -350, 0],
    "in_time": {"period_s": 2.0, "harmonics": 2, "body_kg": 60.0, "femur_deg": 0.0,
                "damping_N_s_per_mm": 2.0, "error_mm": 0.1},
}  # fmt: skip


def cine(folder, header=HEADER, times=TIMES):
    rows = np.c_[times, BENT, 40.0 * np.sin(np.pi * TIMES), np.zeros(12)].tolist()
    table(folder, "cine.csv", header, rows)


def test_a_study_says_what_moves_and_how(tmp_path):
    cine(tmp_path)
    (test,) = study(tmp_path, [CINE]).tests
    frames = test.frames
    assert frames.time_s.tolist() == TIMES.tolist()
    assert frames.leg.mass_kg == leg_of_person(60.0, 1.75).mass_kg
    assert frames.gravity_m_s2 == gravity_of(0.0)
    assert (frames.harmonics, frames.cycles_before, frames.most_mm) == (2, 1, 0.1)
    np.testing.assert_allclose(test.bent_deg, BENT, atol=1e-9)


def test_a_motion_begins_at_rest_where_it_is_bent_most(tmp_path):
    cine(tmp_path)
    frames = study(tmp_path, [CINE]).tests[0].frames
    np.testing.assert_allclose(np.rad2deg(frames.led(np.zeros(1))), 50.0, atol=1e-6)
    np.testing.assert_allclose(frames.starts_with_rad_s, 0.0, atol=1e-5)
    # Bent most one second before the first row, and a whole period before that.
    np.testing.assert_allclose(frames.since_start_s[-12:], 3.0 + TIMES, atol=1e-5)
    np.testing.assert_allclose(
        frames.over_time(BENT[:, None])[[0, -12], 0], [50.0, 10.0], atol=0.01
    )


def test_columns_of_another_program_say_the_time_too(tmp_path):
    cine(tmp_path, ("frame", *HEADER[1:]), np.arange(12.0))
    item = CINE | {"columns": {"time_s": f"{1 / 6} * frame"}}
    (test,) = study(tmp_path, [item]).tests
    np.testing.assert_allclose(test.frames.time_s, TIMES)


def test_a_cohort_knows_knees_in_motion_apart(tmp_path):
    cine(tmp_path)
    one, other = (
        study(tmp_path, [CINE | {"in_time": CINE["in_time"] | {"body_kg": kg}}]).tests[0]
        for kg in (60.0, 80.0)
    )
    assert json.dumps(plain_test(one)) != json.dumps(plain_test(other))


@pytest.mark.parametrize(
    ("in_time", "said"),
    [
        ({"perod_s": 2.0}, r"in_time.perod_s.*did you mean period_s"),
        ({"period_s": 1.0}, r"in_time.period_s: 1 s of rows over .*: expected a longer one"),
        ({"period_s": 2.0, "harmonics": 6}, r"harmonics: 6: expected at most 5 from 12 rows"),
        ({"cycles_before": 2}, r"cycles_before: 2: expected period_s too"),
        ({"height_m": 175}, r"height_m: 175: .*cm are suspected"),
        ({"error_mm": 0}, r"error_mm: 0: expected between"),
    ],
)
def test_what_no_motion_can_be_is_refused(tmp_path, in_time, said):
    cine(tmp_path)
    with pytest.raises(InputProblem, match=said):
        study(tmp_path, [CINE | {"in_time": in_time}])


def test_a_motion_needs_times_that_rise_and_loads_and_coordinates_alone(tmp_path):
    cine(tmp_path, ("seconds", *HEADER[1:]))
    with pytest.raises(InputProblem, match=r"cine.csv: expected a column time_s too"):
        study(tmp_path, [CINE])
    cine(tmp_path, times=TIMES[::-1])
    with pytest.raises(InputProblem, match=r"in_time.time_s: .* s after .*times that rise"):
        study(tmp_path, [CINE])
    cine(tmp_path, (*HEADER[:3], "ACL.tension_N"))
    with pytest.raises(InputProblem, match=r"frames: ACL.tension_N too: expected loads"):
        study(tmp_path, [CINE | {"sd_N": 1.0}])


def test_the_fingerprint_of_a_map_knows_what_moves(tmp_path):
    cine(tmp_path)
    slow = CINE | {"in_time": CINE["in_time"] | {"body_kg": 90.0}}
    question = Map(pair=[("ACL.stiffness", "PCL.stiffness")])
    one, other = (fingerprint(study(tmp_path, [test]), question) for test in (CINE, slow))
    assert one != other
