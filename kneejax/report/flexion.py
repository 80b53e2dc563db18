"""Motion over flexion and the forces that hold it: passive flexion and given poses as answers, and
figures, also of what a calibration fitted."""

__all__ = ["motion_figure"]

import itertools
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from numpy.typing import ArrayLike

from kneejax.experiments import Branch, Mechanics, Motion, Way, ways_of, with_flips
from kneejax.geometry import CLINICAL, CONVENTION_WORDS, COORDINATES, FEMORAL
from kneejax.inference import Calibration
from kneejax.mechanics import Knee, load_words
from kneejax.report import panels as draw
from kneejax.report import pose_tables
from kneejax.report.look.colours import BLUE, CONTACT_PARTS, FITS, GREY, VERMILLION, part_styles
from kneejax.report.look.page import Answer, Drawing, Section
from kneejax.report.look.style import SHOWN, Axes, Figure, styled, verbatim
from kneejax.report.look.tables import Column, Table
from kneejax.statics import Status, converged

_COLUMN = {name: i for i, name in enumerate(COORDINATES)}


@styled
def motion_figure(calibration: Calibration) -> Figure:
    """Draw measured, started and fitted motion: five coordinates over flexion.

    Args:
        calibration: what to draw; every procedure is shown, the answer on top.

    Returns:
        Translations on the left, rotations on the right, the legend in the sixth panel.
    """
    measured, several = np.asarray(calibration.measured, float), len(calibration.fits) > 1
    flexion = measured[:, 0]
    # A simulated pose depends on flexion alone, so it is drawn as a line over flexion even where
    # the measurement runs to and fro.
    order = np.argsort(flexion, kind="stable")
    motions = {"start": (BLUE, ":", np.asarray(calibration.start.table, float))}
    for i, fit in reversed(list(enumerate(calibration.fits))):
        table = np.array(fit.motion.table, float)
        for offset in fit.offsets:
            table[:, _COLUMN[offset.name]] += offset.value
        label = verbatim(f"fitted, procedure {fit.procedure}") if several else "fitted"
        dashes = "--" if i == 0 else (0, (1 + 3 * i, 1.5, 1, 1.5))
        motions[label] = FITS[i % len(FITS)], dashes, table
    figure, panels, words = draw.coordinate_panels(flexion)
    lines: dict[str, Any] = {}
    marked: dict[str, Any] = {}
    for name, axes in panels.items():
        column = _COLUMN[name]
        style = draw.measured_curve(flexion)
        (lines["measured"],) = axes.plot(flexion, measured[:, column], **style)
        for label, (color, dashes, table) in motions.items():
            style = {"color": color, **draw.curve_style(flexion[order], dashes)}
            (lines[label],) = axes.plot(flexion[order], table[order, column], **style)
        for kind, motion, color, height in (("start", calibration.start, BLUE, 0.10),
                                            ("fitted", calibration.fit.motion, VERMILLION, 0.03)):
            marks = draw.mark_status(axes, flexion, pose_tables.row_status(motion), color, height)
            marked |= {f"{kind}: {entry}": handle for entry, handle in marks.items()}
    # The answer was drawn last, on top, and is named first.
    legend = ["measured", "start", *reversed([*motions][1:])]
    handles = {label: lines[label] for label in legend} | marked
    draw.part_legend(words, handles, (0.0, 0.84), fontsize=8, ncols=1 if len(handles) <= 8 else 2,
                     handlelength=2.8, columnspacing=1.2, borderpad=0, labelspacing=0.5,
                     markerscale=1.2 if len(measured) <= draw.DENSE else 2.0)  # fmt: skip
    if calibration.fit.offsets:
        note = "Fitted motions are drawn with their frame offsets."
        words.text(0.0, 0.0, note, fontsize=7.5, transform=words.transAxes)
    return figure


