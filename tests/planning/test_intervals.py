"""A reconstruction on knees that a calibration leaves possible."""

import json

import numpy as np
import pytest
import yaml

from kneejax.files import InputProblem, read_calibrated
from kneejax.planning import intervals, missed, on_knee
from kneejax.studies import drawn_parameters, read_plan

pytest.importorskip("dtaidistance")

NAMES = ["MCL.reference_strain", "LCL.reference_strain", "PCL.reference_strain"]


@pytest.fixture
def calibrated(tmp_path):
    values = {
        NAMES[0]: {"value": 0.07, "standard_error": 0.004},
        NAMES[1]: {"value": 0.06, "standard_error": 0.01},
        NAMES[2]: {"value": -0.1, "standard_error": None},
    }
    matrix = [[1.0, -0.8, None], [-0.8, 1.0, None], [None, None, None]]
    document = {
        "knee": "four_ligament",
        "parameters": values,
        "correlation": {"parameters": NAMES, "matrix": matrix},
    }
    (tmp_path / "result.json").write_text(json.dumps(document))
    return tmp_path / "result.json"


def plan_in(folder, **fields):
    plan = {"title": "t", "knee": "result.json", "graft": {"type": "hamstring"}} | fields
    (folder / "plan.yaml").write_text(yaml.safe_dump(plan))
    return read_plan(folder / "plan.yaml")


def test_draws_have_the_spread_and_the_correlation_of_the_fit(calibrated):
    draws, held = drawn_parameters(read_calibrated(calibrated), 4000)
    both = np.array([[one[name] for name in NAMES[:2]] for one in draws])
    assert held == (NAMES[2],)
    assert both.mean(axis=0) == pytest.approx([0.07, 0.06], abs=5e-4)
    assert both.std(axis=0) == pytest.approx([0.004, 0.01], rel=0.05)
    assert np.corrcoef(both.T)[0, 1] == pytest.approx(-0.8, abs=0.02)


def test_draws_need_a_calibration(calibrated):
    with pytest.raises(InputProblem, match="draws: 8: .*result.json of a calibration"):
        plan_in(calibrated.parent, knee="four_ligament", draws=8)


def test_knees_of_a_plan_are_those_that_were_drawn(calibrated):
    plan = plan_in(calibrated.parent, draws=5)
    assert len(plan.drawn) == 5 and plan.held == (NAMES[2],)
    strains = [float(knee.reference_strain()[2]) for knee in plan.drawn]
    assert np.std(strains) > 1e-4


@pytest.mark.long
def test_two_draws_are_the_ends_of_their_quantiles(tmp_path):
    (tmp_path / "result.json").write_text(
        json.dumps({"knee": "four_ligament", "parameters": {NAMES[0]: {"value": 0.07}}})
    )
    limits = {"laxity_band_mm": 0.05}
    plan = plan_in(tmp_path, flexion_deg="40:0:-20", lachman={"flexion_deg": [20]}, limits=limits)
    other = plan_in(tmp_path, set={"ACL.reference_strain": 0.0, "MCL.reference_strain": 0.03}).own
    found = intervals(plan.surgery, [plan.own, other], {"planned": plan.base})
    assert found.knees == ("intact", "deficient", "planned")
    each = [on_knee(plan.surgery, knee) for knee in (plan.own, other)]
    ends = np.sort([surgery.laxity(surgery.before)[:, 0] for surgery in each], axis=0)
    assert np.ptp(ends, axis=0).min() > 1e-3
    for place, part in enumerate((0.025, 0.5, 0.975)):
        expected = ends[0] + part * (ends[1] - ends[0])
        assert found.limits[:2, 0, place] == pytest.approx(expected, abs=1e-7)
    kept = [missed(surgery, surgery.try_out(plan.base))[0] == 0.0 for surgery in each]
    assert found.kept[2] == np.mean(kept) < 1.0
    assert found.known[2].tolist() == [2, 2, 2]
