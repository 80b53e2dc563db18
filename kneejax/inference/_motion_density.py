"""The density of parameters given a motion, of several chains at once."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.inference._parameters import Selection
from kneejax.inference._priors import Prior
from kneejax.inference._problem import TABLE_UNITS, Evaluation, Problem
from kneejax.mechanics import Knee
from kneejax.statics import EnergyNewton, Guess, in_lanes, settle

# A hundred numbers that are this much off, mm, move a log density by less than 1e-4.
_SEARCH = EnergyNewton(atol=1e-8)


class MotionDensity(eqx.Module):
    """Posterior density of a problem's parameters, in coordinates without bounds.

    The poses of all chains are lanes of one solve, each with its chain's parameters. Every search
    begins at the linear prediction from the same balanced poses, so the density is a function of
    the parameters and nothing else. Measured coordinates have independent normal noise; a parameter
    between its bounds is `lower + (upper - lower) / (1 + exp(-position))`.

    Attributes:
        selection: the parameters.
        offsets: free coordinates with an unknown offset to the measurement.
        knee: gives everything else.
        flexion: rad, `(n,)`; of the problem's rows that count, as are the following.
        target: measured coordinates, degrees and mm, `(5, n)`.
        noise: its standard deviation, `(5,)`.
        near: parameters `(p,)` and balanced poses there, to predict from.
        mean: of the priors, `(p,)`.
        precision: one over their variances, zero where flat, `(p,)`.
        lower: bounds, `(p,)`.
        upper: bounds, `(p,)`.
    """

    selection: Selection = eqx.field(static=True)
    offsets: tuple[int, ...] = eqx.field(static=True)
    knee: Knee
    flexion: Array
    target: Array
    noise: Array
    near: tuple[Array, Evaluation]
    mean: Array
    precision: Array
    lower: Array
    upper: Array

    @classmethod
    def of(
        cls,
        problem: Problem,
        noise: np.ndarray,
        priors: tuple[Prior, ...],
        near: tuple[np.ndarray, Evaluation],
    ) -> MotionDensity:
        """The density of a problem.

        Args:
            problem: what is fitted.
            noise: standard deviations of the measurement, `(5,)`, degrees and mm.
            priors: one for each parameter and offset.
            near: parameters and offsets, and balanced poses there.
        """
        values, found = near
        rows = np.flatnonzero(problem.used)
        settled = jax.tree.map(lambda leaf: leaf[..., rows], found.settled)
        known = Evaluation(found.table[:, rows], found.jacobian[:, rows], settled)
        return cls(
            problem.selection,
            problem.offsets,
            problem.knee,
            problem.flexion[rows],
            jnp.asarray(problem.target[:, rows]),
            jnp.asarray(noise),
            (jnp.asarray(values[: len(problem.selection)]), known),
            jnp.array([prior.mean for prior in priors]),
            jnp.array([prior.sd**-2.0 for prior in priors]),
            jnp.array([prior.lower for prior in priors]),
            jnp.array([prior.upper for prior in priors]),
        )

    def values(self, position: Array) -> Array:
        """Parameters and offsets at positions `(..., p)`."""
        return self.lower + (self.upper - self.lower) * jax.nn.sigmoid(position)

    def position(self, values: Array) -> Array:
        """Where parameters and offsets `(..., p)` are without bounds."""
        return jnp.log((values - self.lower) / (self.upper - values))

    def prior(self, position: Array) -> Array:
        """Log density of the priors at positions `(..., p)`, but for a constant."""
        bell = -0.5 * self.precision * (self.values(position) - self.mean) ** 2
        widening = jax.nn.log_sigmoid(position) + jax.nn.log_sigmoid(-position)
        return jnp.sum(bell + widening, axis=-1)

    def __call__(self, position: Array) -> tuple[Array, Array]:
        """Log densities and their gradients at positions `(chains, p)`.

        The gradient is taken in reverse through the implicit derivative: chains share no lane, so
        that of the sum has each chain's in its row.
        """

        def total(position: Array) -> tuple[Array, tuple[Array, Array]]:
            likelihood, balanced = self._likelihood(self.values(position))
            each = likelihood + self.prior(position)
            return jnp.sum(each), (each, balanced)

        gradient, (value, balanced) = jax.grad(total, has_aux=True)(position)
        return (
            jnp.where(balanced, value, -jnp.inf),
            jnp.where(balanced[:, None], gradient, 0.0),
        )

    def _likelihood(self, values: Array) -> tuple[Array, Array]:
        """Log likelihood of each chain, and whether all poses that count are balanced."""
        chains, size = values.shape[0], len(self.selection)
        settled = self._settled(values[:, :size])
        table = settled.q.reshape(5, chains, -1) * TABLE_UNITS[:, None, None]
        for k, coordinate in enumerate(self.offsets):
            table = table.at[coordinate].add(values[:, size + k, None])
        # Gradients of a NaN are NaN even where it is not chosen: it is replaced beforehand.
        balanced = ~jnp.any(jnp.isnan(table), axis=(0, 2))
        table = jnp.where(jnp.isnan(table), 0.0, table)
        error = (table - self.target[:, None]) / self.noise[:, None, None]
        return -0.5 * jnp.sum(error**2, axis=(0, 2)), balanced

    def _settled(self, values: Array):
        """Every pose of every chain: lanes run over the chains' poses, chain by chain."""
        chains, poses = values.shape[0], self.flexion.shape[0]

        def of_its_chain(leaf: Array) -> Array:
            return jnp.repeat(leaf, poses, axis=-1) if leaf.shape[-1] == chains else leaf

        lanes = in_lanes(self.knee, self.selection.apply, values)
        guess = self._predicted(values)
        flexion = jnp.tile(self.flexion, chains)
        return settle(jax.tree.map(of_its_chain, lanes), flexion, guess, search=_SEARCH)

    def _predicted(self, values: Array) -> Guess:
        """Poses to first order from the known ones."""
        near, known = self.near
        count = values.shape[0] * self.flexion.shape[0]
        units = jnp.asarray(TABLE_UNITS)[:, None, None]
        shift = jnp.einsum("inp,cp->icn", known.jacobian, values - near) / units
        follow = jnp.einsum("iabn,icn->abcn", known.settled.drift, shift)
        tangent = jnp.repeat(known.settled.tangent[:, :, None], values.shape[0], axis=2)
        return Guess(
            (known.settled.q[:, None] + shift).reshape(5, count),
            (known.settled.meeting[:, :, None] + follow).reshape(-1, 2, count),
            tangent.reshape(5, 5, count),
        )
