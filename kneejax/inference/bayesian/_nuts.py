"""NUTS over several chains whose log densities are computed together.

BlackJAX knows one chain and is mapped over chains. A log density that contains a solve does not
take that well: under `jax.vmap` each decision of the search (is a tangent needed?) becomes both
branches, and every chain pays for them. Here the density is written for all chains at once, with
its gradient, and `jax.custom_batching.custom_vmap` hands it the chains that `vmap` has collected.

BlackJAX rather than NumPyro, both of which are maintained, because it is made of parts. Both store
momenta by index, on which XLA aborts under `use_shared_fusion` (see `_stored`); here that one part
is replaced. And a kernel that is a plain function compiles in a `jit` of our own, with the options
that a solve needs (`numerics/_configure.py`).
"""

import dataclasses
import time
from collections.abc import Callable
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax import Array

from kneejax.numerics import compiled, imported

#: `(chains, p) -> (chains,), (chains, p)`: log densities and their gradients; a pytree, so that its
#: numbers may change without compiling again. Minus infinity, with any finite gradient, where the
#: density is zero.
Target = Callable[[Array], tuple[Array, Array]]

#: Draws of all chains between two looks from outside.
_CHUNK = 25
#: Mean acceptance that the step size is tuned to (Stan's default).
_ACCEPTANCE = 0.8
_FIRST_STEP = 0.5
#: A trajectory is at most two to the power of this long, and diverges when so much energy is lost.
_DOUBLINGS, _LOST_ENERGY = 10, 1000.0
#: Rounds of the warm-up; each but the last ends with a new scaling.
_ROUNDS = 3


class ChainState(eqx.Module):
    """Where chains are: positions `(chains, p)`, log densities `(chains,)`, their gradients."""

    position: Array
    value: Array
    gradient: Array


@dataclasses.dataclass(frozen=True)
class Chains:
    """What the chains drew; arrays begin with `(chains, draws)`."""

    position: np.ndarray  # `(chains, draws, p)`
    value: np.ndarray  # log density there
    divergent: np.ndarray  # trajectories that ended because their energy was lost
    lost: np.ndarray  # those of them that ran into a place of zero density
    evaluations: np.ndarray  # gradients taken for each draw
    acceptance: np.ndarray  # mean acceptance along each trajectory
    step_size: float  # after the warm-up, where the draws have unit covariance
    warmup_evaluations: int  # gradients taken by all chains before
    # `compile` (the first few steps, with compiling), `warmup`, `sampling`.
    seconds: dict[str, float]


