"""Fibres that do not run straight: through via points, around an obstacle.

A course is a row of pieces between points on two bones. A piece is straight, or taut around the
course's obstacle. Only the ends that the obstacle's bone does not carry pull on that bone from
outside, along the gradient of the length by them; this gives the wrench on the second bone.
"""

__all__ = ["Course"]

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.geometry import (
    FEMUR_AND_TIBIA,
    TIBIA,
    ZERO,
    Obstacle,
    Pair,
    Placement,
    TautPath,
    Vector,
    numbers,
    path_points,
    taut,
)
from kneejax.mechanics._loads import Wrench


class _Node(NamedTuple):
    """An end of a piece: its bone, and the point in that bone's frame, mm."""

    bone: str
    point: Vector


class Piece(eqx.Module):
    """A piece of several fibres between two points."""

    length: Array  # mm, `(fibres, ...)`
    # Wrench of a unit tension on the second bone, about its origin in the first's axes.
    pull: Wrench
    taut: TautPath | None  # the way around the obstacle; None where the piece is straight


class Course(eqx.Module):
    """Several fibres with via points on the same bones and the same obstacle.

    Attributes:
        rows: the fibres' rows among all.
        via: points in order from the first bone to the second, `(points, fibres, 3, ...)`, mm, each
            in its bone's frame; none by default.
        via_bones: bone of each via point.
        obstacle: what every piece goes around; None if nothing is in the way.
        obstacle_bone: bone that carries the obstacle.
        bodies: the two bones.

    Example:
        >>> straight = Course((0, 1), via=[[[0.0, -20.0, 0.0]] * 2], via_bones=("tibia",))
        >>> straight.rows, straight.via.shape
        ((0, 1), (1, 2, 3))
    """

    rows: tuple[int, ...] = eqx.field(static=True, converter=tuple)
    via: Array = numbers(default=None)
    via_bones: tuple[str, ...] = eqx.field(static=True, default=(), converter=tuple)
    obstacle: Obstacle | None = None
    obstacle_bone: str = eqx.field(static=True, default=TIBIA)
    bodies: Pair = eqx.field(static=True, default=FEMUR_AND_TIBIA)

    def __post_init__(self):
        if self.via is None:
            self.via = jnp.asarray(np.zeros((len(self.via_bones), len(self.rows), 3)))

    def __check_init__(self):
        for bone in {*self.via_bones, *([self.obstacle_bone] if self.obstacle else [])}:
            if bone not in self.bodies:
                raise ValueError(f"Course: {bone!r} is none of the bones it joins, {self.bodies}")

    def pieces(self, first: Array, second: Array, there: Placement) -> list[Piece]:
        """The pieces in order from the first bone.

        Args:
            first: attachments on the first bone, `(fibres, 3, ...)`, mm, in its frame.
            second: likewise, on the second.
            there: where the second bone is in the first.
        """
        ends = self._nodes(first, second)
        pairs = zip(ends[:-1], ends[1:], strict=True)
        if self.obstacle is not None:
            return [self._around(self.obstacle, start, end, there) for start, end in pairs]
        # One broadcast here instead of one in every product: its transpose is a sum.
        there = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(first), *jnp.shape(x))), there)
        return [self._straight(start, end, there) for start, end in pairs]

    def ends_inside(self, first: Array, second: Array, there: Placement) -> Array:
        """Whether an attachment or via point lies inside the obstacle; arguments as in `pieces`."""
        inside = jnp.zeros(len(self.rows), bool)
        if self.obstacle is None:
            return inside
        for node in self._nodes(first, second):
            point = self._at_obstacle(self.obstacle, node, there)
            axes = self.obstacle.semi_axes_along_frame
            scaled = Vector(*(x / a for x, a in zip(point, axes, strict=True)))
            inside = inside | (scaled @ scaled < 1.0)
        return inside

    def polylines(
        self, first: Array, second: Array, there: Placement, count: int
    ) -> list[list[Vector]]:
        """Points along each piece in the first bone's axes, for pictures; arguments as `pieces`."""
        nodes, lines = self._nodes(first, second), []
        for start, end in zip(nodes[:-1], nodes[1:], strict=True):
            if self.obstacle is None:
                lines.append([self._in_first(node, there) for node in (start, end)])
                continue
            ends = [self._at_obstacle(self.obstacle, node, there) for node in (start, end)]
            points = path_points(self.obstacle, ends[0], ends[1], count)
            own = self.obstacle.frame.placement
            place = there.after(own) if self.obstacle_bone == self.bodies[1] else own
            lines.append([place.apply((x, y, z)) for x, y, z in points])
        return lines

    def _nodes(self, first: Array, second: Array) -> list[_Node]:
        via = zip(self.via_bones, self.via, strict=True)
        nodes = [(self.bodies[0], first), *via, (self.bodies[1], second)]
        return [_Node(bone, Vector(point[:, 0], point[:, 1], point[:, 2])) for bone, point in nodes]

    def _at_obstacle(self, obstacle: Obstacle, node: _Node, there: Placement) -> Vector:
        """An end in the obstacle's frame; on the obstacle's bone, whatever the pose."""
        point = node.point
        if node.bone != self.obstacle_bone:
            on_second = node.bone == self.bodies[1]
            point = there.apply(point) if on_second else there.apply_inverse(point)
        return obstacle.frame.placement.apply_inverse(point)

    def _around(self, obstacle: Obstacle, start: _Node, end: _Node, there: Placement) -> Piece:
        ends = [self._at_obstacle(obstacle, node, there) for node in (start, end)]
        path = taut(obstacle, ends[0], ends[1])
        pull = Wrench(ZERO, ZERO)
        for (bone, x), direction in ((start, path.pull_start), (end, path.pull_end)):
            if bone == self.obstacle_bone:
                continue
            along = obstacle.frame.placement.turn(direction)
            if bone == self.bodies[1]:  # dragged itself
                pull = pull + Wrench.at(there.turn(x), -along)
            else:  # drags the second bone along
                arm = x - there.translation
                pull = pull + Wrench.at(arm, there.turn(along))
        return Piece(path.length, pull, path)

    def _straight(self, start: _Node, end: _Node, there: Placement) -> Piece:
        line = self._in_first(end, there) - self._in_first(start, there)
        length = line.norm()
        if start.bone == end.bone:
            return Piece(length, Wrench(ZERO, ZERO), None)
        moved, sign = (end, -1.0) if end.bone == self.bodies[1] else (start, 1.0)
        arm = there.turn(moved.point)
        unit = sign / jnp.where(length > 0, length, 1.0) * line
        return Piece(length, Wrench.at(arm, unit), None)

    def _in_first(self, node: _Node, there: Placement) -> Vector:
        return there.apply(node.point) if node.bone == self.bodies[1] else node.point


