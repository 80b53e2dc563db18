"""Fibres that do not run straight: through via points, around an obstacle.

A course is a row of pieces between points on the two bones. A piece is straight, or taut around
the course's obstacle. Only the ends that the obstacle's bone does not carry pull on that bone from
outside, along the gradient of the length by them; this gives the wrench on the tibia.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
from jax import Array
from jax.typing import ArrayLike

from kneejax.geometry import (
    Obstacle,
    Placement,
    TautPath,
    Vector,
    dot,
    norm,
    path_points,
    scale,
    subtract,
    taut,
)
from kneejax.mechanics._wrench import Wrench


class _Node(NamedTuple):
    """An end of a piece: its bone, and the point in that bone's frame, mm."""

    bone: str
    point: Vector


class Piece(eqx.Module):
    """A piece of several fibres between two points.

    Attributes:
        length: mm, `(fibres, ...)`.
        pull: wrench on the tibia of a unit tension, about its origin in femur axes.
        taut: the way around the obstacle; None where the piece is straight.
    """

    length: Array
    pull: Wrench
    taut: TautPath | None


class Course(eqx.Module):
    """Several fibres with via points on the same bones and the same obstacle.

    Attributes:
        via: points in order from the femur to the tibia, `(points, fibres, 3, ...)`, mm, each in
            its bone's frame.
        obstacle: what every piece goes around; None if nothing is in the way.
        rows: the fibres' rows among all.
        via_bones: bone of each via point.
        obstacle_bone: bone that carries the obstacle.
    """

    via: Array
    obstacle: Obstacle | None
    rows: tuple[int, ...] = eqx.field(static=True)
    via_bones: tuple[str, ...] = eqx.field(static=True)
    obstacle_bone: str = eqx.field(static=True)

    def __init__(
        self,
        rows: tuple[int, ...] | list[int],
        via: ArrayLike | None = None,
        via_bones: tuple[str, ...] | list[str] = (),
        obstacle: Obstacle | None = None,
        obstacle_bone: str = "tibia",
    ):
        self.rows = tuple(rows)
        self.via_bones = tuple(via_bones)
        shape = (len(self.via_bones), len(self.rows), 3)
        self.via = jnp.zeros(shape) if via is None else jnp.asarray(via, float)
        self.obstacle = obstacle
        self.obstacle_bone = obstacle_bone

    def pieces(self, femoral: Array, tibial: Array, tibia: Placement) -> list[Piece]:
        """The pieces in order from the femur.

        Args:
            femoral: attachments, `(fibres, 3, ...)`, mm, femur frame.
            tibial: likewise, tibia frame.
            tibia: where the tibia is.
        """
        ends = self._nodes(femoral, tibial)
        pairs = zip(ends[:-1], ends[1:], strict=True)
        if self.obstacle is None:
            return [_straight(start, end, tibia) for start, end in pairs]
        return [self._around(self.obstacle, start, end, tibia) for start, end in pairs]

    def ends_inside(self, femoral: Array, tibial: Array, tibia: Placement) -> Array:
        """Whether an attachment or via point lies inside the obstacle; arguments as in `pieces`."""
        inside = jnp.zeros(len(self.rows), bool)
        if self.obstacle is None:
            return inside
        for node in self._nodes(femoral, tibial):
            point = self._at_obstacle(self.obstacle, node, tibia)
            axes = self.obstacle.semi_axes_along_frame
            scaled = tuple(x / a for x, a in zip(point, axes, strict=True))
            inside = inside | (dot(scaled, scaled) < 1.0)
        return inside

    def polylines(
        self, femoral: Array, tibial: Array, tibia: Placement, count: int
    ) -> list[list[Vector]]:
        """Points along each piece, in femur axes, for pictures; arguments as in `pieces`."""
        nodes, lines = self._nodes(femoral, tibial), []
        for start, end in zip(nodes[:-1], nodes[1:], strict=True):
            if self.obstacle is None:
                lines.append([_in_femur(start, tibia), _in_femur(end, tibia)])
                continue
            ends = [self._at_obstacle(self.obstacle, node, tibia) for node in (start, end)]
            points = path_points(self.obstacle, ends[0], ends[1], count)
            own = self.obstacle.frame.placement
            place = tibia.after(own) if self.obstacle_bone == "tibia" else own
            lines.append([place.apply((x, y, z)) for x, y, z in points])
        return lines

    def _nodes(self, femoral: Array, tibial: Array) -> list[_Node]:
        nodes = [("femur", femoral), *zip(self.via_bones, self.via, strict=True), ("tibia", tibial)]
        return [_Node(bone, (point[:, 0], point[:, 1], point[:, 2])) for bone, point in nodes]

    def _at_obstacle(self, obstacle: Obstacle, node: _Node, tibia: Placement) -> Vector:
        """An end in the obstacle's frame; on the obstacle's bone, whatever the pose."""
        point = node.point
        if node.bone != self.obstacle_bone:
            point = tibia.apply(point) if node.bone == "tibia" else tibia.apply_inverse(point)
        return obstacle.frame.placement.apply_inverse(point)

    def _around(
        self, obstacle: Obstacle, start: _Node, end: _Node, tibia: Placement
    ) -> Piece:
        ends = [self._at_obstacle(obstacle, node, tibia) for node in (start, end)]
        path = taut(obstacle, ends[0], ends[1])
        pull = Wrench((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
        for (bone, x), direction in ((start, path.pull_start), (end, path.pull_end)):
            if bone == self.obstacle_bone:
                continue
            along = obstacle.frame.placement.turn(direction)
            if bone == "tibia":  # dragged itself
                pull = pull + Wrench.at(tibia.turn(x), scale(-1.0, along))
            else:  # drags the tibia along
                arm = subtract(x, tibia.translation)
                pull = pull + Wrench.at(arm, tibia.turn(along))
        return Piece(path.length, pull, path)


def by_kind(courses: Sequence[Course], in_lanes: bool) -> tuple[Course, ...]:
    """The same fibres, with those around obstacles of one kind on one bone in one course.

    However many fibres it has, each course is a program of its own: on lenhart2015, two instead of
    three save a fifth of the time to compile a solve, which then runs as fast.

    Args:
        courses: numbers of obstacles one for all fibres of a course.
        in_lanes: whether arrays end in an axis of lanes.
    """
    kinds: dict[tuple, list[Course]] = {}
    for course in courses:
        leaves, kind = jax.tree.flatten(course.obstacle)
        ranks = tuple(jnp.ndim(leaf) for leaf in leaves)
        kinds.setdefault((kind, ranks, course.obstacle_bone, course.via_bones), []).append(course)
    return tuple(_joined(many, in_lanes) for many in kinds.values())


def _joined(courses: list[Course], in_lanes: bool) -> Course:
    first = courses[0]
    if len(courses) == 1:
        return first
    # A fibre's number stands before the lanes.
    axis = -2 if in_lanes else -1
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
    )


def _side_by_side(arrays: list[Array], axis: int) -> Array:
    """One lane meets many."""
    along = axis % arrays[0].ndim
    others = jnp.broadcast_shapes(*(x.shape[:along] + (1,) + x.shape[along + 1 :] for x in arrays))
    shapes = [others[:along] + (x.shape[along],) + others[along + 1 :] for x in arrays]
    alike = [jnp.broadcast_to(x, shape) for x, shape in zip(arrays, shapes, strict=True)]
    return jnp.concatenate(alike, axis)


def _straight(start: _Node, end: _Node, tibia: Placement) -> Piece:
    line = subtract(_in_femur(end, tibia), _in_femur(start, tibia))
    length = norm(line)
    if start.bone == end.bone:
        return Piece(length, Wrench((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), None)
    tibial, sign = (end, -1.0) if end.bone == "tibia" else (start, 1.0)
    arm = tibia.turn(tibial.point)
    unit = scale(sign / jnp.where(length > 0, length, 1.0), line)
    return Piece(length, Wrench.at(arm, unit), None)


def _in_femur(node: _Node, tibia: Placement) -> Vector:
    return tibia.apply(node.point) if node.bone == "tibia" else node.point
