"""Derivatives of balanced motions: implicit, unrolled and by differences, one lane for each leaf.

Each lane holds a random knee at a random flexion, and a random direction of change of one of its
leaves. A single call then moves every number of a knee at once.
"""

import os
import subprocess
import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
import kneejax.geometry as geo
from kneejax.mechanics import Load, add_lane_axis
from kneejax.numerics import compiler_options
from kneejax.statics import force, sound

# Every leaf of a knee. The first tier has the usual parameters, and each leaf's part of a force.
pytestmark = pytest.mark.slow

#: Rad and mm that weigh the same: 1 mm at 30 mm from the centre.
UNITS = np.array([1 / 30, 1 / 30, 1.0, 1.0, 1.0])[:, None]
ITERATIONS = 5
#: Motion between the two middle knees of a difference, in mm: far below the width of the corners.
TRAVEL = 4e-4
#: How far knees are scattered, and the size of a change of a leaf, by the leaf's name.
SCATTER = {
    "femoral_attachment": 0.5, "tibial_attachment": 0.5, "stiffness": 200.0,
    "slack_length": 0.2, "transition_strain": 0.003, "transition_width": 1e-4,
    "origin": 0.2, "rotation": 0.01, "coefficients": 0.05, "angle": 0.01, "width": 0.2,
    "x": 0.2, "z": 0.2, "youngs_modulus": 0.5, "poisson_ratio": 0.005, "layer_thickness": 0.2,
    "onset_width": 0.002, "force": 2.0, "moment": 50.0, "point": 2.0, "tension": 1.0,
    "insertion": 0.5,
}  # fmt: skip


def _knee():
    """The bundled knee with turned surfaces and two loads, so that it has every kind of leaf."""
    knee = kj.load_knee("four_ligament")

    def frames(k):
        return [s.frame for c in k.contacts for s in (c.femoral, c.tibial)]

    turned = [
        geo.Frame(f.origin, [0.01 * i, 0.004, -0.003 * i]) for i, f in enumerate(frames(knee))
    ]
    loads = (
        Load([3.0, 60.0, -2.0], [50.0, -80.0, 30.0], [1.0, -30.0, 2.0], "tibia", "femur"),
        Load([0.0, 10.0, 0.0], [0.0, 50.0, 0.0]),
    )
    return eqx.tree_at(lambda k: (*frames(k), k.loads), knee, (*turned, loads))


def _names(knee):
    paths = jax.tree_util.tree_flatten_with_path(knee)[0]
    return [jax.tree_util.keystr(path) for path, _ in paths]


KNEE = _knee()
#: No pose depends on the others: where strains are stated, when a fibre tears, what resists haste.
LEAVES = [
    name
    for name in _names(KNEE)
    if not name.startswith(".reference_pose")
    and not name.endswith((".failure_strain", ".damping", ".area"))
]
LANES = [*LEAVES, "flexion"]
#: The largest change of a leaf in a difference, as a part of its scatter. A surface that bears
#: little moves the knee little, but its gap as much as any other.
LARGEST_CHANGE = [2e-3 if ".femoral." in name or ".tibial." in name else 0.1 for name in LANES]


def _scattered(knee, rng, lanes):
    leaves, structure = jax.tree.flatten(add_lane_axis(knee))
    names = _names(knee)
    moved = [
        leaf + SCATTER.get(name.split(".")[-1], 0.0)
        * rng.uniform(-1.0, 1.0, size=leaf.shape[:-1] + (lanes,))
        for leaf, name in zip(leaves, names, strict=True)
    ]
    return jax.tree.unflatten(structure, moved)


def _directions(knee, rng):
    """A change of one leaf in each lane, and of flexion in the last."""
    leaves, structure = jax.tree.flatten(knee)
    changes = []
    for leaf, name in zip(leaves, _names(knee), strict=True):
        change = np.zeros(leaf.shape)
        if name in LEAVES:
            size = SCATTER[name.split(".")[-1]]
            lane = LANES.index(name)
            change[..., lane] = size * rng.uniform(0.3, 1.0, size=leaf.shape[:-1])
        changes.append(jnp.asarray(change))
    flexion = np.zeros(len(LANES))
    flexion[-1] = 0.5
    return jax.tree.unflatten(structure, changes), jnp.asarray(flexion)


def _solved(knee, flexion_deg, change):
    """A motion of one pose, and its derivative along a change by the implicit rule."""

    def poses(knee, flexion_deg):
        found = kj.passive_flexion(knee, flexion_deg[None]).equilibrium
        return found.q[:, 0], found

    value, slopes, found = jax.jvp(poses, (knee, flexion_deg), change, has_aux=True)
    return value, slopes, jax.tree.map(lambda x: x[..., 0], found)