def _force_lines(
    axes: Axes, x: np.ndarray, forces: Mapping[str, ArrayLike], contact: bool, dashes: str = "-"
) -> dict[str, Any]:
    """Forces over flexion, ligaments in the colours of their structures; lines by their names."""
    drawn, styles = {}, part_styles(forces)
    if contact:
        pairs = zip(forces, itertools.cycle(CONTACT_PARTS), strict=False)
        styles = {name: {"color": color, "linestyle": "-"} for name, color in pairs}
    for name, force in forces.items():
        own = styles[name]["linestyle"] if dashes == "-" else dashes
        style = {**styles[name], **draw.curve_style(x, own)}
        label = verbatim(name) if dashes == "-" else None
        (drawn[verbatim(name)],) = axes.plot(x, np.asarray(force, float), label=label, **style)
    return drawn


@styled
def ligament_forces_figure(calibration: Calibration) -> Figure:
    """Draw ligament and contact forces over flexion, at the start and fitted."""
    flexion = np.asarray(calibration.measured, float)[:, 0]
    order = np.argsort(flexion, kind="stable")
    start, fitted = calibration.start, calibration.fit.motion
    groups = [("Ligament", calibration.ligaments, start.ligament_forces, fitted.ligament_forces),
              ("Contact", calibration.contacts, start.contact_forces, fitted.contact_forces)]
    groups = [group for group in groups if group[1]] or groups[:1]
    right = 2.38 if max(len(names) for _, names, *_ in groups) > 12 else 1.4
    figure, panels = draw.grid(len(groups), 1, 2.75 * len(groups) + 0.35, right=right, top=0.28,
                               bottom=0.45, apart=(0, 0.4), sharex=True)  # fmt: skip
    for axes, (title, names, *forces) in zip(panels[:, 0], groups, strict=True):
        contact, last = title == "Contact", axes is panels[-1, 0]
        axes.set_title(f"{title} force, N")
        before, after = (dict(zip(names, np.asarray(x, float)[order].T, strict=True))
                         for x in forces)  # fmt: skip
        _force_lines(axes, flexion[order], before, contact, ":")
        drawn = _force_lines(axes, flexion[order], after, contact)
        draw.flexion_axis(axes, flexion, last)
        axes.tick_params(labelbottom=last)
        if "marker" not in draw.curve_style(flexion[order], "-") and axes is panels[0, 0]:
            drawn |= {word: Line2D([], [], color=GREY, linestyle=d)
                      for word, d in (("fitted", "-"), ("start", ":"))}  # fmt: skip
        draw.mark_status(axes, flexion, pose_tables.row_status(fitted))
        columns = 1 if len(drawn) <= 12 else 2
        draw.part_legend(axes, drawn, (1.01, 1.0), ncols=columns, handlelength=1.4)
    return figure


@styled
def simulation_figure(
    flexion_deg: ArrayLike, table: ArrayLike, status: ArrayLike, ligaments: Mapping[str, ArrayLike],
    contacts: Mapping[str, ArrayLike], convention: str = "femoral",
) -> Figure:  # fmt: skip
    """Draw a simulated motion and its forces, by the names of ligaments and of contacts."""
    x, label = np.asarray(flexion_deg, float), draw.FLEXION
    if np.ptp(x) == 0:
        x, label = np.arange(1.0, len(x) + 1), "Step"
    table, status = np.asarray(table, float), np.asarray(status, int)
    meaning = f"Convention {convention}: {CONVENTION_WORDS.get(convention, '')}".strip(": ")
    figure, panels = draw.panel_grid(4, 2, 8.8, "\n".join(textwrap.wrap(meaning, 100)))
    for name, place in zip(SHOWN, (0, 2, 4, 1, 3), strict=True):
        panels[place].plot(x, table[:, _COLUMN[name]], color=GREY, **draw.curve_style(x, "-"))
        panels[place].set_title(COORDINATES[name].axis_label)
    for place, forces, kind in ((6, ligaments, "Ligament"), (7, contacts, "Contact")):
        _force_lines(panels[place], x, forces, place == 7)
        panels[place].set_ylabel(f"{kind} force, N")
        draw.legend_above(panels[place], 5)
    marks: dict[str, Any] = {}
    for place, axes in enumerate(panels):
        if place != 5:
            marks |= draw.mark_status(axes, x, status)
            draw.flexion_axis(axes, x, place in (3, 4, 6, 7), label=label)
    panels[5].set_axis_off()
    draw.part_legend(panels[5], marks, (0.0, 0.9))
    return figure


