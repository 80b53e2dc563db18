"""The objective of a study over pairs of parameters."""

__all__ = ["about_maps", "fingerprint", "plain_test", "sensitivity_map"]

import dataclasses
import functools
import itertools
import json
from typing import Any

import jax
import numpy as np

from kneejax.experiments import MeasuredTest
from kneejax.files import InputProblem
from kneejax.inference import BlockStore, ParameterMap, sensitivity_maps, versions
from kneejax.inference.sensitivity import map_ranges
from kneejax.parameters import MEANING
from kneejax.studies._fields import Map
from kneejax.studies._progress import Asked, progress_of
from kneejax.studies._study import Study

#: Settings of a study on which its misfit depends, besides knee, poses and tests.
_OF_MISFIT = ("synthetic", "weights", "frame_offset", "failures", "loads", "noise_mm", "noise_deg")


def sensitivity_map(study: Study, options: Map | None = None, *, progress: Asked = None,
                    store: BlockStore | None = None,
                    **fields: Any) -> tuple[ParameterMap, ...]:  # fmt: skip
    """Compute the objective of a study over pairs of parameters, the others kept at the start.

    Args:
        study: that is asked.
        options: which pairs, on which grid; or its fields by name, as `pair=[(x, y)]`.
        progress: as of `calibrate`; a map is counted in balances.
        store: keeps finished blocks; what it has is not computed again.
        **fields: of `Map`.

    Returns:
        One map a pair.

    Raises:
        InputProblem: a field is out of range, or no pair is named.
        UnknownParameter: a name that the knee does not have.
        UnsuitableData: the knee balances at no measured flexion.

    Example:
        `kj.sensitivity_map(study, pair=[("ACL.stiffness", "PCL.stiffness")])` compiles for
        long; options are checked at once:

        >>> import kneejax as kj
        >>> try:
        ...     kj.sensitivity_map(kj.read_study("passive_flexion"))
        ... except kj.InputProblem as problem:
        ...     print(problem)
        pair: parameters: none: expected two, e.g. ACL.stiffness PCL.stiffness; or all pairs
    """
    options = options or Map(**fields)
    check_map(study, options)
    noise = study.scatter
    if any(test.readings for test in study.tests):
        # As in a calibration: what was read of parts counts in its own standard deviation.
        noise = noise.as_stated()
    with progress_of(progress, "map") as show:
        return sensitivity_maps(study.knee_at_start, study.poses(), _pairs(study, options),
                                grid=options.grid, bounds=study.bounds | options.range,
                                weights=noise.first**-2.0, offsets=study.frame_offset,
                                loads=study.acting, tests=study.tests, known=noise.stated,
                                store=store, progress=show and functools.partial(show, "map"),
                                failures=study.counted_failures)  # fmt: skip


def _pairs(study: Study, options: Map) -> list[tuple[str, str]]:
    pairs = [*options.pair]
    if options.all_pairs:
        names = itertools.combinations(study.selection.names, 2)
        pairs += [pair for pair in names if pair not in pairs]
    return pairs


def check_map(study: Study, options: Map) -> None:
    """Refuse what has no map: no pair, one twice, a parameter with itself, a range of no pair."""
    pairs = _pairs(study, options)
    if not pairs:
        names = " ".join(study.selection.names[:2])
        raise InputProblem("pair", "parameters", "none", f"two, e.g. {names}; or all pairs")
    asked = [frozenset(pair) for pair in pairs]
    for i, pair in enumerate(pairs):
        if asked[i] in asked[:i]:
            raise InputProblem("pair", "parameters", " ".join(pair), "every pair once")
        if len(asked[i]) < 2:
            raise InputProblem("pair", "parameters", " ".join(pair), "two different parameters")
    bounds = study.bounds | options.range
    ranges = map_ranges(study.knee_at_start, pairs, grid=options.grid, bounds=bounds)
    for name in options.range:
        if name not in ranges:
            raise InputProblem("range", "parameter", name, "a parameter of a pair", ranges)


def about_maps(study: Study, options: Map) -> dict[str, str]:
    """What maps are of, in words for their files.

    Args:
        study: that is asked.
        options: what is asked; checked.
    """
    pairs = _pairs(study, options)
    ranges = map_ranges(study.knee_at_start, pairs, bounds=study.bounds | options.range)
    return {
        "study": study.title, "knee": study.knee_name,
        "pairs": ", ".join(" ".join(pair) for pair in pairs),
        "grid": f"{options.grid[0]}x{options.grid[1]}",
        "ranges": ", ".join(f"{name} {low:g} to {high:g}" for name, (low, high) in ranges.items())}


def fingerprint(study: Study, options: Map) -> bytes:
    """Everything that the numbers of maps depend on, without computing any.

    Args:
        study: that is asked.
        options: what is asked; checked.
    """
    leaves, structure = jax.tree.flatten((study.knee, study.knee_at_start))
    numbers = b"".join(np.asarray(leaf).tobytes() for leaf in leaves)
    said, poses = study.settings(), study.measured
    words = [about_maps(study, options), *(said[name] for name in _OF_MISFIT),
             *map(plain_test, study.tests), str(structure), versions()["kneejax"]]  # fmt: skip
    # Of structures drawn as several fibres, maps say what their stiffness means.
    words += [MEANING] if study.knee.groups else []
    return numbers + (b"" if poses is None else poses.tobytes()) + json.dumps(words).encode()


def plain_test(test: MeasuredTest) -> dict[str, Any]:
    """A test as lists and words: what a fingerprint knows of it."""

    def listed(value: Any) -> Any:
        if dataclasses.is_dataclass(value):
            return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
        return np.asarray(value).tolist() if hasattr(value, "__array__") else dict(value)

    return json.loads(json.dumps(vars(test) | {}, default=listed))
