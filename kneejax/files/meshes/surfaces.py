"""Articular surfaces fitted to cartilage: where they can touch, how good the fits are there, and
how thick the layer is that femoral and tibial cartilage form together, down to the bones."""

import dataclasses
from typing import NamedTuple

import jax
import numpy as np
from numpy.polynomial import polynomial

from kneejax import geometry
from kneejax.files.meshes import anatomy
from kneejax.files.meshes.anatomy import Femur
from kneejax.files.meshes.health import Sheet
from kneejax.files.reading import InputProblem
from kneejax.geometry import Condyle, Frame, Placement, Plateau, SplineFit, fit_condyle_spline

#: Flexion of the hinge that carries the plateau around the condyle, from the reference pose.
FLEXIONS_DEG = np.arange(-10.0, 151.0, 10.0)
#: How far it also slides forwards and backwards, since a knee rolls as it bends, mm.
SLIDES_MM = (-10.0, -5.0, 0.0, 5.0, 10.0)
#: Places that come this near when the surfaces first touch belong to the contact region, mm.
NEAR_MM = 2.0
#: Size of the patches over which the mean residual is formed, mm.
PATCH_MM = 5.0
_CELL = np.deg2rad(3.0), 1.5
_FEWEST_IN_PATCH = 5
_PATELLA_WIDTHS_MM = (20.0, 80.0)
#: How far around the condyles a patella gets, degrees from anterior, in a knee bent by 120: bent by
#: 140 it reaches 5 mm farther, which its status says.
_LOWEST_DEG = 120.0
#: The patella's joint looks backwards: Y of this frame points there, X upwards, Z to the right.
_BACKWARDS = (0.0, 0.0, 0.5 * np.pi)
#: Thickness of both cartilages where nothing is known of it, mm.
ASSUMED_MM = 6.0
#: A field is nowhere thinner than this, mm: else it is taken simpler.
_THINNEST_MM = 0.5
_DEGREES = (3, 2, 1)
#: Bone is looked for this far below and above the cartilage's surface, mm.
DEEPEST_MM, HIGHEST_MM = 12.0, 4.0
#: Cartilage may end below the bone's surface at its rims: meshes are refused where more than this
#: share of the area lies deeper than this, mm.
MOST_NEGATIVE, TOUCHING_MM = 0.2, 0.1
_CELL_MM = 5.0


class FitQuality(NamedTuple):
    """What a fit leaves over in the contact region, mm."""

    rms: float  # root of the area-weighted mean square normal distance
    maximum: float  # largest distance
    mean: float  # area-weighted mean distance, positive where points lie outside the fit
    patch_rms: float  # root mean square of the means over patches of `PATCH_MM`
    patch_maximum: float  # largest of those means
    everywhere_rms: float  # `rms` over the whole fitted region
    held_out_rms: float  # over the whole fitted region, of points that were held out


@dataclasses.dataclass(frozen=True)
class SheetFit:
    """A fitted articular surface."""

    fit: SplineFit  # the spline and its residuals, in the frames of a right knee
    region: np.ndarray  # mask of its points that lie in the contact region
    quality: FitQuality  # what is left over there


def fit_compartment(
    name: str, sheet: Sheet, femur: Femur, tibia: Placement,
    angle_deg: tuple[float, float] | None, splines: dict[str, float],
) -> tuple[SheetFit, SheetFit]:  # fmt: skip
    """Fits of a condyle and its plateau, and where they can touch; `splines` are their options."""
    lateral = anatomy.cylindrical(femur.axis, femur.cloud.points)[2] > femur.notch_mm
    cloud = femur.cloud.kept(lateral == (name == "lateral"))
    tibial = anatomy.joined([sheet])
    at_reference = anatomy.moved(tibia, tibial.points)
    angle, width = anatomy.condyle_region(femur, cloud, at_reference)
    angle = angle if angle_deg is None else tuple(float(a) for a in angle_deg)
    try:
        condyle = fit_condyle_spline(cloud.points, angle, width, femur.axis, cloud.areas, **splines)
        plane = geometry.fit_plane(tibial.points, tibial.areas).surface
        plateau = _fit_plateau(sheet, plane.frame, splines)
    except ValueError as error:
        raise InputProblem(sheet.name, name, str(error), "enough of both cartilages") from None
    on_condyle, on_plateau = contact_regions(femur, condyle, at_reference)
    return sheet_fit(condyle, femur, on_condyle), sheet_fit(plateau, femur, on_plateau)


