"""What a person gave wrongly is said in one line, and nothing is written."""

import json

import pytest

from kneejax.cli import main
from kneejax.files import bundled_path

POSES = "flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm\n"
#: 25 angles each, as many as the bundled study has: one program serves all commands.
FLEXION, BEYOND = "0:120:5", "40:160:5"
PASSIVE = ["simulate", "passive-flexion", "--knee", "four_ligament"]


def bad_knee(tmp_path, old, new):
    text = bundled_path("knees", "four_ligament").read_text()
    assert old in text
    path = tmp_path / "knee.yaml"
    path.write_text(text.replace(old, new, 1))
    return ["describe", str(path)]


def bad_table(tmp_path, text):
    path = tmp_path / "poses.csv"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return ["evaluate", "four_ligament", str(path), "--out", str(tmp_path / "out")]


def study(tmp_path, text):
    path = tmp_path / "study.yaml"
    path.write_text(text)
    return ["calibrate", str(path), "--out", str(tmp_path / "out")]


def cohort(tmp_path, template, knee, more=""):
    path = tmp_path / "cohort.yaml"
    fields = "title: S, knee: four_ligament, parameters: ['*.stiffness'], procedures: [III]"
    template = "" if template == "title: a" else f", {template}"
    path.write_text(
        f"title: C\nstudy: {{{fields}{template}}}\nknees: [{{name: a, {knee}}}]\n{more}"
    )
    return ["calibrate", str(path), "--out", str(tmp_path / "out")]


def simulate(tmp_path, *words):
    return [*PASSIVE, *words, "--out", str(tmp_path / "o")]


TWIN = bundled_path("studies", "paper1").read_text()

