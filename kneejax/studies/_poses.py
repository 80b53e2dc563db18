"""The poses of a study: as they were measured, or made by its knee."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field as described
from pydantic import PlainValidator, ValidationInfo

from kneejax.files import InputProblem, bundled_measurements
from kneejax.files.reading import Field
from kneejax.studies._checked import (
    Angles,
    Convention,
    Flag,
    Part,
    Seed,
    Text,
    Values,
    by_name,
    folder_of,
    within,
)

if TYPE_CHECKING:
    from kneejax.studies._study import Study

#: Free coordinate -> its unit, in the order of `kneejax.geometry.FREE_COORDINATES`.
UNITS = {"adduction": "deg", "internal_rotation": "deg", "anterior": "mm", "superior": "mm",
         "lateral": "mm"}  # fmt: skip
_COLUMNS = ("flexion_deg", *(f"{name}_{unit}" for name, unit in UNITS.items()))
#: Signs of a left knee in axes with Z to the person's right: adduction, internal rotation and
#: lateral shift change.
MIRROR = (1.0, -1.0, -1.0, 1.0, 1.0, -1.0)


def _table(value: Any, info: ValidationInfo) -> str:
    field = Field("", "", value)
    path = folder_of(info) / field.text()
    if os.path.isfile(path):
        return os.fspath(path)
    every = bundled_measurements()
    known = {name: one for name, one in every.items() if one.use == "poses"}
    if field.value in known:
        return os.fspath(known[field.value].path)
    if field.value in every:
        other = "a table under tests" if every[field.value].use == "test" else "conditions alone"
        raise field.problem(f"measured poses; {field.value} is {other}")
    raise field.problem(f"a CSV table or a bundled measurement; not at {path}", known)


def given_poses(field: Field) -> np.ndarray | None:
    if field.value is None:
        return None
    expected = "poses, (n, 6): degrees and mm, all finite"
    if isinstance(field.value, str | int | float):
        raise field.problem(f"a mapping with the fields file, source, or {expected}")
    try:
        table = np.asarray(field.value, float)
    except (TypeError, ValueError):
        raise field.problem(expected) from None
    if table.ndim != 2 or table.shape[1] != len(_COLUMNS) or not len(table):
        raise Field("", "", f"shape {table.shape}").problem(expected)
    if not np.isfinite(table).all():
        row = int(np.flatnonzero(~np.isfinite(table).all(axis=1))[0])
        raise Field("", f"[{row}]", "not finite").problem(expected)
    return table


class Measured(Part):
    """A table of measured poses, as a study names it."""

    file: Annotated[Text, PlainValidator(_table)] = described(
        description="CSV table, relative to the study's folder, or a bundled measurement"
    )
    source: Text = described(description="who measured it")
    convention: Convention = described("femoral", description="what its coordinates mean")
    columns: Annotated[
        dict[str, str],
        by_name(
            lambda field, _: field.text(),
            f"a mapping with the fields {', '.join(_COLUMNS)}",
            _COLUMNS,
        ),
    ] = described(default_factory=dict, description="column of a pose -> what the table calls it")
    mirror: Flag = described(False, description="whether a left knee was measured in axes with Z "
                             "to the person's right")  # fmt: skip

    def read(
        self, limits: tuple[float, float] | None
    ) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Poses within limits of flexion, `(n, 6)`, degrees and mm, and loads that acted."""
        from kneejax.files import read_loads, read_poses

        table = read_poses(self.file, self.convention, self.columns)
        loads = read_loads(self.file)
        if self.mirror:
            table = table * MIRROR
            # Of a left knee medial and lateral change sides; varus and inwards stay what they are.
            loads |= {"lateral_N": -loads["lateral_N"]} if "lateral_N" in loads else {}
        if limits is None:
            return table, loads
        lower, upper = limits
        # Limits include poses that a conversion moved by rounding.
        inside = (table[:, 0] >= lower - 1e-6) & (table[:, 0] <= upper + 1e-6)
        if not inside.any():
            expected = f"limits within {table[:, 0].min():g} and {table[:, 0].max():g}, as measured"
            raise InputProblem("", "flexion_deg", f"{lower:g} to {upper:g}", expected)
        return table[inside], {name: sizes[inside] for name, sizes in loads.items()}


class Synthetic(Part):
    """Poses that the model itself makes, with noise, to see whether they lead back."""

    parameters: Values = described(description="parameter -> value that makes the data")
    flexion_deg: Angles = described(description="prescribed angles, or a text such as 0:120:5")
    noise_mm: Annotated[float, within("noise_mm")] = described(
        0.0, description="standard deviation of the noise on displacements"
    )
    noise_deg: Annotated[float, within("noise_deg")] = described(
        0.0, description="standard deviation of the noise on rotations"
    )
    seed: Seed = described(0, description="of the noise")


def measured_poses(study: Study) -> np.ndarray:
    """The poses that a study compares its knee with; synthetic ones take a motion of the knee.

    Args:
        study: any.

    Returns:
        Shape `(n, 6)` in the order of `kneejax.geometry.COLUMNS`, degrees and mm; no row where a
        study has only tests.

    Raises:
        UnsuitableData: the knee that should make the data does not balance.
    """
    made = study.synthetic
    if made is None:
        return np.empty((0, 6)) if study.measured is None else study.measured
    from kneejax.inference import synthetic_motion

    return synthetic_motion(
        study.knee,
        made.parameters,
        made.flexion_deg,
        noise_mm=made.noise_mm,
        noise_deg=made.noise_deg,
        loads=study.acting,
        seed=made.seed,
    )
