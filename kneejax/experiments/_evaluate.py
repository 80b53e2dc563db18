"""What holds a knee in given poses: forces, strains, contacts, slack."""

__all__ = ["Mechanics", "evaluate", "evaluate_beside", "load_share", "slack_poses", "status_of"]

from contextlib import AbstractContextManager

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array, lax

from kneejax.geometry import TIBIA, Placement, Pose, State, Vector, coordinates_of
from kneejax.mechanics import (
    OFF_SURFACE_MM,
    Border,
    Contact,
    FibreFaults,
    Foundation,
    Gap,
    Knee,
    Sampled,
    add_lane_axis,
    displacement,
)
from kneejax.numerics import Named, beside, compiled, on_all_cores, safe_sqrt, traced
from kneejax.quantities import AXES
from kneejax.statics import ContactFaults, Status, worst_fault

# Poses of one call, so that tables of all lengths share one program.
_CHUNK = 64
# Poses that share what is rare and dear: the border of their patches, a thorough search of rays.
_BORDER_LANES, _RAY_LANES = 32, 8
# Fields of contacts that are vectors, and those that are truth values.
_VECTORS = "contact_force", "contact_moment", "center"
_FLAGS = "known", "too_deep", "no_patch", "through_bone"


class Mechanics(eqx.Module, Named):
    """Ligaments and contact at poses; arrays begin with the pose.

    The onset of contact is rounded, in pressures and areas as in forces: near first touch they
    are small, not zero. `max_depth` is exact.

    Attributes:
        length: `(poses, ligaments)`, mm.
        strain: `(poses, ligaments)`.
        tension: `(poses, ligaments)`, N.
        contact_force: on the tibia in tibia axes, `(poses, contacts, 3)`, N.
        area: `(poses, contacts)`, mm^2.
        max_pressure: `(poses, contacts)`, MPa.
        mean_pressure: `(poses, contacts)`, MPa.
        max_depth: `(poses, contacts)`, mm.
        center: in the tibia frame, `(poses, contacts, 3)`, mm.
        known: whether the surfaces meet in their fitted regions, or at most
            `kneejax.mechanics.OFF_SURFACE_MM` beyond, `(poses, contacts)`.
        too_deep: whether the overlap is the whole layer somewhere, `(poses, contacts)`.
        contact_moment: on the tibia about its origin in tibia axes, `(poses, contacts, 3)`, N mm.
        wrap_angle: over which a fibre lies on its obstacle, `(poses, ligaments)`, rad; not
            positive where it is free, minus infinity where it has none.
        wrap_inside: whether an end of the fibre lies inside its obstacle, `(poses, ligaments)`.
        wrap_side: direction in which the fibre passes its obstacle's centre, in the obstacle's
            frame, `(poses, ligaments, 3)`; zero without an obstacle.
        other_side: how much longer the way around the other side is, `(poses, ligaments)`, mm;
            infinite where free.
        wrap_beyond: whether a fibre touches a cylinder beyond its length, `(poses, ligaments)`.
        no_patch: whether the surfaces touch where no elliptical patch fits, `(poses, contacts)`.
        through_bone: whether the condyle has passed through the plateau, `(poses, contacts)`.
        beyond_mm: how far contact reaches beyond the fitted regions, `(poses, contacts)`, mm; NaN
            where it is not known.
        beyond_share: of the force that is carried there, `(poses, contacts)`, 0 to 1; likewise.
        displacement: of the tibia from the reference pose, degrees and mm, `(poses, 5)`; see
            `kneejax.mechanics.displacement`.
        ligament_force: of each on its second bone in tibia axes, `(poses, ligaments, 3)`, N.
        max_extrusion: of a meniscus, the largest outward motion of its sections, `(poses,
            contacts)`, mm; zero where nothing gives way.
        mean_extrusion: likewise, the mean along its arc.

    Example:
        `kj.evaluate` makes them of poses:

        >>> import kneejax as kj
        >>> poses = kj.Pose.from_table([[0, 0, 0, 0, 0.5, 0]])
        >>> found = kj.evaluate(kj.load_knee("four_ligament"), poses)
        >>> found.contact_force.shape
        (1, 2, 3)
    """

    length: Array
    strain: Array
    tension: Array
    contact_force: Array
    area: Array
    max_pressure: Array
    mean_pressure: Array
    max_depth: Array
    center: Array
    beyond_mm: Array
    beyond_share: Array
    known: Array
    too_deep: Array
    contact_moment: Array
    wrap_angle: Array
    wrap_inside: Array
    wrap_side: Array
    other_side: Array
    wrap_beyond: Array
    no_patch: Array
    through_bone: Array
    displacement: Array
    ligament_force: Array
    max_extrusion: Array
    mean_extrusion: Array

    OVER = {
        "pose ligament": {"length": "mm", "strain": "1", "tension": "N"},
        "pose contact": {
            "area": "mm2", "max_pressure": "MPa", "mean_pressure": "MPa", "max_depth": "mm",
            "beyond_mm": "", "beyond_share": "1", "max_extrusion": "mm", "mean_extrusion": "mm",
        },
        "pose contact axis": {"contact_force": "N", "contact_moment": "N mm", "center": "mm"},
        "pose ligament axis": {"ligament_force": "N"},
    }  # fmt: skip

    def _named(self) -> dict[str, tuple]:
        return super()._named() | {"axis": ("axis", AXES)}


