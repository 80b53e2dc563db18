"""Derivatives of many balances."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import kneejax as kj
from kneejax.geometry import State
from kneejax.mechanics import Foundation, add_lane_axis
from kneejax.statics import LoadCases, balance_with_slopes
from kneejax.statics._slopes import _LANES, _slopes


@pytest.mark.long
def test_derivatives_by_many_and_by_few_parameters_agree():
    """By few they are taken column by column, by more than there are coordinates row by row."""
    knee = kj.load_knee("four_ligament")
    few = ("ACL.femoral_attachment", "MCL.reference_strain")
    found = {}
    for names in (few, ("*.stiffness", "PCL.femoral_attachment", *few)):
        chosen = kj.select(knee, names)
        values = np.asarray(chosen.read(knee))[None]
        slopes = balance_with_slopes(knee, chosen.apply, values, LoadCases.at([20.0, 70.0]))
        for k, name in enumerate(chosen.names):
            found.setdefault(name, []).append(slopes.jacobian[..., k])
    both = [pair for pair in found.values() if len(pair) == 2]
    assert len(both) == 4 and len(found) > 9
    for by_column, by_row in both:
        np.testing.assert_allclose(by_row, by_column, rtol=1e-9, atol=1e-12)


@pytest.mark.long
def test_bundles_of_a_whole_knee_vary_in_stiffness_and_strain_together(
    central_difference, monkeypatch
):
    """Row by row over all fibres: XLA aborted over slices of them, and each strain asked for the
    lengths of all anew. No contact is asked: none of them changes."""
    knee = kj.load_knee("lenhart2015")
    bundles = ("MCLs", "ACLam", "LCL")
    kinds = ("stiffness", "reference_strain")
    chosen = kj.select(knee, [f"{name}.{kind}" for name in bundles for kind in kinds])
    values, load_cases = np.asarray(chosen.read(knee)), LoadCases.at(np.full(_LANES, 20.0))
    q = jnp.asarray(knee.at_reference.at(load_cases.free))[:, None]
    # A made-up balance that is as stiff along each coordinate as one.
    known = {
        "q": jnp.broadcast_to(q, (5, _LANES)), "contact_points": jnp.zeros((0, 2, _LANES)),
        "residual": jnp.zeros((5, _LANES)),
        "tangent": jnp.broadcast_to(jnp.eye(5)[..., None], (5, 5, _LANES)),
        "reaction": jnp.zeros((1, _LANES)), "coupling": jnp.zeros((1, 5, _LANES)),
        "depth": jnp.zeros((0, _LANES)), "status": jnp.zeros(_LANES, int),
        "fault": jnp.zeros(_LANES, int), "steps": jnp.zeros(_LANES, int),
    }  # fmt: skip
    in_lanes = np.tile(values, (_LANES, 1))
    given = knee, in_lanes, None, load_cases.of(knee).plain(), known
    slope = _slopes(chosen.apply, *given)
    monkeypatch.setattr(Foundation, "press", lambda *_: pytest.fail("a contact was asked"))
    jax.eval_shape(functools.partial(_slopes.__wrapped__, chosen.apply), *given)

    @jax.jit
    def pulls(values):
        lanes = add_lane_axis(chosen.apply(knee, values))
        state = State.of({"flexion": jnp.deg2rad(jnp.array([20.0]))}, q)
        return jnp.stack(lanes.work_of(lanes.pull(state)[0], state, load_cases.free))[:, 0]

    units = np.abs(values)
    expected = central_difference(lambda x: pulls(units * x), values / units) / units
    assert np.abs(expected).max() > 1.0
    np.testing.assert_allclose(slope[-1], expected, rtol=1e-6, atol=1e-6 * np.abs(expected).max())
