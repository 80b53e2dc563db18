"""Thousands of damaged inputs and wrong command lines, each answered in one line or taken.

    python benchmarks/fuzz.py --count 5000 --seed 0

Every file of every kind is damaged in one to three ways (bytes flipped, cut or doubled; values
exchanged, made huge, deep or of another type; keys twice; other encodings) and read as a command
reads it; nothing is solved. The same seed gives the same inputs. A reader has 2 s and 1 GB.
"""

from __future__ import annotations

import argparse
import collections
import contextlib
import dataclasses
import functools
import io
import os
import random
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from damage import (
    AXES,
    CANDIDATES,
    COHORT,
    DRAWER,
    GRF,
    JOINT,
    KNEES,
    LANDMARKS,
    LOADS,
    LOADS_XML,
    OFTEN,
    PLAN,
    POSES,
    RESULT,
    SETTINGS,
    STO,
    STUDY,
    WAYS,
)

ROOT = Path(__file__).resolve().parents[1]
SECONDS, BYTES = 2.0, 2**30
#: Characters of a refusal at most.
LONGEST = 2500
ACCEPTED, REFUSED = "accepted", "refused"
TRACEBACK, NO_FILE, SLOW, BIG = "traceback", "not one line with its file", "too slow", "too big"
FAULTS = (TRACEBACK, NO_FILE, SLOW, BIG)


@dataclasses.dataclass(frozen=True)
class Kind:
    """A kind of input: files of a folder, the one that is damaged, and how it is read."""

    files: dict[str, bytes]
    damaged: str
    read: Callable[[Path], Any]


@dataclasses.dataclass(frozen=True)
class Answer:
    """What a reader made of an input."""

    kind: str
    number: int
    ways: tuple[str, ...]
    outcome: str
    sentence: str
    seconds: float
    data: bytes = dataclasses.field(repr=False, default=b"")


def kinds() -> dict[str, Kind]:
    """Every kind of input by its name."""
    import trimesh

    from kneejax import files
    from kneejax.cli._main import line
    from kneejax.cli._settings import command_again, read_settings
    from kneejax.cohorts import read_cohort
    from kneejax.files.meshes.points import read_mesh_points
    from kneejax.files.opensim.acting import read_external_loads
    from kneejax.files.opensim.model import read_model
    from kneejax.files.tables import storage as storages
    from kneejax.studies import read_study
    from kneejax.studies._acl_plan import read_plan

    model = ROOT / "tests/files/opensim/models/right_schema3.osim"
    body = next(iter(read_model(model).bodies))
    sphere = trimesh.creation.icosphere(1, 20.0)

    def mesh(kind: str, **options) -> bytes:
        data = sphere.export(file_type=kind, **options)
        return data.encode() if isinstance(data, str) else data

    def storage(path: Path) -> None:
        table = files.read_storage(path)
        storages.angles_rad(table, "knee_angle_r")
        table.at(storages.common_times([table], 5), [*table.columns])

    def settings(path: Path) -> None:
        command_again(read_settings(path.parent), line().commands, path, path.parent)

    def one(name: str, data: bytes, read: Callable[[Path], Any], **beside: bytes) -> Kind:
        files = {key.replace("_", "."): value for key, value in beside.items()}
        return Kind({name: data, **files}, name, read)

    knee = files.bundled_path("knees", "four_ligament").read_bytes()
    patella = files.bundled_path("knees", "ten_bundle").read_bytes()
    osim = functools.partial(files.import_osim, side="r")
    landmarks = lambda path: (files.read_femur_landmarks(path), files.read_tibia_landmarks(path))  # noqa: E731
    table = {"poses_csv": POSES, "drawer_csv": DRAWER}
    return {
        "knee": one("knee.yaml", knee, files.load_knee_file),
        "knee of many fibres": one("knee.yaml", patella, files.load_knee_file),
        "result": one("result.json", RESULT, files.load_knee_file),
        "study": one("study.yaml", STUDY, read_study, **table),
        "cohort": one("cohort.yaml", COHORT, read_cohort, knees_csv=KNEES, **table),
        "cohort's table": Kind(
            {"knees.csv": KNEES, "cohort.yaml": COHORT, "poses.csv": POSES}, "knees.csv",
            lambda path: read_cohort(path.parent / "cohort.yaml"),
        ),
        "plan": one("plan.yaml", PLAN, read_plan),
        "settings": one("settings.json", SETTINGS, settings),
        "poses": one("poses.csv", POSES, files.read_poses),
        "test": one("drawer.csv", DRAWER, files.read_lab_table),
        "loads over time": one("loads.csv", LOADS, files.read_loads_over_time),
        "candidates": one("tests.csv", CANDIDATES, files.read_candidates),
        "storage": one("walk.sto", STO, storage),
        "joint": one("joint.yaml", JOINT, files.read_joint),
        "axes": one("axes.yaml", AXES, files.read_axis_points),
        "landmarks": one("landmarks.yaml", LANDMARKS, landmarks),
        "osim": one("knee.osim", model.read_bytes(), osim),
        "external loads": one(
            "loads.xml", LOADS_XML % body.encode(),
            lambda path: read_external_loads(path, read_model(model)), grf_sto=GRF,
        ),
        "stl": one("bone.stl", mesh("stl"), read_mesh_points),
        "stl of text": one("bone.stl", mesh("stl_ascii"), read_mesh_points),
        "ply": one("bone.ply", mesh("ply"), read_mesh_points),
        "ply of text": one("bone.ply", mesh("ply", encoding="ascii"), read_mesh_points),
        "obj": one("bone.obj", mesh("obj"), read_mesh_points),
    }  # fmt: skip