def evaluate(knee: Knee, poses: Pose | State, contact_points: Array | None = None) -> Mechanics:
    """Ligaments and contact at given poses; nothing is solved.

    Many poses are computed in batches on all cores, so memory does not grow with their number.

    Args:
        knee: any knee.
        poses: of the tibia, fields of shape `(poses,)`; a `State` where other bones move too.
        contact_points: points near those where surfaces meet, if they are known, `(n, 2, poses)`.

    Returns:
        The mechanics of each pose, differentiable with respect to poses and knee. Depth beyond the
        layer gives NaN pressure by the log and ratio laws; `max_depth` says so.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> found = kj.evaluate(knee, kj.Pose.from_table([[0.0, 0.0, 0.0, 0.0, 0.5, 0.0]]))
        >>> found.tension.shape
        (1, 4)
    """
    state = poses if isinstance(poses, State) else State({TIBIA: poses})
    count = jnp.size(state.tibia.flexion)
    if traced(knee, state, contact_points) or not count:
        return _evaluate(knee, state, contact_points)
    knee = knee.for_many_poses()
    # The last chunk is filled up with the last pose.
    rows = np.minimum(np.arange(-(-count // _CHUNK) * _CHUNK), count - 1).reshape(-1, _CHUNK)
    given = jax.tree.map(np.atleast_1d, (state, contact_points))

    def chunk(own: np.ndarray) -> Mechanics:
        here, there = jax.tree.map(lambda x: x[..., own], given)
        return jax.tree.map(np.asarray, _evaluate(knee, here, there))

    parts = on_all_cores(chunk, rows)
    return jax.device_put(jax.tree.map(lambda *x: np.concatenate(x)[:count], *parts))


def evaluate_beside(knee: Knee) -> AbstractContextManager[None]:
    """Compile what `evaluate` needs for a knee beside what a block computes.

    Args:
        knee: any knee; only its structure counts.

    Returns:
        A context, at the end of which `evaluate` is ready for poses of that knee.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> with evaluate_beside(knee):
        ...     motion = kj.passive_flexion(knee, [0.0, 30.0])
        >>> kj.evaluate(knee, motion.pose, motion.equilibrium.contact_points).tension.shape
        (2, 4)
    """
    knee = knee.for_many_poses()
    there = jax.tree.map(lambda x: np.reshape(np.asarray(x, float), 1), knee.at_reference)
    return beside(evaluate, knee, there, np.full((knee.patch_count, 2, 1), np.nan))


@compiled(effort="least")
def _evaluate(knee: Knee, state: State, contact_points: Array | None) -> Mechanics:
    lanes = add_lane_axis(knee)
    ligaments, found = lanes.ligaments, {}
    patches = [row for row, contact in enumerate(lanes.contacts) if contact.has_patch]
    if patches:
        each = lanes.map_patches(_over_patch, state, contact_points, in_turn=True)
        found |= {row: {name: x[k] for name, x in each.items()} for k, row in enumerate(patches)}
    for foundation in lanes.over_points:
        there = state.between(foundation.bodies)
        each, through = _over_points_in_blocks(foundation, there), foundation.passed_through(there)
        each |= {"no_patch": jnp.zeros_like(through), "through_bone": through}
        found |= {row: {x: y[k] for x, y in each.items()} for k, row in enumerate(foundation.rows)}
    rows = [found[row] for row in range(len(lanes.contacts))]
    if rows:
        contacts = jax.tree.map(lambda *x: jnp.stack(x, axis=-1), *rows)
    else:
        nothing, vectors = jnp.zeros((*state.shape, 0)), jnp.zeros((3, *state.shape, 0))
        contacts = dict.fromkeys(Mechanics.OVER["pose contact"], nothing)
        contacts |= dict.fromkeys(_FLAGS, nothing > 0) | dict.fromkeys(_VECTORS, vectors)
    contacts |= {name: jnp.moveaxis(contacts[name], 0, -1) for name in _VECTORS}
    length, wrap, pull = ligaments.length_wrap_and_forces(state)
    # Of a pose that is not known a smooth law would say that a ligament is slack.
    nowhere = jnp.isnan(jnp.sum(state.at(coordinates_of(knee.bodies)), axis=0))
    length, tension = (
        jnp.where(nowhere, jnp.nan, x) for x in (length, ligaments.tension_at(length))
    )

    def in_rows(vector: Vector) -> Array:
        return jnp.moveaxis(jnp.stack(vector), 0, -1).swapaxes(0, 1)

    return Mechanics(
        length=length.T, strain=(length / ligaments.slack_length - 1.0).T, tension=tension.T,
        wrap_angle=wrap.angle.T, wrap_inside=wrap.inside.T, wrap_side=in_rows(wrap.side),
        other_side=wrap.other_side.T, wrap_beyond=wrap.beyond_ends.T,
        displacement=displacement(lanes, state.tibia).T,
        ligament_force=in_rows(state.tibia.placement.turn_back(pull)), **contacts,
    )  # fmt: skip


def _over_patch(contact: Contact, tibia: Placement, near: Array) -> dict[str, Array]:
    """Fields of a contact with an elliptical patch, arrays end in poses."""
    pressed = contact.press(tibia, near)
    gap = pressed.gap
    area = 2.0 * jnp.pi * contact.rounded(gap.depth) * gap.mean_radius
    force, moment = (
        jnp.stack(tibia.turn_back(x)) for x in (pressed.wrench.force, pressed.wrench.moment)
    )
    center = jnp.broadcast_arrays(*contact.tibial.frame.placement.apply(gap.point))
    apart = gap.depth <= 0
    known, whole = (pressed.off <= OFF_SURFACE_MM) | apart, (pressed.off <= 0.0) | apart
    deep = gap.depth >= contact.layer_thickness
    border = _border(contact, gap, pressed.contact_point, pressed.off, whole)
    still = jnp.zeros_like(gap.depth)
    return {
        "contact_force": force, "contact_moment": moment, "center": jnp.stack(center),
        "area": area, "max_pressure": contact.pressure(gap.depth),
        "mean_pressure": safe_sqrt(jnp.sum(force**2, axis=0)) / area, "max_depth": gap.depth,
        "beyond_mm": border.beyond_mm, "beyond_share": border.share,
        "known": known, "too_deep": deep, "max_extrusion": still, "mean_extrusion": still,
        "no_patch": (pressed.off <= OFF_SURFACE_MM) & contact.has_no_patch(gap),
        "through_bone": contact.passed_through(tibia) & (deep | ~known),
    }  # fmt: skip


def _border(contact: Contact, gap: Gap, contact_points: Array, off: Array, whole: Array) -> Border:
    """Border of patches: hundreds of places of each, asked only of those not wholly inside.

    These are put together in blocks, and blocks of whole ones are passed over.
    """
    count = jnp.cumsum(~whole)
    place = jnp.where(whole, count[-1] + jnp.cumsum(whole), count) - 1
    order = jnp.zeros_like(place).at[place].set(jnp.arange(len(place)), unique_indices=True)
    block = _BORDER_LANES if len(whole) % _BORDER_LANES == 0 else len(whole)
    # What a plane answers may lack the lanes.
    gap = jax.tree.map(lambda x: jnp.broadcast_to(x, whole.shape), gap)

    def of_block(own: Array) -> Border:
        def asked() -> Border:
            return contact.border(*jax.tree.map(lambda x: x[..., own], (gap, contact_points, off)))

        nothing = jnp.zeros(block)
        return lax.cond(jnp.all(whole[own]), lambda: Border(nothing, nothing), asked)

    found = lax.map(of_block, order.reshape(-1, block))
    return jax.tree.map(lambda x: x.ravel()[place], found)


def _over_points_in_blocks(foundation: Foundation, tibia: Placement) -> dict[str, Array]:
    """As `_over_points`: one unusual ray then costs a few poses a thorough search, not all."""
    count = len(tibia.translation[0])
    block = _RAY_LANES if count % _RAY_LANES == 0 else count
    blocks = jax.tree.map(lambda x: x.reshape(-1, block), tibia)
    found = lax.map(lambda some: _over_points(foundation, some), blocks)
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], count), found)


