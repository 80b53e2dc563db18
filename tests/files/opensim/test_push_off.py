"""A movement that OpenSim simulates with contacts of its own: the push-off of docs/activity.md."""

import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest

from kneejax.experiments import activity
from kneejax.files import ask_opensim, load_knee_file, read_activity, read_storage, whole_body

ROOT = Path(__file__).parents[3]
SHARED = ROOT / "../shared/data"
JUMPER = SHARED / "jumper"
HAMSTRINGS = SHARED / "gait2392/subject01_simbody_adjusted.osim"
pytestmark = [
    pytest.mark.opensim,
    pytest.mark.skipif(not JUMPER.exists(), reason="the jumper is not beside the checkout"),
]


@pytest.fixture(scope="module")
def osim():
    return pytest.importorskip("opensim")


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(ROOT / "docs/figures/make_push_off.py"))


@pytest.fixture(scope="module")
def jumper(osim, script, tmp_path_factory):
    """A copy of the jumper that has jumped, with a model of three hamstrings beside its own."""
    folder = tmp_path_factory.mktemp("push_off") / "jumper"
    shutil.copytree(JUMPER, folder)
    states = script["_movement"](folder)
    text, other = (path.read_text(encoding="utf-8", errors="surrogateescape")
                   for path in (folder / script["MODEL"], HAMSTRINGS))  # fmt: skip
    three = folder / "three_hamstrings.osim"
    three.write_text(
        script["three_hamstrings"](text, other), encoding="utf-8", errors="surrogateescape"
    )
    return folder / script["MODEL"], three, states


@pytest.fixture(scope="module")
def asked(jumper, tmp_path_factory):
    """Files that `read_activity` takes, of the model with three hamstrings at six instants."""
    _, three, states = jumper
    body = whole_body(three, states, None, side="r", instants=6, time_s=(0.02, 0.42))
    return body, ask_opensim(body, tmp_path_factory.mktemp("asked"))


def test_its_feet_carry_it_and_nothing_is_left_for_the_pelvis(asked):
    """Forces of the model's own contacts are in inverse dynamics, though no table names them."""
    moments = read_storage(asked[1].moments)
    left = [moments.columns[f"pelvis_t{axis}_force"] for axis in "xyz"]
    assert np.abs(left).max() < 2.0


def test_three_hamstrings_are_together_as_strong_as_the_one(osim, jumper):
    """They begin where it does, and end where those of another model do."""
    one, three = (osim.Model(str(path)) for path in jumper[:2])
    other = osim.Model(str(HAMSTRINGS))
    assert three.getMuscles().getSize() == one.getMuscles().getSize() + 4
    for side in "rl":
        names = [f"{name}_{side}" for name in ("bifemlh", "semimem", "semiten")]
        lump = one.getMuscles().get(names[0])
        own = [three.getMuscles().get(name) for name in names]
        total = sum(muscle.getMaxIsometricForce() for muscle in own)
        assert total == pytest.approx(lump.getMaxIsometricForce(), rel=1e-5)
        begins = [m.getGeometryPath().getPathPointSet().get(0) for m in (lump, *own)]
        bodies = {point.getBody().getName() for point in begins}
        assert bodies == {"pelvis"}
        for muscle, name in zip(own, names, strict=True):
            points = muscle.getGeometryPath().getPathPointSet()
            theirs = other.getMuscles().get(name).getGeometryPath().getPathPointSet()
            assert points.getSize() == theirs.getSize()


def test_the_intact_knee_holds_what_three_hamstrings_pull(asked):
    """On a patella of its own; it does not hold the one that ends on the fibula alone."""
    read = load_knee_file("ten_bundle")
    coordinates = asked[1].forces.with_name("coordinates.sto")
    record = read_activity(
        asked[0].model, [coordinates, asked[1].forces], side="r", knee=read.knee,
        document=read.document,
    )  # fmt: skip
    found = activity(read.with_patella(), record)
    assert found.holds.all()
    assert record.pose[0, 0] > 75.0 > record.pose[-1, 0]
