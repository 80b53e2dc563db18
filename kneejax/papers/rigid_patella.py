"""Paper 3's own patella, and a leg that is raised over it by an elastic knee.

Two rigid contact points without friction, a tendon that does not stretch: nothing of it is elastic,
so nothing of it is a part of a knee. Three constraints hold the patella, and their multipliers are
its forces. The elastic form becomes this one as it stiffens. Tibia, patella, pull and multipliers
are one system of equations, whose root is the held leg.

The paper prints neither its polynomials nor the place of its facets, but their kind: second-order
polynomials in cylindrical coordinates for the two surfaces of the groove, planes 130 degrees apart
for the facets, parted by a vertical ridge. They are laid through a knee's own groove and patella.
"""

import dataclasses
import functools
from collections.abc import Iterable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optimistix as optx
from jax import Array
from jax.typing import ArrayLike

from kneejax.experiments import Shank, evaluate, passive_flexion
from kneejax.geometry import (
    FEMUR,
    FREE_COORDINATES,
    PATELLA,
    TIBIA,
    Condyle,
    Frame,
    Placement,
    Plane,
    Pose,
    State,
    Surface,
    coordinates_of,
    fit_condyle,
    scales,
)
from kneejax.mechanics import Knee, Load, add_lane_axis
from kneejax.numerics import compiled, traced
from kneejax.parameters import fibre_rows
from kneejax.statics import force_along

#: Where a search ends, mm and N per N of pull; and after how many steps it is given up.
_TOLERANCE, _MOST_LOOKS = 1e-11, 100
#: What counts as 1 of each unknown of a patella: its six coordinates; angle and width of both
#: points of the groove; force of the medial and lateral contact and of the tendon, per N of the
#: quadriceps' pull.
SCALES = (*scales(coordinates_of([PATELLA])), 1 / 30, 1.0, 1 / 30, 1.0, 1.0, 1.0, 1.0)
#: Between the patella's facets (section 2), degrees.
FACETS_DEG = 130.0
#: The order of the groove's polynomials (section 2).
ORDER = 2
#: Where on the groove its two surfaces are laid: angle from the front, and width from its deepest
#: line, degrees and mm: from the floor over the crest that the facets ride on.
_ANGLE_DEG, _WIDTH_MM = (-35.0, 85.0), (4.0, 25.0)
#: Where on the patella: height and width from the ridge, mm.
_HEIGHT_MM, _FACET_MM = (-10.0, 10.0), (4.0, 14.0)
_POINTS = 25
#: Before the unknowns of the patella: the tibia's free coordinates, and the pull, N.
_TIBIA = len(FREE_COORDINATES)
_PULL, _FIRST = _TIBIA, _TIBIA + 1
#: What is left over at a root, N; steps of a search at most, and how long one may be: 1 mm, 1 N/N.
_ENOUGH_N, _MOST_STEPS, _LONGEST = 1e-8, 40, 3.0
#: The quadriceps' arm where nothing is known of it, mm, and N of pull that count as 1.
_ARM_MM, _PULL_N = 40.0, 100.0
#: Forces on a patella by the pull where nothing is known of them: medial, lateral, tendon.
_NEAR_FORCES = (0.2, 0.4, 1.0)


