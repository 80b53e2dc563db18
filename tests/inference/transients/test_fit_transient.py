"""Dampers are found from a motion that they made."""

import jax.numpy as jnp
import numpy as np
import pytest

from kneejax.dynamics import LoadCurve, move_within
from kneejax.geometry import FREE_COORDINATES, coordinates_of, table_units
from kneejax.inference.transients import Recorded, fit_transient
from kneejax.mechanics import load_of
from tests.dynamics.massed import in_a_vice

pytestmark = pytest.mark.usefixtures("optimised_code")

TIMES = np.linspace(0.0, 0.02, 21)
START = np.zeros(6)
TRUE = {"critical": 0.35, "damping_N_s_per_mm": 0.08}
FIRST = {"critical": 1.0, "damping_N_s_per_mm": 0.01}


def pulled():
    """A load that grows in 2 ms."""
    return LoadCurve.of([0.0, 0.002], load_of(anterior_N=jnp.array([0.0, 60.0]),
                                              internal_Nm=jnp.array([0.0, 1.5])))  # fmt: skip


def recorded(noise=0.0, seed=0, start=START):
    moving = in_a_vice().critically_damped(TRUE["critical"])
    moving = moving.damped_everywhere(TRUE["damping_N_s_per_mm"])
    made = move_within(1e-4, moving, start, TIMES, loads=pulled(), held=("flexion",))
    rows = [coordinates_of(moving.knee.bodies).index(name) for name in FREE_COORDINATES]
    table = np.asarray(made.q)[:, rows] * table_units(FREE_COORDINATES)
    table = table - table[0] + noise * np.random.default_rng(seed).standard_normal(table.shape)
    return Recorded(TIMES, {name: table[:, k] for k, name in enumerate(FREE_COORDINATES)})


def fitted(record, free=FIRST, start=START):
    return fit_transient(
        in_a_vice(), start, record, free, most_mm=1e-4, loads=pulled(), held=("flexion",)
    )


@pytest.mark.long
def test_dampers_are_found_from_the_motion_that_they_made():
    found = fitted(recorded())
    assert found.converged and found.evaluations < 40
    np.testing.assert_allclose(found.values, list(TRUE.values()), rtol=1e-3)
    assert max(found.rms.values()) < 1e-4
    assert (found.lower <= found.values).all() and (found.values <= found.upper).all()


@pytest.mark.long
def test_changes_count_from_where_the_motion_begins():
    """A tibia that is let go beside its balance."""
    beside = START + np.array([0.0, 0.01, 0.0, 0.2, 0.0, 0.1])
    found = fitted(recorded(start=beside), start=beside)
    np.testing.assert_allclose(found.values, list(TRUE.values()), rtol=1e-3)


@pytest.mark.slow
def test_with_noise_the_truth_is_as_near_as_the_interval_says_and_the_noise_is_known():
    found = fitted(recorded(noise=0.002))
    error = found.uncertainty.standard_error
    assert (np.abs(found.values - list(TRUE.values())) < 3.0 * error).all()
    assert (error < 0.2 * np.array(list(TRUE.values()))).all()
    np.testing.assert_allclose(found.noise, 0.002, rtol=0.4)


def test_what_is_no_damper_or_no_coordinate_is_refused():
    with pytest.raises(ValueError, match="free: .*'stiffness'.*expected some of critical"):
        fitted(Recorded(TIMES, {"anterior": TIMES}), {"stiffness": 1.0})
    with pytest.raises(ValueError, match="changes: 'flexion'; expected some of adduction"):
        Recorded(TIMES, {"flexion": TIMES})
    with pytest.raises(ValueError, match="expected a coordinate at least"):
        Recorded(TIMES, {})


def test_a_record_by_columns_counts_from_its_first_row():
    record = Recorded.of_table([0.0, 0.1], {"anterior_mm": [3.0, 5.0]})
    assert record.changes["anterior"].tolist() == [0.0, 2.0]
    assert np.isnan(record.table()[:, 0]).all()