def flexion_answer(
    name: str, motion: Motion, mechanics: Mechanics, flexion: np.ndarray, *,
    loads: Mapping[str, float], unloaded: Motion | None = None,
    branches: Sequence[Branch] | None = None, convention: str = FEMORAL,
) -> Answer:
    """Passive flexion; `unloaded` is the same without the loads, which says what they moved."""
    knee, status = motion.knee, with_flips(motion.status, mechanics)
    table = np.array(motion.to_table())
    table[:, 0] = flexion
    words = pose_tables.pose_words(knee, mechanics, pose_tables.search_words(motion, loads))
    more = {"converged": motion.equilibrium.converged, "stable": motion.stable, "doubt": words}
    tables = {"poses": pose_tables.pose_table(table, status, convention, more=more),
              "forces": pose_tables.force_table(knee, mechanics, {"flexion_deg": flexion})}
    main = ["poses"]
    if unloaded is not None:
        tables["displacement"] = pose_tables.change_table(flexion, displacement(motion, unloaded))
        main.append("displacement")
    sections = [pose_tables.peak_section(knee, mechanics, flexion, "at flexion, deg")]
    if branches is not None:
        # All balances for the file; the others for people.
        poses = np.array([[flexion[b.load_case], *b.pose[1:]] for b in branches])
        marks = {"by_test": [int(b.by_test) for b in branches],
                 "apart_mm": [b.apart_mm for b in branches],
                 "starts": [b.starts for b in branches]}  # fmt: skip
        whole = pose_tables.pose_table(poses, [b.status for b in branches], convention, more=marks)
        rows = [row for row, b in zip(whole.rows, branches, strict=True) if not b.by_test]
        columns = [one for one in whole.columns if one.name != "convention"]
        tables["branches"] = Table(columns, [row[: len(columns)] for row in whole.rows])
        said, others = "No other stable balance was found at any of these angles.", []
        if rows:
            said, others = "There are other stable equilibria:", [Table(whole.columns, rows)]
        sections.append(Section("Other balances", [said], others, printed=True))
    named = [f"{x:g}" for x in flexion]
    forces = pose_tables.bundle_forces(knee, mechanics.tension)
    contact = pose_tables.contact_forces(mechanics)
    angles = f"{', '.join(named)} degrees of flexion"
    if len(flexion) > 4:
        angles = f"{len(flexion)} flexions from {min(flexion):g} to {max(flexion):g} degrees"
    doubts = pose_tables.status_doubts(status, words, *pose_tables.named_places(named, "degrees"))
    return Answer(
        title=f"Passive flexion of {name}",
        asked=f"How the tibia moves, {load_words(loads)}, at {angles}.",
        verdict=pose_tables.verdict_of(status),
        sentence=_sentence(status, table, forces, flexion), tables=tables, main=main,
        drawings={"simulation": Drawing(
            simulation_figure, flexion, pose_tables.in_convention(table, convention)[0], status,
            forces, dict(zip(knee.contact_names, contact.T, strict=True)), convention,
        )},
        doubts=[*doubts], sections=sections,
    )  # fmt: skip