def fit_patellofemoral(
    sheets: list[Sheet], femur: Femur, findings: list[str], splines: dict[str, float]
) -> tuple[SheetFit, SheetFit]:
    """Fits of the patella, and of one surface around both condyles that it meets."""
    patella, cloud = fit_patella(sheets, findings, splines), femur.cloud
    angle, _, along = anatomy.cylindrical(femur.axis, cloud.points)
    region = float(np.rad2deg(angle.min())), _LOWEST_DEG
    width = float(along.min()), float(along.max())
    trochlea = fit_condyle_spline(cloud.points, region, width, femur.axis, cloud.areas, **splines)
    return sheet_fit(patella, femur), sheet_fit(trochlea, femur)


def fit_patella(
    sheets: list[Sheet], findings: list[str], splines: dict[str, float]
) -> SplineFit[Plateau]:
    """Fit a spline to the patella's cartilage, in its frame, over height and width."""
    name = sheets[0].name
    width = float(np.ptp(np.concatenate([sheet.points[:, 2] for sheet in sheets])))
    low, high = _PATELLA_WIDTHS_MM
    if not low < width < high:
        expected = f"a patellar cartilage {low:g} to {high:g} mm wide (along Z)"
        raise InputProblem(name, "width", f"{width:.3g} mm", expected + "; is the unit right?")
    facing = anatomy.articular(sheets, np.array([-1.0, 0.0, 0.0]), "rear", findings)
    if len(facing) > 1:
        raise InputProblem(name, "sheets", f"{len(facing)} of them", "one sheet")
    (sheet,) = facing
    mean = np.average(sheet.normals, axis=0, weights=sheet.face_areas)
    if -mean[0] < np.abs(mean[1:]).max():
        towards = f"({', '.join(f'{x:.1f}' for x in mean)}) on average"
        expected = "a surface that faces backwards, (-1, 0, 0); is X anterior and Y superior?"
        raise InputProblem(name, "frame", towards, expected)
    points, areas, _ = sheet.corners()
    frame = Frame(np.average(points, axis=0, weights=areas), _BACKWARDS)
    try:
        return _fit_plateau(sheet, frame, splines)
    except ValueError as error:
        raise InputProblem(name, "patella", str(error), "enough of its cartilage") from None


