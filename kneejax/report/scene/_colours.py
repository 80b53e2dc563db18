"""Colours of a scene: strain on fibres, pressure on plateaux."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from kneejax.report.scene._pressure_map import PRESSURE_COLOURS
from kneejax.report.scene._scene import Fibre, Plateau, Scene

#: A slack fibre carries nothing, and fades: thin and grey. Strained ones are the redder the more.
SLACK = "#A9ADB2"
_REDS, _PALEST = "coolwarm", 0.58
CONDYLE, GROUND, BONE, OBSTACLE = "#EADFCB", "#DDD6C8", "#E9E4D8", "#6FA8A0"
MUSCLE = "#8E6A9E"
BONE_OPACITY = {"femur": 0.25, "tibia": 0.4, "patella": 0.3}


def strain_limit(every: Sequence[Scene]) -> float:
    """Strain at the end of the colours: the largest pull in full percent, at least 2 %."""
    fibres = (fibre for scene in every for fibre in scene.fibres if not fibre.is_muscle)
    most = max((fibre.strain for fibre in fibres), default=0.0)
    return max(0.02, float(np.ceil(most * 100.0)) / 100.0)


def pressure_limit(every: Sequence[Scene]) -> float:
    """Pressure at the end of the colours, MPa: the largest one; 1 without contact."""
    peaks = [np.nanmax(p.pressure_MPa, initial=0.0) for scene in every for p in scene.plateaus]
    peak = float(max(peaks, default=0.0))
    return peak if peak > 0 else 1.0


def strain_colours():
    """The scale of colours of strained fibres, from no strain to the largest."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps[_REDS](np.linspace(_PALEST, 1.0, 256)))


def fibre_colour(fibre: Fibre, limit: float) -> str:
    """Colour of a fibre: a muscle's, or that of its strain (`strain_colour`)."""
    return MUSCLE if fibre.is_muscle else strain_colour(fibre.strain, limit)


def strain_colour(strain: float, limit: float) -> str:
    """Colour of a fibre, as `#rrggbb`; grey where it is slack.

    Args:
        strain: any; beyond the limit the last colour holds.
        limit: strain at the end of the colours.

    Example:
        >>> strain_colour(0.05, 0.05), strain_colour(-1.0, 0.05)
        ('#b40426', '#a9adb2')
    """
    from matplotlib.colors import to_hex

    if not strain > 0:
        return to_hex(SLACK)
    return to_hex(strain_colours()(min(strain / limit, 1.0)))


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