def _unrolled(knee, flexion, change, q, tangent):
    """Newton's rule with a given tangent, differentiated step by step; forces on the way."""

    def iterate(knee, flexion):
        def step(q, _):
            unbalanced, _ = force(knee, {"flexion": flexion}, q)
            move = jnp.linalg.solve(jnp.moveaxis(tangent, -1, 0), unbalanced.T[..., None])
            return q - move[..., 0].T, unbalanced

        return jax.lax.scan(step, q, length=ITERATIONS)

    return jax.jvp(iterate, (knee, flexion), change, has_aux=True)


solved = jax.jit(jax.vmap(_solved, -1, -1), compiler_options=dict(compiler_options()))
unrolled = jax.jit(_unrolled, compiler_options=dict(compiler_options()))


@jax.jit
def _first_touch(contact, tibia):
    """Lower the plateau until it just touches the condyle."""

    def lower(_, contact):
        depth = contact.gap(tibia, contact.contact_point(tibia)).depth
        origin = contact.tibial.frame.origin
        return eqx.tree_at(
            lambda c: c.tibial.frame.origin, contact, origin.at[1].add(-depth)
        )

    return jax.lax.fori_loop(0, 15, lower, contact)


def _at_the_corners(knee, flexion_deg, change, found):
    """The same poses, with first touch medially, an ACL at zero strain and a PCL at transition.

    The last load is chosen to balance them.
    """
    flexion = jnp.deg2rad(flexion_deg)
    state = geo.State.of({"flexion": flexion}, found.q)
    pose = state.tibia
    toe = knee.ligaments.transition_strain[1]
    length = knee.ligaments.length(state)
    taut = jnp.stack([0.0 * toe, toe, 0.0 * toe + 0.06, 0.0 * toe + 0.06])
    load = Load(jnp.zeros_like(length[:3]), jnp.zeros_like(length[:3]), jnp.zeros_like(length[:3]))
    knee = eqx.tree_at(
        lambda k: (k.ligaments.slack_length, k.contacts, k.loads, k.reference_pose),
        knee,
        (
            length / (1.0 + taut),
            (_first_touch(knee.contacts[0], pose.placement), knee.contacts[1]),
            (knee.loads[0], load),
            pose,
        ),
    )
    rad = (change[0], jnp.deg2rad(change[1]))
    _, _, history = unrolled(knee, flexion, rad, found.q, found.tangent)
    unbalanced = history[0]
    # Internal forces do work along these axes of adduction and of internal rotation.
    c, s = jnp.cos(flexion), jnp.sin(flexion)
    axes = jnp.stack([c, -s, 0.0 * c]), jnp.stack(pose.placement.turn((0.0, 1.0, 0.0)))
    moment = unbalanced[0] * axes[0] + unbalanced[1] * axes[1]
    return eqx.tree_at(
        lambda k: (k.loads[1].force, k.loads[1].moment), knee, (unbalanced[2:], moment)
    )


@pytest.fixture(scope="module", params=["random", "corners"])
def case(request):
    """Knees, flexions, changes of one leaf in each lane, balanced poses and their derivatives."""
    rng = np.random.default_rng(4)
    knee = _scattered(KNEE, rng, len(LANES))
    flexion_deg = jnp.asarray(rng.uniform(0.0, 115.0, size=len(LANES)))
    change = _directions(knee, rng)
    answer = solved(knee, flexion_deg, change)
    if request.param == "corners":
        knee = _at_the_corners(knee, flexion_deg, change, answer[2])
        answer = solved(knee, flexion_deg, change)
    return request.param, knee, flexion_deg, change, *answer


def _size(change):
    """Largest motion of each lane, mm."""
    return np.abs(np.asarray(change) / UNITS).max(axis=0)


def test_the_poses_are_balanced_and_those_at_the_corners_stand_on_them(case):
    name, knee, _, _, _, _, found = case
    assert sound(np.asarray(found.status)).all()
    if name == "corners":
        strain = np.asarray(knee.ligaments.strain(found.state))
        toe = np.asarray(knee.ligaments.transition_strain)
        np.testing.assert_allclose(found.depth[0], 0.0, atol=1e-9)
        np.testing.assert_allclose(strain[0], 0.0, atol=1e-9)
        np.testing.assert_allclose(strain[1], toe[1], atol=1e-9)


