"""Colours of a scene: strain on fibres, pressure on plateaux."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kneejax.report.scene._pressure_map import PRESSURE_COLOURS
from kneejax.report.scene._scene import Plateau, Scene

#: Diverging colours of strain, grey at zero: a slack fibre is never white on white.
STRAIN_COLOURS = "coolwarm"
CONDYLE, GROUND, BONE, OBSTACLE = "#EADFCB", "#DDD6C8", "#E9E4D8", "#6FA8A0"
BONE_OPACITY = {"femur": 0.25, "tibia": 0.4}


def strain_limit(every: Sequence[Scene]) -> float:
    """Strain at the end of the colours: the largest pull in full percent, at least 2 %."""
    most = max((fibre.strain for scene in every for fibre in scene.fibres), default=0.0)
    return max(0.02, float(np.ceil(most * 100.0)) / 100.0)


def pressure_limit(every: Sequence[Scene]) -> float:
    """Pressure at the end of the colours, MPa: the largest one; 1 without contact."""
    peaks = [np.nanmax(p.pressure_MPa, initial=0.0) for scene in every for p in scene.plateaus]
    peak = float(max(peaks, default=0.0))
    return peak if peak > 0 else 1.0


def strain_colour(strain: float, limit: float) -> str:
    """Colour of a fibre, as `#rrggbb`.

    Args:
        strain: any; beyond the limits the last colour holds.
        limit: strain at the end of the colours, on both sides of zero.

    Example:
        >>> strain_colour(0.05, 0.05), strain_colour(-1.0, 0.05)
        ('#b40426', '#3b4cc0')
    """
    from matplotlib import colormaps
    from matplotlib.colors import to_hex

    return to_hex(colormaps[STRAIN_COLOURS](0.5 + 0.5 * np.clip(strain / limit, -1.0, 1.0)))


def pressure_colours(plateau: Plateau, limit: float) -> np.ndarray:
    """Colour of each point of a plateau, `(m, n, 3)`, 0 to 1; the ground's where not pressed.

    Args:
        plateau: points with their pressure.
        limit: pressure at the end of the colours, MPa.
    """
    from matplotlib import colormaps
    from matplotlib.colors import to_rgb

    pressure = np.nan_to_num(plateau.pressure_MPa, nan=limit)
    colours = colormaps[PRESSURE_COLOURS](np.clip(pressure / limit, 0.0, 1.0))[..., :3]
    # A quick fade at the rim instead of the teeth of the grid.
    share = np.clip(pressure / (0.04 * limit), 0.0, 1.0)[..., None]
    return share * colours + (1.0 - share) * np.array(to_rgb(GROUND))
