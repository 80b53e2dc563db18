"""Thousands of damaged inputs and wrong command lines, each answered in one line or taken.

    python tests/fuzz.py --count 5000 --seed 0

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
import json
import os
import random
import re
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

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


POSES = (
    b"flexion_deg,adduction_deg,internal_rotation_deg,anterior_mm,superior_mm,lateral_mm\n"
    b"0,0.4,-3.1,2.0,-30.1,1.1\n15,1.2,0.5,3.4,-30.9,1.3\n30,1.9,4.2,4.1,-31.7,1.2\n"
    b"60,2.8,7.9,3.0,-32.2,0.8\n90,3.4,9.1,1.2,-32.6,0.5\n"
)
DRAWER = b"flexion_deg,anterior_N,anterior_mm,weight\n30,-90,-3.9,1\n30,0,0,1\n30,90,4.8,1\n"
LOADS = b"time_s,anterior_N,internal_Nm\n0,0,0\n0.1,50,1\n0.2,100,2\n"
CANDIDATES = b"flexion_deg,anterior_N,varus_Nm,name\n30,134,0,Lachman\n90,0,10,varus\n"
STUDY = b"""title: Two tests
knee: four_ligament
measured: {file: poses.csv, source: a robot, columns: {flexion_deg: flexion_deg}}
parameters: ["*.stiffness", ACL.reference_strain]
start: {"*.stiffness": 5000}
bounds: {ACL.reference_strain: [-0.1, 0.1]}
prior: {stiffness: 2000}
weights: {mm: 1, deg: 0.5}
procedures: [III]
starts: 2
seed: 3
noise_mm: 0.3
noise_deg: 0.3
frame_offset: [anterior]
set: {PCL.slack_length: 35}
tests:
  - {name: drawer, file: drawer.csv, sd_mm: 0.5, counted_from: least_load, flexion_deg: [30],
     constant: {compression_N: 20}, cut: [LCL]}
"""
COHORT = b"""title: Two knees
study:
  title: a
  knee: four_ligament
  parameters: ["*.stiffness"]
  measured: {file: poses.csv, source: a robot}
  noise_mm: 0.3
  noise_deg: 0.3
knees: knees.csv
about: [age]
"""
KNEES = b"name,side,age,noise_mm,set.ACL.stiffness\nK1,right,61,0.2,4000\nK2,left,70,0.3,5000\n"
PLAN = b"""title: One graft
knee: ten_bundle
ligament: ACL
graft: {type: hamstring, bundles: 1, stiffness_N: 5000}
fixation: {flexion_deg: 20, tension_N: 80}
lachman: {flexion_deg: [20, 90], force_N: 100}
limits: {graft_N: 400, laxity_band_mm: 2, tension_N: [20, 150]}
octagon_apothem_mm: 10
map: {points: 15}
set: {PCL.stiffness: 9000}
"""
JOINT = b"""kneejax: joint
name: hinge
side: left
interpolation: linear
knots:
  - {flexion_deg: 0, femoral_medial_mm: [0, 0, 20], femoral_lateral_mm: [0, 0, -20],
     tibial_medial_mm: [0, 30, 20], tibial_lateral_mm: [0, 30, -20]}
  - {flexion_deg: 90, femoral_medial_mm: [1, 0, 20], femoral_lateral_mm: [1, 0, -20],
     tibial_medial_mm: [0, 31, 20], tibial_lateral_mm: [0, 31, -20]}
"""
AXES = b"""extension: {medial_mm: [6, 8, -21.5], lateral_mm: [1, 11, 23]}
flexion: {medial_mm: [0.5, 1.5, -21], lateral_mm: [-2, 1, 23.5]}
"""
LANDMARKS = b"""epicondyles: {medial_mm: [0, 0, -40], lateral_mm: [0, 0, 40]}
femoral_head: {near_mm: [0, 400, -20], within_mm: 25}
tibia:
  plateau: {medial_mm: [0, 0, -35], lateral_mm: [0, 0, 35]}
  ankle_center_mm: [-30, -380, 3]
