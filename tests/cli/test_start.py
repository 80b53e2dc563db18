"""What needs no knee is answered at once: help, versions, mistakes, places that take no files."""

import argparse
import importlib.metadata
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from kneejax import __version__, geometry
from kneejax.cli import main
from kneejax.cli._commands import SHELLS, build_parser
from kneejax.cli._parser import CONVENTIONS
from kneejax.cli._settings import asked_for, words_again

HEAVY = {
    "jax", "equinox", "optimistix", "numpy", "scipy", "matplotlib", "trimesh", "yaml", "tqdm",
    "shtab",
}  # fmt: skip


def parsers(parser=None, words=()):
    """Every command's words and parser; those that only hold further commands too."""
    parser = build_parser() if parser is None else parser
    yield words, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from parsers(below, (*words, name))


COMMANDS = dict(parsers())
#: These write a file, or let another command write.
WITHOUT_SETTINGS = {("export", "osim"), ("rerun",)}
WITH_OUT = [w for w, p in COMMANDS.items() if "--out" in p._option_string_actions]
WITH_SETTINGS = [words for words in WITH_OUT if words not in WITHOUT_SETTINGS]


def example(parser):
    return parser.format_help().rstrip("\n").splitlines()[-1].strip()


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
        ("calibrate --weigths x", 2, set()),
        ("knees", 0, {"yaml"}),
        ("completion fish", 0, {"shtab"}),
        (f"calibrate --out {os.devnull}/x", 2, set()),
        (f"rerun {os.devnull}", 2, set()),
    ],
)
def test_nothing_heavy_is_imported_for_a_quick_answer(words, status, allowed):
    code = (
        "import sys\nfrom kneejax.cli import main\n"
        "try: status = main(sys.argv[1:])\n"
        "except SystemExit as ended: status = ended.code or 0\n"
        "print('modules', status, *sys.modules)"
    )
    command = [sys.executable, "-c", code, *words.split()]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
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
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first == f"kneejax {__version__}"
    for package in ("jax", "numpy", "optimistix"):
        assert f"{package} {importlib.metadata.version(package)}" in second


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_begins_with_a_sentence_and_ends_with_an_example(words):
    parser = COMMANDS[words]
    lines = parser.format_help().splitlines()
    assert re.fullmatch(r"[A-Z].*\.", lines[0]) and len(lines[0]) < 80
    assert lines[-2] == "example:"
    assert f"kneejax {' '.join(words)}".strip() in example(parser)
    # To show the help must leave the parser as it was.
    assert parser.format_help().splitlines() == lines


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_help_explains_every_argument_with_its_default(words, monkeypatch):
    monkeypatch.setenv("COLUMNS", "999")  # no line is broken
    parser = COMMANDS[words]
    said = " ".join(parser.format_help().split())
    for action in parser._actions:
        assert action.help or isinstance(action, argparse._SubParsersAction), action.dest
        if action.default not in (None, argparse.SUPPRESS, []) and action.default is not False:
            assert f"(default: {action.default})" in said


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_the_example_is_a_command_line(words):
    """Of several commands in a row each one; $(...) is what a shell puts in its place."""
    lines = re.sub(r'eval "\$\((.*)\)"', r"\1", example(COMMANDS[words])).split(" && ")
    for line in lines:
        name, *rest = line.split()
        chosen, unknown = build_parser().parse_known_args(rest)
        assert name == "kneejax" and not unknown and chosen.command


@pytest.mark.parametrize(
    ("word", "near"), [("help", "--help"), ("version", "--version"), ("knes", "knees")]
)
def test_the_nearest_command_or_option_is_named(word, near, capsys):
    with pytest.raises(SystemExit) as ended:
        main([word])
    assert ended.value.code == 2 and f"did you mean {near}?" in capsys.readouterr().err


def test_conventions_are_those_of_the_package():
    assert CONVENTIONS == tuple(geometry.CONVENTIONS)


@pytest.mark.parametrize("words", WITH_SETTINGS, ids=" ".join)
def test_an_example_is_recorded_and_asked_for_again(words):
    assert_asked_again(example(COMMANDS[words]).split(" && ")[-1].split()[1:])


@pytest.mark.parametrize(
    "line",
    [
        "simulate passive-flexion --flexion=-10:30:5 --set ACL.stiffness=300 --set=*.slack_length=9"
        " --load anterior_N=-1e-7 --cut ACL --cut PCL --branches --convention tibial",
        "map --pair A.x B.x --pair A.x C.x --all-pairs --grid 5x7 --range A.x=-1:2",
        "sensitivity twin.yaml --sweep A.x --sweep B.x=0:1:5 --global morris --samples 8",
        "sensitivity --knees four_ligament knee.yaml",
        "identify --noise-mm 1e-5 --prior *.x=1:inf --posterior --candidates tests.csv",
        "joint fit poses.csv --femur f.stl --at -5 0.5 90 --medial-epicondyle -0.00001 0 1e30"
        " --column flexion_deg=7 --extension-facet 60 100",
        "joint compare a.csv b.csv --joint x=a.yaml,b.yaml --calibrate-at 0 90 --no-anova",
        "joint compare a.csv --knee four_ligament --anova --average-within 0.1",
        "import stl --femur-cartilage f --tibia-cartilage t --side l --angle -10 160.5 --notch -1",
    ],
)
def test_arguments_are_recorded_and_asked_for_again(line):
    assert_asked_again(line.split())


def assert_asked_again(words):
    parser = build_parser()
    chosen = parser.parse_args([*words, "--out", "somewhere"])
    settings = json.loads(json.dumps(asked_for(chosen)))
    assert settings["command"].split() == words[: len(settings["command"].split())]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("os.path.exists", lambda path: True)
        again = words_again(settings, parser, Path("settings.json"))
    found = vars(parser.parse_args([*again, "--out", "somewhere"]))
    numbers = {name: asked_for(parser.parse_args(again))[name] for name in settings}
    assert numbers == settings and found.keys() == vars(chosen).keys()


def needed(words):
    """Words for everything that a command cannot do without."""
    given = list(words)
    for action in COMMANDS[words]._actions:
        word = str(next(iter(action.choices or ["x"])))
        if action.required and action.option_strings and action.dest != "out":
            given += [action.option_strings[0], word]
        elif not action.option_strings and action.nargs != "?":
            given.append(word)
    return given


@pytest.mark.parametrize("words", WITH_OUT, ids=" ".join)
def test_a_place_that_takes_no_files_is_known_before_anything_else(
    words, tmp_path, monkeypatch, capsys
):
    """Once it was said after the work; and as root, who may write everywhere, on Linux's /proc."""
    monkeypatch.setattr("kneejax.cli._main._prepare_jax", lambda: pytest.fail("JAX came first"))
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
    for words, parser in COMMANDS.items():
        assert all(word in script for word in words)
        options = [name for name in parser._option_string_actions if name.startswith("--")]
        assert all(name.lstrip("-") in script for name in options)


def command(code, *words, **options):
    """A process of its own, in which some code comes before the command."""
    code = f"import os, signal, sys\n{code}\nfrom kneejax.cli import main\nsys.exit(main())"
    return subprocess.run(
        [sys.executable, "-c", code, *words], text=True, stderr=subprocess.PIPE, **options
    )


def test_ctrl_c_while_jax_is_imported_is_one_line():
    code = (
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
        _main._check_platform("JAX_PLATFORMS")
