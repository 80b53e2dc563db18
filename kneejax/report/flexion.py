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
    more = {"converged": motion.equilibrium.converged, "stable": motion.stable, "doubt": words}
    tables = {"poses": pose_tables.pose_table(table, status, convention, more=more),
              "forces": pose_tables.force_table(knee, mechanics, {"flexion_deg": flexion})}
    main = ["poses"]
    if unloaded is not None:
        tables["displacement"] = pose_tables.change_table(flexion, displacement(motion, unloaded))
        main.append("displacement")
    peaks = pose_tables.peak_table(knee, mechanics, flexion, "at flexion, deg")
    sections = [Section("Largest forces", tables=[peaks])]
    if branches is not None:
        # All balances for the file; the others for people.
        poses = np.array([[flexion[b.load_case], *b.pose[1:]] for b in branches])
        poses = poses.reshape(-1, len(COLUMNS))
        marks = {"by_test": [int(b.by_test) for b in branches],
                 "apart_mm": [b.apart_mm for b in branches],
                 "starts": [b.starts for b in branches]}  # fmt: skip
        whole = pose_tables.pose_table(poses, [b.status for b in branches], convention, more=marks)
        rows = [row for row, b in zip(whole.rows, branches, strict=True) if not b.by_test]
        columns = [one for one in whole.columns if one.name != "convention"]
        tables["branches"] = Table(columns, [row[: len(columns)] for row in whole.rows])
        said = "No other stable balance was found at any of these angles."
        said = "There are other stable equilibria:" if rows else said
        others = [Table(whole.columns, rows)] * bool(rows)
        sections.append(Section("Other balances", [said], others, printed=True))
    places = faults.named_places([f"{x:g}" for x in flexion], "degrees")
    forces = pose_tables.bundle_forces(knee, mechanics.tension)
    contact = pose_tables.contact_forces(mechanics)
    angles = f"{', '.join(f'{x:g}' for x in flexion)} degrees of flexion"
    if len(flexion) > 4:
        ends = f"from {np.min(flexion):g} to {np.max(flexion):g} degrees"
        angles = f"{len(flexion)} flexions {ends}"
    return Answer(
        title=f"Passive flexion of {name}",
        asked=f"How the tibia moves, {load_words(loads)}, at {angles}.",
        verdict=pose_tables.verdict_of(status),
        sentence=_sentence(status, table, forces, flexion), tables=tables, main=main,
        drawings={
            "simulation": Drawing(
                simulation_figure, flexion, convert_table(table, FEMORAL, convention), status,
                forces, dict(zip(knee.contact_names, contact.T, strict=True)), convention,
            )
        },
        doubts=[*faults.status_doubts(status, words, *places)], sections=sections,
    )  # fmt: skip


def evaluation_answer(knee: Knee, table: np.ndarray, found: Mechanics) -> Answer:
    """Ligaments and contact at given poses.

    Args:
        knee: any knee.
        table: the poses, degrees and mm, `(n, 6)`.
        found: their mechanics.

    Returns:
        The answer; its tables are ligaments and contact, and for people a row a pose.
    """
    rows, flexion = range(len(table)), table[:, 0]
    status, doubts = faults.given_doubts(knee, found, [str(row) for row in rows])
    states = pose_tables.words_of(status)
    words = {way.value: way.word for way in Way}
    of_fibres = {"length_mm": found.length, "strain": found.strain, "force_N": found.tension,
                 "way": np.vectorize(words.get, otypes=[object])(ways_of(found)),
                 "wrap_deg": np.rad2deg(np.maximum(np.asarray(found.wrap_angle), 0.0))}
    # Moments are about X, Y, Z of the tibia: adduction, internal rotation, extension.
    of_contacts = {
        **pose_tables.contact_numbers(knee, found), "max_depth_mm": found.max_depth,
        pose_tables.along("center_{}_mm"): found.center,
        pose_tables.along("force_{}_N"): found.contact_force,
        pose_tables.about("moment_{}_Nmm"): found.contact_moment,
        "beyond_mm": found.beyond_mm, "beyond_share": found.beyond_share,
    }  # fmt: skip
    forces = pose_tables.bundle_forces(knee, found.tension)
    sizes = np.stack([*forces.values()], axis=1) if forces else np.full((len(table), 1), np.nan)
    most, names = np.nan_to_num(sizes).argmax(axis=1), [*forces] or [""]
    pressure = np.asarray(found.max_pressure)
    contacts = [Column(f"{name}_N", f"{name} contact, N", ".1f") for name in knee.contact_names]
    summary = Table.of({
        Column("pose"): rows, Column("flexion_deg", show=".1f"): flexion,
        Column("ligament", "most in", words=True): [names[k] for k in most],
        Column("ligament_N", show=".1f"): sizes[np.arange(len(table)), most],
        tuple(contacts): pose_tables.contact_forces(found),
        Column("max_pressure_MPa", "peak pressure, MPa", ".2f"):
            pressure.max(axis=1) if pressure.size else np.nan,
        "status": states,
    }, "At each pose", "Ligament forces are sums over their fibres.")  # fmt: skip
    return Answer(
        title=f"{knee.name} at given poses",
        asked=f"Ligament and contact forces at {len(table)} given poses; nothing is moved.",
        verdict=pose_tables.verdict_of(status), sentence=_sound(status) + ".",
        tables={
            "ligaments": pose_tables.part_table({"pose": rows, "flexion_deg": flexion}, "ligament",
                                                knee.ligaments.names, of_fibres),
            "contact": pose_tables.part_table({"pose": rows}, "contact", knee.contact_names,
                                              of_contacts, {"status": states}),
        },
        main=[summary], doubts=doubts,
        sections=[Section("Ligaments", tables=["ligaments"]),
                  Section("Contact", tables=["contact"])],
        text=[f"{_sound(status)}."],
    )


def displacement(under_load: Motion, without: Motion) -> np.ndarray:
    """How far a load moved the tibia."""
    tables = []
    for motion in (under_load, without):
        table = convert_table(np.asarray(motion.to_table()), FEMORAL, CLINICAL)
        table[~converged(np.asarray(motion.status))] = np.nan
        tables.append(table)
    return (tables[0] - tables[1])[:, 1:]


def _sound(status: np.ndarray) -> str:
    good = int((np.asarray(status) == Status.BALANCED).sum())
    if good == len(status):
        return f"All {good} poses pass every check" if good > 1 else "1 pose passes every check"
    return f"{good} of {len(status)} poses pass every check"


def _sentence(status, table: np.ndarray, forces: Mapping[str, np.ndarray], flexion) -> str:
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
    peaks = {name: np.nanmax(x) for name, x in forces.items() if np.isfinite(x).any()}
    if peaks:
        most = max(peaks, key=lambda name: peaks[name])
        words += f" Most is carried by {most}, {peaks[most]:.0f} N."
    return words
