"""`kneejax describe KNEE`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from kneejax.cli.options import Describe
from kneejax.files import load_knee_file
from kneejax.mechanics import Knee
from kneejax.parameters import QUANTITIES, UnknownParameter, default_bounds, select
from kneejax.report import knee_text

_OF_CONTACTS = ("youngs_modulus", "poisson_ratio", "layer_thickness")


def run(asked: Describe) -> int:
    """Print a knee: ligaments, contacts, loads, frames, adaptations; or its parameters."""
    read = load_knee_file(asked.knee)
    if asked.parameters:
        print("\n".join(parameter_lines(read.knee, asked.fibres)))
    else:
        print(knee_text(read.knee, read.document, asked.fibres))
    return 0


def parameter_lines(knee: Knee, fibres: bool = False) -> Iterator[str]:
    """Names of a knee's parameters with value, unit and the bounds of a fit, a line each.

    Args:
        knee: any knee.
        fibres: whether single fibres of structures are listed too.
    """
    grouped = {fibre for _, members in knee.groups for fibre in members}
    owners = [name for name, _ in knee.groups]
    owners += [name for name in knee.ligaments.names if fibres or name not in grouped]
    names = [f"{owner}.{quantity}" for owner in owners for quantity in QUANTITIES]
    names += [f"{owner}.{quantity}" for owner in knee.contact_names for quantity in _OF_CONTACTS]
    yield f"{knee.name}: names as `parameters:` of a study and --set take them; *.stiffness is"
    yield "the stiffness of every ligament. Bounds hold in a fit unless the study states others."
    yield f"{'parameter':<36} {'value':>10} {'unit':<5} {'lower':>10} {'upper':>10}"
    for name in names:
        try:
            one = select(knee, [name])
        except UnknownParameter:  # e.g. an attachment on a bone that the ligament does not reach
            continue
        bounds = zip(one.names, np.asarray(one.read(knee)), *default_bounds(knee, one), strict=True)
        for i, (full, value, lower, upper) in enumerate(bounds):
            row = f"{full:<36} {value:>10.4g} {one.unit(i):<5} {lower:>10.4g} {upper:>10.4g}"
            yield row if np.isfinite(value) else f"{full:<36} {'none':>10} {one.unit(i)}".rstrip()
