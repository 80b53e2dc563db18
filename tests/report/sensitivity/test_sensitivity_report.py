"""Sensitivity figures and summary: nothing that failed looks as if it were fine."""

from __future__ import annotations

import numpy as np
import pytest

from kneejax import report
from kneejax.inference import GlobalIndices, LocalSensitivity, MotionIndices, Output, Sweep, Sweeps
from kneejax.report.sensitivity import sensitivity_doubts, swept_table
from kneejax.report.sensitivity_figures import fit_indices_figure, pose_indices_figure
from kneejax.statics import Status

FLEXION = np.array([0.0, 30.0, 60.0, 90.0])
FREE = ("adduction", "internal_rotation", "anterior", "superior", "lateral")


def made_up_sweep(name="ACL.reference_strain", unit=""):
    """Five values; the first has lost a pose, the second is unstable, and so on."""
    values = np.linspace(-0.2, 0.2, 5)
    motion = np.stack([np.sin(FLEXION / 40 + k) for k in range(5)], axis=1)
    table = motion + values[:, None, None]
    status = np.full((5, 4), Status.BALANCED)
    strange = np.zeros((5, 4), bool)
    status[0, :2], table[0, :2] = [Status.NOT_CONVERGED, Status.TOO_DEEP], np.nan
    status[1, 2] = Status.UNSTABLE
    status[2, 3] = Status.OUTSIDE_REGION
    strange[4, 1:] = True
    table[4, 1:] += 500.0
    one = Sweep(name, unit, 0.03, values, table, status, strange)
    return Sweeps(FLEXION, motion, np.zeros(4, int), (one,))


def made_up_slopes(names, failed=()):
    p = len(names)
    rng = np.random.default_rng(0)
    derivative = rng.normal(size=(4, 5, p)) * np.logspace(0, -2, p)
    status = np.zeros(4, int)
    derivative[list(failed)], status[list(failed)] = np.nan, Status.NOT_CONVERGED
    return LocalSensitivity(
        tuple(names),
        ("",) * p,
        np.ones(p),
        FLEXION,
        np.zeros((4, 5)),
        status,
        derivative,
        "prior",
        np.ones(p),
    )


def made_up_indices(names, method="sobol", left_out=30, lost=False):
    angles = (0.0, 45.0, 90.0)
    outputs = [Output(f"{c} at {a:g} deg", "mm", c, a) for c in FREE for a in angles]
    outputs += [Output(f"rmse of {c}", "mm", c, None) for c in FREE]
    outputs.append(Output("objective", "", "", None))
    shape = (len(outputs), len(names))
    rng = np.random.default_rng(1)
    measures = ("total_order", "first_order") if method == "sobol" else ("mu_star", "sigma", "mu")
    values = {m: np.full(shape, np.nan) if lost else rng.uniform(0, 1, shape) for m in measures}
    half = {m: 0.1 * values[m] for m in (measures if method == "sobol" else measures[:1])}
    low, high = np.zeros(len(names)), np.ones(len(names))
    words = tuple(one.name for one in outputs)
    indices = GlobalIndices(
        method, tuple(names), words, low, high, values, half, 0.95, 1280, 40, 128, left_out
    )
    return MotionIndices(indices, tuple(outputs), ())


def words(figure):
    """All texts of a figure."""
    import matplotlib.text

    return [text.get_text() for text in figure.findobj(matplotlib.text.Text)]


def test_what_is_wrong_with_a_pose_is_counted_in_the_legend():
    shown = words(report.sweep_figure(made_up_sweep(), "ACL.reference_strain"))
    for entry in (
        "no balance: 2 of 20 poses",
        "unstable: 1 of 20 poses",
        "outside fitted surfaces: 1 of 20 poses",
        "unphysiological: 3 of 20 poses",
        "the knee itself (0.03)",
        "ACL reference strain",
    ):
        assert entry in shown