def by_kind(courses: Sequence[Course], batched: bool) -> tuple[Course, ...]:
    """The same fibres, with those around obstacles of one kind on one bone in one course.

    However many fibres it has, each course is a program of its own: on lenhart2015, two instead of
    three save a fifth of the time to compile a solve, which then runs as fast.
    """
    kinds: dict[tuple, list[Course]] = {}
    for course in courses:
        leaves, kind = jax.tree.flatten(course.obstacle)
        ranks = tuple(jnp.ndim(leaf) for leaf in leaves)
        bones = course.obstacle_bone, course.via_bones, course.bodies
        kinds.setdefault((kind, ranks, bones), []).append(course)
    return tuple(_joined(many, batched) for many in kinds.values())


def _joined(courses: list[Course], batched: bool) -> Course:
    first = courses[0]
    if len(courses) == 1:
        return first
    # A fibre's number stands before the batch.
    axis = -2 if batched else -1
    sizes = [len(course.rows) for course in courses]

    def each(*numbers: Array) -> Array:
        rows = [
            jnp.repeat(jnp.expand_dims(number, axis), size, axis)
            for number, size in zip(numbers, sizes, strict=True)
        ]
        return _side_by_side(rows, axis)

    return Course(
        [row for course in courses for row in course.rows],
        _side_by_side([course.via for course in courses], 1),
        first.via_bones,
        None if first.obstacle is None else jax.tree.map(each, *(c.obstacle for c in courses)),
        first.obstacle_bone,
        first.bodies,
    )


def _side_by_side(arrays: list[Array], axis: int) -> Array:
    """Arrays joined; those of one knee broadcast against a batch."""
    along = axis % arrays[0].ndim
    others = jnp.broadcast_shapes(*(x.shape[:along] + (1,) + x.shape[along + 1 :] for x in arrays))
    shapes = [others[:along] + (x.shape[along],) + others[along + 1 :] for x in arrays]
    alike = [jnp.broadcast_to(x, shape) for x, shape in zip(arrays, shapes, strict=True)]
    return jnp.concatenate(alike, axis)