def _over_points(foundation: Foundation, tibia: Placement) -> dict[str, Array]:
    """Fields of contacts over points, arrays `(contacts, ..., poses)`."""
    of_each, sampled = foundation.of_each, foundation.sample(tibia)
    points, depth = sampled.points, sampled.depth
    pressure = points.pressure(depth)
    share = pressure * points.area
    area = of_each(jnp.sum, points.touching(depth) * points.area)
    wrenches = foundation.wrenches(tibia, sampled)
    force, moment = (
        jnp.stack(tibia.turn_back(x), axis=1) for x in (wrenches.force, wrenches.moment)
    )
    total = of_each(jnp.sum, share)
    # Divided after the sums: all of them then go over the points together.
    middle = [of_each(jnp.sum, share * x) / total for x in points.point]
    faults, border = foundation.faults(tibia, sampled), foundation.border(tibia, sampled)
    most, even = _extrusion(foundation, sampled)
    return {
        "contact_force": force, "contact_moment": moment, "center": jnp.stack(middle, axis=1),
        "area": area, "max_depth": foundation.deepest(depth),
        "max_pressure": of_each(jnp.max, jnp.where(points.area > 0.0, pressure, 0.0)),
        "mean_pressure": total / jnp.where(area > 0.0, area, 1.0),
        "beyond_mm": border.beyond_mm, "beyond_share": border.share, "known": ~faults.outside,
        "too_deep": faults.too_deep | faults.lost, "max_extrusion": most, "mean_extrusion": even,
    }  # fmt: skip


