"""Where the patella was, as data of the one fit: a knee of three bones in a study."""

import dataclasses
import functools

import numpy as np
import pytest
import yaml

import kneejax as kj
from kneejax.experiments._extensor import at_rest, pulled_at
from kneejax.experiments._motion import followed
from kneejax.files import InputProblem, write_rows
from kneejax.geometry import BODIES, COLUMNS, PATELLA, free_of
from kneejax.inference.fit import Problem, fit_lanes
from kneejax.numerics import WrongValue
from kneejax.parameters import UnknownParameter
from kneejax.statics import Slopes

FLEXION = [20.0, 50.0, 80.0]
PULL_N = 150.0
OF_PATELLA = [one.column for one in BODIES[PATELLA].values()]
#: The tendon, a retinaculum, the line of the quadriceps, where the groove stands.
NAMES = [
    "PT1.slack_length", "PFL2.slack_length", "PFL3.patellar_attachment.superior",
    "vaslat.origin.lateral", "patellofemoral.femoral_surface.anterior", "ACL.reference_strain",
]  # fmt: skip


def moved(knee, pull_N):
    """Balances at the flexions under a pull of the quadriceps."""
    return followed(knee, pulled_at(knee, np.array(FLEXION), np.full(3, pull_N), ()))


def patella(motion):
    return np.asarray(motion.equilibrium.state.poses[PATELLA].to_table())


def tracked(knee, **given):
    """A motion under a pull as a test that reads all coordinates of both bones."""
    motion, rest = moved(knee, PULL_N), float(at_rest(knee))
    readings = dict(zip(OF_PATELLA, patella(motion).T, strict=True))
    test = kj.MeasuredTest(
        "tracking", FLEXION, {}, np.asarray(motion.to_table("grood-suntay"))[:, 1:],
        counted_from="absolute", readings=readings, sd_mm=0.5, sd_deg=0.5,
        tensions={"quadriceps": np.full(len(FLEXION), PULL_N - rest)},
    )  # fmt: skip
    return dataclasses.replace(test, **given)


#: Constants between the frames of the laboratory and the knee, of the patella's coordinates.
OFF = np.array([3.0, -2.0, 4.0, 1.5, -2.5, 0.8])


def off_by(test, off):
    """The same test in frames that are off."""
    readings = {name: test.readings[name] + x for name, x in zip(OF_PATELLA, off, strict=True)}
    return dataclasses.replace(test, readings=readings)


def problem_of(knee, test, names=NAMES):
    selection = kj.select(knee, names)
    none = np.empty((0, 6))
    return Problem.of(knee, selection, none, np.full(5, 4.0), tests=[test], known=np.full(5, 0.5))


@pytest.fixture(scope="module")
def knee(pulled_knee):
    return pulled_knee


