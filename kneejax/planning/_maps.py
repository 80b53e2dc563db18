"""What a tunnel's place does, over all of a footprint; and what the tension does."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from kneejax.geometry import TIBIA
from kneejax.numerics import imported
from kneejax.planning._limits import excess
from kneejax.planning._surgery import CHOICES, Outcome, Surgery
from kneejax.statics import Progress


@dataclasses.dataclass(frozen=True)
class TunnelMap:
    """A tunnel moved over a grid, everything else kept.

    Attributes:
        bone: on which.
        bundle: whose tunnel.
        names: of the two coordinates.
        first: values of the first, `(n,)`, mm from the middle of the footprint.
        second: of the second, `(m,)`.
        base: choices that are kept.
        total: distance of all strain curves, `(m, n)`; NaN where the knee has no balance.
        laxity_mm: `(tests, m, n)`.
        peak_N: largest force of a graft, `(m, n)`.
        isometry_mm: of the bundle's graft, `(m, n)`.
        excess: by how much the worst limit is missed, as a part of it, `(m, n)`; negative where all
            are kept.
        off_bone_mm: distance from the bone's mesh, `(m, n)`; 0 without a mesh.
        status: `Status` values, `(m, n)`.
        lachman_deg: flexions of the tests.
    """

    bone: str
    bundle: str
    names: tuple[str, str]
    first: np.ndarray
    second: np.ndarray
    base: np.ndarray
    total: np.ndarray
    laxity_mm: np.ndarray
    peak_N: np.ndarray
    isometry_mm: np.ndarray
    excess: np.ndarray
    off_bone_mm: np.ndarray
    status: np.ndarray
    lachman_deg: tuple[float, ...]

    @property
    def least(self) -> tuple[float, float, float] | None:
        """Coordinates and strain distance of the best point that keeps all limits; None where no
        point does."""
        kept = np.where(self.excess <= 0.0, self.total, np.inf)
        if not np.isfinite(kept).any():
            return None
        row, column = np.unravel_index(np.argmin(kept), kept.shape)
        return float(self.first[column]), float(self.second[row]), float(kept[row, column])

    def to_dataset(self, attributes: Mapping[str, Any] | None = None):
        """The map as an `xarray.Dataset` with units.

        Args:
            attributes: of the whole.

        Raises:
            MissingPackage: the package xarray is not installed.
        """
        xarray = imported("xarray", "xarray", "maps")
        axes = (f"{self.names[1]}_mm", f"{self.names[0]}_mm")
        content: dict[str, Any] = {
            "strain_distance": (axes, self.total, {"units": "1"}),
            "graft_peak_N": (axes, self.peak_N, {"units": "N"}),
            "graft_length_change_mm": (axes, self.isometry_mm, {"units": "mm"}),
            "limits_missed_by": (axes, self.excess, {"units": "1"}),
            "distance_from_bone_mm": (axes, self.off_bone_mm, {"units": "mm"}),
            "status": (axes, self.status.astype(np.int8)),
        }
        for angle, moved in zip(self.lachman_deg, self.laxity_mm, strict=True):
            content[f"laxity_{angle:g}_deg_mm"] = (axes, moved, {"units": "mm"})
        places = {
            axes[0]: (axes[0], self.second, {"units": "mm"}),
            axes[1]: (axes[1], self.first, {"units": "mm"}),
        }
        own = {"bone": self.bone, "bundle": self.bundle}
        return xarray.Dataset(content, places, {**own, **(attributes or {})})


def tunnel_map(
    surgery: Surgery,
    base: np.ndarray,
    bone: str,
    first: np.ndarray,
    second: np.ndarray,
    *,
    bundle: int = 0,
    progress: Progress | None = None,
) -> TunnelMap:
    """Move a tunnel over a grid.

    Args:
        surgery: the reconstruction.
        base: choices that are kept, `(choices,)`.
        bone: `femur` or `tibia`.
        first: values of the first coordinate, `(n,)`, mm.
        second: of the second, `(m,)`.
        bundle: whose tunnel.
        progress: called now and then with balances done and asked for.
    """
    column = len(CHOICES) * bundle + (0 if bone == TIBIA else 2)
    grid = np.tile(np.asarray(base, float), (len(second), len(first), 1))
    grid[..., column], grid[..., column + 1] = first, second[:, None]
    shape = grid.shape[:2]
    flat = grid.reshape(-1, grid.shape[-1])
    found = surgery.try_out(flat, grid=shape, progress=progress)
    footprint = surgery.footprint(bone)
    every = (
        found.total, found.peak_N, found.isometry_mm[:, bundle], excess(surgery, found),
        footprint.off_bone(flat[:, column : column + 2]), found.status,
    )  # fmt: skip
    total, peak, isometry, far, off, status = (x.reshape(shape) for x in every)
    return TunnelMap(
        bone, surgery.plan.bundles[bundle], footprint.names, first, second, np.asarray(base),
        total, np.moveaxis(found.laxity_mm, 0, -1).reshape(-1, *shape), peak, isometry, far, off,
        status, surgery.protocol.lachman_deg,
    )  # fmt: skip


def over_tension(surgery: Surgery, base: np.ndarray, tension_N: np.ndarray) -> Outcome:
    """All bundles fixed under other tensions, everything else kept.

    Args:
        surgery: the reconstruction.
        base: choices that are kept, `(choices,)`.
        tension_N: of every bundle, `(n,)`.
    """
    choices = np.tile(np.asarray(base, float), (len(tension_N), 1))
    choices[:, len(CHOICES) - 1 :: len(CHOICES)] = tension_N[:, None]
    return surgery.try_out(choices)