def _extrusion(foundation: Foundation, sampled: Sampled) -> tuple[Array, Array]:
    """How far the sections of each meniscus have moved outwards, mm: the most, and the mean."""
    points, hoops = sampled.points, foundation.hoops
    if points.given_way is None or hoops is None:
        still = jnp.zeros((len(foundation.counts), *sampled.depth.shape[1:]))
        return still, still
    a_mm = hoops.given_way(sampled.depth, jnp.ones_like(hoops.angle))
    gives = (a_mm != 0.0) & (points.area > 0.0)
    weight = jnp.where(gives, points.area, 0.0)
    outward = jnp.where(gives, points.given_way / jnp.where(gives, a_mm, 1.0), 0.0)
    whole = foundation.of_each(jnp.sum, weight)
    mean = foundation.of_each(jnp.sum, weight * outward) / jnp.where(whole > 0.0, whole, 1.0)
    return foundation.of_each(jnp.max, outward), mean


def load_share(knee: Knee, poses: Mechanics) -> np.ndarray:
    """Which part of the load of its compartment each contact carries, along the tibia.

    A meniscus belongs to the compartment whose name its own begins with, as `medial_meniscus` to
    `medial`.

    Args:
        knee: with which the poses were evaluated.
        poses: evaluated.

    Returns:
        `(poses, contacts)`, 0 to 1; NaN where the compartment carries nothing.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> found = kj.evaluate(knee, kj.Pose.from_table([[0.0, 0.0, 0.0, 0.0, 0.5, 0.0]]))
        >>> load_share(knee, found).tolist()
        [[1.0, 1.0]]
    """
    cartilage = [name for name in knee.contact_names if name not in knee.menisci]
    own = [max((x for x in cartilage if name.startswith(x)), key=len, default=name)
           for name in knee.contact_names]  # fmt: skip
    together = np.array([[a == b for b in own] for a in own], float).reshape(len(own), len(own))
    down = np.abs(np.asarray(poses.contact_force)[..., AXES.index("superior")])
    with np.errstate(invalid="ignore"):
        return down / (down @ together)


def status_of(poses: Mechanics, knee: Knee) -> Array:
    """What evaluated poses are, each by itself; nothing is said of balance.

    The same faults that a search finds in the poses it ends at.

    Args:
        poses: evaluated.
        knee: with which they were evaluated.

    Returns:
        `Status` values, `(poses,)`; a pose that is NaN is `NOT_CONVERGED`.
    """
    fibres = FibreFaults(
        jnp.any(poses.strain > knee.ligaments.failure_strain, axis=-1),
        jnp.any(poses.wrap_beyond, axis=-1),
        jnp.any(poses.wrap_inside, axis=-1),
    )
    contacts = (poses.max_depth, ~poses.known, poses.too_deep, poses.no_patch, poses.through_bone)
    each = [ContactFaults(*(x[:, k] for x in contacts)) for k in range(poses.max_depth.shape[1])]
    nowhere = jnp.isnan(poses.displacement).any(axis=-1)
    worst = worst_fault(each, fibres, poses.displacement.T)
    return jnp.where(nowhere, int(Status.NOT_CONVERGED), worst)


def slack_poses(
    knee: Knee, poses: Pose | State, contact_points: np.ndarray | None = None
) -> dict[str, np.ndarray]:
    """Where each ligament and group of a knee is slack.

    Args:
        knee: any knee.
        poses: of the tibia, fields of shape `(n,)`; a `State` where other bones move too.
        contact_points: contact points if they are known.

    Returns:
        Ligament or group -> `(n,)`, true where no fibre of it is strained.
    """
    strain = np.asarray(evaluate(knee, poses, contact_points).strain)
    names = knee.ligaments.names
    slack = {name: column <= 0.0 for name, column in zip(names, strain.T, strict=True)}
    for group, fibres in knee.groups:
        slack[group] = np.all([slack[fibre] for fibre in fibres], axis=0)
    return slack
