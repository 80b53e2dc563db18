"""Derivatives of many balances."""

import numpy as np

import kneejax as kj
from kneejax.statics import Stations, balance_with_slopes


def test_derivatives_by_many_and_by_few_parameters_agree():
    """By few they are taken column by column, by more than there are coordinates row by row."""
    knee = kj.load_knee("four_ligament")
    few = ("ACL.femoral_attachment", "medial.youngs_modulus")
    found = {}
    for names in (few, ("*.stiffness", "PCL.femoral_attachment", *few)):
        chosen = kj.select(knee, names)
        values = np.asarray(chosen.read(knee))[None]
        slopes = balance_with_slopes(knee, chosen.apply, values, Stations.at([20.0, 70.0]))
        for k, name in enumerate(chosen.names):
            of = slopes.jacobian[..., k].ravel(), slopes.meeting_jacobian[..., k].ravel()
            found.setdefault(name, []).append(np.concatenate(of))
    both = [pair for pair in found.values() if len(pair) == 2]
    assert len(both) == 4 and len(found) > 9
    for by_column, by_row in both:
        np.testing.assert_allclose(by_row, by_column, rtol=1e-9, atol=1e-12)