def sample(
    target: Target, start: ChainState, origin: np.ndarray, covariance: np.ndarray, *, draws: int,
    warmup: int, seed: int = 0, progress: Callable[[int, int], None] | None = None,
) -> Chains:  # fmt: skip
    """Draw by the no-U-turn sampler (Hoffman and Gelman 2014, J. Machine Learning Research 15,
    1593), scaled about an `origin`, `(p,)`, by a covariance `(p, p)`, then twice by that of the
    warm-up's draws, which are rounded up to a multiple of 75; step size and scaling are those of
    all chains. `progress` is told of draws done and asked for."""
    begin, _, final = _tuning()
    scaled = _Scaled(target, jnp.asarray(origin), jnp.linalg.cholesky(jnp.asarray(covariance)))
    state, key, tuning = scaled.inwards(start), jax.random.key(seed), begin(_FIRST_STEP)
    rounds, chunks = -(-warmup // (_ROUNDS * _CHUNK)), -(-draws // _CHUNK)
    done = evaluations = 0
    begun, compiling = time.perf_counter(), 0.0

    def advance(count: int, adapting: bool) -> list[dict[str, np.ndarray]]:
        """Chunks of draws; arrays begin with `(draws, chains)`."""
        nonlocal state, key, tuning, done, evaluations, compiling
        seen = []
        for _ in range(count):
            key, own = jax.random.split(key)
            tuning = jax.tree.map(lambda x: jnp.asarray(x, float), tuning)
            state, tuning, trace = _advance(scaled, state, tuning, own, jnp.asarray(adapting))
            seen.append({name: np.asarray(values) for name, values in trace.items()})
            compiling = compiling or time.perf_counter() - begun
            evaluations += int(seen[-1]["evaluations"].sum())
            done += _CHUNK
            if progress:
                progress(done, _CHUNK * (_ROUNDS * rounds + chunks))
        return seen

    for number in range(_ROUNDS):
        tuning = begin(_FIRST_STEP)
        seen = advance(rounds, adapting=True)
        if number < _ROUNDS - 1:
            late, outside = [x["position"] for x in seen[len(seen) // 2 :]], scaled.outwards(state)
            scaled = scaled.scaled_by(np.concatenate(late))
            state = scaled.inwards(outside)
    warmed, before = time.perf_counter(), evaluations
    seen = advance(chunks, adapting=False)
    trace = {name: np.concatenate([x[name] for x in seen])[:draws] for name in seen[0]}
    trace = {name: np.swapaxes(value, 0, 1) for name, value in trace.items()}
    position = np.asarray(scaled.outwards(trace.pop("position")))
    seconds = {"compile": compiling, "warmup": warmed - begun - compiling}
    seconds["sampling"] = time.perf_counter() - warmed
    return Chains(
        position=position, **trace, step_size=float(final(tuning)), warmup_evaluations=before,
        seconds=seconds,
    )  # fmt: skip


class _Scaled(eqx.Module):
    """A target in coordinates in which it is near a standard normal density."""

    target: Target
    origin: Array
    scale: Array

    def __call__(self, position: Array) -> tuple[Array, Array]:
        value, gradient = self.target(self.outwards(position))
        return value, gradient @ self.scale

    def outwards(self, inside):
        """Positions, or chains, in the target's own coordinates."""
        if isinstance(inside, ChainState):
            gradient = jnp.linalg.solve(self.scale.T, inside.gradient.T).T
            return ChainState(self.outwards(inside.position), inside.value, gradient)
        return self.origin + inside @ self.scale.T

    def inwards(self, outside: ChainState) -> ChainState:
        """Chains in scaled coordinates."""
        position = jnp.linalg.solve(self.scale, (outside.position - self.origin).T).T
        return ChainState(position, outside.value, outside.gradient @ self.scale)

    def scaled_by(self, seen: np.ndarray) -> "_Scaled":
        """Scaled by the covariance of draws `(draws, chains, p)`, drawn towards the present one."""
        points = seen.reshape(-1, seen.shape[-1])
        count, size = points.shape
        trust = count / (count + 5.0 * size)
        found = trust * np.cov(points.T).reshape(size, size) + (1.0 - trust) * np.eye(size)
        scale = self.scale @ np.linalg.cholesky(found)
        return _Scaled(self.target, self.outwards(points.mean(axis=0)), scale)


@compiled()
def _advance(target: _Scaled, state: ChainState, tuning, key: Array, adapting: Array):
    """A chunk of draws of every chain, all with one step size."""
    (_, update, final), chains = _tuning(), state.position.shape[0]

    def draw(carry, key: Array):
        here, tuning = carry
        step_size = jnp.where(adapting, jnp.exp(tuning.log_step_size), final(tuning))
        trajectory = jax.vmap(partial(_trajectory, target), in_axes=(0, 0, None))
        here, seen = trajectory(jax.random.split(key, chains), here, step_size)
        tuned = update(tuning, jnp.mean(seen["acceptance"]))
        tuning = jax.tree.map(lambda new, old: jnp.where(adapting, new, old), tuned, tuning)
        return (here, tuning), {"position": here.position, "value": here.value, **seen}

    (state, tuning), trace = jax.lax.scan(draw, (state, tuning), jax.random.split(key, _CHUNK))
    return state, tuning, trace


def _trajectory(
    target: _Scaled, key: Array, here: ChainState, step_size: Array
) -> tuple[ChainState, dict[str, Array]]:
    """One draw of one chain: BlackJAX's NUTS from its parts, but for where momenta are stored."""
    integrators, metrics, proposal, termination, trajectory = (
        imported(f"blackjax.mcmc.{name}", "blackjax")
        for name in ("integrators", "metrics", "proposal", "termination", "trajectory")
    )
    metric = metrics.default_metric(jnp.ones(here.position.shape))
    kinetic, turning = metric.kinetic_energy, metric.check_turning
    integrator = integrators.velocity_verlet(partial(_log_density, target), kinetic)
    criterion, update, is_met = termination.iterative_uturn_numpyro(turning)
    walk = trajectory.dynamic_progressive_integration(
        integrator, kinetic, partial(_stored, update), is_met, _LOST_ENERGY
    )
    expand = trajectory.dynamic_multiplicative_expansion(walk, turning, _DOUBLINGS)
    key_momentum, key = jax.random.split(key)
    momentum = metric.sample_momentum(key_momentum, here.position)
    begin = integrators.IntegratorState(here.position, momentum, here.value, here.gradient)
    energy = kinetic(momentum) - here.value
    alone = proposal.Proposal(begin, energy, 0.0, -np.inf)
    point = trajectory.Trajectory(begin, begin, momentum, 0)
    first = trajectory.DynamicExpansionState(0, alone, point, criterion(begin, _DOUBLINGS))
    (_, drawn, path, _), (divergent, _) = expand(key, first, energy, step_size)
    ends = path.leftmost_state.logdensity, path.rightmost_state.logdensity
    there = drawn.state
    return ChainState(there.position, there.logdensity, there.logdensity_grad), {
        "divergent": divergent,
        "lost": jnp.isneginf(ends[0]) | jnp.isneginf(ends[1]),
        "evaluations": path.num_states,
        "acceptance": jnp.exp(drawn.sum_log_p_accept) / path.num_states,
    }


def _stored(update, kept, momentum_sum: Array, momentum: Array, step: Array):
    """Keep the momenta of even steps. BlackJAX writes them by index: under `jax.vmap` two scatters,
    on which XLA 0.10 aborts with `use_shared_fusion`. Choosing serves as well."""
    _, _, low, high = update(kept, momentum_sum, momentum, step)
    row = (jnp.arange(_DOUBLINGS)[:, None] == high) & (step % 2 == 0)
    return type(kept)(
        jnp.where(row, momentum, kept.momentum),
        jnp.where(row, momentum_sum, kept.momentum_sum),
        low,
        high,
    )


def _tuning() -> tuple[Callable, Callable, Callable]:
    """Dual averaging of the step size: how it begins, goes on, and what it ends with."""
    steps = imported("blackjax.adaptation.step_size", "blackjax")
    return steps.dual_averaging_adaptation(_ACCEPTANCE)


@jax.custom_vjp
def _log_density(target: _Scaled, position: Array) -> Array:
    return _one_chain(target, position)[0]


@jax.custom_batching.custom_vmap
def _one_chain(target: _Scaled, position: Array):
    value, gradient = target(position[None])
    return value[0], gradient[0]


@_one_chain.def_vmap
def _all_chains(size: int, batched, target: _Scaled, position: Array):
    return target(position), (True, True)


_log_density.defvjp(_one_chain, lambda gradient, change: (None, change * gradient))
