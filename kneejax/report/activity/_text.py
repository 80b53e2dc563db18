"""What a recorded movement did to a knee, in lines."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from kneejax.experiments import Activity
from kneejax.geometry import COORDINATES, coordinate
from kneejax.report.in_time import bundles
from kneejax.report.look import listed
from kneejax.report.motion import second_balance

#: A knee whose residual is larger does not agree with the record, N m.
_LARGE_NM = 5.0


def activity_lines(found: Mapping[str, Activity]) -> Iterator[str]:
    """Range of each coordinate, peaks of forces, what flexion is held with.

    Args:
        found: what a knee is called, e.g. `intact`, -> its activity.
    """
    for name, one in found.items():
        count, held = len(one.holds), int(one.holds.sum())
        yield f"{name}: in balance at {held} of {count} instants"
        if not held:
            continue
        yield from _coordinates(one)
        yield from _forces(one)
        residual = one.residual_Nm
        rms, most = np.sqrt(np.nanmean(residual**2)), np.nanmax(np.abs(residual))
        yield f"  moment that holds flexion: {rms:.1f} N m rms, at most {most:.1f} N m"
        if rms > _LARGE_NM:
            yield (
                "    so much is not explained by muscles, ligaments, contact and what acts on the "
                "leg together"
            )


def _coordinates(one: Activity) -> Iterator[str]:
    table, record = np.asarray(one.motion.to_table()), one.record
    same = record.same_frames
    yield "                            least      most" + ("  rms from record" if same else "")
    for k, name in enumerate(COORDINATES):
        values = table[:, k]
        cells = f"{np.nanmin(values):11.2f}{np.nanmax(values):10.2f}"
        if same and k:
            cells += f"{np.sqrt(np.nanmean((values - record.pose[:, k]) ** 2)):17.2f}"
        yield f"  {coordinate(name).axis_label:<20}{cells}"


def _forces(one: Activity) -> Iterator[str]:
    force = np.linalg.norm(np.asarray(one.mechanics.contact_force), axis=-1)
    time = one.record.time_s
    for k, name in enumerate(one.motion.knee.contact_names):
        if np.isfinite(force[:, k]).any():
            at = int(np.nanargmax(force[:, k]))
            yield f"  contact {name}: at most {force[at, k]:.0f} N, at {time[at]:.2f} s"
    names = one.motion.knee.ligaments.names
    tension = np.asarray(one.mechanics.tension)
    peaks = {}
    for name, fibres in bundles(one.motion.knee).items():
        whole = tension[:, [names.index(fibre) for fibre in fibres]].sum(axis=1)
        peaks[name] = float(np.nanmax(whole))
    largest = sorted(peaks.items(), key=lambda pair: -pair[1])[:5]
    yield "  ligaments, peak: " + ", ".join(f"{name} {force:.0f} N" for name, force in largest)


def second_words(one: Activity) -> tuple[str, ...]:
    """Of each instant where a second stable balance lies; empty where none is known."""
    here = np.asarray(one.motion.to_table())
    return tuple(
        second_balance(other, own) if np.isfinite(other).all() else ""
        for other, own in zip(one.other, here, strict=True)
    )


def second_lines(one: Activity) -> Iterator[str]:
    """When a second stable balance is known, and what is reported then; nothing without one."""
    rows = np.flatnonzero(np.isfinite(one.other).all(axis=1))
    if not len(rows):
        return
    # Runs of instants, one after the other.
    runs = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    time = one.record.time_s
    spans = [f"{time[r[0]]:g}" + (f" to {time[r[-1]]:g}" if len(r) > 1 else "") for r in runs]
    yield (
        f"{listed(spans, 8)} s ({len(rows)} of {len(time)} instants): a second stable balance "
        "exists, and the loads alone do not decide between them: reported is that to which the "
        "intact knee comes when it is cut while they act; what the other is stands in the column "
        "doubt"
    )