BAD = {
    "unknown command": (lambda t: ["calibrat"], "calibrate"),
    "unknown option": (lambda t: ["calibrate", "--outt", "x"], "did you mean --out?"),
    "field of a study as an option": (
        lambda t: ["calibrate", "--weigths", "x"],
        "did you mean the field weights of a study file?",
    ),
    "misspelt option with a value": (
        lambda t: ["simulate", "passive-flexion", "--flx=3"],
        "did you mean --flexion?",
    ),
    "unknown choice": (
        lambda t: ["evaluate", "four_ligament", "x.csv", "--convention", "tibal"],
        "did you mean tibial?",
    ),
    "unknown experiment": (
        lambda t: ["simulate", "passive-flexon"],
        "did you mean passive-flexion?",
    ),
    "too many words": (
        lambda t: ["calibrate", "paper1", "extra"],
        "calibrate: argument: extra: expected no further argument",
    ),
    "unknown knee": (lambda t: ["describe", "four_ligamnt"], "did you mean four_ligament?"),
    "unknown knee as a file": (
        lambda t: ["describe", str(t / "four_ligamnt.yaml")],
        "did you mean four_ligament?",
    ),
    "unknown study": (lambda t: ["calibrate", "papr1"], "did you mean paper1?"),
    "unknown study as a file": (
        lambda t: ["calibrate", str(t / "papr1.yaml")],
        "did you mean paper1?",
    ),
    "no such study": (
        lambda t: ["calibrate", str(t / "nostudy.yaml")],
        "a bundled study (average_knee, four_ligament_fitted, lenhart2015_mri, paper1",
    ),
    "study of another name beside it": (
        lambda t: [study(t, TWIN)[0], str(t / "stdy.yaml")],
        "did you mean study.yaml?",
    ),
    "negative stiffness": (lambda t: bad_knee(t, "stiffness_N: 4500.0", "stiffness_N: -1"), "-1"),
    "unknown field": (lambda t: bad_knee(t, "stiffness_N: 4500.0", "stifness_N: 1"), "stiffness_N"),
    "slack length zero": (
        lambda t: bad_knee(t, "reference_strain: 0.03", "slack_length_mm: 0"),
        "slack_length_mm",
    ),
    "metres": (
        lambda t: bad_knee(t, "[-1.151, -0.054, 5.299]", "[-1151, -54, 5299]"),
        "femoral_attachment_mm",
    ),
    "directory": (lambda t: ["describe", str(t)], "directory"),
    "empty table": (lambda t: bad_table(t, ""), "empty"),
    "binary table": (lambda t: bad_table(t, bytes(range(256))), "poses.csv"),
    "NaN in a table": (lambda t: bad_table(t, POSES + "0,0,nan,0,0,1\n"), "nan"),
    "missing file": (lambda t: ["evaluate", "four_ligament", str(t / "no.csv")], "no.csv"),
    "unknown parameter": (
        lambda t: [*PASSIVE, "--set", "ACL.stifness=3", "--out", str(t / "o")],
        "ACL.stiffness",
    ),
    "set: a parameter of no ligament": (
        lambda t: simulate(t, "--set", "meniscus.tension=3"),
        "--set: unknown parameter 'meniscus.tension': expected a ligament, a group or a part of",
    ),
    "unknown parameter of a study": (
        lambda t: study(t, TWIN.replace('"*.stiffness"', "ACL.stifness")),
        "study.yaml: parameters[0]: ACL.stifness: expected a parameter of four_ligament; "
        "did you mean ACL.stiffness?",
    ),
    "unknown bounds of a study": (
        lambda t: study(t, TWIN.replace("stiffness: [300, 10000]", "ACL.stifness: [300, 10000]")),
        "study.yaml: bounds: ACL.stifness: expected a parameter of four_ligament; "
        "did you mean ACL.stiffness?",
    ),
    "unknown parameter of what a fibre wraps": (
        lambda t: study(t, TWIN.replace('"*.stiffness"', "quadriceps.tensio")),
        "study.yaml: unknown parameter 'quadriceps.tensio': expected a ligament, a group or a part",
    ),
    "unknown ligament": (lambda t: simulate(t, "--cut", "foo"), "expected one of ACL, PCL"),
    "cut twice": (lambda t: simulate(t, "--cut", "ACL", "--cut", "ACL"), "every name once"),
    "unknown load": (
        lambda t: simulate(t, "--load", "anterio_N=3"),
        "did you mean anterior_N?",
    ),
    "a load without its unit": (
        lambda t: simulate(t, "--load", "internal_rotation=5"),
        "did you mean internal_Nm?",
    ),
    "a moment in N mm": (
        lambda t: simulate(t, "--load", "varus_Nm=10000"),
        "N mm are suspected",
    ),
    "an absurd load": (
        lambda t: simulate(t, "--load", "anterior_N=1e30"),
        "between -100,000 and 100,000 N",
    ),
    "a load given twice": (
        lambda t: simulate(t, "--load", "varus_Nm=1", "--load", "varus_Nm=2"),
        "every name once",
    ),
    "set: negative stiffness": (
        lambda t: simulate(t, "--set", "ACL.stiffness=-5"),
        "--set: ACL.stiffness: -5: expected",
    ),
    "set: slack length zero": (
        lambda t: simulate(t, "--set", "ACL.slack_length=0"),
        "between 1 and 700 mm",
    ),
    "set: a strain that no length has": (
        lambda t: simulate(t, "--set", "ACL.reference_strain=-1.5"),
        "between -0.9 and 0.5",
    ),
    "set: an attachment far off": (
        lambda t: simulate(t, "--set", "ACL.tibial_attachment.superior=-900"),
        "--set: ACL.length: 900.1 mm",
    ),
    "absurd flexion": (
        lambda t: simulate(t, "--flexion", "0,1e30"),
        "between -30 and 180 degrees",
    ),
    "absurd pose": (
        lambda t: bad_table(t, POSES + "0,0,0,1e30,0,1\n"),
        "between -1000 and 1000 mm",
    ),
    "absurd range of a map": (
        lambda t: [
            "map",
            "paper1",
            "--pair",
            "ACL.stiffness",
            "PCL.stiffness",
            "--range",
            "ACL.stiffness=1:1e30",
            "--out",
            str(t / "o"),
        ],
        "10,000,000 N",
    ),
    "absurd sweep": (
        lambda t: ["sensitivity", "--sweep", "ACL.reference_strain=-5:5", "--out", str(t / "o")],
        "a strain, not percent",
    ),
    "absurd width": (
        lambda t: ["sensitivity", "--prior", "ACL.stiffness=1e-300", "--out", str(t / "o")],
        "--prior: ACL.stiffness: 1e-300: expected between 0.01 and",
    ),
    "flexion not a range": (
        lambda t: ["simulate", "passive-flexion", "--flexion", "0:x:5", "--out", str(t / "o")],
        "flexion",
    ),
    "bounds exclude the start": (
        lambda t: study(t, TWIN.replace("stiffness: [300, 10000]", "stiffness: [300, 4000]")),
        "exclude the start 4500",
    ),
    "unknown study field": (lambda t: study(t, TWIN + "boundz: 3\n"), "bounds"),
    "a parameter that is a number": (
        lambda t: study(t, TWIN.replace('["*.stiffness"', "[5")),
        "parameters[0]: 5: expected a text",
    ),
    "procedures that are a number": (
        lambda t: study(t, TWIN.replace("procedures: [", "procedures: 3 #")),
        "procedures: 3: expected a list of names",
    ),
    "a test whose name is a number": (
        lambda t: study(t, TWIN + "tests: [{name: 30, file: walker1988}]\n"),
        "tests[0].name: 30: expected a text",
    ),
    "a cohort whose tests are a number": (
        lambda t: cohort(t, "tests: 5", "side: left"),
        "tests: 5: expected a list of tests",
    ),
    "a cohort whose table is a list": (
        lambda t: cohort(t, "measured: {file: [1], source: us}", "side: left"),
        "measured.file: [1]: expected a text",
    ),
    "a cohort with a list about a knee": (
        lambda t: cohort(t, "title: a", "age: [1]", "about: [age]"),
        "age: [1]: expected a number",
    ),
    "a table of commas": (lambda t: bad_table(t, ",,,,,\n"), "header: empty: expected names of"),
    "flexion of the opposite sense": (
        lambda t: bad_table(t, POSES + "-89,0,0,1,2,3\n"),
        "row 1 (line 2), flexion_deg: -89: expected between -30 and 180 degrees",
    ),
    "an underscore in a number": (
        lambda t: bad_table(t, POSES + "0,0,0,1_0,2,3\n"),
        "anterior_mm: 1_0: expected a number",
    ),
    "digits of another script": (
        lambda t: bad_table(t, POSES + "0,0,0,١٢,2,3\n"),
        "anterior_mm: ١٢: expected a number",
    ),
    "no flexion": (
        lambda t: simulate(t, "--flexion", ""),
        "--flexion: empty: expected a value, not an empty text",
    ),
    "an option of another experiment, given as 0": (
        lambda t: simulate(t, "--moment_Nm", "0"),
        "--moment-Nm: passive-flexion: expected a test",
    ),
    "nowhere": (
        lambda t: [*PASSIVE, "--out", ""],
        "--out: empty: expected a value, not an empty text",
    ),
    "an underscore in an option": (
        lambda t: ["simulate", "drawer", "--force_N", "1_00"],
        "--force-N: 1_00: expected a number",
    ),
    "a slack length twice": (
        lambda t: simulate(t, "--set", "ACL.slack_length=20", "--set", "*.reference_strain=0.03"),
        "--set: ACL.slack_length and *.reference_strain give one number (slack length of ACL)",
    ),
    **{
        f"a load of the opposite sense: {said}": (
            lambda t, said=said: simulate(t, "--load", said),
            f"; did you mean {meant}?\n",
        )
        for said, meant in (
            ("posterior_N=90", "anterior_N=-90"),
            ("medial_N=5", "lateral_N=-5"),
            ("distraction_N=5", "compression_N=-5"),
            ("valgus_Nm=5", "varus_Nm=-5"),
            ("external_Nm=-5", "internal_Nm=5"),
            ("abduction=1", "varus_Nm=-1"),
        )
    },
}