def test_solid_lines_hold_sound_poses_only_and_set_the_scale():
    """A pose that flew off by 500 mm is dotted and outside the panel."""
    sweeps = made_up_sweep()
    figure = report.sweep_figure(sweeps, "ACL.reference_strain")
    one = sweeps.sweeps[0]
    fine = np.where((one.sound & (one.status == 0))[..., None], one.table, np.nan)
    for axes in figure.axes[:5]:
        assert np.ptp(axes.get_ylim()) < 10.0
        solid = [line.get_ydata() for line in axes.lines if line.get_linewidth() == 0.8]
        solid = [y for y in solid if len(y) == 4]
        assert len(solid) == 5
        column = next(
            k for k in range(5) if np.array_equal(solid[3], fine[3, :, k], equal_nan=True)
        )
        np.testing.assert_array_equal(solid, fine[..., column])


def test_measured_poses_are_black_and_said_to_be_moved():
    measured = np.column_stack([FLEXION, np.zeros((4, 5))])
    figure = report.sweep_figure(made_up_sweep(), "ACL.reference_strain", measured, moved=True)
    assert "measured, moved onto the knee itself" in words(figure)
    black = [line for line in figure.axes[0].lines if line.get_color() == "#000000"]
    assert len(black) == 1


def test_of_many_parameters_curves_show_those_that_move_most_and_heat_all():
    names = [f"L{i:02d}.stiffness" for i in range(30)]
    local = made_up_slopes(names, failed=(2,))
    shown = words(report.local_curves_figure(local))
    assert sum(word.startswith("L") and "stiffness" in word for word in shown) == 12
    assert "L00 stiffness" in shown and "not balanced" in shown
    assert any("18 that move it less are not shown" in word for word in shown)
    heat = report.local_heatmap_figure(local)
    assert "L29 stiffness" in words(heat)
    for axes in heat.axes[:5]:
        if axes.collections:
            low, high = axes.collections[0].get_clim()
            assert low == -high
    # The translations share one scale, the rotations another.
    limits = {axes.collections[0].get_clim() for axes in heat.axes[:6] if axes.collections}
    assert len(limits) == 2


@pytest.mark.parametrize("method", ["sobol", "morris"])
def test_bars_carry_their_intervals_and_say_what_was_left_out(method):
    found = made_up_indices(["ACL.stiffness", "PCL.stiffness", "ACL.reference_strain"], method)
    kind = "Saltelli blocks" if method == "sobol" else "trajectories"
    for figure in (fit_indices_figure(found), pose_indices_figure(found)):
        assert any(f"30 of 128 {kind} left out" in word for word in words(figure))
    assert "95 % interval" in words(fit_indices_figure(found))


def test_what_was_not_computed_says_so_instead_of_empty_bars():
    found = made_up_indices(["ACL.stiffness", "PCL.stiffness"], left_out=128, lost=True)
    for figure in (fit_indices_figure(found), pose_indices_figure(found)):
        assert "not computed" in words(figure)


def test_the_table_of_sweeps_has_the_sound_range_and_the_faults():
    text = swept_table(made_up_sweep()).terminal()
    assert text.isascii() and max(map(len, text.splitlines())) < 100
    row = next(line for line in text.splitlines() if line.endswith(" 2"))
    assert row.split() == ["ACL.reference_strain", "0", "to", "0.100", "1", "-", "3", "1", "2"]


def test_doubt_is_for_the_knee_itself_and_for_much_that_was_left_out():
    names = ["ACL.reference_strain", "PCL.stiffness"]
    sweeps = made_up_sweep()
    few, many = made_up_indices(names, left_out=5), made_up_indices(names, left_out=30)
    assert sensitivity_doubts(made_up_slopes(names), sweeps, few) == []
    doubts = sensitivity_doubts(made_up_slopes(names, failed=(1, 3)), sweeps, many)
    assert doubts[0].startswith("the knee itself at 30, 90 degrees: no balance found")
    assert "30 of 128 Saltelli blocks" in doubts[1]
