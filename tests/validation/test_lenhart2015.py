"""A published knee, imported on the fly, against what OpenSim JAM recorded on it.

Importer and mechanics are judged together: the model and its meshes go through `kneejax import`
into a folder of the test, and what comes out is held against the record at all instants.
"""

import numpy as np
import pytest

from kneejax import Pose, Status, evaluate
from tests.mechanics.raycast_foundation import confined_modulus, load_mesh_mm, raycast_contact
from tests.validation import equilibrium_lenhart2015 as equilibrium
from tests.validation.imported_lenhart2015 import import_both
from tests.validation.recorded_lenhart2015 import (
    CONTACT_CRITERIA,
    DATA,
    alone,
    compare_contact,
    compare_fibres,
    read_record,
)
from tests.validation.second_knee import write_second_knee

pytestmark = [
    pytest.mark.skipif(not DATA.exists(), reason="lenhart2015 is not beside the checkout"),
    pytest.mark.slow,
]


@pytest.fixture(scope="module")
def record():
    return read_record()


@pytest.fixture(scope="module")
def imported(tmp_path_factory):
    """Knee files of the published knee and of its unseen twin, and what the twin is."""
    pytest.importorskip("trimesh")
    folder = tmp_path_factory.mktemp("import")
    second = write_second_knee(DATA / "lenhart2015.osim", DATA / "meshes", folder / "second")
    return *import_both(DATA, second, folder), second


@pytest.fixture(scope="module")
def knee(imported):
    return alone(imported[0].knee)


@pytest.fixture(scope="module")
def found(knee, record):
    """Mechanics of the published knee at every recorded pose."""
    return evaluate(knee, record.poses())


@pytest.fixture(scope="module")
def fibres(imported, knee, found, record):
    entries = imported[0].document["ligaments"]
    obstacles = {name: entry["wrap"] for name, entry in entries.items() if "wrap" in entry}
    return compare_fibres(knee, obstacles, found, record)


def test_every_tibiofemoral_fibre_of_the_record_is_there(fibres, record):
    bodies = {tuple(record.points[name]["bodies"]) for name in fibres.names}
    assert len(bodies) == 1  # one femur, one tibia
    spanning = {name for name, fibre in record.points.items() if tuple(fibre["bodies"]) in bodies}
    assert set(fibres.names) == spanning


def test_unwrapped_fibres(fibres):
    free = ~fibres.has_obstacle
    assert free.sum() > 20
    assert np.abs(fibres.length_error[free]).max() < 1e-3  # mm; found: 1.2e-5
    assert np.abs(fibres.force_error[free]).max() < 0.01  # N; found: 6e-4


def test_wrapped_fibres(fibres):
    bent, wrapped = fibres.has_obstacle, fibres.wrapped
    assert wrapped.sum() > 100 and not wrapped[~bent].any()
    assert np.abs(fibres.length_error[bent]).max() < 0.1  # mm; found: 0.0031
    assert fibres.within[bent].all()  # 2 % or 0.5 N; found: 0.034 N


def test_contact(found, record):
    compared = compare_contact(found, record)
    assert compared.usable.all()
    for quantity, errors in compared.errors.items():
        # Found: 2.9 %, 7.5 %, 10 %, 0.21 mm.
        assert np.abs(errors).max() < CONTACT_CRITERIA[quantity], quantity


@pytest.mark.parametrize(
    ("time", "force_N"), {0.5: 556.9, 1.0: 434.6, 1.5: 304.9, 2.0: 265.9, 2.5: 716.4}.items()
)
def test_contact_against_rays_between_the_meshes(time, force_N, found, record):
    """The reference is right: rays, record and fitted surfaces say the same."""
    row = int(np.abs(record.time - time).argmin())
    names = (f"lenhart2015-R-{bone}-cartilage.stl" for bone in ("femur", "tibia"))
    meshes = [load_mesh_mm(DATA / "meshes" / name) for name in names]
    rays = raycast_contact(*meshes, record.table[row], confined_modulus(10.0, 0.45), 6.0)
    assert np.linalg.norm(rays.force) == pytest.approx(force_N, rel=0.01)
    ours = np.asarray(found.contact_force)[row].sum(axis=0)
    assert np.linalg.norm(ours - rays.force) < CONTACT_CRITERIA["force"] * force_N


