"""Poses, axes and a mesh to fit joints to; figures are drawn only where a test wants them."""

import numpy as np
import pytest

from tests.cli.joint.fitting import AXES, ENDS, write_poses
from tests.joints.bones import write_femur


@pytest.fixture
def poses(tmp_path):
    middle = [[45.0, -1.6, 9.6, 4.0, -35.0, 2.7]]
    return write_poses(tmp_path / "poses.csv", np.r_[ENDS[1:], middle, ENDS[:1]].tolist())


@pytest.fixture
def axes(tmp_path):
    (tmp_path / "axes.yaml").write_text(AXES)
    return str(tmp_path / "axes.yaml")


@pytest.fixture(scope="module")
def mesh(tmp_path_factory):
    return write_femur(tmp_path_factory.mktemp("mesh") / "femur.obj")


@pytest.fixture
def figures():
    """A test that has it wants the figures."""

@pytest.fixture(autouse=True)
def drawn_only_where_wanted(request, monkeypatch):
    """Drawing takes longer than all else."""
    if "figures" not in request.fixturenames:
        for name in ("axes", "motion"):
            figure = f"kneejax.report.joint_fit.joint_{name}_figure"
            monkeypatch.setattr(figure, lambda *_: None)
        for name, made in (("picture_svg", "<svg></svg>"), ("save_figure", [])):
            monkeypatch.setattr(f"kneejax.report.look.page.{name}", lambda *_, x=made, **__: x)
