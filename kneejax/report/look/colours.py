"""Colours of figures: those of ligaments are the same in each of them."""

__all__ = ["BLACK", "BLUE", "GREEN", "GREY", "LIGHT", "ORANGE", "PURPLE", "VERMILLION"]

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.colors import Colormap

#: Colours that stay apart for colour-blind readers (Okabe and Ito).
BLACK, BLUE, VERMILLION, GREEN = "#000000", "#0072B2", "#D55E00", "#009E73"
PURPLE, ORANGE, SKY, YELLOW = "#CC79A7", "#E69F00", "#56B4E9", "#B8A900"
GREY, LIGHT = "#666666", "#E4E7EA"
#: Colours of the procedures; the first is the answer. What they begin with is blue.
FITS = (VERMILLION, GREEN, PURPLE, ORANGE, SKY)
#: Colours of ligaments, twelve before they repeat, and of contacts.
PARTS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY, BLACK, YELLOW, "#7A4B9A", "#8C564B",
         "#5B8C5A", "#999999")  # fmt: skip

CONTACT_PARTS = (BLACK, "#7A4B9A", "#8C564B", GREY)
#: The same colour for a structure in every figure, whichever bundles of it a knee has.
_STRUCTURES = {"ACL": VERMILLION, "PCL": BLUE, "MCL": GREEN, "LCL": ORANGE, "graft": PURPLE}
_OTHERS = [color for color in PARTS if color not in _STRUCTURES.values()]
_DASHES = ("-", "--", ":", "-.")


def part_styles(names: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Colour and dashes of each ligament: a colour for each structure, dashes for its bundles."""
    styles: dict[str, dict[str, Any]] = {}
    seen: dict[str, int] = {}
    for name in names:
        structure = next((one for one in _STRUCTURES if one in name), name)
        count = seen[structure] = seen.get(structure, -1) + 1
        others = [one for one in seen if one not in _STRUCTURES]
        color = _STRUCTURES.get(structure) or _OTHERS[others.index(structure) % len(_OTHERS)]
        styles[name] = {"color": color, "linestyle": _DASHES[count % len(_DASHES)]}
    return styles


def parameter_styles(names: Sequence[str]) -> list[tuple[str, int]]:
    """Colour of each parameter's ligament, and the number of its quantity, as they come."""
    pairs = [name.partition(".")[::2] for name in names]
    quantities = list(dict.fromkeys(quantity for _, quantity in pairs))
    colours = part_styles(dict.fromkeys(ligament for ligament, _ in pairs))
    return [(colours[part]["color"], quantities.index(quantity)) for part, quantity in pairs]


def shades(count: int, last: float = 0.92) -> Any:
    """Colours from dark to bright for so many curves in order, `(count, 4)`."""
    import matplotlib

    return matplotlib.colormaps["viridis"](np.linspace(0.0, last, count))


def uniform_colours():
    """Part of viridis, without the yellow that is lost on white paper."""
    from matplotlib.colors import ListedColormap

    return ListedColormap(shades(256, 0.9))


def both_signs() -> "Colormap":
    """Blue for what is negative, white at zero, red for what is positive."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("both signs", [BLUE, "#FFFFFF", VERMILLION])
