"""The objective of a study over pairs of parameters."""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Callable

import jax
import numpy as np

from kneejax.files.reading import Field, InputProblem
from kneejax.inference import BlockStore, ParameterMap, sensitivity_maps, versions
from kneejax.inference.intervals import stated_noise
from kneejax.inference.sensitivity import map_ranges
from kneejax.mechanics import range_of_parameter
from kneejax.parameters import MEANING
from kneejax.studies._poses import measured_poses
from kneejax.studies._questions import Map
from kneejax.studies._study import Study
from kneejax.studies._study_fields import plain

#: Settings of a study on which its misfit depends, besides knee, poses and tests.
_OF_MISFIT = (
    "synthetic", "weights", "frame_offset", "failures", "loads", "noise_mm", "noise_deg",
)  # fmt: skip
_MOST_POINTS = 2000  # a side of a map


def check(study: Study, question: Map) -> None:
    """Refuse what cannot be drawn; see `kneejax.studies.check`."""
    for points in question.grid:
        Field("grid", "points", points).integer(2, _MOST_POINTS)
    for name, limits in question.range.items():
        Field("range", name, list(limits)).interval(range_of_parameter(name))
    pairs = _pairs(study, question)
    if not pairs:
        names = " ".join(study.selection.names[:2])
        raise InputProblem("pair", "parameters", "none", f"two, e.g. {names}; or all pairs")
    asked = [frozenset(pair) for pair in pairs]
    for i, pair in enumerate(pairs):
        if asked[i] in asked[:i]:
            raise InputProblem("pair", "parameters", " ".join(pair), "every pair once")
        if len(asked[i]) < 2:
            expected = "two different parameters"
            raise InputProblem("pair", "parameters", " ".join(pair), expected)
    bounds = _bounds(study, question)
    ranges = map_ranges(study.knee_at_start, pairs, grid=question.grid, bounds=bounds)
    for name in question.range:
        if name not in ranges:
            raise InputProblem("range", "parameter", name, "a parameter of a pair", ranges)


def mapped(
    study: Study,
    question: Map,
    progress: Callable[[str, int, int], None] | None,
    store: BlockStore | None,
) -> tuple[ParameterMap, ...]:
    """Compute the maps; see `kneejax.run`."""
    known, weights = stated_noise(*study.noise), study.weight_vector
    if any(test.readings for test in study.tests):
        # As in a calibration: what was read of parts counts in its own standard deviation.
        weights = np.where(weights > 0, known**-2.0, 0.0)
    return sensitivity_maps(
        study.knee_at_start,
        measured_poses(study),
        _pairs(study, question),
        grid=question.grid,
        bounds=_bounds(study, question),
        weights=weights,
        offsets=tuple(study.frame_offset),
        loads=study.acting,
        tests=study.tests,
        known=known,
        store=store,
        progress=progress and functools.partial(progress, "map"),
        failures=study.counted_failures,
    )


def about_maps(study: Study, question: Map) -> dict[str, str]:
    """What maps are of, in words for their files.

    Args:
        study: that is asked.
        question: what is asked; checked.
    """
    pairs = _pairs(study, question)
    ranges = map_ranges(study.knee_at_start, pairs, bounds=_bounds(study, question))
    return {
        "study": study.title,
        "knee": study.knee_name,
        "pairs": ", ".join(" ".join(pair) for pair in pairs),
        "grid": f"{question.grid[0]}x{question.grid[1]}",
        "ranges": ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in ranges.items()),
    }


def fingerprint(study: Study, question: Map) -> bytes:
    """Everything that the numbers of maps depend on, without computing any.

    Args:
        study: that is asked.
        question: what is asked; checked.
    """
    leaves, structure = jax.tree.flatten((study.knee, study.knee_at_start))
    numbers = b"".join(np.asarray(leaf).tobytes() for leaf in leaves)
    said = study.settings()
    settings = [said[name] for name in _OF_MISFIT]
    settings += [plain(vars(test)) for test in study.tests]
    poses = b"" if study.measured is None else study.measured.tobytes()
    words = [about_maps(study, question), *settings, str(structure), versions()["kneejax"]]
    # Of structures drawn as several fibres, maps say what their stiffness means.
    words += [MEANING] if study.knee.groups else []
    return numbers + poses + json.dumps(words).encode()


def _pairs(study: Study, question: Map) -> list[tuple[str, str]]:
    pairs = [(first, second) for first, second in question.pair]
    if question.all_pairs:
        names = itertools.combinations(study.selection.names, 2)
        pairs += [pair for pair in names if pair not in pairs]
    return pairs


def _bounds(study: Study, question: Map) -> dict[str, tuple[float, float]]:
    return {**study.bounds, **{name: tuple(ends) for name, ends in question.range.items()}}
