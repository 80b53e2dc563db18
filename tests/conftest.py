"""What every test shares: float64, central differences, the order of a convergence, toy knees."""

import dataclasses
import importlib
import sys
from pathlib import Path

import jax
import numpy as np
import pytest
from hypothesis import settings

import kneejax as kj
import kneejax.geometry as geo
from kneejax.files import load_knee_file, write_knee
from kneejax.mechanics import ConstantTensionLine, Contact, Knee, Ligaments, Load, Muscles

jax.config.update("jax_enable_x64", True)

settings.register_profile("kneejax", deadline=None, max_examples=15, derandomize=True)
settings.load_profile("kneejax")


def pytest_configure(config):
    config.addinivalue_line("markers", "opensim: compares against OpenSim, skipped without it")


def _central_difference(function, x, step=1e-3):
    """Fourth-order central differences of `function`, one column for each entry of `x`."""
    x = np.asarray(x, float)
    columns = []
    for index in np.ndindex(*x.shape):
        unit = np.zeros_like(x)
        unit[index] = step
        near = np.asarray(function(x + unit)) - np.asarray(function(x - unit))
        far = np.asarray(function(x + 2 * unit)) - np.asarray(function(x - 2 * unit))
        columns.append((8.0 * near - far) / (12.0 * step))
    columns = np.stack(columns, axis=-1)
    return columns.reshape(columns.shape[:-1] + x.shape)


def _slope_on_log_axes(x, y):
    return np.polyfit(np.log(np.asarray(x, float)), np.log(np.asarray(y, float)), 1)[0]


@pytest.fixture(scope="session")
def benchmark_script():
    """What a script of `benchmarks/` defines, by its name."""
    folder = str(Path(__file__).parents[1] / "benchmarks")

    def script(name):
        sys.path.insert(0, folder)
        try:
            return importlib.import_module(name)
        finally:
            sys.path.remove(folder)

    return script


@pytest.fixture(scope="session")
def central_difference():
    """Derivative of a function of an array, of shape `(*output, *input)`."""
    return _central_difference


@pytest.fixture(scope="session")
def slope_on_log_axes():
    """Order in which errors `y` shrink with `x`."""
    return _slope_on_log_axes


@pytest.fixture
def rng():
    """Random numbers, the same in every run."""
    return np.random.default_rng(7)


@pytest.fixture(scope="session")
def knee():
    """The bundled knee of four fibres, whose programs most files share."""
    return kj.load_knee("four_ligament")


