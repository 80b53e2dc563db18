"""Condyles side by side: each point asks the one that it belongs to."""

from __future__ import annotations

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jax import Array

from kneejax.geometry.surfaces._bases import CUBIC_SPLINE
from kneejax.geometry.surfaces._condyle import Condyle
from kneejax.geometry.surfaces._splines import SplineTables
from kneejax.geometry.surfaces._surface import Surface


class Condyles(eqx.Module):
    """Condyles given by splines, which points of all of them are asked of at once.

    Attributes:
        tables: control values of all.
        angle: as in `Condyle`, `(2, condyles, ...)`.
        width: likewise.
    """

    tables: SplineTables
    angle: Array
    width: Array

    @staticmethod
    def can_hold(surface: Surface) -> bool:
        """Whether a surface can stand among others here.

        A spline reads a few values of a table wherever that begins; powers would need all of
        their coefficients at every point.
        """
        return isinstance(surface, Condyle) and surface.basis == CUBIC_SPLINE

    @classmethod
    def of(cls, condyles: Sequence[Condyle]) -> Condyles:
        """Condyles in a row; their numbers have the same axes, and their frames are left out."""

        def beside(limits: list[Array]) -> Array:
            return jnp.stack(jnp.broadcast_arrays(*limits), axis=1)

        tables = SplineTables.of([one.coefficients for one in condyles])
        return cls(tables, beside([x.angle for x in condyles]), beside([x.width for x in condyles]))

    def at(self, which: Array) -> Condyle:
        """One condyle, in its own frame, whose numbers are those of each point's own.

        Args:
            which: number of each point's condyle, `(points, ...)`, one for all lanes.
        """
        own, every = jnp.ravel(which), self.tables
        numbers = (x[own] for x in (every.begins, every.rows, every.columns))
        # Not gathered: see `_by_all` of splines.
        limits = (
            sum(
                jnp.where((own == k).reshape(-1, *(1,) * (x.ndim - 2)), x[:, k, None], 0.0)
                for k in range(x.shape[1])
            )
            for x in (self.angle, self.width)
        )
        empty = Condyle(jnp.zeros((4, 4)), *limits, basis=CUBIC_SPLINE)
        tables = SplineTables(every.values, *numbers)
        return eqx.tree_at(lambda one: one.coefficients, empty, tables)
