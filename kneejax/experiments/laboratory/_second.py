"""Second stable balances of a knee that was cut, in a test under load."""

from __future__ import annotations

import jax
import numpy as np

from kneejax.experiments._second_balances import (
    GUESSED,
    changed_in_steps,
    follow_second,
    second_of,
)
from kneejax.experiments.laboratory._curves import Curves
from kneejax.geometry import COLUMNS, FREE_COORDINATES, table_units
from kneejax.mechanics import Knee
from kneejax.statics import balance_near, balance_one, converged, itself


def second_balances(curves: Curves, before: Knee) -> np.ndarray:
    """Where a knee that was cut has a second stable balance under the loads of a test.

    A test finds what is connected with the unloaded knee. From the other side the intact knee is
    loaded first and cut then: at the ends of each curve and without the test's load. What is found
    there apart from the curve is followed along it, as far as it exists.

    Args:
        curves: of the knee that was cut.
        before: the knee before.

    Returns:
        Poses, degrees and mm, `(flexions, loads, 6)`; NaN where none is known, and in tests in
        which a machine moves or holds the tibia.
    """
    motion, nodes = curves.motion, curves.nodes
    answer = np.full((*nodes.shape, len(COLUMNS)), np.nan)
    if curves.test.machine:
        return answer
    part = curves.part
    ends = sorted({int(part.argmin()), int(np.abs(part).argmin()), int(part.argmax())})
    load_cases = jax.tree.map(lambda x: np.asarray(x)[nodes.ravel()], motion.load_cases.of(before))
    main = {x: np.moveaxis(np.asarray(getattr(motion.equilibrium, x)), -1, 0)[nodes.ravel()]
            for x in GUESSED}  # fmt: skip
    main["status"] = np.asarray(motion.status)[nodes.ravel()]
    second = {x: np.full_like(main[x], np.nan) for x in GUESSED}
    lines = np.arange(nodes.size).reshape(nodes.shape)
    rows = lines[:, ends].ravel()
    at = jax.tree.map(lambda x: x[rows], load_cases)
    whole = balance_one(before, at).in_nodes()
    good = np.asarray(converged(whole["status"]))
    # A loose knee snaps over on the way to its load: then what it snaps to from its neutral pose.
    rest = np.repeat(np.arange(len(nodes)) * len(ends) + ends.index(int(np.abs(part).argmin())),
                     len(ends))  # fmt: skip
    lost = np.flatnonzero(~good & good[rest])
    if len(lost):
        begin = [whole[name][rest[lost]][None] for name in GUESSED]
        there = jax.tree.map(lambda x: x[lost], at)
        snapped = balance_near(before, itself, np.zeros(1), there, *begin).in_nodes()
        for name in (*GUESSED, "status"):
            whole[name] = np.array(whole[name])
            whole[name][lost] = snapped[name]
        good = np.asarray(converged(whole["status"]))
    if good.any():
        at, rows = jax.tree.map(lambda x: x[good], at), rows[good]
        found = changed_in_steps(before, motion.knee, at, [whole[x][good] for x in GUESSED])
        if found is not None:
            here = second_of(at, {x: main[x][rows] for x in ("q", "status")}, found)
            for name, values in second.items():
                values[rows[here]] = found[name][here]
    follow_second(motion.knee, load_cases, main, second, lines)
    poses = second["q"].reshape(*nodes.shape, -1)[..., : len(FREE_COORDINATES)]
    answer[..., 1:] = poses * table_units(FREE_COORDINATES)
    flexion = np.array(curves.test.flexion_deg)[:, None]
    answer[..., 0] = np.where(np.isnan(answer[..., 1]), np.nan, flexion)
    return answer