def contact_regions(
    femur: Femur, condyle: SplineFit[Condyle], tibial: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the points of a condyle and a plateau that touch as a hinge flexes and slides."""
    surface = condyle.surface
    limits = [np.asarray(x) for x in (surface.angle, surface.width)]
    plateau, touched = np.zeros(len(tibial), bool), []
    for slide in SLIDES_MM:
        slid = tibial + np.array([slide, 0.0, 0.0])
        angle, distance, along = anatomy.cylindrical(femur.axis, slid)
        # A row for each flexion.
        turned, along = np.broadcast_arrays(angle + np.deg2rad(FLEXIONS_DEG)[:, None], along)
        over = (turned > limits[0][0]) & (turned < limits[0][1])
        over &= (along > limits[1][0]) & (along < limits[1][1])
        radius = _radius(surface, np.clip(turned, *limits[0]), np.clip(along, *limits[1]))
        gap = np.where(over, distance - np.asarray(radius), np.inf)
        near = gap < gap.min(axis=1, keepdims=True) + NEAR_MM
        plateau |= near.any(axis=0)
        touched.append(_cells(turned[near], along[near]))
    # The cells and their eight neighbours.
    cells = {(i + p, j + q) for i, j in set(map(tuple, np.concatenate(touched).tolist()))
             for p in range(-1, 2) for q in range(-1, 2)}
    own_angle, _, own_along = anatomy.cylindrical(femur.axis, condyle.points)
    own = _cells(own_angle, own_along)
    return np.array([tuple(cell) in cells for cell in own.tolist()], bool), plateau


def _fit_plateau(sheet: Sheet, frame: Frame, splines: dict[str, float]) -> SplineFit[Plateau]:
    """A height over the plane of a frame, within the outline of a sheet."""
    cloud = anatomy.joined([sheet])
    x, _, z = ((float(c.min()), float(c.max())) for c in anatomy.in_frame(frame, cloud.points).T)
    outline = np.round(anatomy.outline(sheet, frame), 3)
    return geometry.fit_plateau_spline(cloud.points, x, z, frame, cloud.areas, outline=outline,
                                       **splines)


def sheet_fit(fit: SplineFit, femur: Femur | None, region: np.ndarray | None = None) -> SheetFit:
    """A fit, with what it leaves over in a region, by default everywhere."""
    every = np.ones(len(fit.points), bool)
    region = every if region is None else region
    if isinstance(fit.surface, Condyle):  # two lengths along the surface, mm
        assert femur is not None
        angle, radius, along = anatomy.cylindrical(femur.axis, fit.points)
        across = np.c_[float(np.average(radius, weights=fit.weights)) * angle, along]
    else:
        across = anatomy.in_frame(fit.surface.frame, fit.points)[:, [0, 2]]
    rows = region if region.any() else every
    residual, weight = fit.residual[rows], fit.weights[rows]
    patch = np.floor(across[rows] / PATCH_MM).astype(int)
    _, place = np.unique(patch, axis=0, return_inverse=True)
    place = place.ravel()
    total, count = np.bincount(place, weight), np.bincount(place)
    means = (np.bincount(place, weight * residual) / total)[count >= _FEWEST_IN_PATCH]
    means = means if len(means) else np.array([np.average(residual, weights=weight)])
    return SheetFit(fit, region, FitQuality(
        rms=float(np.sqrt(np.average(residual**2, weights=weight))),
        maximum=float(np.abs(residual).max()),
        mean=float(np.average(residual, weights=weight)),
        patch_rms=float(np.sqrt(np.mean(means**2))),
        patch_maximum=float(np.abs(means).max()),
        everywhere_rms=fit.rms,
        held_out_rms=fit.held_out_rms,
    ))


# One program for all places: operation by operation they take 5.8 s for a knee instead of 0.3.
@jax.jit
def _radius(surface: Condyle, angle: np.ndarray, along: np.ndarray) -> jax.Array:
    return surface.radius(angle, along)


def _cells(angle: np.ndarray, along: np.ndarray) -> np.ndarray:
    return np.floor(np.c_[angle / _CELL[0], along / _CELL[1]]).astype(int)


class Layer(NamedTuple):
    """A layer's mean thickness, how it was found, and a polynomial that is added, or None."""

    thickness_mm: float
    source: str
    variation: np.ndarray | None = None


def find_layer(
    name: str, condyle: SheetFit, plateau: SheetFit, femur: Femur, sheet: Sheet,
    bones: tuple[list[Sheet], list[Sheet]] | None, kind: str, findings: list[str],
) -> Layer:  # fmt: skip
    """The layer of a compartment between the bones' surfaces: `constant`, or a `field`."""
    if bones is None:
        return Layer(ASSUMED_MM, "assumed: no bone meshes")
    wanted = {*map(tuple, condyle.fit.points[condyle.region].tolist())}
    on_condyle = femur.cloud.kept([tuple(p) in wanted for p in femur.cloud.points.tolist()])
    tibial = anatomy.joined([sheet])
    above_femur = thickness(on_condyle, bones[0], f"{name} femoral")
    above_tibia = thickness(tibial, bones[1], f"{name} tibial")
    known = np.isfinite(above_tibia)
    femoral, own = (
        float(np.average(above[rows], weights=cloud.areas[rows])) for above, rows, cloud in (
            (above_femur, np.isfinite(above_femur), on_condyle),
            (above_tibia, known & plateau.region, tibial)))
    findings.append(f"{name}: cartilage {femoral:.2f} mm thick on the femur and {own:.2f} mm on "
                    "the tibia, on average over the contact region.")
    mean = femoral + own
    if mean < _THINNEST_MM:
        value = f"{mean:.2f} mm in the {name} contact region"
        expected = f"cartilage of at least {_THINNEST_MM:g} mm on both bones together"
        raise InputProblem(sheet.name, "thickness", value, expected)
    source = "mean distance along the normal from cartilage to bone, both bones, contact region"
    if kind == "constant":
        return Layer(mean, source)
    surface = plateau.fit.surface
    x, _, z = anatomy.in_frame(surface.frame, tibial.points[known]).T
    s, t = (2.0 * (c - lower) / (upper - lower) - 1.0
            for c, (lower, upper) in ((x, np.asarray(surface.x)), (z, np.asarray(surface.z))))
    # The femoral share is its mean, since that part moves. What lies outside the contact region
    # steers a field little, and keeps it in bounds.
    weights = np.where(plateau.region, 1.0, 0.1)[known] * tibial.areas[known]
    values = femoral + above_tibia[known] - mean
    # Places beyond the sheet, as thick as the nearest of its own, hold a field there.
    a, b = (x.ravel() for x in np.meshgrid(*[np.linspace(-1.0, 1.0, 11)] * 2))
    apart = (a[:, None] - s) ** 2 + (b[:, None] - t) ** 2
    nearest = np.argmin(apart, axis=1)
    beyond = apart[np.arange(len(a)), nearest] > 0.1**2
    s, t, values = np.r_[s, a[beyond]], np.r_[t, b[beyond]], np.r_[values, values[nearest[beyond]]]
    weights = np.r_[weights, np.full(beyond.sum(), 0.5 * weights.sum() / len(a))]
    grid = np.linspace(-1.0, 1.0, 25)
    for degree in _DEGREES:
        # The nearest polynomial of this whole degree.
        table, root = np.zeros((degree + 1, degree + 1)), np.sqrt(weights)
        powers = np.add.outer(range(degree + 1), range(degree + 1)) <= degree
        columns = polynomial.polyvander2d(s, t, [degree, degree])[:, powers.ravel()]
        table[powers] = np.linalg.lstsq(columns * root[:, None], root * values, rcond=None)[0]
        field = mean + polynomial.polygrid2d(grid, grid, table)
        if field.min() >= _THINNEST_MM:
            off = values - polynomial.polyval2d(s, t, table)
            rms = float(np.sqrt(np.average(off**2, weights=weights)))
            findings.append(f"{name}: thickness from {field.min():.1f} to {field.max():.1f} mm as "
                            f"a polynomial of degree {degree}, {rms:.2f} mm rms from the measured.")
            return Layer(mean, source, table)
    findings.append(f"{name}: the thickness varies too much for a smooth field; constant instead.")
    return Layer(mean, source)


def distances_along(points: np.ndarray, directions: np.ndarray, sheets: list[Sheet]) -> np.ndarray:
    """Signed distance from points `(n, 3)` along unit vectors into a bone to the nearest surface of
    it that is met from outside, mm, `(n,)`; open sheets may face either way. NaN where there is
    none from `HIGHEST_MM` above (negative) to `DEEPEST_MM` below. Source: Moeller and Trumbore,
    Journal of Graphics Tools 2 (1997)."""
    corner = [np.concatenate([s.points[s.faces[:, k]] for s in sheets]) for k in range(3)]
    sided = np.concatenate([np.full(len(s.faces), s.closed) for s in sheets])
    center = sum(corner) / 3.0
    reach = max(float(np.linalg.norm(c - center, axis=1).max()) for c in corner)
    answer = np.full(len(points), np.nan)
    # Neighbouring lines see the same few triangles.
    _, cell = np.unique(np.floor(points / _CELL_MM).astype(int), axis=0, return_inverse=True)
    order = np.argsort(cell.ravel(), kind="stable")
    for rows in np.split(order, np.flatnonzero(np.diff(cell.ravel()[order])) + 1):
        down, up = DEEPEST_MM * directions[rows], HIGHEST_MM * directions[rows]
        box = np.r_[points[rows] + down, points[rows] - up]
        near = ((center > box.min(axis=0) - reach) & (center < box.max(axis=0) + reach)).all(axis=1)
        if near.any():
            a, b, c = (x[near] for x in corner)
            answer[rows] = _nearest(points[rows], directions[rows], a, b, c, sided[near])
    return answer


def thickness(cartilage: anatomy.Cloud, bone: list[Sheet], what: str) -> np.ndarray:
    """Thickness of a cartilage at its corners, mm; NaN where no bone lies below."""
    found = distances_along(cartilage.points, -cartilage.normals, bone)
    known = np.isfinite(found)
    name = bone[0].name
    share = float(np.average(known, weights=cartilage.areas))
    if share < 0.5:
        expected = f"bone below the {what} cartilage; do both meshes have one frame?"
        raise InputProblem(name, "place", f"below {100 * share:.0f} % of the cartilage", expected)
    below = float(np.average(found[known] < -TOUCHING_MM, weights=cartilage.areas[known]))
    if below > MOST_NEGATIVE:
        expected = f"a {what} cartilage thicker than zero, above its bone"
        value = f"negative over {100 * below:.0f} % of the cartilage"
        raise InputProblem(name, "thickness", value, expected)
    return found


def _nearest(points, directions, a, b, c, sided) -> np.ndarray:
    ab, ac = b - a, c - a
    normal = np.cross(ab, ac)
    # Positive where a line enters the solid through the triangle.
    entering = -directions @ normal.T
    ok = np.abs(entering) > 1e-12
    scale = np.where(ok, entering, 1.0)
    to_a = points[:, None] - a[None]
    distance = np.einsum("pti,ti->pt", to_a, normal) / scale
    turned = np.cross(to_a, -directions[:, None])
    u = -np.einsum("pti,ti->pt", turned, ac) / scale
    v = np.einsum("pti,ti->pt", turned, ab) / scale
    slack = 1e-9
    hit = ok & (u >= -slack) & (v >= -slack) & (u + v <= 1.0 + slack)
    hit &= (entering > 0) | ~sided
    hit &= (distance > -HIGHEST_MM) & (distance < DEEPEST_MM)
    best = np.argmin(np.where(hit, np.abs(distance), np.inf), axis=1)
    rows = np.arange(len(points))
    return np.where(hit[rows, best], distance[rows, best], np.nan)
