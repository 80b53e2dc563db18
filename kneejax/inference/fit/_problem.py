"""Measured motion against a knee: residuals, Jacobian and the objective of paper 1."""

from __future__ import annotations

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.experiments import passive_flexion
from kneejax.geometry import FREE_COORDINATES, table_units
from kneejax.mechanics import Knee, add_lane_axis
from kneejax.numerics import compiled, lanes_for
from kneejax.parameters import Selection
from kneejax.statics import (
    Guess,
    Settled,
    Slopes,
    differentiable,
    settle,
)

#: Degrees and mm per internal unit of a free coordinate.
TABLE_UNITS = table_units(FREE_COORDINATES)
#: Weights of paper 1, section 3.4: 8 per degree^2, 1 per mm^2, in the order of the coordinates.
DEFAULT_WEIGHTS = np.array([8.0, 8.0, 1.0, 1.0, 1.0])


class Evaluation(eqx.Module):
    """Model poses at one parameter vector, and their derivative.

    Attributes:
        table: free coordinates, degrees and mm, `(5, n)`.
        jacobian: by the parameters, `(5, n, p)`.
        settled: the balance.
    """

    table: Array
    jacobian: Array
    settled: Settled


@partial(jax.jit, static_argnums=0)
def _with_lanes(selection: Selection, knee: Knee, values: Array) -> Knee:
    return add_lane_axis(selection.apply(knee, values))


@compiled(static_argnums=(0,))
def _table_and_jacobian(
    selection: Selection, knee: Knee, values: Array, settled: Settled
) -> tuple[Array, Array]:
    def table(x: Array) -> Array:
        lanes = add_lane_axis(selection.apply(knee, x))
        found = differentiable(lanes, settled.prescribed, settled)
        return found.q * jnp.asarray(TABLE_UNITS)[:, None]

    value, push = jax.linearize(table, values)
    return value, jax.vmap(push, out_axes=-1)(jnp.eye(values.shape[0]))