@pytest.mark.slow
@pytest.mark.parametrize("counted_from", ["absolute", "extension", "unloaded", "offset"])
def test_a_knee_shows_no_residual_against_where_its_own_patella_was(
    knee, counted_from, central_difference
):
    """Nor does it when counted from a row or from the knee at rest; and slopes are exact."""
    test = tracked(knee, counted_from="absolute")
    if counted_from == "unloaded":
        still = moved(knee, float(at_rest(knee)))
        away = np.asarray(still.to_table("grood-suntay"))[:, 1:]
        rest = dict(zip(OF_PATELLA, patella(still).T, strict=True))
        changed = {name: x - rest[name] for name, x in test.readings.items()}
        test = dataclasses.replace(
            test, observed=test.observed - away, readings=changed, counted_from="unloaded"
        )
    if counted_from == "offset":
        test = off_by(test, OFF)
    test = dataclasses.replace(test, counted_from=counted_from)
    problem = problem_of(knee, test)
    start = np.asarray(problem.selection.read(knee))
    first = problem.begin(start[None])
    assert first.converged.all()
    residual, slope = problem.residual(first)
    assert np.abs(residual).max() < 1e-6
    assert problem.cases.readings is not None
    assert len(problem.cases.readings) == 6 * 3
    if counted_from not in ("absolute", "offset"):
        return

    def at(x):
        return problem.residual(problem.balance(x[None], first))[0]

    differences = central_difference(at, start, 1e-4)
    scale = np.abs(differences).max(axis=0)
    assert slope / scale == pytest.approx(differences / scale, rel=1e-6, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("counted_from", ["absolute", "offset"])
def test_a_tendon_and_a_groove_are_found_from_where_the_patella_was(knee, counted_from):
    """Also in frames that are off by a constant in each of the patella's coordinates."""
    selection = kj.select(knee, NAMES)
    start = np.asarray(selection.read(knee))[None]
    away = np.array([0.9, 0.5, 0.5, 1.0, 0.4, 0.005])
    test = tracked(selection.apply(knee, start[0] + away))
    if counted_from == "offset":
        test = dataclasses.replace(off_by(test, OFF), counted_from="offset")
    problem = problem_of(knee, test)
    box = [start - 5.0, start + 5.0]
    found = fit_lanes(problem.balance, problem.cases, problem.begin(start), start, *box)
    assert (found.values - start)[0] == pytest.approx(away, rel=1e-4)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ({"readings": {"patella_yaw_deg": np.zeros(3)}}, "of PART.tension_N.*patella_tilt_deg"),
        ({"sd_deg": None}, "sd_deg: not stated; expected how well patella_flexion"),
        ({"sd_mm": None}, "sd_mm: not stated; expected how well patella_anterior"),
    ],
)
def test_readings_of_the_patella_that_say_nothing_are_refused(given, says):
    readings = {name: np.zeros(3) for name in OF_PATELLA}
    every = {"counted_from": "absolute", "readings": readings, "sd_mm": 0.5, "sd_deg": 0.5}
    with pytest.raises(ValueError, match=says):
        kj.MeasuredTest("tracking", FLEXION, {}, np.full((3, 5), np.nan), **every | given)


def test_a_knee_without_a_patella_cannot_be_compared_with_one(knee):
    two = kj.load_knee("four_ligament")
    readings = {"patella_tilt_deg": np.zeros(3)}
    test = kj.MeasuredTest("tilt", FLEXION, {}, np.full((3, 5), np.nan), counted_from="absolute",
                           readings=readings, sd_deg=1.0)  # fmt: skip
    with pytest.raises(UnknownParameter, match="`patella: true` in the study"):
        problem_of(two, test, ["ACL.stiffness"])
    assert problem_of(knee, test, ["ACL.stiffness"]).counted_numbers == 3


def test_what_is_counted_from_another_row_is_less_that_row_whose_error_all_share(knee):
    """A force is what it is, whatever the poses are counted from."""
    test = kj.MeasuredTest(
        "tracking", FLEXION, {}, np.full((3, 5), np.nan), counted_from="extension",
        readings={"patella_tilt_deg": [1.0, 3.0, 7.0], "PT1.tension_N": [10.0, 20.0, 40.0]},
        sd_deg=0.5, sd_N=2.0,
    )  # fmt: skip
    read = problem_of(knee, test, ["ACL.stiffness"]).cases.readings
    tilt, force = (read.name == read.names.index(name) for name in test.readings)
    assert read.target[tilt].tolist() == [0.0, 2.0, 6.0] and (read.neutral[tilt] == 0).all()
    assert read.sd[tilt].tolist() == [0.5] * 3
    assert len({*read.group[tilt].tolist()}) == 1 and (read.group[tilt] >= 0).all()
    assert read.target[force].tolist() == [10.0, 20.0, 40.0] and (read.neutral[force] == -1).all()
    assert read.sd[force].tolist() == [2.0] * 3 and (read.group[force] == -1).all()


def anywhere(problem):
    """Poses near the reference, whether they balance or not: a reading asks where bones are."""
    knee, count = problem.knee, len(problem.cases.load_cases)
    values = np.asarray(problem.selection.read(knee))[None]
    here = np.asarray(knee.at_reference.at(free_of(["flexion"], knee.bodies)))
    q = here + np.random.default_rng(2).uniform(-0.02, 0.02, (1, count, len(here)))
    met, slope = np.zeros((1, count, knee.patch_count, 2)), np.zeros((*q.shape, 1))
    tangent = np.zeros((*q.shape, len(here)))
    return Slopes(values, q, slope, met, met[..., None], tangent, np.zeros((1, count), int))