class RigidPatella(eqx.Module):
    """A patella on a groove that it touches in two points, between tendon and quadriceps."""

    groove: tuple[Condyle, Condyle]  # the medial and the lateral surface of the femur's groove
    facets: tuple[Surface, Surface]  # those of the patella, medial and lateral
    patellar_attachment: Array  # of the tendon, `(3,)`, mm, patella frame
    tibial_attachment: Array  # of the tendon, `(3,)`, mm, tibia frame
    tendon_length: Array  # mm
    origin: Array  # of the quadriceps, `(3,)`, mm, femur frame
    insertion: Array  # of the quadriceps, `(3,)`, mm, patella frame

    def gap(self, side: int, patella: Placement, met: Array) -> Array:
        """Distance, mm, of the groove's point at parameters `met` from the facet of a side."""
        groove, facet = self.groove[side], self.facets[side]
        point = groove.frame.placement.apply(groove.point(met[0], met[1]))
        seen = facet.frame.placement.apply_inverse(patella.apply_inverse(point))
        return facet.level(seen)

    def tendon(self, patella: Placement, attached: Array) -> Array:
        """The tendon to the patella from its end on the tibia, in femur axes, `(3,)`, mm."""
        return jnp.stack(patella.apply(tuple(self.patellar_attachment))) - attached

    def quadriceps(self, patella: Placement) -> Array:
        """Length of the quadriceps, a straight line, mm."""
        return jnp.linalg.norm(jnp.stack(patella.apply(tuple(self.insertion))) - self.origin)

    def stationary(self, unknowns: Array, attached: Array) -> Array:
        """What vanishes where the patella is in balance, `(13,)`; the pull is 1 N.

        The quadriceps becomes as short as the constraints allow: the derivatives of its length
        with the constraints' multipliers. In order: forces and moments on the patella; that each
        point of the groove has the facet's normal (paper 3, Eqs 1 and 2); that it touches the
        facet (Eq 17), medial and lateral; that the tendon has its length.
        """
        medial, lateral, pull = unknowns[10:]
        touch = unknowns[6:10].reshape(2, 2)

        def constrained(coordinates: Array) -> tuple[Placement, list[Array]]:
            there = Pose(*coordinates).placement
            stretch = jnp.linalg.norm(self.tendon(there, attached)) - self.tendon_length
            return there, [*(self.gap(k, there, touch[k]) for k in (0, 1)), stretch]

        def lagrangian(coordinates: Array) -> Array:
            there, (inner, outer, stretch) = constrained(coordinates)
            return self.quadriceps(there) + pull * stretch - medial * inner - lateral * outer

        there, left = constrained(unknowns[:6])
        slopes = [jax.grad(self.gap, argnums=2)(k, there, touch[k]) for k in (0, 1)]
        forces = jax.grad(lagrangian)(unknowns[:6])
        units = jnp.array([*SCALES[:10], 1.0, 1.0, 1.0])
        return jnp.concatenate([forces, *slopes, jnp.stack(left)]) * units

    def balanced(self, attached: Array, near: Array) -> Array:
        """Where the patella is in balance, `(13,)`; NaN where the search finds nothing."""
        size, begin = jnp.array(SCALES), jax.lax.stop_gradient(near)
        solver = optx.Dogleg(rtol=_TOLERANCE, atol=_TOLERANCE)
        found = optx.root_find(
            lambda x, args: args[0].stationary(x * size, args[1]),
            solver, begin / size, (self, attached), max_steps=_MOST_LOOKS, throw=False,
        )  # fmt: skip
        left = jnp.max(jnp.abs(self.stationary(found.value * size, attached)))
        return jnp.where(left < 1e3 * _TOLERANCE, found.value * size, jnp.nan)


def rigid_patella_of(knee: Knee) -> RigidPatella:
    """The patella of a knee of three bones in paper 3's form: surfaces as simple, one tendon and
    one quadriceps between the mean attachments of its fibres and heads."""
    (contact,) = (one for one in knee.contacts if one.bodies == (FEMUR, PATELLA))
    assert isinstance(contact.femoral, Condyle)
    fibres, muscles = knee.ligaments, knee.muscles
    rows = np.array([k for k, pair in enumerate(fibres.bodies) if pair == (PATELLA, TIBIA)])
    assert muscles is not None
    heads = np.array(muscles.quadriceps)
    part = muscles.tension[heads] / jnp.sum(muscles.tension[heads])
    share = fibres.stiffness[rows] / jnp.sum(fibres.stiffness[rows])
    return RigidPatella(groove=_groove(contact.femoral), facets=_facets(contact.tibial),
                        patellar_attachment=share @ fibres.femoral_attachment[rows],
                        tibial_attachment=share @ fibres.tibial_attachment[rows],
                        tendon_length=share @ fibres.slack_length[rows],
                        origin=part @ muscles.femoral_attachment[heads],
                        insertion=part @ muscles.tibial_attachment[heads])  # fmt: skip