def evaluation_answer(knee: Knee, table: np.ndarray, found: Mechanics) -> Answer:
    """Ligaments and contact at given poses, `(n, 6)`, degrees and mm."""
    rows, flexion = range(len(table)), table[:, 0]
    status, doubts = pose_tables.given_doubts(knee, found, [str(row) for row in rows])
    states = pose_tables.words_of(status)
    words = {way.value: way.word for way in Way}
    of_fibres = {"length_mm": found.length, "strain": found.strain, "force_N": found.tension,
                 "way": np.vectorize(words.get, otypes=[object])(ways_of(found)),
                 "wrap_deg": np.rad2deg(np.maximum(np.asarray(found.wrap_angle), 0.0))}
    # Moments are about X, Y, Z of the tibia: adduction, internal rotation, extension.
    of_contacts = {**pose_tables.contact_numbers(knee, found), "max_depth_mm": found.max_depth,
                   pose_tables.along("center_{}_mm"): found.center,
                   pose_tables.along("force_{}_N"): found.contact_force,
                   pose_tables.about("moment_{}_Nmm"): found.contact_moment,
                   "beyond_mm": found.beyond_mm, "beyond_share": found.beyond_share}  # fmt: skip
    forces = pose_tables.bundle_forces(knee, found.tension) or {"": np.full(len(table), np.nan)}
    sizes, names = np.stack([*forces.values()], axis=1), [*forces]
    most, pressure = np.nan_to_num(sizes).argmax(axis=1), np.asarray(found.max_pressure)
    contacts = [Column(f"{name}_N", f"{name} contact, N", ".1f") for name in knee.contact_names]
    summary = Table.of({
        "pose": rows, Column("flexion_deg", show=".1f"): flexion,
        Column("ligament", "most in"): [names[k] for k in most],
        Column("ligament_N", show=".1f"): sizes[np.arange(len(table)), most],
        tuple(contacts): pose_tables.contact_forces(found),
        Column("max_pressure_MPa", "peak pressure, MPa", ".2f"):
            pressure.max(axis=1) if pressure.size else np.nan,
        "status": states,
    }, "At each pose", "Ligament forces are sums over their fibres.")  # fmt: skip
    return Answer(
        title=f"{knee.name} at given poses",
        asked=f"Ligament and contact forces at {len(table)} given poses; nothing is moved.",
        verdict=pose_tables.verdict_of(status), sentence=_sound(status),
        tables={
            "ligaments": pose_tables.part_table({"pose": rows, "flexion_deg": flexion}, "ligament",
                                                knee.ligaments.names, of_fibres),
            "contact": pose_tables.part_table({"pose": rows}, "contact", knee.contact_names,
                                              of_contacts, {"status": states}),
        },
        main=[summary], doubts=doubts,
        sections=[Section("Ligaments", tables=["ligaments"]),
                  Section("Contact", tables=["contact"])],
        text=[_sound(status)],
    )


def displacement(under_load: Motion, without: Motion) -> np.ndarray:
    """How far a load moved the tibia."""
    loaded, free = (
        np.where(converged(np.asarray(motion.status))[:, None],
                 pose_tables.in_convention(motion.to_table(), CLINICAL)[0], np.nan)
        for motion in (under_load, without)
    )  # fmt: skip
    return (loaded - free)[:, 1:]


def _sound(status: np.ndarray) -> str:
    good = int((np.asarray(status) == Status.BALANCED).sum())
    if good == len(status) == 1:
        return "1 pose passes every check."
    of_all = f"All {good}" if good == len(status) else f"{good} of {len(status)}"
    return f"{of_all} poses pass every check."


def _sentence(status, table: np.ndarray, forces: Mapping[str, np.ndarray], flexion) -> str:
    """How far the tibia moves from the first to the last balance, and what carries most."""
    known = np.flatnonzero(np.isfinite(table).all(axis=1))
    words = _sound(status)
    if len(known) > 1:
        first, last = known[[0, -1]]
        turned, moved = (table[last] - table[first])[2:4]
        words += (
            f" From {flexion[first]:g} to {flexion[last]:g} degrees the tibia turns "
            f"{abs(turned):.1f} degrees {'in' if turned >= 0 else 'out'}wards and moves "
            f"{abs(moved):.1f} mm {'forwards' if moved >= 0 else 'backwards'}."
        )
    peaks = {name: np.nanmax(x) for name, x in forces.items() if np.isfinite(x).any()}
    if peaks:
        most = max(peaks, key=peaks.__getitem__)
        words += f" Most is carried by {most}, {peaks[most]:.0f} N."
    return words
