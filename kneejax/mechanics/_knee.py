"""The knee: one immutable pytree whose every number is a leaf."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array

from kneejax.geometry import Placement, Pose
from kneejax.mechanics._loads import ConstantTensionLine, Load, Support
from kneejax.mechanics._wrench import Wrench, generalised_force
from kneejax.mechanics.contact import Contact, Pressed
from kneejax.mechanics.ligaments import FibreFaults, Ligaments


class Knee(eqx.Module):
    """Ligaments, compartments and loads between one femur and one tibia.

    Every number in it is a leaf of the pytree: it can be differentiated, mapped over and
    calibrated. Names and choices of law are static. A left knee is stored as its mirrored right
    twin (reading does that), so X is anterior, Y superior and Z lateral here.

    Attributes:
        ligaments: all fibres.
        contacts: the compartments.
        contact_names: one name per compartment, e.g. `medial`.
        loads: wrenches on the tibia that act in every experiment on this knee.
        lines: lines of constant tension.
        reference_pose: where reference strains and reference lengths are stated.
        groups: names that stand for several fibres each.
        name: of the knee.
        side: `right` or `left`, the side it was read from.
    """

    ligaments: Ligaments
    contacts: tuple[Contact, ...]
    loads: tuple[Load | Support, ...]
    lines: tuple[ConstantTensionLine, ...]
    reference_pose: Pose
    contact_names: tuple[str, ...] = eqx.field(static=True)
    groups: tuple[tuple[str, tuple[str, ...]], ...] = eqx.field(static=True, default=())
    name: str = eqx.field(static=True, default="knee")
    side: str = eqx.field(static=True, default="right")

    def energy(self, pose: Pose) -> Array:
        """Potential energy at a pose, N mm; its derivative is minus the wrench.

        Args:
            pose: one pose or a batch; the knee's leaves then carry the same trailing axes.
        """
        tibia = pose.placement
        total = self.ligaments.energy(tibia)
        for line in self.lines:
            total = total + line.energy(pose.flexion, tibia)
        for contact in self.contacts:
            total = total + contact.energy(tibia)
        return total

    def press(
        self, pose: Pose, meeting: tuple[Array, Array]
    ) -> tuple[list[Wrench], Array, Pressed | None, FibreFaults]:
        """What all parts but the loads do to the tibia, each patch centred at a given point.

        Balance is computed from it with the meeting points as further unknowns: no solve hides
        inside, which keeps compilation short and every derivative one level deep.

        Args:
            pose: as in `energy`.
            meeting: the two parameters of the meeting points, each `(n, ...)` for the `n`
                contacts that have a patch.

        Returns:
            Wrenches about the tibia's origin in femur axes, of which each may hold several parts
            along its first axis; energy in N mm; the patches, with a leading axis of length `n`,
            or None if there are none; and what is wrong with any fibre.
        """
        wrenches, energy, fibres = self.press_without_patches(pose)
        if not self.patch_count:
            return wrenches, energy, None, fibres
        pressed = self.map_patches(Contact.press, pose.placement, meeting)
        energy = energy + jnp.sum(pressed.energy, axis=0)
        return [*wrenches, pressed.wrench], energy, pressed, fibres

    def for_many_poses(self) -> Knee:
        """The same knee with what does not depend on the pose computed once."""
        contacts = tuple(contact.with_points_placed() for contact in self.contacts)
        return dataclasses.replace(self, contacts=contacts)

    def map_patches(self, function, tibia: Placement, meeting):
        """Apply `function(contact, tibia, meeting)` to each contact that has a patch.

        Args:
            function: returns a pytree of arrays.
            tibia: placement of the tibia.
            meeting: an array, or a tuple of arrays, with one row per contact.

        Returns:
            The answers, stacked along a leading axis of length `n`.

        Contacts of one kind (same surfaces, degrees and law) are stacked and mapped together:
        half the operations to compile for two compartments.
        """
        kinds: dict[object, list[int]] = {}
        patches = [contact for contact in self.contacts if contact.has_patch]
        for row, contact in enumerate(patches):
            leaves, structure = jax.tree.flatten(contact)
            kinds.setdefault((structure, *(jnp.shape(leaf) for leaf in leaves)), []).append(row)
        order, answers, all_rows = [], [], list(range(len(patches)))
        for rows in kinds.values():
            # One broadcast here instead of one in every product: its transpose is a sum.
            count = len(rows)
            tibias = jax.tree.map(lambda x, n=count: jnp.broadcast_to(x, (n, *x.shape)), tibia)
            alike = jax.tree.map(lambda *x: jnp.stack(x), *(patches[row] for row in rows))
            own = jax.tree.map(lambda x, r=rows: x if r == all_rows else x[jnp.array(r)], meeting)
            answers.append(jax.vmap(function)(alike, tibias, own))
            order += rows
        lanes = jnp.shape(tibia.translation[0])

        def with_lanes(*x: Array) -> list[Array]:
            # What a plane answers may lack the lanes.
            shape = jnp.broadcast_shapes(lanes, *(y.shape[1:] for y in x))
            return [jax.vmap(lambda row: jnp.broadcast_to(row, shape))(y) for y in x]  # pyright: ignore[reportReturnType]

        if len(answers) == 1:
            return jax.tree.map(lambda x: with_lanes(x)[0], answers[0])
        back = jnp.argsort(jnp.array(order))
        return jax.tree.map(lambda *x: jnp.concatenate(with_lanes(*x))[back], *answers)

    @property
    def patch_count(self) -> int:
        """Number of contacts that have a patch, hence a meeting point."""
        return sum(contact.has_patch for contact in self.contacts)

    def press_without_patches(self, pose: Pose) -> tuple[list[Wrench], Array, FibreFaults]:
        """As `press`, of all but the contacts that have a patch: wrenches, energy, fibres."""
        tibia = pose.placement
        wrenches, energy, fibres = self.ligaments.pull(tibia)
        for line in self.lines:
            energy = energy + line.energy(pose.flexion, tibia)
            wrenches = [*wrenches, line.wrench(pose.flexion, tibia).alone()]
        for contact in self.contacts:
            if not contact.has_patch:
                of_contact, wrench = contact.press_points(tibia)
                energy, wrenches = energy + of_contact, [*wrenches, wrench.alone()]
        return wrenches, energy, fibres

    def load_work(self, pose: Pose, names: Sequence[str]) -> Array:
        """Generalised force of the loads on some coordinates.

        Args:
            pose: as in `energy`.
            names: of the coordinates.

        Returns:
            `(len(names), ...)`: N mm per rad of a rotation, N of a translation.
        """
        total = jnp.zeros((len(names),) + jnp.shape(pose.adduction))
        for load in self.loads:
            total = total + jnp.stack(load.work(pose, names))
        return total

    def force_on(self, pose: Pose, wrench: Wrench, names: Sequence[str]) -> tuple[Array, ...]:
        """Generalised force of the knee's own parts on some coordinates.

        Args:
            pose: as in `energy`.
            wrench: of all parts, about the tibia's origin in femur axes.
            names: of the coordinates.

        Returns:
            One array each, as in `load_work`.
        """
        rows = generalised_force(pose, pose.placement, wrench, names)
        if "flexion" not in names or not self.lines:
            return rows
        # The upper end of a line travels with flexion: it does work that no wrench tells.
        ends = sum(line.work_of_end(pose.flexion, pose.placement) for line in self.lines)
        return tuple(x + ends if n == "flexion" else x for n, x in zip(names, rows, strict=True))

    def reference_length(self) -> Array:
        """Length of each fibre at the reference pose, shape `(n,)`, mm."""
        return self.ligaments.length(self.reference_pose.placement)

    def reference_strain(self) -> Array:
        """Strain of each fibre at the reference pose, shape `(n,)`."""
        return self.reference_length() / self.ligaments.slack_length - 1.0


def add_lane_axis(tree):
    """Give every array of a pytree a trailing axis of length one, for a batch of poses.

    Mechanics is elementwise over trailing axes ("lanes"). A single knee meets a batch of poses
    when its leaves have one lane that broadcasts.
    """
    return jax.tree.map(lambda x: jnp.asarray(x)[..., None], tree)
