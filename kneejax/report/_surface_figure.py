"""What a surface fit leaves over, drawn on the surface."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from kneejax.geometry import SurfaceFit


def surface_fit_figure(fits: dict[str, SurfaceFit]) -> Figure:
    """Residual of surface fits at the points that were fitted, seen along the joint.

    Args:
        fits: title -> fit; one panel each. Points are drawn in the bone's anterior and lateral
            coordinates, which is a view from above or below.

    Returns:
        The figure; colours end at the 98th percentile, the largest residual stands in the title.
    """
    from matplotlib.figure import Figure

    columns = min(len(fits), 2)
    rows = -(-len(fits) // columns)
    figure = Figure(figsize=(3.6 * columns, 3.1 * rows), layout="constrained")
    for number, (title, fit) in enumerate(fits.items(), 1):
        axes = figure.add_subplot(rows, columns, number)
        limit = float(np.quantile(np.abs(fit.residual), 0.98))
        dots = axes.scatter(
            fit.points[:, 2],
            fit.points[:, 0],
            c=fit.residual,
            s=4,
            cmap="RdBu_r",
            vmin=-limit,
            vmax=limit,
            linewidths=0,
        )
        axes.set_title(
            f"{title}\n{fit.rms:.2f} mm rms, {fit.maximum:.2f} mm at most", fontsize=9, loc="left"
        )
        axes.set_xlabel("lateral, mm", fontsize=8)
        axes.set_ylabel("anterior, mm", fontsize=8)
        axes.tick_params(labelsize=8)
        axes.set_aspect("equal")
        bar = figure.colorbar(dots, ax=axes, shrink=0.85)
        bar.set_label("distance outside the fit, mm", fontsize=8)
        bar.ax.tick_params(labelsize=8)
    return figure