"""
STO = (
    b"walk\nversion=1\nnRows=4\nnColumns=3\ninDegrees=yes\nendheader\ntime\tknee_angle_r\thip\n"
    b"0\t-5\t3\n0.1\t-17\t4\n0.2\t-30.5\t5\n0.3\t-41\t6\n"
)
GRF = b"grf\nnRows=2\nnColumns=10\ninDegrees=yes\nendheader\ntime\t" + b"\t".join(
    f"g_{kind}{axis}".encode() for kind in "vpt" for axis in "xyz"
) + b"\n0\t0\t600\t0\t0\t0\t0\t0\t0\t0\n1\t0\t700\t0\t0\t0\t0\t0\t0\t0\n"  # fmt: skip
LOADS_XML = b"""<?xml version="1.0"?><OpenSimDocument Version="40000"><ExternalLoads name="loads">
<objects><ExternalForce name="foot"><applied_to_body>%s</applied_to_body>
<force_expressed_in_body>ground</force_expressed_in_body><point_expressed_in_body>ground
</point_expressed_in_body><force_identifier>g_v</force_identifier><point_identifier>g_p
</point_identifier><torque_identifier>g_t</torque_identifier></ExternalForce></objects>
<datafile>grf.sto</datafile></ExternalLoads></OpenSimDocument>"""


def kinds() -> dict[str, Kind]:
    """Every kind of input by its name."""
    import trimesh

    from kneejax import files
    from kneejax.cli._commands import build_parser
    from kneejax.cli._settings import read_settings, words_again
    from kneejax.cohorts import read_cohort
    from kneejax.files import tables
    from kneejax.files.meshes._points import read_mesh_points
    from kneejax.files.opensim._external_loads import read_external_loads
    from kneejax.files.opensim._model import read_model
    from kneejax.studies import read_study
    from kneejax.studies._acl_plan import read_plan

    model = ROOT / "tests/files/opensim/models/right_schema3.osim"
    body = next(iter(read_model(model).bodies))
    sphere = trimesh.creation.icosphere(1, 20.0)

    def mesh(kind: str, **options) -> bytes:
        data = sphere.export(file_type=kind, **options)
        return data.encode() if isinstance(data, str) else data

    def storage(path: Path) -> None:
        table = tables.read_storage(path)
        tables.angles_rad(table, "knee_angle_r")
        table.at(tables.common_times([table], 5), [*table.columns])

    def settings(path: Path) -> None:
        words_again(read_settings(path.parent), build_parser(), path)

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
        "poses": one("poses.csv", POSES, tables.read_poses),
        "test": one("drawer.csv", DRAWER, tables.read_lab_table),
        "loads over time": one("loads.csv", LOADS, tables.read_loads_over_time),
        "candidates": one("tests.csv", CANDIDATES, tables.read_candidates),
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


RESULT = json.dumps({
    "title": "a fit", "knee": "four_ligament",
    "parameters": {
        "ACL.stiffness": {"value": 5000.0, "start": 4500.0, "standard_error": 120.0},
        "PCL.reference_strain": {"value": 0.02, "start": 0.03, "standard_error": None},
    },
    "noise": {"anterior": 0.3}, "frame_offset": {"anterior_mm": {"value": 0.4}},
    "correlation": {"parameters": ["ACL.stiffness"], "matrix": [[1.0]]},
    "settings": {"knee": "four_ligament", "path": "study.yaml", "patella": False,
                 "overrides": {"LCL.stiffness": 3000.0}, "start": {"ACL.stiffness": 4500.0}},
}, indent=1).encode()  # fmt: skip
SETTINGS = json.dumps({
    "command": "simulate", "experiment": "drawer", "knee": "four_ligament", "flexion": "0:30:15",
    "force_N": 100.0, "both": True, "load": {"internal_Nm": 1.0}, "cut": ["ACL"],
    "working_folder": "/", "versions": {"kneejax": "0.1.0"},
}, indent=1).encode()  # fmt: skip

#: What is put in the place of a value.
VALUES = (
    b"", b"0", b"-1", b"1e999", b"-1e308", b"nan", b".nan", b".inf", b"9" * 400, b"9" * 5000,
    b"1_000", "١٢".encode(), b"0x10", b"true", b"null", b"~", b"[]", b"{}", b"[1, 2]", b"{a: 1}",
    b'"text"', b"'", b'"', b"2020-01-01", b"10:50:5", b"!!float x", b"!!python/name:os.system",
    b"&a [*a]", b"*a", b"<<: {a: 1}", b"a" * 10_000, b"[" * 20_000, b'{"a":' * 5000, b"- " * 500,
    b"\x00", b"\xff\xfe", "ß€𝄞".encode(), b"\t", b"%s%n", b"../../../etc/passwd", b"a" * 300,
    b"ACL.stiffness", b"*", b"1e-320", b"-0", b"+.5", b"5.", b"1,5", b"None", b"NaN", b"-Infinity",
    b"\xe2\x80\xa8", b"&bomb;", b"<a>", b"-89", b"65536", b"4294967296", b"1e6",
)  # fmt: skip
_TOKEN = re.compile(rb"[\w.+*-]+")
_BOMB = b"\n".join(
    [b"bomb0: &b0 [1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    + [b"bomb%d: &b%d [%s]" % (k, k, b", ".join([b"*b%d" % (k - 1)] * 9)) for k in range(1, 10)]
)
_ENTITIES = (
    b'<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">'
    b'<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;"><!ENTITY d "&c;&c;&c;&c;&c;&c;&c;&c;&c;&c;">'
    b'<!ENTITY e "&d;&d;&d;&d;&d;&d;&d;&d;&d;&d;"><!ENTITY f "&e;&e;&e;&e;&e;&e;&e;&e;&e;&e;">]>'
)
ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "latin-1", "cp500", "utf-8-sig")
_DECLARED = (b"punycode", b"idna", b"utf-7", b"rot13", b"unicode_escape", b"nonsense", b"utf-16",
             b"ascii", b"latin-1", b"cp1252", b"hex", b"undefined")  # fmt: skip


def _flipped(data: bytes, draw: random.Random) -> bytes:
    found = bytearray(data)
    for _ in range(draw.randint(1, 8)):
        found[draw.randrange(len(found))] ^= 1 << draw.randrange(8)
    return bytes(found)


def _cut(data: bytes, draw: random.Random) -> bytes:
    return data[: draw.randrange(len(data))]


def _without(data: bytes, draw: random.Random) -> bytes:
    begin = draw.randrange(len(data))
    return data[:begin] + data[begin + draw.randint(1, 200) :]


def _doubled(data: bytes, draw: random.Random) -> bytes:
    begin = draw.randrange(len(data))
    part = data[begin : begin + draw.randint(1, 300)]
    return data[:begin] + part * draw.choice((2, 2, 3, 50)) + data[begin + len(part) :]


def _line_gone(data: bytes, draw: random.Random) -> bytes:
    lines = data.split(b"\n")
    del lines[draw.randrange(len(lines))]
    return b"\n".join(lines)


def _line_twice(data: bytes, draw: random.Random) -> bytes:
    lines = data.split(b"\n")
    k = draw.randrange(len(lines))
    return b"\n".join([*lines[: k + 1], *lines[k:]])


def _lines_exchanged(data: bytes, draw: random.Random) -> bytes:
    lines = data.split(b"\n")
    i, k = draw.randrange(len(lines)), draw.randrange(len(lines))
    lines[i], lines[k] = lines[k], lines[i]
    return b"\n".join(lines)


def _value(data: bytes, draw: random.Random) -> bytes:
    found = [*_TOKEN.finditer(data)]
    if not found:
        return data + draw.choice(VALUES)
    one = draw.choice(found)
    return data[: one.start()] + draw.choice(VALUES) + data[one.end() :]


def _value_of_key(data: bytes, draw: random.Random) -> bytes:
    """All that stands after a key in its line, or between two tags."""
    found = [*re.finditer(rb"(?m)(?<=: ).+?(?=,?$)|(?<=>)[^<>]+(?=<)|(?<==).+$", data)]
    if not found:
        return _value(data, draw)
    one = draw.choice(found)
    return data[: one.start()] + draw.choice(VALUES) + data[one.end() :]


def _token_moved(data: bytes, draw: random.Random) -> bytes:
    found = [*_TOKEN.finditer(data)]
    if len(found) < 2:
        return data
    one, other = draw.choice(found), draw.choice(found)
    return data[: one.start()] + other.group() + data[one.end() :]


def _number(data: bytes, draw: random.Random) -> bytes:
    found = [*re.finditer(rb"-?\d+\.?\d*(e-?\d+)?", data)]
    if not found:
        return data
    one = draw.choice(found)
    size = float(one.group()) * draw.choice((-1.0, 1e-3, 1e3, 1e6, 10.0, 0.0, 1e300))
    return data[: one.start()] + repr(size).encode() + data[one.end() :]


def _encoded(data: bytes, draw: random.Random) -> bytes:
    return data.decode("latin-1").encode(draw.choice(ENCODINGS), "replace")


def _declared(data: bytes, draw: random.Random) -> bytes:
    head = b'<?xml version="1.0" encoding="%s"?>' % draw.choice(_DECLARED)
    return head + re.sub(rb"<\?xml.*?\?>", b"", data)


def _bombed(data: bytes, draw: random.Random) -> bytes:
    if data.lstrip().startswith(b"<"):
        return _ENTITIES + re.sub(rb"<\?xml.*?\?>", b"", data).replace(b"</", b"&f;</", 3)
    lines = _value_of_key(data, draw).split(b"\n")
    return _BOMB + b"\n" + b"\n".join(lines) + b"\nnotes: *b%d\n" % draw.randint(1, 9)


def _empty(data: bytes, draw: random.Random) -> bytes:
    return draw.choice((b"", b"\n", b" ", b",,,,\n", b"{}", b"[]", b"null", b"\x00" * 50, b"---"))


WAYS: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "bytes flipped": _flipped, "cut": _cut, "a part gone": _without, "a part twice": _doubled,
    "a line gone": _line_gone, "a line twice": _line_twice, "lines exchanged": _lines_exchanged,
    "another token": _value, "another value": _value_of_key, "a token elsewhere": _token_moved,
    "another number": _number, "another encoding": _encoded, "an encoding declared": _declared,
    "a bomb": _bombed, "empty": _empty,
}  # fmt: skip
_OFTEN = {"another value": 6, "another token": 4, "another number": 3, "a token elsewhere": 2}


def inputs(count: int, seed: int, every: dict[str, Kind]) -> Iterator[tuple]:
    """Kind, number, ways and content of each damaged input; each by its number alone."""
    names, ways = [*every], [*WAYS]
    often = [_OFTEN.get(way, 1) for way in ways]
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
    """Two seconds of the processor, and a gigabyte more than the process has, where the system can limit them."""

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
    from kneejax.cohorts import CohortProblems
    from kneejax.files import InputProblem
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
    except (InputProblem, UnknownParameter, UnsuitableData, Implausible, MissingPackage) as problem:
        sentence = str(problem)
        # Of the file or another that it names, or of something bundled that is not there.
        named = str(folder) in sentence or sentence.startswith(("bundled data", "knee: name"))
        whole = "\n" not in sentence and len(sentence) <= LONGEST
        outcome = REFUSED if named and whole else NO_FILE
    except CohortProblems as problem:
        lines = problem.problems
        sentence = lines[0]
        good = all("\n" not in x and len(x) <= LONGEST and str(folder) in x for x in lines)
        outcome = REFUSED if good else NO_FILE
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
    from kneejax.cli._commands import build_parser

    found = []
    for words, parser in _parsers(build_parser()):
        places = [a for a in parser._actions if not a.option_strings and a.nargs != "?"]
        filled = [*words, *(str(next(iter(a.choices or ["four_ligament"]))) for a in places)]
        if isinstance(places[0] if places else None, argparse._SubParsersAction):
            filled = [*words]
        found.append([*filled, "--nonsense"])
        found.append([*filled, "x", "y", "z", "ü", "1"])
        for action in parser._actions:
            flag = next(iter(action.option_strings), None)
            if flag is None or action.nargs == 0 or flag in ("--help", "-h", "--version"):
                continue
            found += [[*filled, flag, ""], [*filled, flag]] if action.nargs is None else []
            if action.type in (int, float):
                found += [[*filled, flag, value] for value in ("1_000", "x", "١٢", "0x10", "1,5")]
            if action.choices:
                found.append([*filled, flag, "nonsense"])
    return random.Random(seed).sample(found, min(count, len(found)))


def _parsers(parser, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    yield words, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for name, below in action.choices.items():
                yield from _parsers(below, (*words, name))


def refused(words: list[str]) -> str:
    """What is wrong with a command line's answer; empty where it is status 2 and one line."""
    from kneejax.cli import main

    said = io.StringIO()
    warnings.filterwarnings("ignore", "kneejax.configure.. comes too late", RuntimeWarning)
    try:
        with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
            status = main(words)
    except SystemExit as ended:
        status = ended.code
    lines = said.getvalue().splitlines()
    good = status == 2 and len(lines) == 1 and lines[0].startswith("kneejax: ")
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
    print(f"{total:.0f} s in all; slowest: {slowest.seconds:.2f} s, {slowest.number} {slowest.kind}")
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
