"""Passive flexion, and poses that were given, as answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from kneejax.experiments import Branch, Mechanics, Motion, Way, ways_of, with_flips
from kneejax.geometry import CLINICAL, COLUMNS, FEMORAL, convert_table
from kneejax.mechanics import Knee, load_words
from kneejax.report import doubts as faults
from kneejax.report import pose_tables
from kneejax.report.look.page import Answer, Drawing, Section
from kneejax.report.look.tables import Column, Table
from kneejax.report.motion_figures import simulation_figure
from kneejax.statics import Status, converged

_WAYS = ("anterior", "superior", "lateral")
_MOMENTS = ("adduction", "internal_rotation", "extension")


def flexion_answer(
    name: str, motion: Motion, mechanics: Mechanics, flexion: np.ndarray, *,
    loads: Mapping[str, float], unloaded: Motion | None = None,
    branches: Sequence[Branch] | None = None, convention: str = FEMORAL,
) -> Answer:
    """Passive flexion of a knee.

    Args:
        name: of the knee, with what was cut.
        motion: balances, one a flexion.
        mechanics: of these.
        flexion: as it was asked for, degrees, `(n,)`.
        loads: that acted, by name.
        unloaded: the same without loads, for how far they moved the tibia.
        branches: other balances, where they were searched for.
        convention: of the poses.

    Returns:
        The answer; its tables are poses and forces, displacement with loads, and branches.
    """
    knee, status = motion.knee, with_flips(motion.status, mechanics)
    table = np.array(motion.to_table())
    table[:, 0] = flexion
    words = faults.pose_words(knee, mechanics, faults.search_words(motion, loads))
    more = {"converged": np.asarray(motion.equilibrium.converged).tolist(),
            "stable": np.asarray(motion.stable).tolist(), "doubt": words}  # fmt: skip
    tables = {"poses": pose_tables.pose_table(table, status, convention, more=more),
              "forces": pose_tables.force_table(knee, mechanics, {"flexion_deg": flexion})}
    main, text = ["poses"], [f"{name}, {load_words(loads)}", tables["poses"].text()]
    if unloaded is not None:
        tables["displacement"] = pose_tables.change_table(flexion, displacement(motion, unloaded))
        main.append("displacement")
        text += ["", tables["displacement"].text()]
    sections = [
        Section("Largest forces", tables=[
            pose_tables.peak_table(knee, mechanics, flexion, "at flexion, deg")])
    ]
    if branches is not None:
        tables["branches"], others, said = _branches(branches, flexion, convention)
        text += [said, *([others.terminal()] if others.rows else [])]
        sections.append(Section("Other balances", [said], [others] if others.rows else []))
    places = faults.named_places([f"{x:g}" for x in flexion], "degrees")
    doubts = [*faults.status_doubts(status, words, *places)]
    shown = convert_table(table, FEMORAL, convention)
    return Answer(
        title=f"Passive flexion of {name}",
        asked=f"How the tibia moves, {load_words(loads)}, at {_angles(flexion)}.",
        verdict=pose_tables.verdict_of(status),
        sentence=_sentence(status, table, knee, mechanics, flexion), tables=tables, main=main,
        drawings={
            "simulation": Drawing(simulation_figure, flexion, shown, status,
                                  *_parts(knee, mechanics), convention)
        },
        doubts=doubts, sections=sections, text="\n".join([*text, *doubts]),
    )


def evaluation_answer(knee: Knee, table: np.ndarray, found: Mechanics) -> Answer:
    """Ligaments and contact at given poses.

    Args:
        knee: any knee.
        table: the poses, degrees and mm, `(n, 6)`.
        found: their mechanics.

    Returns:
        The answer; its tables are ligaments and contact, and for people a row a pose.
    """
    count = len(table)
    status, doubts = faults.given_doubts(knee, found, [str(row) for row in range(count)])
    return Answer(
        title=f"{knee.name} at given poses",
        asked=f"Ligament and contact forces at {count} given poses; nothing is moved.",
        verdict=pose_tables.verdict_of(status), sentence=_sound(status) + ".",
        tables={"ligaments": _ligament_table(knee, table, found),
                "contact": _contact_table(knee, found, status)},
        main=[_summary(knee, table, found, status)], doubts=doubts,
        sections=[Section("Ligaments", tables=["ligaments"]),
                  Section("Contact", tables=["contact"])],
        text="\n".join([f"{count} pose{'s' * (count != 1)} of {knee.name}", *doubts]),
    )


def displacement(under_load: Motion, without: Motion) -> np.ndarray:
    """How far a load moved the tibia."""
    tables = []
    for motion in (under_load, without):
        table = convert_table(np.asarray(motion.to_table()), FEMORAL, CLINICAL)
        table[~converged(np.asarray(motion.status))] = np.nan
        tables.append(table)
    return (tables[0] - tables[1])[:, 1:]


def _angles(flexion: np.ndarray) -> str:
    if len(flexion) <= 4:
        return f"{', '.join(f'{x:g}' for x in flexion)} degrees of flexion"
    return f"{len(flexion)} flexions from {np.min(flexion):g} to {np.max(flexion):g} degrees"


def _sound(status: np.ndarray) -> str:
    good = int((np.asarray(status) == Status.BALANCED).sum())
    if good == len(status):
        return f"All {good} poses pass every check" if good > 1 else "1 pose passes every check"
    return f"{good} of {len(status)} poses pass every check"


def _sentence(status, table: np.ndarray, knee: Knee, mechanics: Mechanics, flexion) -> str:
    """How far the tibia moves from the first to the last balance, and what carries most."""
    known = np.flatnonzero(np.isfinite(table).all(axis=1))
    words = _sound(status) + "."
    if len(known) > 1:
        first, last = known[[0, -1]]
        change = table[last] - table[first]
        words += (
            f" From {flexion[first]:g} to {flexion[last]:g} degrees the tibia turns "
            f"{abs(change[2]):.1f} degrees {'in' if change[2] >= 0 else 'out'}wards and moves "
            f"{abs(change[3]):.1f} mm {'forwards' if change[3] >= 0 else 'backwards'}."
        )
    peaks = {n: np.nanmax(x) for n, x in pose_tables.bundle_forces(knee, mechanics.tension).items()
             if np.isfinite(x).any()}  # fmt: skip
    if peaks:
        most = max(peaks, key=lambda name: peaks[name])
        words += f" Most is carried by {most}, {peaks[most]:.0f} N."
    return words


def _parts(knee: Knee, mechanics: Mechanics):
    forces = pose_tables.bundle_forces(knee, mechanics.tension)
    nothing = np.zeros((len(mechanics.tension), 0))
    drawn = np.stack([*forces.values()], axis=1) if forces else nothing
    return [*forces], drawn, knee.contact_names, pose_tables.contact_forces(mechanics)


def _branches(
    found: Sequence[Branch], flexion: np.ndarray, convention: str
) -> tuple[Table, Table, str]:
    """All balances for the file; the others for people, and what they are."""
    poses = np.array([[flexion[b.load_case], *b.pose[1:]] for b in found]).reshape(-1, len(COLUMNS))
    more = {"by_test": [int(b.by_test) for b in found], "apart_mm": [b.apart_mm for b in found],
            "starts": [b.starts for b in found]}  # fmt: skip
    whole = pose_tables.pose_table(poses, [b.status for b in found], convention, more=more)
    rows = [row for row, b in zip(whole.rows, found, strict=True) if not b.by_test]
    columns = [one for one in whole.columns if one.name != "convention"]
    file = Table(columns, [row[: len(columns)] for row in whole.rows])
    said = "No other stable balance was found at any of these angles."
    if rows:
        said = "Besides these, the knee also balances at:"
    return file, Table(whole.columns, rows), said


def _ligament_table(knee: Knee, table: np.ndarray, found: Mechanics) -> Table:
    words = {way.value: way.word for way in Way}
    numbers = {"length_mm": found.length, "strain": found.strain, "force_N": found.tension,
               "way": np.vectorize(words.get, otypes=[object])(ways_of(found)),
               "wrap_deg": np.rad2deg(np.maximum(np.asarray(found.wrap_angle), 0.0))}  # fmt: skip
    keys = {"pose": range(len(table)), "flexion_deg": table[:, 0]}
    return pose_tables.part_table(keys, "ligament", knee.ligaments.names, numbers)


def _contact_table(knee: Knee, found: Mechanics, status: np.ndarray) -> Table:
    # Moments are about X, Y, Z of the tibia: adduction, internal rotation, extension.
    numbers = {
        "force_N": pose_tables.contact_forces(found), "area_mm2": found.area,
        "max_pressure_MPa": found.max_pressure, "mean_pressure_MPa": found.mean_pressure,
        "max_depth_mm": found.max_depth, tuple(f"center_{x}_mm" for x in _WAYS): found.center,
        tuple(f"force_{x}_N" for x in _WAYS): found.contact_force,
        tuple(f"moment_{x}_Nmm" for x in _MOMENTS): found.contact_moment,
        "beyond_mm": found.beyond_mm, "beyond_share": found.beyond_share,
    }  # fmt: skip
    words = {"status": [Status(int(x)).word for x in status]}
    keys = {"pose": range(len(status))}
    return pose_tables.part_table(keys, "contact", knee.contact_names, numbers, words)


def _summary(knee: Knee, table: np.ndarray, found: Mechanics, status: np.ndarray) -> Table:
    forces = pose_tables.bundle_forces(knee, found.tension)
    contact = pose_tables.contact_forces(found)
    pressure = np.asarray(found.max_pressure)
    columns = [
        Column("pose", show=str), Column("flexion_deg", "flexion, deg", ".1f"),
        Column("ligament", "most in", words=True), Column("ligament_N", "ligament, N", ".1f"),
        *(Column(f"{name}_N", f"{name} contact, N", ".1f") for name in knee.contact_names),
        Column("max_pressure_MPa", "peak pressure, MPa", ".2f"), Column("status", words=True),
    ]  # fmt: skip
    rows = []
    for i, outcome in enumerate(status):
        most = max(forces, key=lambda name, i=i: np.nan_to_num(forces[name][i]), default="")
        peak = pressure[i].max() if pressure.size else np.nan
        rows.append([i, table[i, 0], most, forces[most][i] if most else np.nan, *contact[i], peak,
                     Status(int(outcome)).word])  # fmt: skip
    return Table(columns, rows, "At each pose", "Ligament forces are sums over their fibres.")
