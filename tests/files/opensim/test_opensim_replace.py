"""A reconstructed knee in the model: grafts are put in, the torn fibre is not there any more."""

import copy
from pathlib import Path

import numpy as np
import pytest

from kneejax.cli import main
from kneejax.files import (
    InputProblem,
    KneeFile,
    export_osim,
    import_osim,
    load_knee_file,
    reconstructed,
    write_knee,
)
from kneejax.files.knee.file import build_knee
from kneejax.geometry import TIBIA, Pose, State
from kneejax.mechanics import add_lane_axis
from kneejax.planning import PLANNED, operated_knees
from kneejax.studies import read_plan
from tests.files.opensim.test_opensim_reference import FOREIGN

MODELS = Path(__file__).parent / "models"
LEFT, RIGHT = MODELS / "left_schema4.osim", MODELS / "right_schema3.osim"
LENHART = Path(__file__).parents[3] / "../shared/data/lenhart2015/lenhart2015.osim"
#: Numbers that a balance under a pretension gives: no round ones.
GRAFT = {
    "stiffness_N": 7140.0,
    "transition_strain": 0.06,
    "transition_width": 1e-4,
    "failure_strain": 0.37,
    "damping_N_s": 0.0,
    "source": "a plan",
}
#: Poses at which a graft of a right knee is taut: flexion, adduction, internal rotation, mm.
POSES = [[0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [30.0, 1.0, 4.0, 6.0, -2.0, 0.5],
         [75.0, 2.0, -3.0, 9.0, -9.0, -1.0]]  # fmt: skip
TORN = {LEFT: "cross1", RIGHT: "Band1"}


def reconstruction(model, side):
    """The document of a model's knee with a graft in the place of one fibre."""
    document = copy.deepcopy(import_osim(model, side=side).document)
    document.pop("groups", None)
    torn = document["ligaments"].pop(TORN[model])
    ends = "femoral_attachment_mm", "tibial_attachment_mm"
    moved = {end: (np.array(torn[end]) + [0.123456789, 1 / 3, -0.7]).tolist() for end in ends}
    slack = torn["slack_length_mm"] * 0.87654321
    document["ligaments"]["graft"] = moved | {"slack_length_mm": slack} | GRAFT
    return document


def tension(document):
    """Of each fibre at the poses, `(poses, fibres)`, N."""
    # A model without meshes has no contacts: the fibres alone are read.
    fibres = add_lane_axis(build_knee(document, "knee.yaml").knee.ligaments)
    found = fibres.tension(State({TIBIA: Pose.from_table(POSES)}))
    return dict(zip(document["ligaments"], np.asarray(found), strict=True))


@pytest.mark.long
@pytest.mark.parametrize(("model", "side"), [(LEFT, "l"), (RIGHT, "r")], ids=["left", "right"])
def test_read_again_it_gives_the_same_forces(model, side, tmp_path):
    document = reconstruction(model, side)
    knee = KneeFile(build_knee(document, "knee.yaml").knee, {}, "", Path("knee.yaml"), document)
    written = export_osim(knee, model, replace=True)
    again = import_osim(model, side=side, data=written.data, inside="straight").document
    assert TORN[model] not in again["ligaments"] and "graft" in again["ligaments"]
    graft = document["ligaments"]["graft"]
    for field in graft.keys() - {"source", "failure_strain"}:
        assert again["ligaments"]["graft"][field] == graft[field], field
    ours, theirs = tension(document), tension(again)
    assert ours.keys() == theirs.keys() and ours["graft"].max() > 100.0
    for name, forces in ours.items():
        assert np.abs(theirs[name] - forces).max() < 1e-6
    assert f"{TORN[model]}: taken out" in written.changes


def test_the_rest_of_the_model_stays_line_by_line():
    document = reconstruction(LEFT, "l")
    knee = KneeFile(build_knee(document, "knee.yaml").knee, {}, "", Path("knee.yaml"), document)
    new = export_osim(knee, LEFT, replace=True).data.decode().splitlines()
    old = LEFT.read_text(encoding="utf-8").splitlines()
    inside = [k for k, line in enumerate(new) if 'name="graft"' in line]
    assert len(inside) == 1
    end = next(k for k, line in enumerate(new) if k > inside[0] and "</Blankevoort" in line)
    torn = [k for k, line in enumerate(old) if 'name="cross1"' in line][0]
    end_of_torn = next(k for k, line in enumerate(old) if k > torn and "</Blankevoort" in line)
    assert new[: inside[0]] + new[end + 1 :] == old[:torn] + old[end_of_torn + 1 :]


@pytest.mark.parametrize(("model", "side"), [(LEFT, "l"), (RIGHT, "r")], ids=["left", "right"])
def test_fibres_by_other_names_keep_their_ways(model, side):
    """All are taken out and put in: via points, obstacles and numbers come back."""
    document = copy.deepcopy(import_osim(model, side=side).document)
    document.pop("groups", None)
    document["imported_from"].pop("ligaments", None)
    old = document["ligaments"]
    document["ligaments"] = {f"my_{name}": entry for name, entry in old.items()}
    knee = KneeFile(build_knee(document, "knee.yaml").knee, {}, "", Path("knee.yaml"), document)
    written = export_osim(knee, model, replace=True)
    again = import_osim(model, side=side, data=written.data, inside="straight").document
    assert any("wrap" in entry for entry in old.values())
    for name, entry in document["ligaments"].items():
        found = again["ligaments"][name]
        for field in entry.keys() - {"source", "failure_strain", "wrap"}:
            assert found[field] == entry[field], (name, field)
        assert ("wrap" in found) == ("wrap" in entry)
    assert len(again["ligaments"]) == len(old)


def test_without_being_asked_no_fibre_is_added(tmp_path):
    document = reconstruction(RIGHT, "r")
    with pytest.raises(InputProblem, match="ligaments.graft: graft: .*or --replace to add it"):
        export_osim(KneeFile(None, {}, "", Path("knee.yaml"), document), RIGHT)


def test_a_law_that_opensim_has_not_is_refused():
    document = reconstruction(RIGHT, "r")
    document["ligaments"]["graft"]["law"] = "neo_hookean"
    with pytest.raises(InputProblem, match="ligaments.graft.law: neo_hookean: expected blanke"):
        export_osim(KneeFile(None, {}, "", Path("knee.yaml"), document), RIGHT, replace=True)


def test_bundles_of_another_source_take_the_place_of_all_fibres(tmp_path, capsys):
    if not LENHART.exists():
        pytest.skip("the shared data are not here")
    new = tmp_path / "new.osim"
    words = ["export", "osim", "ten_bundle", str(LENHART), "--out", str(new)]
    assert main(words) == 2 and not new.exists()
    assert "--replace" in capsys.readouterr().err
    assert main([*words, "--replace"]) == 0
    assert "its frames are assumed to be those of femur_distal_r" in capsys.readouterr().out
    own, again = load_knee_file("ten_bundle").document, import_osim(new, side="r").document
    assert again["ligaments"].keys() == own["ligaments"].keys()
    ours = np.asarray(load_knee_file("ten_bundle").knee.ligaments.slack_length)
    theirs = [entry["slack_length_mm"] for entry in again["ligaments"].values()]
    assert np.abs(ours - theirs).max() < 1e-12
    assert "patella" in again


@pytest.mark.long
@pytest.mark.opensim
def test_opensim_finds_the_length_and_tension_of_a_planned_graft(tmp_path):
    """Paper 2's bundles with a graft under 80 N, in the model on whose bones they are."""
    osim = pytest.importorskip("opensim")
    if not LENHART.exists():
        pytest.skip("the shared data are not here")
    plan = read_plan("ten_bundle")
    knee = operated_knees(plan)[PLANNED]
    one = plan.surgery.plan
    document = reconstructed(plan.document, knee, one.torn, one.bundles, "the bundled plan")
    write_knee(document, tmp_path / "planned.yaml")
    new = tmp_path / "planned.osim"
    new.write_bytes(export_osim(tmp_path / "planned.yaml", LENHART, replace=True).data)
    new.write_text(FOREIGN.sub("", new.read_text(encoding="utf-8")), encoding="utf-8")
    osim.Logger.setLevelString("Off")
    model = osim.Model(str(new))
    state = model.initSystem()
    names = [f"knee_{kind}_r" for kind in ("flex", "add", "rot", "tx", "ty", "tz")]
    forces = model.getForceSet()
    own = add_lane_axis(load_knee_file(tmp_path / "planned.yaml").knee.ligaments)
    there = State({TIBIA: Pose.from_table(POSES)})
    lengths, tensions = np.asarray(own.length(there)), np.asarray(own.tension(there))
    for k, pose in enumerate(POSES):
        for name, value, unit in zip(names, pose, [np.pi / 180] * 3 + [1e-3] * 3, strict=True):
            model.getCoordinateSet().get(name).setValue(state, value * unit, False)
        model.realizeVelocity(state)
        for row, name in enumerate(own.names):
            fibre = osim.Blankevoort1991Ligament.safeDownCast(forces.get(name))
            assert abs(1e3 * fibre.getLength(state) - lengths[row, k]) < 1e-9
            # The corners of our law are rounded, OpenSim's are not.
            assert abs(fibre.getTotalForce(state) - tensions[row, k]) < 0.003
    assert tensions[own.names.index("graft")].max() > 50.0
