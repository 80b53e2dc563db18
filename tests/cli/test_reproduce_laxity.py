"""`kneejax reproduce 2` and `3`: files and exit status, from studies that are made up."""

import csv

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.geometry import Pose
from kneejax.papers import paper2, paper3
from kneejax.papers.claims import VERDICTS
from kneejax.papers.paper2 import TOTALS, Lachman, LachmanStudy, Octagon
from kneejax.papers.paper3 import TORSION_DEG, LaxityStudy
from kneejax.papers.rigid_patella import RigidLeg
from kneejax.planning import Outcome
from kneejax.statics import Status


def lachman_study(status):
    loads = np.linspace(0.0, 100.0, 3)
    tension = {name: loads / 10.0 + 2.0 for name in ("LCL", "aDMCL")}
    ends = {"two bundles": 2.6, "one bundle": 2.7, "deficient": 8.0}
    tests = {
        name: Lachman(end * loads / 100.0, tension, 0.0, 1.0, status, 100.0)
        for name, end in ends.items()
    }
    longer = {-0.03: tests["two bundles"], 0.03: tests["one bundle"]}
    return LachmanStudy(loads, tests, tests, {0.0: tests["deficient"]}, 0.1, longer)


def drawer_study(status, flexion):
    moved = np.linspace(-5.0, 5.0, 11)
    force = np.tile(moved**3, (len(flexion), 1))
    turned = 5.0 + np.array(TORSION_DEG)
    turned[-1] = np.nan
    return LaxityStudy(
        flexion, moved, force, {"ACL": np.abs(force), "PCL": np.abs(force)},
        np.array(TORSION_DEG), turned, -5.0 - np.array(TORSION_DEG),
        np.tile([-3.0, 2.0], (len(TORSION_DEG), 1)), 3.0, {0.0: status},
    )  # fmt: skip


def octagon_of():
    """Grafts whose distances are Table 4's."""
    names, nothing = ("pACL", "PCL", "graft"), np.zeros(0)

    def outcome(columns):
        distance = np.array(TOTALS)[:, None] * np.full(columns, 1.0 / columns)
        return Outcome(
            nothing, nothing, distance, nothing, nothing, nothing, nothing,
            followed=None,  # pyright: ignore[reportArgumentType]
        )  # fmt: skip

    return Octagon(names, outcome(3), outcome(2), 2.7, 2.6)


def raised():
    """A leg at some flexions, the quadriceps slack at the last."""
    x = np.array([0.0, 20.0, 40.0, 60.0, 90.0])
    pull = np.array([300.0, 200.0, 200.0, 200.0, -1.0])
    parts = {name: x for name in ("patellar tendon", "contact", "weight", "a", "b", "c")}
    return RigidLeg(
        x, Pose.from_table(np.c_[x, np.zeros((5, 5))]), np.zeros((5, 6)), pull, pull,
        np.ones((5, 2)), pull, 40.0 + 0 * x, {"ACL": x, "PCL": x}, parts, np.zeros((5, 19)),
    )  # fmt: skip


@pytest.mark.parametrize("paper", ["2", "3"])
@pytest.mark.parametrize(("status", "code"), [(Status.GIVES_WAY, 0), (Status.OUTSIDE_REGION, 1)])
def test_claims_tables_and_figures_are_written(paper, status, code, tmp_path, monkeypatch, capsys):
    asked = []
    monkeypatch.setattr(paper2, "lachman_study", lambda knee: lachman_study(status))
    monkeypatch.setattr(paper2, "octagon_study", lambda knee: octagon_of())
    monkeypatch.setattr(
        paper3, "laxity_study",
        lambda knee, flexion, mm, Nm: asked.append((mm, Nm)) or drawer_study(status, flexion),
    )  # fmt: skip
    monkeypatch.setattr(paper3, "raise_leg", lambda knee, with_patella: raised())
    assert main(["reproduce", paper, "--out", str(tmp_path)]) == code
    with (tmp_path / "reproduction.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["verdict"] for row in rows} <= set(VERDICTS)
    assert all(row["number"].startswith(f"{paper}.") for row in rows)
    drawn = {"2": ["lachman"], "3": ["drawer", "raised_leg", "torsion"]}[paper]
    assert sorted(x.stem for x in (tmp_path / "figures").iterdir()) == drawn
    if paper == "2":
        with (tmp_path / "octagon.csv").open() as file:
            totals = [float(x["total"]) for x in csv.DictReader(file) if x["graft"] == "moved"]
        assert totals == pytest.approx(TOTALS)
    table = {"2": "lachman.csv", "3": "drawer.csv"}[paper]
    with (tmp_path / table).open() as file:
        assert {"anterior_mm", "anterior_N"} <= set(csv.DictReader(file).fieldnames or ())
    assert ("warning: " in capsys.readouterr().out) == bool(code)
    # The conditions are those of the bundled table.
    assert asked == ([(5.0, 3.0)] if paper == "3" else [])
