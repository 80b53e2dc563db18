"""What a surface fit leaves over, drawn on the surface."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from kneejax.geometry import Condyle
from kneejax.report.look import GREY, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.geometry import SurfaceFit


@styled
def surface_fit_figure(
    fits: Mapping[str, SurfaceFit], regions: Mapping[str, np.ndarray] | None = None
) -> Figure:
    """Residual of surface fits at the points that were fitted.

    Condyles are unrolled: angle from anterior over width. Plateaus are seen from above, a patella
    from the front.

    Args:
        fits: title -> fit; one panel each.
        regions: title -> mask of the fit's points in the contact region. Titles state the
            residual there, points elsewhere are drawn faintly. Everywhere by default.

    Returns:
        The figure, on one scale of colours that ends at the largest 98th percentile of a panel.
        Points beyond it are ringed; the largest residual stands in the title.
    """
    from matplotlib.figure import Figure

    inside = {
        title: np.ones(len(fit.points), bool) if (regions or {}).get(title) is None
        else np.asarray((regions or {})[title], bool)
        for title, fit in fits.items()
    }  # fmt: skip
    ends = [np.quantile(np.abs(fit.residual[inside[title]]), 0.98) for title, fit in fits.items()]
    limit = float(max(ends, default=0.0)) or 1.0
    columns = min(len(fits), 2)
    rows = -(-len(fits) // columns)
    figure = Figure(figsize=(3.6 * columns, 3.2 * rows), layout="constrained")
    for number, (title, fit) in enumerate(fits.items(), 1):
        axes = figure.add_subplot(rows, columns, number)
        dots = _draw(axes, title, fit, inside[title], limit)
    bar = figure.colorbar(dots, ax=figure.axes, shrink=0.6, aspect=30, extend="both")
    bar.set_label("distance outside the fit, mm (ringed: beyond the scale)")
    return figure


def _draw(axes, title: str, fit: SurfaceFit, here: np.ndarray, limit: float):
    residual, weights = fit.residual[here], fit.weights[here]
    across, along = _flat(fit)
    colours = {"cmap": "RdBu_r", "vmin": -limit, "vmax": limit, "linewidths": 0}
    if not here.all():
        axes.scatter(across[~here], along[~here], c=GREY, s=1.5, alpha=0.35, linewidths=0)
    # Thousands of points are one picture inside the SVG, which keeps the file small.
    dots = axes.scatter(
        across[here], along[here], c=residual, s=4, rasterized=len(residual) > 2000, **colours
    )
    far = np.abs(residual) > limit
    axes.scatter(
        across[here][far], along[here][far], c=residual[far], s=14,
        **{**colours, "linewidths": 0.5}, edgecolors="black",
    )  # fmt: skip
    rms = float(np.sqrt(np.average(residual**2, weights=weights)))
    digits = 3 if rms < 0.1 else 2
    largest = float(np.abs(residual).max())
    axes.set_title(f"{title}\n{rms:.{digits}f} mm rms, {largest:.2f} mm at most")
    axes.grid(False)
    if isinstance(fit.surface, Condyle):
        axes.set_xlabel("along the axis, mm")
        axes.set_ylabel("angle from anterior, degrees")
        axes.invert_yaxis()  # anterior is up, as on a plateau
    else:
        axes.set_xlabel("lateral, mm")
        axes.set_ylabel(("anterior, mm", "superior, mm")[_upwards(fit.surface)])
        axes.set_aspect("equal")
    return dots


def _flat(fit: SurfaceFit) -> tuple[np.ndarray, np.ndarray]:
    if not isinstance(fit.surface, Condyle):
        return fit.points[:, 2], fit.points[:, _upwards(fit.surface)]
    local = fit.surface.frame.placement.apply_inverse(tuple(fit.points.T))
    x, y, z = (np.broadcast_to(np.asarray(c), len(fit.points)) for c in local)
    return z, np.rad2deg(0.5 * np.pi - np.arctan2(x, -y))


def _upwards(surface) -> int:
    """Axis of the bone, 0 anterior or 1 superior, that a plateau's own X is nearest to."""
    along = surface.frame.placement.turn((1.0, 0.0, 0.0))
    return int(abs(float(along[1])) > abs(float(along[0])))