def _groove(whole: Condyle) -> tuple[Condyle, Condyle]:
    """Medial and lateral polynomial through points of a groove on both sides of its floor."""
    angle = np.deg2rad(np.linspace(*_ANGLE_DEG, _POINTS))
    across = np.linspace(-8.0, 8.0, 81)
    radius = np.asarray(whole.radius(angle[:, None] + 0 * across, across + 0 * angle[:, None]))
    floor = float(np.median(across[np.argmin(radius, axis=1)]))
    sides = []
    for side in (-1.0, 1.0):
        width = floor + side * np.linspace(*_WIDTH_MM, _POINTS)
        grid = np.meshgrid(angle, width, indexing="ij")
        points = whole.frame.placement.apply(whole.point(*map(jnp.asarray, grid)))
        every = np.stack([np.ravel(x) for x in points], axis=1)
        limits = float(width.min()), float(width.max())
        found = fit_condyle(
            every, _ANGLE_DEG, limits, (ORDER, ORDER), whole.frame, total_degree=ORDER
        )
        sides.append(found.surface)
    return sides[0], sides[1]


def _facets(whole: Surface) -> tuple[Plane, Plane]:
    """Medial and lateral plane, each at half of 130 degrees from the ridge's plane of symmetry."""
    tilt = 0.5 * np.deg2rad(180.0 - FACETS_DEG)
    height = np.linspace(*_HEIGHT_MM, _POINTS)
    across = np.linspace(-8.0, 8.0, 81)
    ridge = float(across[np.argmax(np.mean(_levels(whole, height, across), axis=0))])
    through = []
    for side in (-1.0, 1.0):
        width = ridge + side * np.linspace(*_FACET_MM, _POINTS)
        level = _levels(whole, height, width) + np.tan(tilt) * side * width
        origin = whole.frame.placement.apply((0.0, float(level.mean()), 0.0))
        # The plate's frame stands with its Y axis backwards; the facet leans to its side.
        turned = jnp.array([0.0, side * tilt, 0.5 * np.pi])
        through.append(Plane(Frame(jnp.stack([jnp.asarray(x) for x in origin]), turned)))
    return through[0], through[1]


def _levels(whole: Surface, height: np.ndarray, width: np.ndarray) -> np.ndarray:
    grid = np.meshgrid(height, width, indexing="ij")
    return np.asarray(whole.point(*map(jnp.asarray, grid))[1])


@dataclasses.dataclass(frozen=True)
class RigidLeg:
    """A leg held by its quadriceps over a rigid patella, at poses, and its forces."""

    flexion_deg: np.ndarray  # `(poses,)`
    tibia: Pose  # its pose
    patella: np.ndarray  # its pose, degrees and mm, `(poses, 6)`
    quadriceps_N: np.ndarray  # pull, `(poses,)`; NaN where there is no root
    tendon_N: np.ndarray  # `(poses,)`
    #: Medial, lateral, `(poses, 2)`; negative where a facet would have to hold on to the groove.
    contact_N: np.ndarray
    patellofemoral_N: np.ndarray  # their resultant, `(poses,)`
    arm_mm: np.ndarray  # how fast the extension moment grows with the pull, `(poses,)`
    tension: dict[str, np.ndarray]  # group of ligaments or ligament -> its tension, `(poses,)`, N
    shear: dict[str, np.ndarray]  # part -> its force on the tibia along its anterior axis, likewise
    unknowns: np.ndarray  # all that was solved for, see `held_by_rigid_patella`

    @property
    def held(self) -> np.ndarray:
        """Where a quadriceps that pulls holds the leg, `(poses,)`."""
        return self.quadriceps_N > 0.0

    def where_held(self, values: np.ndarray) -> np.ndarray:
        """The same, NaN where the quadriceps would have to push."""
        return np.where(self.held, values, np.nan)

    @property
    def doubts(self) -> list[str]:
        """Where the leg has no balance, and where a facet would have to hold on to the groove."""
        off = self.held & (self.contact_N < 0.0).any(axis=1)
        doubtful = {"No held leg was found": np.isnan(self.quadriceps_N),
                    "The patella touches one facet only": off}  # fmt: skip
        return [f"{what} at {', '.join(f'{x:g}' for x in self.flexion_deg[where])} degrees."
                for what, where in doubtful.items() if where.any()]  # fmt: skip


