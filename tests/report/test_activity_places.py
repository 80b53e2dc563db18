"""What is said of a graft in several places, from forces and poses that are known."""

from types import SimpleNamespace

import numpy as np
import pytest

from kneejax.experiments import Cycle
from kneejax.report.activity import place_table, places_figure
from kneejax.statics import Status

COUNT = 20
WAVE = np.sin(np.linspace(0.0, np.pi, COUNT))


def knee(stiffness, pull, forward):
    """An activity of three fibres: a ligament, another one, a graft."""
    table = np.zeros((COUNT, 6))
    table[:, 3], table[:, 2] = forward, 2.0 * forward
    tension = np.stack([pull * WAVE * (k > 0) for k in stiffness], axis=1)
    return SimpleNamespace(
        holds=np.ones(COUNT, bool),
        motion=SimpleNamespace(
            status=np.zeros(COUNT, int),
            knee=SimpleNamespace(ligaments=SimpleNamespace(stiffness=np.array(stiffness))),
            to_table=lambda: table,
        ),
        mechanics=SimpleNamespace(
            tension=tension,
            strain=tension / 1000.0,
            contact_force=np.full((COUNT, 2, 3), [0.0, 300.0, 400.0]),
        ),
    )


@pytest.fixture
def found():
    places = {f"octagon {k}": knee([0.0, 5.0, 7.0], 50.0 + k, 0.1 * k) for k in range(1, 9)}
    return {
        "intact": knee([6.0, 5.0, 0.0], 100.0, 1.0),
        "without ACL": knee([0.0, 5.0, 0.0], 100.0, 4.0),
        "planned": knee([0.0, 5.0, 7.0], 80.0, 1.5),
    } | places


def test_the_ligament_counts_where_it_acts_and_the_graft_elsewhere(found):
    rows = {row["knee"]: row for row in place_table(found).records()}
    peak = WAVE.max()
    assert rows["intact"]["graft_peak_N"] == pytest.approx(100.0 * peak)
    assert rows["planned"]["graft_peak_N"] == pytest.approx(80.0 * peak)
    assert rows["planned"]["graft_peak_strain"] == pytest.approx(0.08 * peak)
    assert rows["without ACL"]["graft_peak_N"] is None
    assert rows["without ACL"]["anterior_rms_from_intact_mm"] == pytest.approx(3.0)
    assert rows["without ACL"]["internal_rotation_rms_from_intact_deg"] == pytest.approx(6.0)
    assert all(row["contact_peak_N"] == pytest.approx(500.0) for row in rows.values())


def test_every_knee_has_its_line_and_its_curve(found):
    lines = place_table(found).terminal().splitlines()
    assert len(lines) == 2 + len(found) and max(map(len, lines)) <= 98
    cycle = Cycle(np.linspace(0.0, 100.0, COUNT), 60.0, "from heel strike to heel strike")
    figure = places_figure(found, cycle, "ten_bundle")
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels == [*found]


@pytest.mark.filterwarnings("error")
def test_knees_that_do_not_balance_are_counted_and_have_no_numbers(found):
    """One is lost everywhere, one at five instants and overstretched at two others."""
    for name, lost in (("without ACL", slice(None)), ("octagon 3", slice(5))):
        one = found[name]
        one.holds[lost] = False
        for values in (one.motion.to_table(), one.mechanics.tension, one.mechanics.strain,
                       one.mechanics.contact_force):  # fmt: skip
            values[lost] = np.nan
    found["octagon 3"].motion.status[5:7] = Status.OVERSTRETCHED
    rows = {row[0]: row[1:] for row in place_table(found).rows}
    assert rows["without ACL"][:2] == [0, 0] and np.isnan(rows["without ACL"][2:]).all()
    assert rows["octagon 3"][:2] == [COUNT - 5, 2] and np.isfinite(rows["octagon 3"][2:]).all()
    assert place_table(found).terminal().splitlines()[3].split()[2:] == ["0", "0", *"-----"]
    cycle = Cycle(np.linspace(0.0, 100.0, COUNT), np.nan, "the whole record")
    for one in found.values():
        one.holds[-1] = False
    figure = places_figure(found, cycle, "x")
    figure.canvas.draw()
    (legend,) = figure.legends
    box = legend.get_window_extent().transformed(figure.transFigure.inverted())
    assert box.x0 > 0.0 and box.x1 < 1.0 and box.y1 < figure.axes[-1].get_position().y0
    labels = [x.get_text() for x in legend.get_texts()]
    assert labels[1] == "without ACL (0 of 20)" and labels[5] == "octagon 3 (14 of 20)"
