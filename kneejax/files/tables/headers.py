"""Columns of a robot's table by the words and units of their headers, as in `JCS Valgus [deg]`.

Open Knee(s) (simVITRO) writes `Knee JCS Medial [mm]`, `Knee JCS Flexion [deg]`,
`JCS Load Anterior Drawer [N]`, `JCS Load External Rotation Torque [Nm]`; KneeHub
`Internal Rotation (deg)`, `Applied Load (N)`. A header says the sense in which its numbers rise,
of the tibia: motions as well as loads.
"""

import math
import re
from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from kneejax.geometry import COLUMNS, COORDINATES
from kneejax.mechanics import NAMED_LOADS

#: Unit of a header -> that of the package, and the factor that leads to it.
_UNITS = {
    "mm": ("mm", 1.0), "cm": ("mm", 10.0), "m": ("mm", 1000.0),
    "deg": ("deg", 1.0), "degree": ("deg", 1.0), "degrees": ("deg", 1.0), "°": ("deg", 1.0),
    **dict.fromkeys(("rad", "radian", "radians"), ("deg", math.degrees(1.0))),
    "n": ("N", 1.0), "kn": ("N", 1000.0), "nm": ("Nm", 1.0), "ncm": ("Nm", 0.01),
    "nmm": ("Nm", 0.001),
}  # fmt: skip
#: Words that say that a column is a load.
_LOAD = {"load", "force", "torque", "moment", "shear", "drawer"}
#: Other words that a header may have; any else is of something else (a patella, a set point).
_BESIDE = _LOAD | {
    "knee", "jcs", "gs", "joint", "tibiofemoral", "tf", "tibia", "tibial", "angle", "rotation",
    "translation", "displacement", "position", "applied", "actual", "measured", "right", "left",
}  # fmt: skip
#: Words of what is tested -> the load that such a test applies, in its positive sense.
_TESTED = {"ap": "anterior_N", "drawer": "anterior_N", "lachman": "anterior_N",
           "axial": "compression_N", "vv": "varus_Nm", "ie": "internal_Nm",
           "torsion": "internal_Nm"}  # fmt: skip
_WORDS = {"mm": "mm", "deg": "degrees", "N": "N", "Nm": "N m"}  # unit -> what it is called
#: mm below which all translations of a table are metres: no knee moves less.
METRES_BELOW = 0.1
#: N m that no knee has had; N mm are a thousand times as large.
MOST_MOMENT_NM = 100.0


class _Sense(NamedTuple):
    """What a word says: column of a motion, name of a load (none of flexion's), and the sign."""

    motion: str
    load: str
    sign: float


_SENSES = {"flexion": _Sense(COLUMNS[0], "", 1.0), "extension": _Sense(COLUMNS[0], "", -1.0)}
for _load in NAMED_LOADS.values():
    _motion = next(COORDINATES[x].column for x in _load.also_called if x in COORDINATES)
    for _word in {*_load.also_called, *_load.opposite} - {*_BESIDE, *_TESTED}:
        _SENSES[_word] = _Sense(_motion, _load.name, -1.0 if _word in _load.opposite else 1.0)
_SENSES |= {"proximal": _SENSES["superior"], "distal": _SENSES["inferior"]}


class Header(NamedTuple):
    """What a header says."""

    own: str  # itself
    name: str  # of the package; empty for flexion's moment, and for a load without a direction
    factor: float  # that leads to the package's unit and sense
    unit: str  # `mm`, `deg`, `N` or `Nm`
    stated: bool  # whether the unit stands there
    nameless: bool = False  # whether it is a load without a direction


def header_meaning(own: str) -> Header | None:
    """What a header says in words and unit; None where it is of something else."""
    match = re.fullmatch(r"(.*?)\s*[\[(]([^\[\]()]*)[\])]\s*", own)
    text, unit = (match[1], re.sub(r"[\s.*·-]", "", match[2]).lower()) if match else (own, "")
    words = re.split(r"[\s/-]+", text.strip().lower())
    senses = {_SENSES[word] for word in words if word in _SENSES}
    if not {*words} <= {*_SENSES, *_BESIDE} or len(senses) > 1 or (match and unit not in _UNITS):
        return None
    stated, factor = _UNITS[unit] if match else ("", 1.0)
    is_called, is_load = bool(_LOAD & {*words}), stated in ("N", "Nm")
    if not senses:
        nameless = Header(own, "", factor, stated, True, nameless=True)
        return nameless if is_load and is_called else None
    (sense,) = senses
    turns, is_load = sense.motion.endswith("_deg"), is_load if match else is_called
    kind = ("Nm" if turns else "N") if is_load else ("deg" if turns else "mm")
    # One bare word is no robot's header.
    if stated not in ("", kind) or not (match or len(words) > 1):
        return None
    return Header(own, sense.load if is_load else sense.motion, sense.sign * factor, kind,
                  stated=bool(match))