def _small_knee():
    """Two condyles on two plateaus, four fibres, one load and one line; no bone in particular."""
    radius = [[23.0, 0.4, -1.6], [-1.5, 0.2, 0.0], [0.8, 0.0, 0.0]]
    angle, width = np.deg2rad([0.0, 180.0]), (-13.0, 13.0)
    contacts = []
    for side, smaller in ((-1.0, 0.0), (1.0, 1.0)):
        c = np.array(radius)
        c[0, 0] -= smaller
        plateau = geo.Frame([0.0, -23.0 + 2.5 * smaller, 23.0 * side])
        height = [[0.0, 0.1, 0.6 * smaller], [0.2, 0.0, 0.0], [0.8 - 0.5 * smaller, 0.0, 0.0]]
        contacts.append(
            Contact(
                geo.Condyle(c, angle, width, geo.Frame([0.0, smaller, 23.0 * side])),
                geo.Plateau(height, (-22, 22), (-13, 13), plateau),
            )
        )
    ligaments = Ligaments(
        [[-8, 4, 6], [-2, 0, -6], [0, 3, -38], [-4, 2, 38]],
        [[14, -26, 0], [-22, -32, 0], [8, -85, -22], [-18, -55, 36]],
        [4500.0, 5000.0, 2750.0, 2000.0],
        [33.5, 36.5, 85.0, 56.0],
        [0.03, 0.03, 0.05, 0.06],
        [0.002] * 4,
        ["ACL", "PCL", "MCL", "LCL"],
    )
    return Knee(
        ligaments,
        tuple(contacts),
        (Load([0.0, 40.0, 0.0], [0.0, 500.0, 0.0], [1.0, -50.0, 2.0], "tibia", "femur"),),
        (ConstantTensionLine(20.0, [[35.0, 45.0, 2.0], [-5.0, -20.0, 0.0]], [32.0, -60.0, 4.0]),),
        geo.Pose.from_table([0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
        ("medial", "lateral"),
    )


@pytest.fixture(scope="session")
def small_knee():
    """A knee of two compartments whose poses are balanced nowhere in particular."""
    return _small_knee()


#: Where the bones of the knees below are in extension.
AT = {
    "tibia": geo.Pose.from_table([0.0] * 6),
    "patella": geo.Pose.from_table([5.0, 0.0, 0.0, 44.0, 8.0, 0.0]),
}


def _strained(ends, bodies, stiffness, strain, names):
    """Straight fibres with a strain at the reference poses."""
    count = len(names)
    fibres = Ligaments(*ends, stiffness, [1.0] * count, [0.03] * count, [1e-3] * count, names,
                       bodies=bodies)  # fmt: skip
    slack = fibres.length(geo.State(AT)) / (1.0 + np.array(strain))
    return dataclasses.replace(fibres, slack_length=slack)


#: Fibres of a cage, four of them by the names of ligaments.
CAGE = ("ACL", "PCL", "MCL", "LCL", "cage4", "cage5", "cage6", "cage7")


def _cage():
    """From the axis of flexion, at both sides, to four points of the tibia around it."""
    ends = [[0.0, 0.0, z] for z in (-30.0, 30.0) for _ in range(4)]
    feet = [[x, y, z] for z in (-30.0, 30.0) for x in (25.0, -25.0) for y in (-30.0, 30.0)]
    return ends, feet


@pytest.fixture(scope="session")
def hinged_knee():
    """A tibia that hinges about Z in a cage of eight fibres, which hold it without a contact: what
    is said of any knee takes a third of the time to compile."""
    cage = _strained(_cage(), (geo.FEMUR_AND_TIBIA,) * 8, [3000.0] * 8, [0.02] * 8, CAGE)
    return Knee(cage, (), (), (), AT["tibia"], ())


@pytest.fixture(scope="session")
def hinged_file(tmp_path_factory):
    """The same as a knee file."""
    document = load_knee_file("four_ligament").document
    own = document["ligaments"]["ACL"] | {"stiffness_N": 3000.0, "reference_strain": 0.02}
    ends = "femoral_attachment_mm", "tibial_attachment_mm"
    cage = {name: own | dict(zip(ends, each, strict=True))
            for name, *each in zip(CAGE, *_cage(), strict=True)}  # fmt: skip
    fields = "kneejax", "name", "side", "description", "reference_pose"
    kept = {field: document[field] for field in fields}
    path = tmp_path_factory.mktemp("knees") / "hinged.yaml"
    write_knee(kept | {"name": "hinged", "ligaments": cage, "contacts": {}}, path)
    return path


@pytest.fixture(scope="session")
def pulled_knee():
    """The same, and a patella on a ball of 30 mm, with tendon, retinacula and a quadriceps."""
    ends, feet = _cage()
    tendon = [[0.0, -18.0, z] for z in (-6.0, 0.0, 6.0)]
    feet += [[32.0, -55.0, z] for _, _, z in tendon]
    bands = [[5.0, y, z] for y in (-8.0, 14.0) for z in (-35.0, 35.0)]
    feet += [[0.0, y, z] for y in (-6.0, 6.0) for z in (-18.0, 18.0)]
    pairs = geo.FEMUR_AND_TIBIA, ("patella", "tibia"), ("femur", "patella")
    each = np.repeat(range(3), (len(CAGE), len(tendon), len(bands)))
    names = *CAGE, *(f"PT{k}" for k in range(3)), *(f"PFL{k}" for k in range(4))
    ligaments = _strained(
        (ends + tendon + bands, feet), tuple(pairs[k] for k in each),
        np.array([3000.0, 4000.0, 2000.0])[each], np.array([0.02, 0.02, 0.01])[each], names,
    )  # fmt: skip
    groove = Contact(
        geo.Sphere(30.0, geo.Frame([0.0, 5.0, 0.0])),
        geo.Plane(geo.Frame([-11.0, 0.0, 0.0], [0.0, 0.0, np.pi / 2])),
        bodies=("femur", "patella"),
    )
    heads = Muscles(
        [[38.0, 170.0, 12.0], [30.0, 170.0, -12.0]], [[2.0, 18.0, 5.0], [2.0, 18.0, -5.0]],
        [10.5, 9.5], ["vaslat", "vasmed"], bodies=(("femur", "patella"),) * 2,
    )  # fmt: skip
    return Knee(
        ligaments, (groove,), (), (), AT["tibia"], ("patellofemoral",),
        other_bones={"patella": AT["patella"]}, muscles=heads,
    )  # fmt: skip
