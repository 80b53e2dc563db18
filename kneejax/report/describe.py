"""A knee in words and tables for a terminal, in plain ASCII."""

__all__ = ["knee_text"]

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from kneejax.geometry import COLUMNS, CUBIC_SPLINE
from kneejax.mechanics import Contact, Knee, Ligaments, Support
from kneejax.report.look.page import prose
from kneejax.report.look.tables import aligned, grouped, trimmed, wrapped

#: More fibres than this are gathered by their groups.
MOST_ROWS = 15
_FIXED_SPACE = "\u00a0"  # where no line is broken
_SIZES = {"radius_mm": "radius", "length_mm": "length", "semi_axes_mm": "semi-axes"}


def knee_text(knee: Knee, document: Mapping[str, Any], every_fibre: bool = False) -> str:
    """Describe a knee: ligaments, wrap objects, contacts, lines, loads, what was adapted, notes.

    Args:
        knee: what the file gave.
        document: the file's content, for what a knee does not hold: names and fits.
        every_fibre: a row for each fibre, with its length and strain at the reference pose, also
            where many fibres would be gathered and where ways around obstacles must be found.

    Returns:
        Lines without a final line break, of fewer than 100 columns but for long names.

    Example:
        >>> import kneejax as kj
        >>> file = kj.files.load_knee_file("four_ligament")
        >>> print(knee_text(file.knee, file.document).splitlines()[0])
        four_ligament (right knee)
    """
    pose = np.asarray(knee.reference_pose.to_table())
    words = ", ".join(f"{c} {value:g}" for c, value in zip(COLUMNS, pose, strict=True))
    lines = [f"{knee.name} ({knee.side} knee)"]
    lines += wrapped(_one_line(document["description"]), "  ")
    lines += wrapped(f"reference pose: {words}", "  ")
    lines.append("  frames: X anterior, Y superior, Z lateral; tibia in femur; mm, N, MPa")
    lines += ["", *_ligaments(knee, document["ligaments"], every_fibre)]
    users = [part.get("wrap") for part in document["ligaments"].values()]
    wraps = document.get("wraps", {})
    lines += ["", "Wrap objects"] if wraps else []
    for name, wrap in wraps.items():
        sizes = [f"{word} {' x '.join(map(trimmed, np.atleast_1d(wrap[field])))} mm"
                 for field, word in _SIZES.items() if field in wrap]  # fmt: skip
        lines.append(f"  {name}: {wrap['kind']} on the {wrap['bone']}, {', '.join(sizes)}, for "
                     f"{users.count(name)} fibres")  # fmt: skip
    for name, contact in zip(knee.contact_names, knee.contacts, strict=True):
        lines += ["", *_contact(name, contact, document["contacts"][name])]
    for bone, surface in document.get("surfaces", {}).items():
        lines += ["", f"Surface of the {bone}, not in contact: {_surface(surface)}"]
    if "patella" in document:
        lines += ["", *_patella(document["patella"])]
    lines += [""] * bool(knee.lines or knee.loads)
    lines += [f"Line {line.name}: {float(line.tension):g} N" for line in knee.lines]
    for load in knee.loads:
        if isinstance(load, Support):
            lines.append(f"Support of {load.coordinate}: {float(load.size):g} N or N mm")
            continue
        force = " ".join(f"{x:g}" for x in np.asarray(load.force))
        lines.append(f"Load {load.name}: {force} N in {load.axes} axes")
    for change in document.get("adaptations", ()):
        lines += ["", f"Adapted {change['field']}"]
        for key in ("from", "to", "reason"):
            lines += wrapped(_one_line(change[key]), f"  {key}: ")
    if "notes" in document:
        lines += ["", "Notes", *wrapped(_one_line(document["notes"]), "  ")]
    return "\n".join(lines)


def _patella(section: Mapping[str, Any]) -> list[str]:
    """What stands in a knee file for where the patella is asked for."""
    if "same_as" in section:
        return [f"Patella: that of {section['same_as']}; acts where the quadriceps pulls"]
    heads = {n: x for n, x in section["muscles"].items() if x["insertion_bone"] == "patella"}
    others = [name for name in section["muscles"] if name not in heads]
    rest = sum(part["tension_N"] for part in heads.values())
    lines = ["Patella: acts where the quadriceps pulls"]
    lines += wrapped(f"ligaments: {', '.join(section['ligaments'])}", "  ")
    lines += wrapped(f"contact: {', '.join(section['contacts']) or 'none'}", "  ")
    lines += wrapped(f"quadriceps: {', '.join(heads)}; {rest:.2f} N at rest", "  ")
    return lines + wrapped(f"other muscles: {', '.join(others)}", "  ") if others else lines


def _one_line(text: Any) -> str:
    return " ".join(str(text).split())