@pytest.mark.parametrize("name", ["knee.yaml", "result.json"])
def test_the_knee_of_a_study_is_not_overwritten(name, tmp_path, unmeasured, capsys):
    knee = tmp_path / name
    found = json.dumps({"knee": "four_ligament", "parameters": {}})
    text = bundled_path("knees", "four_ligament").read_text() if name == "knee.yaml" else found
    knee.write_text(text)
    words = study(tmp_path, TWIN.replace("knee: four_ligament", f"knee: {name}"))
    assert main([*words[:2], "--out", str(tmp_path)]) == 2
    assert "another file than the knee that is calibrated" in capsys.readouterr().err
    assert knee.read_text() == text and not (tmp_path / "figures").exists()


@pytest.mark.parametrize("case", BAD)
def test_bad_input_is_one_line_and_status_2(case, tmp_path, capsys):
    arguments, expected = BAD[case]
    status = main(arguments(tmp_path))
    printed = capsys.readouterr()
    assert status == 2
    # A cohort's mistakes are counted in a line of their own.
    lines = printed.err.strip().splitlines()
    assert len([line for line in lines if "nothing was computed" not in line]) == 1
    assert expected in printed.err
    assert not (tmp_path / "out").exists() and not (tmp_path / "o").exists()


@pytest.mark.parametrize("option", [("--set", "{}.stiffness=3"), ("--cut", "{}")])
def test_a_name_of_thousands_of_letters_is_shown_by_its_beginning(option, tmp_path, capsys):
    assert main(simulate(tmp_path, option[0], option[1].format("A" * 5000))) == 2
    said = capsys.readouterr().err
    assert f"'{'A' * 60}...'" in said and len(said) < 400


def test_an_option_that_is_like_no_other_is_offered_none(capsys):
    assert main(["calibrate", "--colour", "blue"]) == 2
    assert "did you mean" not in capsys.readouterr().err


def test_every_mistake_of_a_study_has_a_line_of_its_own(tmp_path, capsys):
    words = study(tmp_path, TWIN.replace("seed: 1", "seed: -1") + "starts: 0\nboundz: 3\n")
    assert main(words) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 3 and all(line.startswith("kneejax: ") for line in lines)
    assert not (tmp_path / "out").exists()
