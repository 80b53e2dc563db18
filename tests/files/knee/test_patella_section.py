"""The section of the patella in a knee file: what it may say, and the knee of three bones."""

import copy

import jax
import numpy as np
import pytest
import yaml

from kneejax.files import InputProblem, format_knee, load_knee_file, mirror_document
from kneejax.files.knee.file import build_knee
from kneejax.geometry import Pose, State
from kneejax.mechanics import add_lane_axis
from tests.files.knee.knee_documents import changed


@pytest.fixture(scope="module")
def document():
    return load_knee_file("lenhart2015_reduced").document


def with_changes(document, **changes):
    """A copy with other values at places `patella__muscles__field`; None takes away."""
    answer = copy.deepcopy(document)
    for place, value in changes.items():
        changed(answer, place.split("__"), value)
    return answer


def test_the_two_bones_know_nothing_of_the_patella(document):
    """A knee goes on as before: none of its numbers comes from the section."""
    without = build_knee(with_changes(document, patella=None), "knee.yaml").knee
    with_section = build_knee(document, "knee.yaml")
    assert with_section.knee.bodies == ("tibia",) and with_section.knee.muscles is None
    for a, b in zip(_leaves(without), _leaves(with_section.knee), strict=True):
        np.testing.assert_array_equal(a, b)


def _leaves(knee):
    return jax.tree.leaves(knee)


def test_three_bones_have_its_parts_and_no_line_in_its_place(document):
    knee = build_knee(document, "knee.yaml").with_patella()
    assert knee.bodies == ("tibia", "patella") and not knee.lines
    assert knee.contact_names[-1] == "patellofemoral"
    assert knee.contacts[-1].bodies == ("femur", "patella")
    pairs = dict(zip(knee.ligaments.names, knee.ligaments.bodies, strict=True))
    assert pairs["PTc"] == ("patella", "tibia") and pairs["mPFL"] == ("femur", "patella")
    assert set(knee.muscles.names) == {"recfem", "vasint", "vaslat", "vasmed"}
    assert float(knee.muscles.tension.sum()) == pytest.approx(19.61, abs=1e-3)


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_quadriceps_passes_in_front_of_the_femur(document, side):
    """Bent by 130 degrees, where the way behind the femur is the shorter one."""
    own = document if side == "right" else mirror_document(document)
    free = copy.deepcopy(own)
    for wrap in free["patella"]["wraps"].values():
        wrap.pop("side", None)
    bent = State({
        "tibia": Pose.from_table([[130.0, 6.0, -13.0, -5.0, -9.0, -1.0]]),
        "patella": Pose.from_table([[108.0, -8.0, 2.0, -11.0, -24.0, 3.0]]),
    })  # fmt: skip
    ahead, behind = (
        float(add_lane_axis(build_knee(x, "knee.yaml").with_patella().muscles)
              .quadriceps_length(bent)[0])
        for x in (own, free)
    )  # fmt: skip
    assert ahead > behind + 3.0


def test_muscles_pull_as_they_are_told(document):
    read = build_knee(document, "knee.yaml")
    knee = read.with_patella({"semimem": 80.0, "recfem": 0.0})
    assert "recfem" not in knee.muscles.names
    row = knee.muscles.names.index("semimem")
    assert knee.muscles.bodies[row] == ("femur", "tibia") and knee.muscles.tension[row] == 80.0


