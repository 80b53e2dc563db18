"""What `kneejax activity` refuses, each in one line and before anything is written."""

import numpy as np
import pytest

from kneejax.cli import main

MODEL = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="40000"><Model name="m"><Ground name="ground"/>
<length_units>meters</length_units><force_units>N</force_units>
<BodySet><objects><Body name="femur_r"><mass>8</mass></Body>
<Body name="tibia_r"><mass>4</mass></Body></objects></BodySet><JointSet><objects>
<WeldJoint name="hip_r"><socket_parent_frame>/ground</socket_parent_frame>
<socket_child_frame>/bodyset/femur_r</socket_child_frame></WeldJoint>
<PinJoint name="knee_r"><socket_parent_frame>/bodyset/femur_r</socket_parent_frame>
<socket_child_frame>/bodyset/tibia_r</socket_child_frame>
<coordinates><Coordinate name="knee_angle_r"/></coordinates></PinJoint>
</objects></JointSet></Model></OpenSimDocument>"""


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "m.osim").write_text(MODEL)
    time = np.linspace(0.0, 1.0, 8)
    axes = [f"knee_r_on_tibia_r_in_tibia_r_{kind}{axis}" for kind in "fmp" for axis in "xyz"]
    for name, names, begin in (
        ("angles.sto", ["knee_angle_r"], 0.0),
        ("radians.sto", ["knee_angle_r"], 0.0),
        ("reaction.sto", axes, 0.0),
        ("late.sto", axes, 5.0),
        ("short.sto", axes[:4], 0.0),
        ("misspelt.sto", ["knee_angel_r"], 0.0),
    ):
        size = 1.0 if name == "radians.sto" else 30.0
        rows = [[begin + t, *[-size * t] * len(names)] for t in time]
        text = "\n".join("\t".join(map(str, row)) for row in rows)
        head = "\t".join(["time", *names])
        (tmp_path / name).write_text(f"m\ninDegrees=yes\nendheader\n{head}\n{text}\n")
    return tmp_path


@pytest.mark.parametrize(
    ("files", "options", "said"),
    [
        (["angles.sto", "late.sto"], [], "late.sto: time: from 5 s: expected times that overlap"),
        (["radians.sto", "reaction.sto"], [], "radians are suspected"),
        (["angles.sto", "short.sto"], [], "no JOINT_on_tibia_r_in_tibia_r_my"),
        (["misspelt.sto"], [], "did you mean knee_angle_r?"),
        (["nowhere.sto"], [], "nowhere.sto: file: missing"),
        (["angles.sto"], [], "muscle forces: missing"),
        (["angles.sto", "reaction.sto"], ["--side", "l"], "--side: side: l: expected r"),
        (["angles.sto", "reaction.sto"], ["--instants", "2"],
         "--instants: 2: expected a whole number between 4 and 20,000"),
        (["angles.sto", "reaction.sto"], ["--cut", "ACX"], "ACX"),
        (["angles.sto", "reaction.sto"], ["--frames", "equal"],
         "--frames: equal: expected one of auto, same, landmarks"),
        (["angles.sto", "reaction.sto"], ["--plan", "ten_bundle"],
         "--knee: four_ligament: expected no --plan"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(files, options, said, folder, capsys):
    words = [str(folder / name) for name in files]
    words += ["--model", str(folder / "m.osim"), "--knee", "four_ligament", *options]
    out = folder / "out"
    assert main(["activity", *words, "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not out.exists()


LOADS = """<?xml version="1.0" encoding="UTF-8"?><OpenSimDocument Version="40000">
<ExternalLoads><objects><ExternalForce name="floor">
<applied_to_body>tibia_r</applied_to_body><force_identifier>v</force_identifier>
<point_identifier>p</point_identifier></ExternalForce></objects>
<datafile>floor.mot</datafile></ExternalLoads></OpenSimDocument>"""


@pytest.fixture
def ground(folder):
    """Forces from the ground, from 5 s on."""
    (folder / "floor.xml").write_text(LOADS)
    rows = "\n".join("\t".join(map(str, [5.0 + t, *[0.0] * 6])) for t in np.linspace(0, 1, 8))
    head = "\t".join(["time", *(f"{kind}{axis}" for kind in "vp" for axis in "xyz")])
    (folder / "floor.mot").write_text(f"m\ninDegrees=no\nendheader\n{head}\n{rows}\n")
    return folder


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ("", "FILES: none: expected OpenSim's tables, or --motion and --grf"),
        ("angles.sto --grf floor.xml", "--grf: floor.xml: expected --motion with it"),
        ("angles.sto --rounds 2", "--rounds: 2: expected --motion with it"),
        ("reaction.sto --motion angles.sto", "--motion and FILES: expected one of both"),
        ("--motion angles.sto --grf floor.xml", "time: from 5 s: expected times that overlap"),
        ("--motion radians.sto", "radians are suspected"),
        ("--motion misspelt.sto", "no knee_angle_r: expected a column of the coordinate"),
        ("--motion angles.sto --side l", "knee of: r (knee_r); or give --femur and --tibia"),
        ("--motion angles.sto --femur femur_r", "--femur: femur_r: expected --femur and --tibia"),
        ("--motion angles.sto --femur a --tibia b", "--femur: a: expected a body of the model"),
        ("--motion angles.sto --rounds 21",
         "--rounds: 21: expected a whole number between 0 and 20"),
        ("--motion angles.sto --time_s 0.2", "--time-s: 0.2: expected BEGIN:END"),
        ("--motion angles.sto --time_s 0.2:3", "expected two times from 0 to 1 s, which"),
        ("--motion angles.sto --actuators m.osim", "expected reserves and residuals of OpenSim"),
        ("--motion angles.sto --actuators nowhere.xml", "nowhere.xml: file: missing"),
    ],
)
def test_a_movement_for_opensim_is_checked_before_it_is_asked(
    words, said, ground, capsys, monkeypatch
):
    monkeypatch.chdir(ground)
    monkeypatch.setattr("kneejax.files.opensim.whole_body.check_installed", lambda *_: None)
    command = ["activity", *words.split(), "--model", "m.osim", "--knee", "four_ligament"]
    assert main([*command, "--out", "out"]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not (ground / "out").exists()


class _AskedError(Exception):
    """OpenSim would be asked now."""


@pytest.mark.parametrize(("option", "bodies"), [([], 1), (["--patella"], 2)])
def test_of_a_plan_the_motion_of_its_intact_knee_goes_back(
    option, bodies, ground, monkeypatch, capsys
):
    """In the structure of all its knees, so that one program serves rounds and places."""
    asked = []

    def ask(arguments, body, knee, document, show):
        asked.append((arguments.rounds, knee, document["name"]))
        raise _AskedError

    monkeypatch.chdir(ground)
    monkeypatch.setattr("kneejax.files.opensim.whole_body.check_installed", lambda *_: None)
    monkeypatch.setattr("kneejax.cli._activity.asked_of_opensim", ask)
    words = ["--motion", "angles.sto", "--model", "m.osim", "--plan", "ten_bundle", "--rounds", "2"]
    with pytest.raises(_AskedError):
        main(["activity", *words, *option, "--out", "out"])
    ((rounds, knee, name),) = asked
    assert (rounds, name, len(knee.bodies)) == (2, "ten_bundle", bodies)
    at = knee.ligaments.names.index("graft")
    acts = dict(zip(knee.ligaments.names, np.asarray(knee.ligaments.stiffness), strict=True))
    assert acts["aACL"] > 0.0 and float(knee.ligaments.stiffness[at]) == 0.0


def test_without_the_extra_one_line_says_what_to_install(ground, capsys, monkeypatch):
    monkeypatch.chdir(ground)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    words = ["--motion", "angles.sto", "--model", "m.osim", "--out", "out"]
    assert main(["activity", *words]) == 2
    error = capsys.readouterr().err
    assert "opensim, which is not installed: pip install 'kneejax[opensim]'" in error
    assert error.count("\n") == 1 and not (ground / "out").exists()


@pytest.mark.slow
def test_a_joint_reaction_is_balanced_written_and_run_again(folder, capsys):
    """A made-up reaction: tables, figure, settings, and the same numbers once more."""
    table = (folder / "reaction.sto").read_text().splitlines()
    rows = [table[4 + k].split()[0] for k in range(8)]
    # 400 N of compression held by the joint, so that the knee is pressed together.
    wrench = "0 -400 0 0 0 0 0 0 0".replace(" ", "\t")
    text = "\n".join([*table[:4], *(f"{time}\t{wrench}" for time in rows)]) + "\n"
    (folder / "reaction.sto").write_text(text)
    out, again = folder / "out", folder / "again"
    words = [str(folder / "angles.sto"), str(folder / "reaction.sto"), "--knee", "four_ligament"]
    words += ["--model", str(folder / "m.osim"), "--cut", "ACL", "--out", str(out)]
    status = main(["activity", *words])
    assert status in (0, 1), capsys.readouterr().err
    header = (out / "activity.csv").read_text().splitlines()[0]
    assert header.startswith("knee,time_s,cycle_percent,flexion_deg")
    assert (out / "figures" / "activity.png").stat().st_size > 20_000
    parts = {line.split(",")[2] for line in (out / "residual.csv").read_text().splitlines()[1:]}
    assert parts == {"joint reaction", "ligaments", "medial", "lateral", "left over"}
    assert main(["rerun", str(out), "--out", str(again)]) == status
    for name in ("activity.csv", "forces.csv", "contact.csv", "residual.csv"):
        assert (again / name).read_text() == (out / name).read_text()
