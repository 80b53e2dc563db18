"""The knee: one immutable pytree whose every number is a leaf."""

__all__ = ["Held", "Knee", "add_lane_axis"]

import dataclasses
import functools
import operator
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array, lax
from jax.typing import ArrayLike

from kneejax.geometry import FEMUR, TIBIA, Pair, Pose, State
from kneejax.mechanics._loads import Line, Load, Support, Wrenches
from kneejax.mechanics._mass import TimeStep
from kneejax.mechanics._muscles import QUADRICEPS, Muscles
from kneejax.mechanics.contact import Contact, Foundation, PointFaults, Pressed, foundations_of
from kneejax.mechanics.ligaments import FibreFaults, Ligaments
from kneejax.numerics import compiled


class Held(NamedTuple):
    """What the parts of a knee do to its bones, but for the loads.

    Attributes:
        wrenches: between the bones.
        energy: N mm.
        patches: of the contacts that have one, along a leading axis of length `n`; None without.
        points: what is wrong with the contacts over points together; None without any.
        fibres: what is wrong with any fibre.
    """

    wrenches: Wrenches
    energy: Array
    patches: Pressed | None
    points: PointFaults | None
    fibres: FibreFaults


class Knee(eqx.Module):
    """Ligaments, compartments and loads between a femur, a tibia and what other bones there are.

    Every number in it is a leaf of the pytree: it can be differentiated, mapped over and
    calibrated. Names and choices of law are static. A left knee is stored as its mirrored right
    twin (reading does that), so X is anterior, Y superior and Z lateral here. Each part names the
    two bones that it joins.

    Attributes:
        ligaments: all fibres.
        contacts: the compartments.
        contact_names: one name per compartment, e.g. `medial`.
        loads: wrenches on the tibia that act in every experiment on this knee.
        lines: lines of constant tension whose upper end may travel with flexion, or other parts
            that pull by a potential between two bones.
        reference_pose: of the tibia, where reference strains and reference lengths are stated.
        other_bones: bone -> its pose there, of those that move in addition to the tibia.
        muscles: lines of given tension along courses; None without any.
        groups: names that stand for several fibres each.
        name: of the knee.
        side: `right` or `left`, the side it was read from.
        step: inertia and dampers of a step through time; None of a knee at rest.
        foundations: of the contacts over points, where they have been placed for many poses.

    Example:
        >>> import kneejax as kj
        >>> knee = kj.load_knee("four_ligament")
        >>> knee.name, knee.contact_names
        ('four_ligament', ('medial', 'lateral'))
    """

    ligaments: Ligaments
    contacts: tuple[Contact, ...]
    loads: tuple[Load | Support, ...]
    lines: tuple[Line, ...]
    reference_pose: Pose
    contact_names: tuple[str, ...] = eqx.field(static=True)
    groups: tuple[tuple[str, tuple[str, ...]], ...] = eqx.field(static=True, default=())
    name: str = eqx.field(static=True, default="knee")
    side: str = eqx.field(static=True, default="right")
    other_bones: dict[str, Pose] = eqx.field(default_factory=dict)
    muscles: Muscles | None = None
    step: TimeStep | None = None
    foundations: tuple[Foundation, ...] | None = None

    def __check_init__(self):
        known = {FEMUR, *self.bodies}
        parts = [*self.ligaments.bodies, *(x.bodies for x in (*self.contacts, *self.lines))]
        parts += [] if self.muscles is None else self.muscles.bodies
        for bone in {bone for pair in parts for bone in pair} - known:
            raise ValueError(f"Knee: a part joins {bone!r}; the knee's bones are {sorted(known)}")

    def replace(self, values: Mapping[str, ArrayLike]) -> "Knee":
        """The same knee with other values of some parameters.

        Numbers that JAX traces are taken as they are, so that this can be differentiated.

        Args:
            values: name of a parameter, as `kneejax.select` takes it (`ACL.stiffness`,
                `*.reference_strain`, `medial.youngs_modulus`), -> its value, in its own unit. A
                group's stiffness is the sum over its fibres. Their order says nothing: a name
                counts before a wildcard, and reference strains are set last: a fibre whose end
                moves keeps the one that it gets.

        Warns:
            DoubtfulValue: a structure's stiffness that is nearer to that of one of its fibres.

        Raises:
            UnknownParameter: the knee has no such parameter; with the nearest name. Also if one
                number has two values, as of a fibre and of its group.
            Implausible: no number, a value that no knee has (`kneejax.mechanics.RANGES`), or one
                that leads to such a knee, as in a knee file.

        Example:
            >>> import jax, kneejax as kj
            >>> knee = kj.load_knee("four_ligament")
            >>> weak = knee.replace({"ACL.stiffness": 300.0, "MCL.reference_strain": 0.02})
            >>> float(weak.ligaments.stiffness[0])
            300.0
            >>> slack = lambda strain: knee.replace({"ACL.reference_strain": strain})
            >>> rate = jax.grad(lambda strain: slack(strain).ligaments.slack_length[0])(0.0)
            >>> bool(rate == -knee.reference_length()[0])
            True
        """
        # Names are known one room above.
        from kneejax.parameters import replaced

        return replaced(self, values)

    @property
    def bodies(self) -> tuple[str, ...]:
        """The bones that move against the femur."""
        return (TIBIA, *self.other_bones)

    @property
    def pullable(self) -> tuple[str, ...]:
        """What can be given more tension: lines, muscles, and the quadriceps as a whole."""
        muscles = () if self.muscles is None else self.muscles.names
        heads = self.muscles is not None and bool(self.muscles.quadriceps)
        return (*(line.name for line in self.lines), *muscles, *(QUADRICEPS,) * heads)

    @property
    def menisci(self) -> tuple[str, ...]:
        """The contacts that are menisci: those with a ring, and rims that are called so."""
        pairs = zip(self.contact_names, self.contacts, strict=True)
        return tuple(name for name, x in pairs if x.ring is not None or "meniscus" in name)

    @property
    def at_reference(self) -> State:
        """All bones at their reference poses."""
        return State({TIBIA: self.reference_pose, **self.other_bones})

    def energy(self, state: State) -> Array:
        """Potential energy, N mm; its derivative is minus the wrench.

        Args:
            state: one or a batch; the knee's leaves then carry the same trailing axes.
        """
        total = self.ligaments.energy(state)
        for line in self.lines:
            total = total + line.energy(state)
        if self.muscles is not None:
            total = total + self.muscles.energy(state)
        for contact in self.contacts:
            if contact.has_patch:
                total = total + contact.energy(state.between(contact.bodies))
        for foundation in self.over_points:
            total = total + foundation.energy(state.between(foundation.bodies))
        return total if self.step is None else total + self.step.pull(state, Wrenches())

    def press(self, state: State, near: Array | None = None) -> Held:
        """What all parts but the loads do to the bones.

        Args:
            state: as in `energy`.
            near: parameters of points near those where surfaces meet, `(n, 2, ...)` for the `n`
                contacts that have a patch; without any, or where they are NaN, surfaces are
                searched from scratch.
        """
        wrenches, energy, fibres = self.pull(state)
        each = []
        for foundation in self.over_points:
            own, wrench, faults = foundation.press(state.between(foundation.bodies))
            energy = energy + own
            wrenches.add(foundation.bodies, wrench.alone())
            each.append(faults)
        points = functools.reduce(PointFaults.and_of, each) if each else None
        if not self.patch_count:
            return Held(wrenches, energy, None, points, fibres)
        pressed = self.map_patches(Contact.press, state, near)
        energy = energy + jnp.sum(pressed.energy, axis=0)
        for pair, rows in self.patches.items():
            wrenches.add(pair, pressed.of(rows).wrench)
        return Held(wrenches, energy, pressed, points, fibres)

    def for_many_poses(self) -> "Knee":
        """The same knee with the points of its contacts placed, which do not depend on the pose."""
        if self.foundations is not None:
            return self
        if all(contact.has_patch for contact in self.contacts):
            return dataclasses.replace(self, foundations=())
        return dataclasses.replace(self, foundations=_placed(self.contacts))

    @property
    def over_points(self) -> tuple[Foundation, ...]:
        """The contacts over points, those together that can be computed at once."""
        known = self.foundations
        return foundations_of(self.contacts) if known is None else known

    def map_patches(
        self, function, state: State, near: Array | None = None, *, in_turn: bool = False
    ):
        """Apply `function(contact, there, near)` to each contact that has a patch.

        Args:
            function: returns a pytree of arrays; `there` is where the contact's second bone is in
                the first.
            state: where the bones are.
            near: as in `press`.
            in_turn: whether one contact comes after the other: a `lax.cond` in the function then
                passes over what it need not compute.

        Returns:
            The answers, stacked along a leading axis of length `n`.

        Contacts of one kind (same surfaces, degrees and law) are stacked and mapped together:
        half the operations to compile for two compartments.
        """
        if near is None:
            near = jnp.full((self.patch_count, 2, *state.shape), jnp.nan)
        kinds: dict[object, list[int]] = {}
        patches = [contact for contact in self.contacts if contact.has_patch]
        for row, contact in enumerate(patches):
            leaves, structure = jax.tree.flatten(contact)
            kinds.setdefault((structure, *(jnp.shape(leaf) for leaf in leaves)), []).append(row)
        order, answers, all_rows = [], [], list(range(len(patches)))
        for rows in kinds.values():
            # One broadcast here instead of one in every product: its transpose is a sum.
            count = len(rows)
            there = state.between(patches[rows[0]].bodies)
            there = jax.tree.map(lambda x, n=count: jnp.broadcast_to(x, (n, *x.shape)), there)
            alike = jax.tree.map(lambda *x: jnp.stack(x), *(patches[row] for row in rows))
            own = near if rows == all_rows else near[jnp.array(rows)]
            if in_turn:
                answers.append(lax.map(lambda one: function(*one), (alike, there, own)))
            else:
                answers.append(jax.vmap(function)(alike, there, own))
            order += rows

        def full(*x: Array) -> list[Array]:
            # What a plane answers may lack the poses' axes.
            shape = jnp.broadcast_shapes(state.shape, *(y.shape[1:] for y in x))
            return [jax.vmap(lambda row: jnp.broadcast_to(row, shape))(y) for y in x]  # pyright: ignore[reportReturnType]

        if len(answers) == 1:
            return jax.tree.map(lambda x: full(x)[0], answers[0])
        back = jnp.argsort(jnp.array(order))
        return jax.tree.map(lambda *x: jnp.concatenate(full(*x))[back], *answers)

    def contact_points(self, state: State) -> Array:
        """Parameters of the points where surfaces meet, `(n, 2, ...)`, searched from scratch; no
        derivative."""
        if not self.patch_count:
            return jnp.zeros((0, 2, *state.shape))
        found = self.map_patches(Contact.contact_point, state)
        return lax.stop_gradient(jnp.stack(found, axis=1))

    @property
    def patch_count(self) -> int:
        """Number of contacts that have a patch, hence a contact point."""
        return sum(contact.has_patch for contact in self.contacts)

    @property
    def patches(self) -> dict[Pair, tuple[int, ...]]:
        """The bones that contacts with a patch join -> their rows among these."""
        rows: dict[Pair, tuple[int, ...]] = {}
        for row, contact in enumerate(one for one in self.contacts if one.has_patch):
            rows[contact.bodies] = (*rows.get(contact.bodies, ()), row)
        return rows

    def pull(self, state: State) -> tuple[Wrenches, Array, FibreFaults]:
        """As `press`, of all but the contacts: wrenches, energy, fibres."""
        wrenches, energy, fibres = self.ligaments.pull(state)
        if self.muscles is not None:
            pulls, own, wrapped = self.muscles.pull(state)
            wrenches.take(pulls)
            energy, fibres = energy + own, jax.tree.map(operator.or_, fibres, wrapped)
        for line in self.lines:
            energy = energy + line.energy(state)
            wrenches.add(line.bodies, line.wrench(state).alone())
        if self.step is not None:
            energy = energy + self.step.pull(state, wrenches)
        return wrenches, energy, fibres

    def load_work(self, state: State, names: Sequence[str]) -> Array:
        """Generalised force of the loads on some coordinates.

        Args:
            state: as in `energy`.
            names: of the coordinates.

        Returns:
            `(len(names), ...)`: N mm per rad of a rotation, N of a translation.
        """
        total = jnp.zeros((len(names), *state.shape))
        for load in self.loads:
            total = total + jnp.stack(load.work(state, names))
        return total

    def work_of(self, wrenches: Wrenches, state: State, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force of the knee's own parts on some coordinates.

        Args:
            wrenches: of all parts.
            state: as in `energy`.
            names: of the coordinates.

        Returns:
            One array each, as in `load_work`.
        """
        rows = wrenches.work(state, names)
        if self.step is not None and self.step.coordinates is not None:
            damped = self.step.work(state, names)
            rows = tuple(x + force for x, force in zip(rows, damped, strict=True))
        if "flexion" not in names or not self.lines:
            return rows
        # The upper end of a line travels with flexion: it does work that no wrench tells.
        ends = sum(line.work_of_end(state) for line in self.lines)
        return tuple(x + ends if n == "flexion" else x for n, x in zip(names, rows, strict=True))

    @partial(jax.jit, inline=True)
    def reference_length(self) -> Array:
        """Length of each fibre at the reference pose, shape `(n,)`, mm.

        Jitted: operation by operation it took most of the time of a Jacobian by reference strains.
        """
        return self.ligaments.length(self.at_reference)

    def reference_strain(self) -> Array:
        """Strain of each fibre at the reference pose, shape `(n,)`."""
        return self.reference_length() / self.ligaments.slack_length - 1.0


@compiled(effort="least")
def _placed(contacts: tuple[Contact, ...]) -> tuple[Foundation, ...]:
    return foundations_of(contacts)


def add_lane_axis(tree):
    """Give every array of a pytree a trailing axis of length one, for a batch of poses.

    Mechanics is elementwise over trailing axes ("lanes"). A single knee meets a batch of poses
    when its leaves have one lane that broadcasts.

    Example:
        >>> import jax.numpy as jnp
        >>> add_lane_axis({"stiffness": jnp.ones(4)})["stiffness"].shape
        (4, 1)
    """
    return jax.tree.map(lambda x: jnp.asarray(x)[..., None], tree)