def rigid_leg(
    knee: Knee, patella: RigidPatella, start: Pose, flexion_deg: np.ndarray, shank: Shank
) -> RigidLeg:
    """Hold a leg at flexions, in order from one at which the patella rides in the groove, where its
    search begins at `start`; the knee has no line that stands for the patella."""
    flexion, weight = jnp.deg2rad(jnp.asarray(flexion_deg, float)), shank.load()
    begin = _beginnings(knee, patella, start, flexion_deg, weight)
    unknowns, slope = _searched(knee, patella, weight, flexion, begin)
    table = np.asarray(unknowns)
    pull, own = table[:, _PULL], table[:, _FIRST:]
    tibia = State.of({"flexion": flexion}, unknowns[:, :_TIBIA].T).tibia
    there = Pose(*(unknowns[:, _FIRST + k] for k in range(6)))
    attached = jnp.stack(tuple(tibia.placement.apply(tuple(patella.tibial_attachment))))
    along = np.asarray(patella.tendon(there.placement, attached))
    tendon = pull * own[:, 12]
    normals = [facet.frame.placement.turn((0.0, 1.0, 0.0)) for facet in patella.facets]
    pressed = own[:, 10:12, None] * np.array([[float(x) for x in one] for one in normals])
    # The arm, all else balanced: row `_TIBIA` of the derivative is the moment about the flexion
    # axis, at its scale; column `_PULL` the pull.
    slope, every = np.asarray(slope), np.arange(slope.shape[-1])
    others, kept = every != _PULL, every != _TIBIA
    moves = np.linalg.solve(slope[:, kept][:, :, others], slope[:, kept, _PULL, None])[..., 0]
    grows = slope[:, _TIBIA, _PULL] - np.einsum("ij,ij->i", slope[:, _TIBIA, others], moves)

    def forwards(force: Iterable[ArrayLike]) -> np.ndarray:
        return np.asarray(tibia.placement.turn_back(tuple(map(jnp.asarray, force)))[0])

    found, fibres = evaluate(knee, tibia), knee.ligaments.names
    tension = np.asarray(found.tension).T
    pulls = tension * forwards(add_lane_axis(knee.ligaments).unit_pulls(State({TIBIA: tibia})))
    shear = {
        "patellar tendon": forwards(tendon * along / np.linalg.norm(along, axis=0)),
        "contact": np.asarray(found.contact_force)[:, :, 0].sum(axis=1),
        "weight": forwards(x + 0.0 * flexion for x in weight.force),
        **dict(zip(fibres, pulls, strict=True)),
    }
    each = {name: tension[fibre_rows(knee, name)].sum(axis=0)
            for name in (*(group for group, _ in knee.groups), *fibres)}  # fmt: skip
    return RigidLeg(
        np.asarray(flexion_deg, float), tibia, np.asarray(there.to_table()), pull, tendon,
        pull[:, None] * own[:, 10:12], pull * np.linalg.norm(pressed.sum(axis=1), axis=1),
        grows / scales(["flexion"])[0], each, shear, table,
    )  # fmt: skip


def held_by_rigid_patella(
    knee: Knee, patella: RigidPatella, weight: Load, flexion: Array, near: Array
) -> Array:
    """Where a leg is held at flexions in rad, `(poses, unknowns)`, sought `near` others.

    Unknowns are the tibia's free coordinates, rad and mm, the pull, N, then as in `SCALES`.

    Differentiable by every number but `near`. Contacts of the knee are sums over points.
    """
    still = jax.lax.stop_gradient((knee, patella, weight, flexion))
    found, slope = _searched(*still, near)
    # One step from a root by the slope there has the root's derivative, two the second as well.
    unknowns = found
    for _ in range(2 if traced(knee, patella, weight, flexion) else 1):
        left = _unbalanced_at(knee, patella, weight, flexion, unknowns)
        unknowns = unknowns - jnp.linalg.solve(slope, left[..., None])[..., 0]
    return unknowns


def _searched(knee, patella, weight, flexion, near: Array) -> tuple[Array, Array]:
    """The roots, and the derivatives of what vanishes there; both NaN where there is none."""
    unknowns, units = np.asarray(near), np.array(_UNITS)
    lost, slope = np.ones(len(unknowns), bool), np.zeros((*unknowns.shape, len(units)))
    for _ in range(_MOST_STEPS):
        # Numbers that no program has handed out: for those it would be compiled anew.
        left, slope = map(np.asarray, _linear(knee, patella, weight, flexion, unknowns))
        lost = ~(np.abs(left).max(axis=-1) < _ENOUGH_N)
        if not lost.any():
            break
        step = np.linalg.solve(slope, -left[..., None])[..., 0]
        size = np.abs(step / units).max(axis=-1, keepdims=True)
        unknowns = unknowns + step * np.minimum(1.0, _LONGEST / size)
    unknowns = np.where(lost[:, None], np.nan, unknowns)
    return jnp.asarray(unknowns), jnp.asarray(np.where(lost[:, None, None], np.nan, slope))


