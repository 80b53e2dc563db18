"""What `kneejax joint fit` prints and writes of facets and of what a joint loses."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator

from kneejax.joints import CondyleAxes, JointFit

#: Columns of a table of facets.
FACET_COLUMNS = (
    "side", "facet", "points", "radius_mm", "rms_mm", "center_anterior_mm", "center_superior_mm",
    "center_lateral_mm", "center_error_mm", "direction_anterior", "direction_superior",
    "direction_lateral", "direction_error_deg", "own_direction",
)  # fmt: skip


def facet_rows(axes: CondyleAxes) -> list[list]:
    """Rows of a table of facets.

    Args:
        axes: the facets.

    Returns:
        A row per facet, in the order of `FACET_COLUMNS`.
    """
    return [
        [
            f.side, f.name, len(f.rows), f.cylinder.radius, f.cylinder.rms, *f.center,
            f.cylinder.center_error, *f.cylinder.direction, f.cylinder.direction_error_deg,
            f.turned,
        ]
        for f in axes.facets
    ]  # fmt: skip


def joint_kind(fit: JointFit) -> str:
    """What a moving joint is called, by the number of its poses."""
    return "moving axis" if len(fit.rows) == 2 else f"axis through {len(fit.rows)} poses"


def joint_fit_summary(
    fit: JointFit, over: str, hinge: str, facets: CondyleAxes | None = None, regions: str = ""
) -> str:
    """A fit in some lines for a terminal.

    Args:
        fit: the joints.
        over: what they are held against, in words.
        hinge: what the hinge's axis goes through, in words.
        facets: of the femur, if there are any.
        regions: how they were chosen, in words.

    Returns:
        The text, lines of at most 100 columns.
    """
    angles = ", ".join(f"{x:.1f}" for x in fit.poses[:, 0])
    lines = [
        f"{joint_kind(fit)}, {fit.moving.interpolation}: calibrated at {angles} degrees",
        f"hinge: through {hinge}, exact at {fit.poses[0, 0]:.1f} degrees",
    ]
    if facets is not None:
        lines += [f"facets: {regions}", *_facet_lines(facets)]
    title = f"RMSE over {over}, degrees and mm:"
    lines += textwrap.wrap(title, 98, subsequent_indent="  ", break_on_hyphens=False)
    head = ("adduction", "int.rot.", "anterior", "superior", "lateral")
    lines.append(" " * 22 + "".join(f"{name:>11}" for name in head))
    for name, row in zip((joint_kind(fit), "hinge"), fit.rmse, strict=True):
        lines.append(f"{name:<22}" + "".join(f"{x:>11.3f}" for x in row))
    return "\n".join(lines)


def _facet_lines(axes: CondyleAxes) -> Iterator[str]:
    yield f"{'facet, mm':<20}{'points':>7}{'radius':>9}{'rms':>7}{'centre known to':>17}"
    for f in axes.facets:
        row = f"{f.side + ' ' + f.name:<20}{len(f.rows):>7}{f.cylinder.radius:>9.1f}"
        row += f"{f.cylinder.rms:>7.2f}{f.cylinder.center_error:>17.2f}"
        yield row + ("" if f.turned else "  (direction of the transverse axis)")