# ---- equilibrium ----


INSTANTS = slice(None, None, 8)


@pytest.fixture(scope="module")
def stood(knee, record):
    """How firmly poses are held and where searches end, without and with the tendon's fibres."""
    rows = np.arange(len(record.time))[INSTANTS]
    poses = record.poses(rows)
    knees = [equilibrium.standing(knee, record, rows, share) for share in (0.0, 1.0)]
    return [(equilibrium.footing(x, poses), equilibrium.search_from_away(x, poses)) for x in knees]


def test_equilibrium_returns_to_the_recorded_pose_or_says_why_not(stood, record):
    """The missing wrench as a dead load: a tendon's pull that does not turn with the tibia."""
    footing, search = stood[0]
    assert (search.back | ~footing.holds | (search.status == Status.NOT_CONVERGED)).all()
    # A pose that is held may take more steps than a search has; not often.
    assert (search.back & footing.holds).sum() >= 0.95 * footing.holds.sum()
    # Poses are loose in one range of flexion only, for want of stiffness.
    loose, flexion = ~footing.holds, record.flexion[INSTANTS]
    assert 0 < loose.sum() < 0.2 * len(loose) and np.ptp(flexion[loose]) < 15.0
    assert footing.eigenvalues[loose, 0].max() < 1.0 < footing.eigenvalues[~loose, 0].min()


def test_equilibrium_with_the_patellar_tendon_returns_everywhere(stood):
    """Its fibres from the recorded patella, the rest of the wrench as a load: nothing is loose."""
    footing, search = stood[1]
    assert footing.holds.all() and footing.eigenvalues.min() > 1.0
    assert search.back.all()
    assert search.turned.max() < 0.2 and search.moved.max() < 0.2


# ---- a knee that nobody has seen ----


def test_an_unseen_left_knee_is_imported_as_it_is(imported):
    first, twin, second = imported
    assert twin.knee.side == "left" and twin.knee.name == "unseen"
    keys = twin.document["imported_from"]["ligaments"]
    known = [second.fibres[keys.get(name, name)] for name in twin.knee.ligaments.names]
    assert tuple(known) == first.knee.ligaments.names
    assert twin.knee.contact_names == first.knee.contact_names


def test_an_unseen_left_knee_gives_the_mirrored_and_scaled_result(imported, found, record):
    """Fibres to the last digit; contact within what other surfaces of the same cartilage give.

    The text of the model carries every digit of the scaled numbers, so lengths scale to rounding.
    Meshes carry seven, and sizes of cells and distances of points are chosen in mm: other ones on a
    larger knee, whose fits then differ by hundredths of a mm under a depth of 1 mm.
    """
    first, twin, second = imported
    rows = np.arange(0, len(record.time), 10)
    table = record.table[rows] * [1, 1, 1, *[second.scale] * 3]
    here = evaluate(alone(twin.knee), Pose.from_table(table))
    for ours, factor in ((here.length, second.scale), (here.tension, 1.0)):
        known = np.asarray(found.length if factor != 1.0 else found.tension)[rows]
        np.testing.assert_allclose(np.asarray(ours) / factor, known, rtol=1e-12, atol=1e-9)
    compared = compare_contact(here, record, rows, second.scale)
    assert compared.usable.all()
    for quantity, errors in compared.errors.items():
        assert np.abs(errors).max() < CONTACT_CRITERIA[quantity], quantity
    forces = (np.asarray(x.contact_force).sum(axis=1) for x in (here, found))
    ours, known = (np.linalg.norm(x, axis=1) for x in forces)
    # Found: 1.5 %.
    np.testing.assert_allclose(ours / second.scale**2, known[rows], rtol=0.03)
