"""A cohort as one data set with named axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from kneejax.cohorts._summary import CohortSummary
from kneejax.geometry import COORDINATES, FREE_COORDINATES
from kneejax.numerics import check_installed

if TYPE_CHECKING:
    from xarray import Dataset

_ESTIMATES = ("value", "low", "high", "standard_error", "start")


def to_dataset(summary: CohortSummary) -> Dataset:
    """Everything that a cohort found, over knees, parameters and coordinates.

    Args:
        summary: of the cohort.

    Returns:
        Of each knee: estimates with limits, in the light of the others (`in_population`), their
        correlation, errors, outcome; of each parameter mean and spread over knees, which are of the
        logarithm where `logarithm` says so. Knees without an answer are NaN.

    Raises:
        MissingPackage: xarray is not installed.
    """
    check_installed("xarray", "cohorts")
    import xarray

    knees, names = [one.name for one in summary.answers], list(summary.units)
    place = {one.name: row for row, one in enumerate(summary.fitted)}
    size, count = len(knees), len(names)
    table = {field: np.full((size, count), np.nan) for field in _ESTIMATES}
    beside = {k: np.full((size, count), np.nan) for k in ("in_population", "in_population_sd")}
    rmse = np.full((size, len(FREE_COORDINATES)), np.nan)
    correlation = np.full((size, count, count), np.nan)
    interval = np.full((size, count), "", object)
    for row, one in enumerate(summary.answers):
        own = [names.index(name) for name in one.parameters]
        for column, estimate in zip(own, one.parameters.values(), strict=True):
            for field in _ESTIMATES:
                table[field][row, column] = getattr(estimate, field)
            interval[row, column] = estimate.interval
        if own:
            correlation[np.ix_([row], own, own)] = one.correlation
        rmse[row] = [one.rmse.get(name, np.nan) for name in FREE_COORDINATES]
        for column, name in enumerate(names):
            if name in summary.populations and one.name in place:
                found = summary.populations[name]
                beside["in_population"][row, column] = found.shrunk[place[one.name]]
                beside["in_population_sd"][row, column] = found.deviation[place[one.name]]
    each, over = ("knee", "parameter"), summary.populations
    data = {name: (each, x) for name, x in {**table, **beside}.items()}
    data |= {
        "interval": (each, interval.astype(str)),
        "rmse": (("knee", "coordinate"), rmse),
        "correlation": (("knee", "parameter", "other_parameter"), correlation),
        "objective": ("knee", [one.objective for one in summary.answers]),
        "outcome": ("knee", [one.outcome or "failed" for one in summary.answers]),
        "failed": ("knee", [one.failed for one in summary.answers]),
        "mean": ("parameter", [over[n].mean if n in over else np.nan for n in names]),
        "spread": ("parameter", [over[n].spread if n in over else np.nan for n in names]),
        "logarithm": ("parameter", [n in over and over[n].log for n in names]),
        "correlation_over_knees": (("parameter", "other_parameter"), summary.correlation),
    }
    if summary.draws:
        longest = max(len(x) for x in summary.draws.values())
        redrawn = np.full((size, longest, count), np.nan)
        for row, one in enumerate(summary.answers):
            if one.name in summary.draws:
                own = [names.index(name) for name in one.parameters]
                values = summary.draws[one.name][:, : len(own)]
                redrawn[np.ix_([row], range(len(values)), own)] = values
        data["bootstrap"] = (("knee", "draw", "parameter"), redrawn)
    places = {
        "knee": knees, "parameter": names, "other_parameter": names,
        "coordinate": list(FREE_COORDINATES),
        "parameter_unit": ("parameter", [summary.units[name] for name in names]),
        "coordinate_unit": ("coordinate", [COORDINATES[n].unit for n in FREE_COORDINATES]),
    }  # fmt: skip
    return xarray.Dataset(data, places, {"title": summary.title})