def inputs(count: int, seed: int, every: dict[str, Kind]) -> Iterator[tuple]:
    """Kind, number, ways and content of each damaged input; each by its number alone."""
    names, ways = [*every], [*WAYS]
    often = [OFTEN.get(way, 1) for way in ways]
    for number in range(count):
        draw = random.Random(f"{seed} {number}")
        kind, data, done = names[number % len(names)], b"", []
        data = every[kind].files[every[kind].damaged]
        for way in draw.choices(ways, often, k=draw.choice((1, 1, 1, 2, 3))):
            if data:
                data = WAYS[way](data, draw)
                done.append(way)
        yield kind, number, tuple(done), data


class _TooSlow(BaseException):
    """A reader had its time."""


@contextlib.contextmanager
def limited() -> Iterator[None]:
    """Two seconds of the processor, and a gigabyte more, where the system can limit them."""

    def end(*_):
        raise _TooSlow

    if not hasattr(signal, "SIGPROF") or not os.path.exists("/proc/self/statm"):
        yield
        return
    import resource

    has = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    before = resource.getrlimit(resource.RLIMIT_AS)
    handler = signal.signal(signal.SIGPROF, end)
    resource.setrlimit(resource.RLIMIT_AS, (has + BYTES, before[1]))
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        resource.setrlimit(resource.RLIMIT_AS, before)
        signal.signal(signal.SIGPROF, handler)


def answer(kind: str, one: Kind, number: int, ways: tuple[str, ...], data: bytes, folder: Path):
    """Read a damaged input as a command would."""
    from kneejax.files import InputProblem, InputProblems
    from kneejax.mechanics import Implausible
    from kneejax.numerics import MissingPackage
    from kneejax.parameters import UnknownParameter, UnsuitableData

    for name, content in one.files.items():
        (folder / name).write_bytes(data if name == one.damaged else content)
    begin, sentence = time.process_time(), ""
    try:
        with limited(), contextlib.redirect_stderr(io.StringIO()):
            one.read(folder / one.damaged)
        outcome = ACCEPTED
    except InputProblems as problem:
        sentence = "; ".join(map(str, problem.problems))
        lines = str(problem).split("\n")
        whole = len(lines) == len(problem.problems) and max(map(len, lines)) <= LONGEST
        good = whole and all(str(folder) in line for line in lines)
        outcome = REFUSED if good else NO_FILE
    except (InputProblem, UnknownParameter, UnsuitableData, Implausible, MissingPackage) as problem:
        sentence = str(problem)
        # Of the file or another that it names, or of something bundled that is not there.
        named = str(folder) in sentence or sentence.startswith(("bundled data", "knee: name"))
        whole = "\n" not in sentence and len(sentence) <= LONGEST
        outcome = REFUSED if named and whole else NO_FILE
    except _TooSlow:
        outcome = SLOW
    except MemoryError:
        outcome = BIG
    except Exception as problem:
        place = traceback.extract_tb(problem.__traceback__)[-1]
        outcome = TRACEBACK
        sentence = f"{type(problem).__name__}: {problem} ({place.filename}:{place.lineno})"
    return Answer(kind, number, ways, outcome, sentence, time.process_time() - begin, data)


