"""Small whole files of every kind, and ways in which a file is damaged."""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable

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
OFTEN = {"another value": 6, "another token": 4, "another number": 3, "a token elsewhere": 2}