def test_the_best_constant_leaves_what_scatters_about_it(knee):
    """With weights 1, 1, 2 the best constant of errors e is (e0 + e1 + 2 e2) / 4; each coordinate
    has its own; one a flexion would leave nothing of a single number, and is refused."""
    weight = np.array([0.5, 0.5, 1.0])
    tilt, lateral = np.array([1.0, 3.0, 8.0]), np.array([4.0, 4.0, 4.0])
    found = {}
    tracking = functools.partial(
        kj.MeasuredTest, "tracking", FLEXION, {}, np.full((3, 5), np.nan),
        tensions={"quadriceps": np.full(3, PULL_N)}, weight=weight, sd_mm=1.0, sd_deg=1.0,
        readings={"patella_tilt_deg": tilt, "patella_lateral_mm": lateral},
    )  # fmt: skip
    for counted_from in ("absolute", "offset"):
        problem = problem_of(knee, tracking(counted_from=counted_from), ["ACL.stiffness"])
        error, _ = problem.cases.readings.error(problem.cases, anywhere(problem))
        found[counted_from] = error[0].reshape(2, 3)
    error = found["absolute"]
    best = error @ np.array([0.25, 0.25, 0.5])
    assert found["offset"] == pytest.approx(error - best[:, None], abs=1e-12)
    assert np.abs(found["offset"]).max() > 0.1
    with pytest.raises(WrongValue, match="patella_tilt_deg under one load at 20 degrees"):
        tracking(counted_from="offset_each_flexion")


def written(folder, item, **fields):
    """A study of one table with all coordinates of both bones, and the pull."""
    header = ["flexion_deg", *COLUMNS[1:], *OF_PATELLA, "quadriceps.tension_N"]
    rows = [[flexion, *range(1, 6), *range(11, 17), 100.0] for flexion in FLEXION]
    write_rows(folder / "tracking.csv", header, rows)
    test = {
        "name": "tracking", "file": "tracking.csv", "counted_from": "absolute", "sd_mm": 0.5,
        "sd_deg": 0.5,
    }  # fmt: skip
    document = {
        "title": "Tracking", "knee": "four_ligament", "patella": True, "noise_mm": 0.5,
        "noise_deg": 0.5, "parameters": ["PTc.slack_length"], "tests": [test | item],
    }  # fmt: skip
    (folder / "study.yaml").write_text(yaml.safe_dump(document | fields))
    return kj.read_study(folder / "study.yaml")


def test_a_study_reads_the_patella_and_what_pulls_on_it(tmp_path):
    study = written(tmp_path, {})
    (test,) = study.tests
    assert study.knee.bodies == ("tibia", "patella") and study.settings()["patella"] is True
    assert test.tensions["quadriceps"].tolist() == [100.0] * 3
    assert {name: x[0] for name, x in test.readings.items()} == dict(
        zip(OF_PATELLA, range(11, 17), strict=True)
    )
    (left,) = written(tmp_path, {"mirror": True}).tests
    signs = [left.readings[name][0] / test.readings[name][0] for name in OF_PATELLA]
    assert signs == [1.0, -1.0, -1.0, 1.0, 1.0, -1.0]
    (tilt,) = written(tmp_path, {"coordinates": ["patella_tilt", "anterior"]}).tests
    assert list(tilt.readings) == ["patella_tilt_deg"] and tilt.coordinates == ("anterior",)


@pytest.mark.parametrize(
    ("item", "fields", "says"),
    [
        ({}, {"patella": False}, "quadriceps.tension_N|no patella"),
        ({}, {"patella": "yes"}, "patella: yes: expected true or false"),
        ({"coordinates": ["patella_tlt"]}, {}, "did you mean patella_tilt"),
        ({"columns": {"patella_tlt_deg": "patella_tilt_deg"}}, {}, "patella_tilt_deg"),
    ],
)
def test_a_study_that_contradicts_itself_is_refused(tmp_path, item, fields, says):
    with pytest.raises((InputProblem, UnknownParameter), match=says):
        written(tmp_path, item, **fields)