def answers(count: int, seed: int = 0) -> list[Answer]:
    """Read so many damaged inputs."""
    every = kinds()
    with tempfile.TemporaryDirectory() as top:
        for number, (kind, one) in enumerate(every.items()):
            (Path(top) / str(number)).mkdir()
            whole = one.files[one.damaged]
            # What is imported and compiled once is not what a damaged file takes.
            undamaged = _unlimited(kind, one, whole, Path(top) / str(number))
            assert undamaged.outcome == ACCEPTED, (kind, undamaged)
        places = {kind: Path(top) / str(number) for number, kind in enumerate(every)}
        return [
            answer(kind, every[kind], number, ways, data, places[kind])
            for kind, number, ways, data in inputs(count, seed, every)
        ]


def _unlimited(kind: str, one: Kind, data: bytes, folder: Path) -> Answer:
    for name, content in one.files.items():
        (folder / name).write_bytes(content)
    try:
        one.read(folder / one.damaged)
    except ValueError as problem:
        return Answer(kind, -1, (), REFUSED, str(problem), 0.0)
    return Answer(kind, -1, (), ACCEPTED, "", 0.0)


def command_lines(count: int, seed: int = 0) -> list[list[str]]:
    """Wrong command lines: of every command, an option that is not there, or a wrong value."""
    from kneejax.cli._command import Place, marks
    from kneejax.cli._main import line
    from kneejax.cli._words import choices_of, plain_type

    found = []
    for command, model in line().commands.items():
        fields = model.model_fields.values()
        places = [x for x in fields if marks(x, Place) and x.is_required()]
        words = [next(iter(choices_of(x.annotation)), "four_ligament") for x in places]
        filled = [*command.split(), *words]
        found += [[*filled, "--nonsense"], [*filled, "x", "y", "z", "ü", "1"]]
        for field in fields:
            kind, flag = plain_type(field.annotation), f"--{field.alias}"
            if marks(field, Place) or kind is bool:
                continue
            found += [[*filled, flag, ""], [*filled, flag]]
            if kind in (int, float):
                found += [[*filled, flag, value] for value in ("1_000", "x", "١٢", "0x10", "1,5")]
            if choices_of(kind):
                found.append([*filled, flag, "nonsense"])
    return random.Random(seed).sample(found, min(count, len(found)))


def refused(words: list[str]) -> str:
    """What is wrong with an answer; empty where it is status 2 and a line for each mistake."""
    from kneejax.cli import main

    said = io.StringIO()
    warnings.filterwarnings("ignore", "kneejax.configure.. comes too late", RuntimeWarning)
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            status = main(words)
    except SystemExit as ended:
        status = ended.code
    lines = said.getvalue().splitlines()
    good = status == 2 and lines and all(line.startswith("kneejax: ") for line in lines)
    return "" if good else f"{words}: {status}: {lines}"


def run() -> int:
    """Print what became of every kind, and every fault."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--commands", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--accepted", type=Path, help="folder for those that were accepted")
    given = parser.parse_args()
    found = answers(given.count, given.seed)
    table = collections.Counter((one.kind, one.outcome) for one in found)
    outcomes = (ACCEPTED, REFUSED, *FAULTS)
    for kind in dict.fromkeys(one.kind for one in found):
        numbers = ", ".join(f"{x} {table[kind, x]}" for x in outcomes if table[kind, x])
        seconds = sum(one.seconds for one in found if one.kind == kind)
        print(f"{kind}: {numbers}; {seconds:.1f} s")
    for outcome in outcomes:
        print(f"all {outcome}: {sum(one.outcome == outcome for one in found)}")
    slowest = max(found, key=lambda one: one.seconds)
    total = sum(one.seconds for one in found)
    print(f"{total:.0f} s; the slowest {slowest.seconds:.2f} s: {slowest.number} {slowest.kind}")
    seen = collections.Counter()
    for one in found:
        if one.outcome in FAULTS:
            seen[one.outcome, one.sentence[-120:]] += 1
            if seen[one.outcome, one.sentence[-120:]] == 1:
                print(f"{one.number} {one.kind} {one.ways}: {one.outcome}: {one.sentence[:400]}")
    if given.accepted:
        given.accepted.mkdir(parents=True, exist_ok=True)
        for one in found:
            if one.outcome == ACCEPTED:
                name = f"{one.number:05d} {one.kind}".replace(" ", "_")
                (given.accepted / name).write_bytes(one.data)
    wrong = [
        said for words in command_lines(given.commands, given.seed) if (said := refused(words))
    ]
    print(f"command lines: {given.commands}, wrongly answered {len(wrong)}")
    print("\n".join(wrong))
    return int(bool(wrong) or any(one.outcome in FAULTS for one in found))


if __name__ == "__main__":
    import jax

    jax.config.update("jax_enable_x64", True)
    sys.exit(run())
