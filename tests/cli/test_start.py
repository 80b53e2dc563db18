"""What needs no knee is answered at once: help, versions, mistakes, places that take no files."""

import importlib.metadata
import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from kneejax import __version__, geometry
from kneejax.cli import main
from kneejax.cli._command import Place, Written, is_given, marks
from kneejax.cli._main import line
from kneejax.cli._settings import asked_for, command_again
from kneejax.cli._words import choices_of, plain_type
from kneejax.cli.options import ABOVE, EXAMPLE
from kneejax.cli.options.knees import Evaluate
from kneejax.files import bundled_path

HEAVY = {
    "jax", "equinox", "optimistix", "numpy", "scipy", "matplotlib", "trimesh", "yaml", "tqdm",
}  # fmt: skip


#: Words -> model, and those that only hold further commands.
COMMANDS = {tuple(words.split()): model for words, model in line().commands.items()}
EVERY = [*COMMANDS, *(tuple(words.split()) for words in ABOVE)]
WITH_OUT = [words for words, model in COMMANDS.items() if "out" in model.model_fields]
WITH_SETTINGS = [words for words, model in COMMANDS.items() if issubclass(model, Written)]
SHELLS = ("bash", "zsh", "fish")


def help_of(words, capsys):
    assert main([*words, "--help"]) == 0
    return capsys.readouterr().out


def example(words):
    """Of a command; those above several have that of the first one."""
    below = [one.example for name, one in COMMANDS.items() if words and name[: len(words)] == words]
    return [*below, EXAMPLE][0]


@pytest.mark.parametrize(
    ("words", "status", "allowed"),
    [
        ("", 0, set()),
        ("--help", 0, set()),
        ("simulate --help", 0, set()),
        ("joint fit --help", 0, set()),
        ("--version", 0, set()),
        ("calibrat", 2, set()),
        ("calibrate --outt x", 2, set()),
        ("calibrate --weigths x", 2, {"numpy", "yaml"}),
        ("knees", 0, {"yaml"}),
        ("completion fish", 0, {"yaml"}),
        (f"calibrate --out {os.devnull}/x", 2, set()),
        (f"rerun {os.devnull}", 2, set()),
        ("map misspelt.yaml --all-pairs", 2, {"numpy", "yaml"}),
    ],
)
def test_nothing_heavy_is_imported_for_a_quick_answer(words, status, allowed, tmp_path):
    study = bundled_path("studies", "paper1").read_text()
    (tmp_path / "misspelt.yaml").write_text(study.replace('"*.stiffness"', "ACL.stifness"))
    code = (
        "import sys\nfrom kneejax.cli import main\n"
        "try: status = main(sys.argv[1:])\n"
        "except SystemExit as ended: status = ended.code or 0\n"
        "print('modules', status, *sys.modules)"
    )
    command = [sys.executable, "-c", code, *words.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    _, found, *modules = done.stdout.splitlines()[-1].split()
    assert int(found) == status
    assert HEAVY & set(modules) <= allowed


@pytest.mark.parametrize(("asked", "level"), [(None, "3"), ("0", "0")])
def test_xla_is_silent_before_jax_is_imported_unless_somebody_asks(asked, level):
    """By the command line alone: who imports the package hears what JAX lets through."""
    code = (
        "import os, sys\n"
        "class Seen:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'jax':\n"
        "            print('level', os.environ.get('TF_CPP_MIN_LOG_LEVEL'))\n"
        "            raise SystemExit\n"
        "sys.meta_path.insert(0, Seen())\n"
        "import kneejax.cli\n"
        "print('before', os.environ.get('TF_CPP_MIN_LOG_LEVEL'))\n"
        "kneejax.cli.main(['describe', 'four_ligament'])"
    )
    kept = {name: word for name, word in os.environ.items() if name != "TF_CPP_MIN_LOG_LEVEL"}
    given = kept | ({} if asked is None else {"TF_CPP_MIN_LOG_LEVEL": asked})
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=given)
    assert done.stdout.split() == ["before", str(asked), "level", level]