def _ligaments(knee: Knee, parts: Mapping[str, Any], every_fibre: bool) -> list[str]:
    ligaments = knee.ligaments
    names = ligaments.names
    if not names:
        return ["No ligaments"]
    length = _lengths(knee, every_fibre)
    slack, stiffness = np.asarray(ligaments.slack_length), np.asarray(ligaments.stiffness)
    strain = length / slack - 1.0
    gathered = len(names) > MOST_ROWS and not every_fibre
    bundles = _bundles(knee) if gathered else {name: [i] for i, name in enumerate(names)}
    gathered = gathered and len(bundles) < len(names)
    # What is gathered has a count of fibres, others their length.
    second, digits = ("fibres", (2, 2)) if gathered else ("reference_length_mm", (3, 4))
    table = [["ligament", "stiffness_N", second, "slack_length_mm", "reference_strain", "way"]]
    for name, rows in bundles.items():
        own = str(len(rows)) if gathered else _range(length[rows], 3)
        table.append([name, f"{stiffness[rows].sum():.0f}", own, _range(slack[rows], digits[0]),
                      _range(strain[rows], digits[1]), _ways([parts[names[i]] for i in rows])])
    if gathered:
        table = [[name, own, size, *others] for name, size, own, *others in table]
    head = f"Ligaments: {len(names)} fibres"
    head += f" in {len(bundles)} bundles; their stiffnesses are sums" if gathered else ""
    lines = [head, *(f"  {line}" for line in aligned(table, (0, len(table[0]) - 1)))]
    if np.isnan(strain).any():
        lines.append("  -: not straight; `kneejax describe KNEE --fibres` finds the way")
    return lines + _groups(knee, bundles)


def _lengths(knee: Knee, every_fibre: bool) -> np.ndarray:
    """At the reference pose; NaN for fibres that are not straight, unless those are asked for."""
    ligaments, place = knee.ligaments, knee.at_reference
    if every_fibre and ligaments.courses:
        return np.array(jax.jit(Ligaments.length)(ligaments, place))
    straight = eqx.tree_at(lambda x: x.courses, ligaments, ())
    length = np.array(straight.length(place))
    bent = [row for course in ligaments.courses for row in course.rows]
    length[bent] = np.nan
    return length


def _bundles(knee: Knee) -> dict[str, list[int]]:
    """First group that has a fibre -> rows of its fibres; a fibre without group is its own."""
    first = {fibre: name for name, fibres in reversed(knee.groups) for fibre in fibres}
    return grouped((first.get(name, name), row) for row, name in enumerate(knee.ligaments.names))


def _groups(knee: Knee, rows: Mapping[str, list[int]]) -> list[str]:
    """Groups that are no row of the table, as bundles together where they are that."""
    names = knee.ligaments.names
    bundles = {name: {names[row] for row in many} for name, many in _bundles(knee).items()}
    stiffness, said = np.asarray(knee.ligaments.stiffness), []
    for name, fibres in knee.groups:
        if name in rows:
            continue
        inside = [bundle for bundle, members in bundles.items() if members <= set(fibres)]
        together = set().union(*(bundles[bundle] for bundle in inside))
        parts = inside if name not in inside and together == set(fibres) else fibres
        total = stiffness[[names.index(fibre) for fibre in fibres]].sum()
        said.append(f"{name} = {' + '.join(parts)}, {total:.0f}{_FIXED_SPACE}N")
    lines = wrapped("; ".join(said), "  groups: ") if said else []
    lines = [line.replace(_FIXED_SPACE, " ") for line in lines]
    return lines + (wrapped(prose("groups"), "  ") if knee.groups else [])


def _ways(parts: Sequence[Mapping[str, Any]]) -> str:
    """Over which points and around which obstacles fibres run."""
    every: Counter[str] = Counter()
    for part in parts:
        via = len(part.get("via_points", ()))
        words = [f"via {via} point{'s' * (via > 1)}"] * bool(via)
        every[", ".join([*words, *([f"around {part['wrap']}"] if "wrap" in part else [])])] += 1
    return "; ".join(way if count == len(parts) else f"{way} ({count} of {len(parts)})"
                     for way, count in every.items() if way)  # fmt: skip


def _range(values: np.ndarray, decimals: int) -> str:
    if not np.isfinite(values).all():
        return "-"
    ends = (round(float(x), decimals) + 0.0 for x in (values.min(), values.max()))
    return " to ".join(dict.fromkeys(f"{end:.{decimals}f}" for end in ends))


def _contact(name: str, contact: Contact, document: Mapping[str, Any]) -> list[str]:
    form = contact.form.replace("_", " ")
    if "points" in document:
        form += f" over {' x '.join(str(n) for n in document['points'])} points"
    field = " and a field" * (contact.layer_variation is not None)
    return [f"Contact {name}: {form}, {contact.law} law",
            f"  E {float(contact.youngs_modulus):g} MPa, nu {float(contact.poisson_ratio):g}, "
            f"confined modulus {float(contact.modulus):.3f} MPa, layer "
            f"{float(contact.layer_thickness):g} mm{field}",
            *(f"  {side.replace('_', ' ')}: {_surface(document[side])}"
              for side in ("femoral_surface", "tibial_surface"))]  # fmt: skip


def _surface(surface: Mapping[str, Any]) -> str:
    said = [surface["kind"]]
    if "coefficients_mm" in surface:
        m, n = np.shape(surface["coefficients_mm"])
        spline = surface.get("basis") == CUBIC_SPLINE
        said.append(f"cubic spline of {m} x {n} values" if spline else
                    f"polynomial of degree {m - 1} x {n - 1}")  # fmt: skip
    if "fit_rms_mm" in surface:
        said.append(f"fit {surface['fit_rms_mm']:.3f} mm rms")
        said.append(f"{surface['fit_max_mm']:.2f} mm at most")
    return ", ".join(said)