@dataclasses.dataclass
class Problem:
    """A calibration problem: poses of a model against measured poses.

    The last balanced poses and their Jacobian are kept: every search starts from their linear
    prediction, which leaves two or three Newton steps to do.

    Attributes:
        knee: start of everything that is not free.
        selection: the free parameters.
        measured: `(n, 6)`, degrees and mm.
        weights: `(5,)`, per degree^2 and per mm^2.
        offsets: indices of free coordinates with an unknown constant offset to the measurement.
    """

    knee: Knee
    selection: Selection
    measured: np.ndarray
    weights: np.ndarray
    offsets: tuple[int, ...] = ()
    equilibria: int = 0
    _near: tuple[np.ndarray, Evaluation] | None = None
    _used: np.ndarray | None = None

    @property
    def flexion(self) -> Array:
        """Prescribed flexion, rad."""
        return jnp.deg2rad(self.measured[:, 0])

    @property
    def target(self) -> np.ndarray:
        """Measured free coordinates, `(5, n)`."""
        return self.measured[:, 1:].T

    def poses(self, values: np.ndarray) -> Evaluation:
        """Model poses at parameter values, reached from the nearest known ones."""
        x = np.asarray(values[: len(self.selection)], float)
        if self._near is not None:
            return self._near_to(x, _predicted(x, *self._near))
        knee, rows = self.selection.apply(self.knee, jnp.asarray(x)), self._rows
        found = passive_flexion(knee, self.measured[:, 0]).settled
        return self._described(x, jax.tree.map(lambda y: np.asarray(y)[..., rows], found))

    @property
    def _rows(self) -> np.ndarray:
        """Filled up with the last pose: one compiled program for tables of several lengths."""
        size = len(self.measured)
        return np.minimum(np.arange(lanes_for(size)), size - 1)

    def _near_to(self, x: np.ndarray, guess: Guess) -> Evaluation:
        """Search from a guess; the search is compiled once for all selections."""
        rows, flexion = self._rows, np.deg2rad(self.measured[:, 0])
        guess = jax.tree.map(lambda y: np.asarray(y)[..., rows], guess)
        knee = _with_lanes(self.selection, self.knee, jnp.asarray(x))
        return self._described(x, settle(knee, {"flexion": flexion[rows]}, guess))

    def _described(self, x: np.ndarray, settled: Settled) -> Evaluation:
        """Poses with their Jacobian, which is compiled for each selection."""
        size = len(self.measured)
        self.equilibria += size
        both = _table_and_jacobian(self.selection, self.knee, jnp.asarray(x), settled)
        table, jacobian = (np.asarray(y)[:, :size] for y in both)
        settled = jax.tree.map(lambda y: np.asarray(y)[..., :size], settled)
        return Evaluation(table, jacobian, settled)

    def balance(self, values: np.ndarray, near: Slopes) -> Slopes:
        """Balances of one vector of parameters after another, from near ones.

        The search's own compiled program serves here: tracing the program of `fit_many` takes
        longer than some hundred balances of the motion.

        Args:
            values: parameters without offsets, `(variants, p)`.
            near: of near values, one variant each.

        Returns:
            The `Slopes`.
        """
        found = []
        for row, x in enumerate(np.asarray(values, float)):
            step = x - near.values[row]
            q = near.q[row] + near.jacobian[row] @ step
            meeting = near.meeting[row] + near.meeting_jacobian[row] @ step
            guess = (np.moveaxis(y, 0, -1) for y in (q, meeting, near.tangent[row]))
            found.append(slopes_of(x, self._near_to(x, Guess(*guess))))
        fields = [f.name for f in dataclasses.fields(Slopes)]
        return Slopes(*(np.concatenate([getattr(one, f) for one in found]) for f in fields))

    def keep(self, values: np.ndarray, found: Evaluation) -> None:
        """Remember balanced poses to start from."""
        self._near = (np.array(values[: len(self.selection)]), found)

    @property
    def used(self) -> np.ndarray:
        """Rows that count: those where the start's model balances, `(n,)`."""
        return np.ones(len(self.measured), bool) if self._used is None else self._used

    def use_only(self, rows: np.ndarray) -> None:
        """Leave rows out of the objective (where the start finds no balance)."""
        self._used = np.asarray(rows)

    def error(self, values: np.ndarray, found: Evaluation) -> np.ndarray:
        """Model plus offset minus measurement, `(5, n)`, degrees and mm."""
        error = np.asarray(found.table) - self.target
        for k, coordinate in enumerate(self.offsets):
            error[coordinate] += values[len(self.selection) + k]
        return error

    def jacobian(self, found: Evaluation) -> np.ndarray:
        """Derivative of the error by parameters and offsets, `(5, n, p)`."""
        size = len(self.selection) + len(self.offsets)
        full = np.zeros((*np.asarray(found.table).shape, size))
        full[:, :, : len(self.selection)] = np.asarray(found.jacobian)
        for k, coordinate in enumerate(self.offsets):
            full[coordinate, :, len(self.selection) + k] = 1.0
        return full

    def residual(self, values: np.ndarray, found: Evaluation) -> tuple[np.ndarray, np.ndarray]:
        """Weighted residual vector and its Jacobian, rows left out set to zero."""
        root = np.sqrt(self.weights)[:, None] * self.used
        vector = np.where(self.used, root * self.error(values, found), 0.0)
        matrix = np.where(self.used[:, None], root[:, :, None] * self.jacobian(found), 0.0)
        return vector.reshape(-1), matrix.reshape(vector.size, -1)


def slopes_of(values: np.ndarray, found: Evaluation) -> Slopes:
    """An evaluation as balances of one variant, with derivatives by its values."""
    settled = jax.tree.map(np.asarray, found.settled)
    jacobian = np.moveaxis(np.asarray(found.jacobian), 0, 1) / TABLE_UNITS[:, None]
    met = np.einsum("cabn,ncp->nabp", settled.drift, jacobian)
    of_poses = (np.moveaxis(y, -1, 0) for y in (settled.q, settled.meeting, settled.tangent))
    q, meeting, tangent = of_poses
    x = np.array(values[: jacobian.shape[-1]], float)
    return Slopes(*(y[None] for y in (x, q, jacobian, meeting, met, tangent, settled.status)))


def _predicted(values: np.ndarray, near: np.ndarray, known: Evaluation) -> Guess:
    """Poses at new parameters to first order from known ones."""
    settled = jax.tree.map(np.asarray, known.settled)
    shift = np.asarray(known.jacobian) @ (values - near) / TABLE_UNITS[:, None]
    follow = np.sum(settled.drift * shift[:, None, None], axis=0)
    return Guess(settled.q + shift, settled.meeting + follow, settled.tangent)