def by_headers(
    table, ignore: Collection[str] = (), about: str = "",
    known: Collection[str] = (*COLUMNS, *NAMED_LOADS), mapped: Collection[str] = (),
) -> tuple[list[str], list[str]]:  # fmt: skip
    """Name columns by their headers, but for what is `mapped` to one; what was assumed, a phrase
    each, and columns not used."""
    used = {column for column, _ in table.named.values()} | {*ignore}
    read = [x for own in table.header if own not in used and (x := header_meaning(own)) is not None]
    # A load without a direction takes that of the test, where its name says one.
    words = re.findall(r"[a-z]+", about.lower())
    said = [(_SENSES[word].load, _SENSES[word].sign) for word in words if word in _SENSES]
    said += [(_TESTED[word], 0.0) for word in words if word in _TESTED]
    for k, one in enumerate(read):
        loads = {load for load, _ in said if load.endswith(f"_{one.unit}")}
        if one.nameless and len(loads) == 1:
            signs = {sign for load, sign in said if load in loads}
            sign = -1.0 if -1.0 in signs and 1.0 not in signs else 1.0
            read[k] = one._replace(name=loads.pop(), factor=sign * one.factor)
    unused = [one.own for one in read if not (one.name or one.nameless)]
    found: dict[str, Header] = {}
    for one in (x for x in read if x.name in known and x.name not in mapped):
        taken = table.named.get(one.name) or found.setdefault(one.name, one)
        if taken is not one:
            expected = f"one column of {one.name} (columns:), the other left out (ignore:)"
            table.wrong("header", f"{taken[0]} and {one.own}", expected)
    phrases = [f"{name} from {factored(one)}" for name, one in found.items() if one.stated]
    for unit in _WORDS:
        without = [one for one in found.values() if one.unit == unit and not one.stated]
        if without and (judged := _by_size(table, without, found.get(COLUMNS[0]))) is not None:
            factor, words = judged
            phrases.append(words)
            found |= {one.name: one._replace(factor=factor * one.factor) for one in without}
    phrases += [f"{own} is not used, since flexion is prescribed" for own in unused]
    table.named.update({name: (one.own, one.factor) for name, one in found.items()})
    return phrases, unused


def factored(one: Header) -> str:
    """A column and its factor as `columns:` of a test says them."""
    if abs(one.factor) == 1.0:
        return f"{'-' if one.factor < 0 else ''}{one.own}"
    return f"{one.factor:.7g} * {one.own}"


def _by_size(table, columns: list[Header], flexion: Header | None) -> tuple[float, str] | None:
    """The factor of columns without a unit by their size, and what that assumes; None: unclear."""
    unit, factor = columns[0].unit, 1.0
    words = _WORDS[unit]
    largest = max(np.abs(table.sizes(one.own)).max(initial=0.0) for one in columns)
    if unit == "mm" and largest < METRES_BELOW:
        words, factor = "metres", 1000.0
    elif unit == "Nm" and largest > MOST_MOMENT_NM:
        words, factor = "N mm", 0.001
    elif unit == "deg" and largest <= math.pi:
        bent = table.sizes(flexion.own) if flexion and not flexion.stated else np.zeros(1)
        if np.ptp(bent) < 0.5 or (bent == np.round(bent)).all():
            one = columns[0]
            ways = (f'"{one.factor * x:.7g} * {one.own}"' for x in (1.0, math.degrees(1.0)))
            expected = ("its unit: degrees and radians cannot be distinguished; write "
                        f"{one.name}: {' or '.join(ways)} under columns")
            table.wrong(one.own, f"up to {largest:.3g}", expected)
            return None
        words, factor = "radians", math.degrees(1.0)
    named = ", ".join(f"{one.name} from {factored(one)}" for one in columns)
    return factor, f"{named} ({words}, by their size: up to {largest:.3g})"
