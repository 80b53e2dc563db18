import numpy as np
import pytest

import kneejax as kj
from kneejax.explorer import Setting, Solver, Subject
from kneejax.files import load_knee_file
from kneejax.mechanics import load_of
from kneejax.parameters import cut
from kneejax.statics import Status


@pytest.fixture(scope="module")
def solver():
    return Solver(Subject.of(load_knee_file("four_ligament").knee))


LOADED = Setting.of(
    {"flexion_deg": 30.0, "anterior_N": 90.0, "internal_Nm": 2.0, "PCL.stiffness": 5000.0,
     "MCL.reference_strain": 0.04, "ACL.femoral_attachment.anterior": -2.0}
)  # fmt: skip


def test_a_setting_comes_back_from_its_link():
    odd = Setting.of({"flexion_deg": 12.3456789012345, "ACL.cut": 1.0, "anterior_N": -1e-7})
    assert Setting.of_link(odd.link) == odd
    assert Setting.of_link("flexion_deg=nan&x=1&anterior_N=ten&=&%").given == {"x": 1.0}


def test_numbers_stay_within_limits_and_the_knees_own_are_left_out(solver):
    subject = solver.subject
    wild = Setting.of({"flexion_deg": 1e9, "ACL.stiffness": -5.0, "FOO.stiffness": 3.0,
                       "lateral_N": 0.0, "ACL.cut": 0.7})  # fmt: skip
    given = subject.within(wild).given
    assert given["flexion_deg"] == 120.0
    assert given["ACL.stiffness"] == subject.limits["ACL.stiffness"][1] > 0
    assert given["ACL.cut"] == 1.0
    assert "lateral_N" not in given and "FOO.stiffness" not in given


def test_no_fibre_is_in_two_ligaments():
    subject = Subject.of(kj.load_knee("average_knee"))
    assert len(subject.limits) > 60 and "MCL" not in subject.ligaments


def test_a_pose_is_that_of_passive_flexion(solver):
    solver.answer(Setting.of({"flexion_deg": 25.0}))  # begins elsewhere
    answer = solver.answer(LOADED)
    given = {k: x for k, x in LOADED.numbers if "." in k}
    knee = solver.subject.knee.replace(given)
    load = load_of(anterior_N=90.0, internal_Nm=2.0)
    motion = kj.passive_flexion(knee, [30.0], [load])
    expected = np.asarray(motion.to_table())[0, 1:]
    np.testing.assert_allclose([*answer.coordinates.values()], expected, atol=1e-7)
    assert answer.status == Status.BALANCED and not answer.sentence
    assert answer.force_N["ACL"] == pytest.approx(float(motion.tension("ACL")[0]), rel=1e-6)


def test_curves_go_through_the_pose_and_know_laxity(solver):
    curves = solver.curves(LOADED, "anterior_N")
    again = solver.curves(LOADED, "anterior_N", curves)
    answer = solver.answer(LOADED)
    at = list(np.linspace(0.0, 120.0, 25)).index(30.0)
    for name, value in answer.coordinates.items():
        assert curves.coordinates[name][at] == pytest.approx(value, abs=1e-6)
        np.testing.assert_allclose(again.coordinates[name], curves.coordinates[name], atol=1e-6)
    assert curves.force_N["ACL"][at] == pytest.approx(answer.force_N["ACL"], rel=1e-5)
    assert 1.0 < curves.laxity["anterior_N"][at] < 30.0


def test_a_cut_is_a_number_and_carries_nothing(solver):
    whole = solver.answer(LOADED)
    torn = solver.answer(solver.subject.within(LOADED.to("ACL.cut", 1.0)))
    assert torn.force_N["ACL"] == 0.0 < whole.force_N["ACL"]
    assert torn.coordinates["anterior"] > whole.coordinates["anterior"] + 1.0
    saved = solver.subject.knee_at(torn.setting)
    assert cut(saved, ["ACL"]).ligaments.stiffness.tolist() == saved.ligaments.stiffness.tolist()


@pytest.mark.parametrize("name", ["ACL.stiffness", "MCL.reference_strain",
                                  "ACL.femoral_attachment.anterior"])  # fmt: skip
def test_sensitivities_are_the_slopes_of_the_answers(solver, name):
    answer, row = solver.answer(LOADED), solver.names.index(name)
    value = solver.subject.value(LOADED, name)
    step = 1e-4 * max(abs(value), 0.1)
    up, down = (solver.answer(LOADED.to(name, value + x)) for x in (step, -step))
    for of in ("anterior", "internal_rotation", "ACL", "LCL"):
        high, low = (x.coordinates.get(of, x.force_N.get(of)) for x in (up, down))
        slope = (high - low) / (2.0 * step)
        assert answer.slopes[of][row] == pytest.approx(slope, rel=1e-4, abs=1e-8)


def test_what_does_not_balance_is_said_and_the_last_pose_stays(solver):
    good = solver.answer(Setting.of({"flexion_deg": 30.0}))
    torn = {f"{one}.cut": 1.0 for one in solver.subject.ligaments}
    lost = solver.answer(Setting.of({"flexion_deg": 30.0, "varus_Nm": 15.0} | torn))
    assert not lost.status.sound and lost.sentence.endswith(("grey.", "."))
    if not lost.status.converged:
        assert np.isnan(lost.coordinates["anterior"]) and not lost.slopes
        np.testing.assert_array_equal(lost.state.tibia.anterior, good.state.tibia.anterior)


def test_poses_at_rest_are_those_of_the_path(solver):
    one, sure = solver.answer(LOADED), solver.answer(LOADED, sure=True)
    assert not solver.differs(one, sure)
    assert solver.differs(one, solver.answer(Setting.of({"flexion_deg": 90.0})))
