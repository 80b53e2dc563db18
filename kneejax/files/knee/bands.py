"""Bands of a knee file: ligaments between two areas of bone, drawn as fibres when they are read."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any

import numpy as np

from kneejax import mechanics
from kneejax.files import reading
from kneejax.files.knee.parts import POINTS, Point, Sourced
from kneejax.files.reading import Mistakes, Number, Part, Text, one_of, reads, wrong
from kneejax.geometry import Placement, Vector
from kneejax.mechanics import BLANKEVOORT, LIGAMENT_LAWS, RANGES, AttachmentArea

#: Fibres of a band at most.
_MOST_FIBRES = 400
_ELLIPSE = ("centre_mm", "half_axes_mm")
#: Half of an area -> the direction in which it lies, in axes of a right knee.
_HALVES = {
    "anterior": (1.0, 0.0, 0.0), "posterior": (-1.0, 0.0, 0.0), "proximal": (0.0, 1.0, 0.0),
    "distal": (0.0, -1.0, 0.0), "lateral": (0.0, 0.0, 1.0), "medial": (0.0, 0.0, -1.0),
}  # fmt: skip


def _half_axes(value: Any) -> list[tuple[float, ...]]:
    return reading.rows(reading.items(value, "two half diameters", 2), 3, RANGES["point_mm"])


class Area(Part):
    """Where a band is attached, in its bone's frame: an ellipse, or an outline; or half of it."""

    centre_mm: Point | None = None
    half_axes_mm: Annotated[Any, reads(_half_axes), POINTS] = None
    outline_mm: Annotated[Any, reads(reading.rows, 3, RANGES["point_mm"]), POINTS] = None
    half: Annotated[str, one_of(_HALVES)] | None = None

    @reading.checks
    def _check_area(self, mistakes: Mistakes) -> None:
        given = [x for x in (*_ELLIPSE, "outline_mm") if getattr(self, x) is not None]
        if given not in ([*_ELLIPSE], ["outline_mm"]):
            raise wrong(", ".join(given) or "none", f"{' and '.join(_ELLIPSE)}, or outline_mm")
        try:
            self.ellipse()
        except ValueError as problem:
            raise wrong(self.outline_mm, f"an outline around an area ({problem})") from None

    def ellipse(self, side: str = "right") -> AttachmentArea:
        """Its ellipse, or that of its half, in a knee of a side."""
        if self.outline_mm is not None:
            whole = AttachmentArea.of_outline(self.outline_mm)
        else:
            ellipse = (np.array(getattr(self, field), float) for field in _ELLIPSE)
            whole = AttachmentArea(*ellipse)
        if self.half is None:
            return whole
        to_the_right = 1.0 if side == "right" else -1.0
        return whole.half(np.array(_HALVES[self.half]) * [1.0, 1.0, to_the_right])


def _prestretch(value: Any) -> float | tuple[float, ...]:
    allowed, several = RANGES["prestretch"], isinstance(value, list)
    return reading.numbers(value, 2, allowed) if several else reading.number(value, allowed)


class Band(Sourced):
    """A ligament between two areas, of a material."""

    femoral_area: Area
    tibial_area: Area
    youngs_modulus_MPa: Number
    area_mm2: Number
    prestretch: Annotated[Any, reads(_prestretch)]
    law: Annotated[str, one_of(LIGAMENT_LAWS)]
    transition_strain: Number | None = None
    transition_width: Number
    failure_strain: Number | None = None
    damping_N_s: Number = 0.0
    wrap: Text | None = None
    fibres: Annotated[int, reads(reading.whole, 1, _MOST_FIBRES)] = 24

    @reading.checks
    def _check_band(self, mistakes: Mistakes) -> None:
        if (self.law == BLANKEVOORT) == (self.transition_strain is None):
            given = "missing" if self.transition_strain is None else self.transition_strain
            expected = f"a transition strain with the law {BLANKEVOORT}, and only with that"
            mistakes.append(wrong(given, expected, at="transition_strain"))


def fibre_names(name: str, band: Band) -> tuple[str, ...]:
    """Names of a band's fibres: its own with a number."""
    return tuple(f"{name}{row + 1:0{len(str(band.fibres))}d}" for row in range(band.fibres))


def drawn(
    document: dict[str, Any], bands: Mapping[str, Band], tibia: Placement
) -> dict[str, Any]:
    """A knee document whose bands, read, are fibres, each band a group. Half diameters belong to
    each other, first to first; those of an outline twist the band least where the tibia is."""
    fibres, groups = dict(document["ligaments"]), dict(document.get("groups", {}))
    # A left knee's points are its own, and its pose is that of a right one.
    mirror = np.array([1.0, 1.0, -1.0 if document["side"] == "left" else 1.0])
    for name, band in bands.items():
        areas = band.femoral_area, band.tibial_area
        femoral, tibial = (area.ellipse(document["side"]) for area in areas)
        if any(area.outline_mm is not None for area in areas):
            own = tibial.half_axes * mirror
            axes = np.array([[*map(float, tibia.turn(Vector(*x)))] for x in own]) * mirror
            turned = mechanics.untwisted(femoral, AttachmentArea(tibial.centre, axes)).half_axes
            back = [[*map(float, tibia.turn_back(Vector(*x)))] for x in turned * mirror]
            tibial = AttachmentArea(tibial.centre, np.array(back) * mirror)
        field = mechanics.fibre_field(
            femoral, tibial, band.youngs_modulus_MPa, band.area_mm2, band.prestretch, band.fibres
        )
        same = {x: getattr(band, x) for x in (
            "law", "transition_width", "failure_strain", "wrap", "transition_strain")}
        said = band.source if isinstance(band.source, str) else "; ".join(band.source.values())
        groups[name] = [*fibre_names(name, band)]
        for row, fibre in enumerate(groups[name]):
            fibres[fibre] = {
                "femoral_attachment_mm": field.femoral[row].tolist(),
                "tibial_attachment_mm": field.tibial[row].tolist(),
                "stiffness_N": float(field.stiffness[row]),
                "area_mm2": float(field.area[row]),
                "reference_strain": float(field.prestretch[row]) - 1.0,
                "damping_N_s": band.damping_N_s * float(field.area[row]) / band.area_mm2,
                **{key: value for key, value in same.items() if value is not None},
                "source": f"band {name}: {said}",
            }
    rest = {key: value for key, value in document.items() if key != "bands"}
    return rest | {"ligaments": fibres, "groups": groups}