@compiled()
def _unbalanced_at(knee, patella, weight, flexion, unknowns: Array) -> Array:
    return jax.vmap(functools.partial(_unbalanced, knee, patella, weight))(flexion, unknowns)


@compiled()
def _linear(knee, patella, weight, flexion, unknowns: Array) -> tuple[Array, Array]:
    """What is unbalanced, `(poses, n)`, and its derivative by the unknowns, `(poses, n, n)`."""

    def one(a: Array, x: Array) -> tuple[Array, Array]:
        left = functools.partial(_unbalanced, knee, patella, weight, a)
        # One direction after the other: all at once would copy every point of a contact for each
        # of them, and compile for minutes.
        ways = jnp.eye(len(x))
        return left(x), jax.lax.map(lambda way: jax.jvp(left, (x,), (way,))[1], ways).T

    return jax.vmap(one)(flexion, unknowns)


#: What counts as 1 of each unknown.
_UNITS = (*scales(FREE_COORDINATES), _PULL_N, *SCALES)
#: What is balanced on the tibia.
_BALANCED = (*FREE_COORDINATES, "flexion")


def _unbalanced(knee, patella, weight, flexion, unknowns: Array) -> Array:
    """What vanishes where the leg is held: of the tibia, about the flexion axis, of the patella."""
    pull, own = unknowns[_PULL], unknowns[_FIRST:]
    state = State.of({"flexion": flexion[None]}, unknowns[:_TIBIA, None])
    point = state.tibia.placement.apply(tuple(patella.tibial_attachment))
    attached = jnp.stack([jnp.ravel(x)[0] for x in jnp.broadcast_arrays(*point)])
    along = patella.tendon(Pose(*own[:6]).placement, attached)
    tendon = Load(pull * own[12] * along / jnp.linalg.norm(along), point=patella.tibial_attachment)
    left = force_along(add_lane_axis(knee), state, None, _BALANCED)[:, 0]
    for load in (weight, tendon):
        left = left - jnp.stack([x[0] for x in add_lane_axis(load).work(state, _BALANCED)])
    return jnp.concatenate([left * jnp.array(scales(_BALANCED)), patella.stationary(own, attached)])


def _beginnings(
    knee: Knee, patella: RigidPatella, start: Pose, flexion_deg: np.ndarray, weight: Load
) -> Array:
    """Near the held leg: the knee under its weight and the tendon of a patella that rides on it."""
    # A first pull: of a tibia that only flexes about its own origin.
    turn = np.deg2rad(flexion_deg)
    bent = State({TIBIA: Pose(jnp.asarray(turn), *[jnp.zeros(len(turn))] * 5)})
    carried = np.maximum(np.asarray(weight.work(bent, ("flexion",))[0]) / _ARM_MM, 1.0)
    passive = passive_flexion(knee, flexion_deg)
    attached = np.stack(
        [np.broadcast_to(np.asarray(x), len(carried))
         for x in passive.pose.placement.apply(tuple(patella.tibial_attachment))], axis=1,
    )  # fmt: skip
    coordinates = jnp.stack([jnp.ravel(jnp.asarray(x))[0] for x in jax.tree.leaves(start)])
    touch = [jnp.stack([0.0 * x, x]) for x in (jnp.mean(g.width) for g in patella.groove)]
    near = jnp.concatenate([coordinates, *touch, jnp.array(_NEAR_FORCES)])
    solve, rows, ways = jax.jit(RigidPatella.balanced), [], []
    for place in map(jnp.asarray, attached):
        here = solve(patella, place, near)
        near = jnp.where(jnp.all(jnp.isfinite(here)), here, near)
        rows.append(near)
        ways.append(patella.tendon(Pose(*near[:6]).placement, place))
    own, along = np.array(rows), np.array(ways)
    along *= (carried * own[:, 12] / np.linalg.norm(along, axis=1))[:, None]
    tendon = Load(along, np.zeros_like(along), np.tile(patella.tibial_attachment, (len(along), 1)))
    loaded = passive_flexion(knee, flexion_deg, [weight, tendon])
    return jnp.asarray(np.c_[np.asarray(loaded.equilibrium.q).T, carried, own])