def test_the_implicit_derivative_equals_that_of_unrolled_newton_steps(case):
    _, knee, flexion_deg, change, q, slope, found = case
    away = 1e-3 * UNITS * np.random.default_rng(5).uniform(-1.0, 1.0, size=q.shape)
    rad = (change[0], jnp.deg2rad(change[1]))
    last, along, history = unrolled(knee, jnp.deg2rad(flexion_deg), rad, q + away, found.tangent)
    force_left = np.abs(np.asarray(history)).max(axis=(1, 2))
    assert force_left[0] > 1.0 and force_left[-1] < 1e-8
    np.testing.assert_allclose((last - q) / UNITS, 0.0, atol=1e-11)
    error = _size(along - slope) / _size(slope)
    assert dict(zip(LANES, error, strict=True)) == pytest.approx(dict.fromkeys(LANES, 0), abs=1e-6)


def test_each_number_of_a_knee_moves_it_as_central_differences_say(case, central_difference):
    _, knee, flexion_deg, change, _, slope, _ = case
    # Each lane has the step with which its pose travels as far as that of any other.
    step = np.minimum(TRAVEL / _size(slope), LARGEST_CHANGE)

    def poses(e):
        moved = jax.tree.map(lambda x, t: x + e * step * t, (knee, flexion_deg), change)
        return solved(*moved, change)[0] / UNITS

    numeric = central_difference(poses, 0.0, 1.0) / step
    error = np.abs(numeric - slope / UNITS).max(axis=0) / _size(slope)
    assert dict(zip(LANES, error, strict=True)) == pytest.approx(dict.fromkeys(LANES, 0), abs=1e-6)


def _evaluated(knee, pose, change):
    def answers(knee, pose):
        found = kj.evaluate(knee, jax.tree.map(lambda x: x[None], pose))
        return {name: jnp.ravel(getattr(found, name)) for name in SMOOTH}

    return jax.jvp(answers, (knee, pose), change)


SMOOTH = (
    "length", "strain", "tension", "contact_force", "area", "max_pressure", "mean_pressure",
    "max_depth", "center",
)  # fmt: skip
evaluated = jax.jit(jax.vmap(_evaluated, -1, -1), compiler_options=dict(compiler_options()))


def test_the_mechanics_of_a_pose_follow_each_number_and_the_pose(case, central_difference):
    _, knee, flexion_deg, (by_knee, by_flexion), *_, found = case
    # The last lane turns and shifts the tibia in all six ways.
    by_pose = geo.Pose(*(jnp.deg2rad(by_flexion) * n for n in (1.0, -0.5, 0.7, 20.0, 10.0, -30.0)))
    change = by_knee, by_pose
    _, exact = evaluated(knee, found.pose, change)
    step = 1e-3

    def answers(e):
        moved = jax.tree.map(lambda x, t: x + e * step * t, (knee, found.pose), change)
        return np.concatenate([evaluated(*moved, change)[0][field] for field in SMOOTH])

    numeric = central_difference(answers, 0.0, 1.0) / step
    numeric = np.split(numeric, np.cumsum([len(exact[field]) for field in SMOOTH])[:-1])
    for field, theirs in zip(SMOOTH, numeric, strict=True):
        ours = np.asarray(exact[field])
        scale = np.abs(ours).max(axis=0) + 1e-3 * np.abs(ours).max()
        np.testing.assert_allclose(ours / scale, theirs / scale, atol=1e-6, err_msg=field)


COST = """
import time
import kneejax as kj
kj.configure()
import jax
import numpy as np

knee, flexion = kj.load_knee("four_ligament"), np.arange(0.0, 121.0, 5.0)
selection = kj.select(knee, ["*.stiffness", "*.reference_strain"])
values = np.asarray(selection.read(knee))

def motion(x):
    return kj.passive_flexion(selection.apply(knee, x), flexion).equilibrium.q

def seconds(way):
    begun = time.process_time()
    jax.block_until_ready(way(1.01 * values))
    return time.process_time() - begun

ways = motion, jax.jacfwd(motion)
turns = [[seconds(way) for way in ways] for _ in range(32)]
alone, with_jacobian = np.min(turns[2:], axis=0)
print(with_jacobian / alone)
"""

def test_a_motion_with_its_jacobian_costs_hardly_more_than_the_motion(tmp_path):
    """1.4 to 1.6 times, in seconds of the processor, of a process that compiles nothing.

    One that has compiled the same programs itself shows 2.0 to 2.6, before and after any change. A
    motion that is searched twice, or parameters written operation by operation, would be above
    what is allowed.
    """
    own = {k: x for k, x in os.environ.items() if k != "XLA_FLAGS"}
    own["JAX_COMPILATION_CACHE_DIR"] = str(tmp_path)
    own["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    for _ in ("compiles", "computes"):
        done = subprocess.run(
            [sys.executable, "-c", COST], env=own, capture_output=True, text=True, check=True
        )
    assert float(done.stdout) < 2.0