def test_the_module_runs_and_without_a_command_it_helps():
    done = subprocess.run([sys.executable, "-m", "kneejax"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "calibrate" in done.stdout and "usage: kneejax" in done.stdout


def test_versions_are_those_that_are_installed(capsys):
    assert main(["--version"]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"kneejax {__version__}"
    for package in ("jax", "numpy", "optimistix"):
        assert f"{package} {importlib.metadata.version(package)}" in second


@pytest.mark.parametrize("words", EVERY, ids=" ".join)
def test_help_begins_with_a_sentence_and_ends_with_an_example(words, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "300")  # no line is broken
    lines = help_of(words, capsys).rstrip().splitlines()
    assert re.fullmatch(r"[A-Z].*\.", lines[0].rstrip()) and len(lines[0].rstrip()) < 90
    assert lines[-2].rstrip() == "example:" and lines[-1].strip() == example(words)
    assert f"kneejax {' '.join(words)}".strip() in example(words)


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_explains_every_argument_with_its_default(words, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "999")  # no line is broken
    lines = help_of(words, capsys).splitlines()
    said = " ".join(" ".join(lines).split())
    for field in COMMANDS[words].model_fields.values():
        default = field.get_default(call_default_factory=True)
        assert field.description and field.description in said
        assert marks(field, Place) or f"--{field.alias}" in said
        name = "" if marks(field, Place) else f"--{field.alias} "
        own = next(x for x in lines if name in x and field.description in " ".join(x.split()))
        assert {*choices_of(field.annotation)} <= {*re.findall(r"[\w'-]+", own)}
        if is_given(default) and not field.is_required() and field.alias != "out":
            shown = "x".join(map(str, default)) if isinstance(default, tuple) else default
            assert f"(default: {shown})" in said


@pytest.mark.parametrize("words", EVERY, ids=" ".join)
def test_the_example_is_a_command_line(words):
    """Of several commands in a row each one; $(...) is what a shell puts in its place."""
    for command in re.sub(r'eval "\$\((.*)\)"', r"\1", example(words)).split(" && "):
        name, *rest = command.split()
        assert name == "kneejax" and line().read(rest) is not None


@pytest.mark.parametrize(
    ("word", "near"), [("help", "--help"), ("version", "--version"), ("knes", "knees")]
)
def test_the_nearest_command_or_option_is_named(word, near, capsys):
    assert main([word]) == 2 and f"did you mean {near}?" in capsys.readouterr().err


@pytest.mark.parametrize("word", ["--force_N=5", "--force-N=5"])
def test_an_option_has_its_older_spelling_too(word):
    assert line().read(["simulate", "drawer", word]).force_N == 5.0


def test_all_mistakes_of_a_command_line_are_reported_at_once(capsys):
    words = "simulate drawr --force-N x --convention tibal --duration-s 500"
    assert main(words.split()) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 4 and all(line.startswith("kneejax: ") for line in lines)


def test_conventions_are_those_of_the_package():
    choices = choices_of(Evaluate.model_fields["convention"].annotation)
    assert choices == tuple(geometry.CONVENTIONS)


@pytest.mark.parametrize("words", WITH_SETTINGS, ids=" ".join)
def test_an_example_is_recorded_and_asked_for_again(words):
    assert_asked_again(example(words).split(" && ")[-1].split()[1:])


@pytest.mark.parametrize(
    "words",
    [
        "simulate passive-flexion --flexion=-10:30:5 --set ACL.stiffness=300 --set=*.slack_length=9"
        " --load anterior_N=-1e-7 --cut ACL --cut PCL --branches --convention tibial",
        "map --pair A.x B.x --pair A.x C.x --all-pairs --grid 5x7 --range A.x=-1:2",
        "sensitivity twin.yaml --sweep A.x --sweep B.x=0:1:5 --global morris --samples 8",
        "sensitivity --knees four_ligament knee.yaml",
        "identify --noise-mm 1e-5 --prior *.x=1:inf --posterior --candidates tests.csv",
        "joint fit poses.csv --femur f.stl --at -5 0.5 90 --medial-epicondyle -0.00001 0 1e30"
        " --lateral-epicondyle 1 2 -3 --column flexion_deg=7 --extension-facet 60 100",
        "joint compare a.csv b.csv --joint x=a.yaml,b.yaml --calibrate-at 0 90 --axes c --no-anova",
        "joint compare a.csv --knee four_ligament --anova --spread 0.1",
        "import stl --femur-cartilage f --tibia-cartilage t --side l --angle -10 160.5 --notch -1",
    ],
)
def test_arguments_are_recorded_and_asked_for_again(words):
    assert_asked_again(words.split())


def assert_asked_again(words):
    asked = line().read([*words, "--out", "somewhere"])
    settings = json.loads(json.dumps(asked_for(asked)))
    assert settings["command"].split() == words[: len(settings["command"].split())]
    settings["versions"] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.path.exists", lambda path: True)
        file = Path("settings.json")
        again = command_again(settings, line().commands, file, Path("somewhere"))
    assert again == asked


@pytest.mark.parametrize(
    "settings",
    [
        {"command": "simulate", "experiment": "drawer", "knee": "four_ligament", "flexion": "0:9:3",
         "force_N": 100.0, "moment_Nm": None, "hold": ["adduction"], "both": True, "set": {},
         "load": {"anterior_N": 5.0}, "from": [], "free": [], "loads": None, "dynamic": False},
        {"command": "map", "study": "paper1", "pair": [["A.x", "B.x"]], "all-pairs": False,
         "grid": "5x7", "range": ["A.x=-1:2"], "svg": False},
        {"command": "identify", "study": "paper1", "noise-mm": 0.1, "prior": ["*.x=1:inf"]},
        {"command": "sensitivity", "study": "paper1", "sweep": ["A.x", "B.x=0:1:5"], "knees": None,
         "global": "morris", "samples": 8, "prior": ["A.x=3"]},
        {"command": "joint fit", "poses": None, "knee": "four_ligament", "at": [0.0, 90.0],
         "medial-epicondyle": None, "column": None},
        {"command": "import osim", "file": "m.osim", "side": "r", "at": ["hip_flexion_r=5"]},
        {"command": "calibrate", "study": "cohort", "shard": "3/20", "blocks": None, "jobs": None},
    ],
    ids=lambda one: one["command"],
)  # fmt: skip
def test_settings_of_earlier_versions_are_understood(settings, monkeypatch):
    monkeypatch.setattr("os.path.exists", lambda path: True)
    more = {"working_folder": "/", "versions": {}}
    commands = line().commands
    again = command_again(settings | more, commands, Path("settings.json"), Path("out"))
    recorded = again.settings()
    for name, value in settings.items():
        if isinstance(value, float | bool):
            assert recorded[name.replace("_", "-")] == value


def needed(words):
    """Words for everything that a command cannot do without."""
    given = list(words)
    for field in COMMANDS[words].model_fields.values():
        number = plain_type(field.annotation) in (int, float)
        word = next(iter(choices_of(field.annotation)), "1" if number else "x")
        if marks(field, Place) and field.is_required():
            given.append(word)
        elif field.is_required() and field.alias != "out":
            given += [f"--{field.alias}", word]
    more = {"activity": ["x.sto"], "fit": ["x.csv", "--axes", "x.csv"]}
    return given + more.get(words[-1], [])


@pytest.mark.parametrize("words", WITH_OUT, ids=" ".join)
def test_a_place_that_takes_no_files_is_known_before_anything_else(
    words, tmp_path, monkeypatch, capsys
):
    """Once it was said after the work; and as root, who may write everywhere, on Linux's /proc."""
    monkeypatch.setattr("kneejax.cli._main.prepare_jax", lambda: pytest.fail("JAX came first"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    for place in ("file/x", *(["/proc/x"] if os.path.isdir("/proc/self") else [])):
        out = os.path.join(place, "new.osim") if words[0] == "export" else os.path.normpath(place)
        assert main([*needed(words), "--out", out]) == 2
        error = capsys.readouterr().err
        assert error.startswith(f"kneejax: --out: folder: {out}") and error.count("\n") == 1


def test_the_trial_leaves_nothing_behind(tmp_path):
    out = tmp_path / "a" / "b"
    assert main(["evaluate", "four_ligamnt", "x.csv", "--out", str(out)]) == 2
    assert not list(tmp_path.iterdir())
    out.mkdir(parents=True)
    assert main(["evaluate", "four_ligamnt", "x.csv", "--out", str(out)]) == 2
    assert out.is_dir() and not list(out.iterdir())


@pytest.mark.parametrize("shell", SHELLS)
def test_a_shell_completes_every_command_and_option(shell, capsys):
    assert main(["completion", shell]) == 0
    script = capsys.readouterr().out
    for words, model in COMMANDS.items():
        assert all(word in script for word in words)
        options = (field for field in model.model_fields.values() if not marks(field, Place))
        assert all((field.alias or "") in script for field in options)
    # Names of bundled knees, studies and plans too.
    assert all(name in script for name in ("lenhart2015_reduced", "paper1", "ten_bundle"))


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("si", "simulate"),
        ("joint c", "compare"),
        ("describe len", "lenhart2015 lenhart2015_reduced"),
        ("simulate drawer --knee t", "ten_bundle twelve_bundle"),
        ("simulate drawer --fo", "--force-N"),
        ("calibrate pa", "paper1 passive_flexion"),
        ("evaluate four_ligament --convention g", "grood-suntay"),
    ],
)
def test_bash_offers_commands_options_choices_and_bundled_names(line, offered, capsys):
    assert main(["completion", "bash"]) == 0
    script = capsys.readouterr().out
    ask = f"COMP_WORDS=(kneejax {line}); COMP_CWORD=$((${{#COMP_WORDS[@]}}-1)); COMPREPLY=()"
    code = f'{script}\n{ask}; _kneejax; echo "${{COMPREPLY[*]}}"'
    done = subprocess.run(["bash", "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == offered


def command(code, *words, **options):
    """A process of its own, in which some code comes before the command."""
    code = f"import os, signal, sys\n{code}\nfrom kneejax.cli import main\nsys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *words], text=True, stderr=subprocess.PIPE, **options
    )


def test_ctrl_c_while_jax_is_imported_is_one_line():
    # Tests that run behind a shell ignore Ctrl-C, and so would the command.
    code = (
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "class Seen:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'jax': os.kill(os.getpid(), signal.SIGINT)\n"
        "sys.meta_path.insert(0, Seen())"
    )
    done = command(code, "describe", "four_ligament", stdout=subprocess.PIPE)
    assert done.returncode == 130
    assert done.stderr == "kneejax: stopped; no half-written files are left\n"


@pytest.mark.skipif(sys.platform == "win32", reason="shells of Unix close streams")
def test_without_a_place_to_print_to_a_command_that_only_prints_says_so():
    done = command("os.close(1); sys.stdout = None", "knees")
    assert done.returncode == 2
    assert done.stderr == "kneejax: stdout: stream: closed: expected a place to print to\n"


def test_a_platform_that_is_not_there_is_named_with_its_variable(monkeypatch):
    import jax

    from kneejax.cli import _main
    from kneejax.files import InputProblem

    def devices():
        raise RuntimeError("Unable to initialize backend 'tpu'")

    monkeypatch.setenv("JAX_PLATFORMS", "tpu")
    monkeypatch.setattr(jax, "devices", devices)
    with pytest.raises(InputProblem, match="^environment: JAX_PLATFORMS: tpu: expected a platform"):
        _main.prepare_jax()