def test_a_left_patella_is_the_mirrored_right_one(document):
    left = build_knee(mirror_document(document), "left.yaml").with_patella()
    right = build_knee(document, "right.yaml").with_patella()
    for a, b in zip(_leaves(left), _leaves(right), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_a_knee_may_have_the_patella_of_a_bundled_one(document):
    own = build_knee(document, "knee.yaml").with_patella()
    for side in (document, mirror_document(document)):
        other = side | {"patella": {"same_as": "lenhart2015_reduced"}}
        found = build_knee(other, "other.yaml").with_patella()
        for a, b in zip(_leaves(own), _leaves(found), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-12)


def test_the_same_text_is_written_for_it(document):
    text = format_knee(document)
    assert yaml.safe_load(text) == document and format_knee(yaml.safe_load(text)) == text


@pytest.mark.long
def test_the_tendon_runs_around_its_ellipsoid_and_is_longer_than_straight(document):
    knee = build_knee(document, "knee.yaml").with_patella()
    bent = State({
        "tibia": Pose.from_table([[80.0, 4.0, 2.0, 2.0, -7.0, -1.0]]),
        "patella": Pose.from_table([[60.0, 2.0, 0.0, 15.0, -28.0, 5.0]]),
    })  # fmt: skip
    ligaments = add_lane_axis(knee.ligaments)
    around, wrap, _ = ligaments.length_wrap_and_pulls(bent)
    row = knee.ligaments.names.index("PTc")
    between = bent.between(("patella", "tibia"))
    tip = between.apply(tuple(np.asarray(ligaments.tibial_attachment[row])))
    straight = np.linalg.norm(np.stack(tip) - ligaments.femoral_attachment[row])
    assert float(around[row, 0]) >= straight - 1e-9
    assert np.isfinite(np.asarray(wrap.angle[row])).all()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"patella": {"same_as": "lenhart"}}, ("patella.same_as", "lenhart2015")),
        ({"patella__muscles__recfem__tension_N": -5.0}, ("patella.muscles.recfem.tension_N", "-5")),
        ({"patella__muscles__recfem__insertion_bone": "femur"}, ("insertion_bone", "patella")),
        ({"patella__reference_pose__patella_tilt_deg": 200.0}, ("patella_tilt_deg", "degrees")),
        ({"patella__reference_pose__patella_tilt_deg": None}, ("patella_tilt_deg", "missing")),
        ({"patella__ligaments__PTc__femoral_attachment_mm": [1.0, 2.0, 3.0]},
         ("patella.ligaments.PTc", "expected two of femoral_attachment_mm")),
        ({"patella__ligaments__ACLam": {}}, ("patella.ligaments.ACLam", "no ligament between")),
        ({"patella__ligaments__PTc__wrap": "Med_Lig_r"}, ("PTc.wrap", "PatTen_r")),
        ({f"patella__muscles__{head}__tension_N": 0.0
          for head in ("recfem", "vasint", "vaslat", "vasmed")}, ("patella.muscles", "above 0")),
    ],
)  # fmt: skip
def test_what_no_patella_has_is_refused(document, changes, words):
    with pytest.raises(InputProblem) as caught:
        build_knee(with_changes(document, **changes), "knee.yaml")
    text = str(caught.value)
    assert all(line.startswith("knee.yaml: patella") for line in text.split("\n"))
    assert all(word in text for word in words), text


@pytest.mark.parametrize(
    ("changes", "tension", "words"),
    [
        ({"patella__ligaments__PTc__slack_length_mm": 20.0}, {},
         ("patella.ligaments.PTc.slack_length_mm", "torn")),
        ({"patella__muscles__vasint__origin_mm": [15.0, 10.0, 1.0]}, {},
         ("patella.muscles.vasint.wrap", "outside KnExt_vasint_at_fem_r")),
        ({}, {"recfem": -1.0}, ("recfem", "-1 N")),
        ({}, {"recfam": 10.0}, ("recfam", "did you mean", "recfem")),
        ({"patella": None}, {}, ("patella", "missing")),
    ],
)  # fmt: skip
def test_a_knee_that_cannot_be_is_refused_before_it_moves(document, changes, tension, words):
    read = build_knee(with_changes(document, **changes), "knee.yaml")
    with pytest.raises(InputProblem) as caught:
        read.with_patella(tension)
    text = str(caught.value)
    assert "\n" not in text and all(word in text for word in words), text
