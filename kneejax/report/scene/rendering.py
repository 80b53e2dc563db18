"""Scenes rendered."""

__all__ = ["CannotRender"]

import dataclasses
import functools
from collections.abc import Sequence

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import ListedColormap, to_hex, to_rgb

from kneejax.numerics import imported
from kneejax.report.scene.pressure import PRESSURE_COLOURS, spread
from kneejax.report.scene.scene import Fibre, Plateau, Scene
from kneejax.report.scene.surfaces import tube

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
    return float(max(peaks, default=0.0)) or 1.0


def chosen(every: Sequence[Scene], most: int) -> tuple[list[Scene], tuple[float, float]]:
    """At most so many scenes, evenly apart, and the ends of both scales of colours."""
    if not every:
        raise ValueError("no scenes to draw")
    shown = [every[row] for row in spread(len(every), most)]
    return shown, (strain_limit(shown), pressure_limit(shown))


@functools.cache
def strain_colours():
    """The scale of colours of strained fibres, from no strain to the largest."""
    return ListedColormap(colormaps[_REDS](np.linspace(_PALEST, 1.0, 256)))


def fibre_colour(fibre: Fibre, limit: float) -> str:
    """Colour of a fibre: a muscle's, or that of its strain (`strain_colour`)."""
    return MUSCLE if fibre.is_muscle else strain_colour(fibre.strain, limit)


def strain_colour(strain: float, limit: float) -> str:
    """Colour of a fibre, as `#rrggbb`; grey where it is slack."""
    share = min(strain / limit, 1.0)
    return to_hex(strain_colours()(round(255 * share))) if strain > 0 else SLACK


@functools.cache
def _bands(count: int) -> list[str]:
    """Colours of so many equal bands of pressure; the ground's before them."""
    return [GROUND, *map(to_hex, colormaps[PRESSURE_COLOURS](np.linspace(0.12, 1.0, count)))]


def pressure_colours(plateau: Plateau, limit: float) -> np.ndarray:
    """Colour of each point of a plateau, `(m, n, 3)`, 0 to 1; the ground's where not pressed."""
    pressure = np.nan_to_num(plateau.pressure_MPa, nan=limit)
    colours = colormaps[PRESSURE_COLOURS](np.clip(pressure / limit, 0.0, 1.0))[..., :3]
    # A quick fade at the rim instead of the teeth of the grid.
    share = np.clip(pressure / (0.04 * limit), 0.0, 1.0)[..., None]
    return share * colours + (1.0 - share) * np.array(to_rgb(GROUND))


def pressure_bands(plateau: Plateau, limit: float, count: int) -> list[tuple[str, np.ndarray]]:
    """Colour and triangles of equal bands of pressure, MPa, after what is not pressed."""
    pressure = np.nan_to_num(plateau.pressure_MPa, nan=limit).ravel()[plateau.faces].mean(axis=1)
    level = np.where(pressure > 0.02 * limit, np.ceil(pressure / limit * count), 0.0)
    level = np.minimum(level, count).astype(int)
    return [(colour, plateau.faces[level == i]) for i, colour in enumerate(_bands(count))]


#: View -> where the camera stands: anterior, superior and lateral share.
VIEWS = {"anterior": (1.0, 0.0, 0.0), "posterior": (-1.0, 0.0, 0.0), "medial": (0.0, 0.0, -1.0),
         "lateral": (0.0, 0.0, 1.0), "anteromedial, from above": (0.75, 0.62, -0.55),
         "anterolateral, from above": (0.75, 0.62, 0.55)}  # fmt: skip
#: With this many fibres or fewer each is drawn thick.
FEW_FIBRES = 12
_MARGIN_MM = 4.0
#: Bones reach at most so far beyond fibres and cartilage, to the sides, mm.
_BONE_MM = 16.0
_END = "#555555"


class CannotRender(RuntimeError):
    """The machine offers nothing to draw with off-screen; the message says what would do."""


@dataclasses.dataclass(frozen=True)
class Camera:
    """A parallel view: unit vectors, the point in the middle, half width and half height, mm."""

    towards: np.ndarray
    right: np.ndarray
    up: np.ndarray
    center_mm: np.ndarray
    half_mm: tuple[float, float]

    def seen(self, points_mm: np.ndarray) -> np.ndarray:
        """Where points are in the picture, mm right and up from its middle, `(..., 2)`."""
        away = np.asarray(points_mm) - self.center_mm
        return np.stack([away @ self.right, away @ self.up], axis=-1)


def camera(view: str, every: Sequence[Scene]) -> Camera:
    """A camera that sees all articular surfaces and fibres of some scenes of one knee."""
    if view not in VIEWS:
        raise ValueError(f"a view {view!r}; expected one of {', '.join(VIEWS)}")
    towards = np.array(VIEWS[view]) * [1.0, 1.0, every[0].lateral]
    towards /= np.linalg.norm(towards)
    right = np.cross([0.0, 1.0, 0.0], towards)
    right /= np.linalg.norm(right)
    up = np.cross(towards, right)
    points = np.concatenate([scene.points_mm for scene in every])
    flat = np.stack([points @ right, points @ up], axis=-1)
    low, high = flat.min(axis=0) - _MARGIN_MM, flat.max(axis=0) + _MARGIN_MM
    # Bones at that height, as far as they do not make all the rest small: shafts are cut.
    for bone in (bone for scene in every for bone in scene.bones):
        beside = bone.points_mm @ right
        beside = beside[np.abs(bone.points_mm @ up - 0.5 * (low + high)[1]) < 0.5 * (high - low)[1]]
        if len(beside):
            wide = beside.min() - _MARGIN_MM, beside.max() + _MARGIN_MM
            low[0] = min(low[0], max(wide[0], flat[:, 0].min() - _BONE_MM))
            high[0] = max(high[0], min(wide[1], flat[:, 0].max() + _BONE_MM))
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    center = middle[0] * right + middle[1] * up + np.mean(points @ towards) * towards
    return Camera(towards, right, up, center, (float(half[0]), float(half[1])))


def render(
    scene: Scene, view: Camera, strain_limit: float, pressure_limit: float, height: int = 900
) -> np.ndarray:
    """Draw a scene without words; raises `MissingPackage` without PyVista, and `CannotRender`."""
    pv = imported("pyvista", "PyVista", "view")  # it takes half a second and is optional
    width = max(2, round(height * view.half_mm[0] / view.half_mm[1]))
    # Without the remarks that VTK makes on its way from X to EGL to OSMesa.
    with pv.vtk_verbosity("off"):
        try:
            plotter = pv.Plotter(off_screen=True, window_size=(2 * width, 2 * height),
                                 lighting=None)  # fmt: skip
            _fill(pv, plotter, scene, strain_limit, pressure_limit)
            _aim(pv, plotter, view)
            image = plotter.screenshot(return_img=True)
            plotter.close()
        except RuntimeError as error:
            raise CannotRender(f"PyVista could not draw off-screen ({error}); {_NEEDS}") from None
    if image is None:
        raise CannotRender(f"PyVista drew nothing off-screen; {_NEEDS}")
    # Twice as fine and averaged: with software drawing VTK's own smoothing leaves patterns on
    # translucent sheets, and its sorting of their layers loses them.
    fine = np.asarray(image)[..., :3].reshape(height, 2, width, 2, 3)
    return np.round(fine.mean(axis=(1, 3))).astype(np.uint8)


_NEEDS = "on Linux without a display it needs libEGL or libOSMesa (Debian: apt install libegl1)"


def _fill(pv, plotter, scene: Scene, strain_limit: float, pressure_limit: float) -> None:
    plotter.set_background("white")
    plain = {"smooth_shading": True, "specular": 0.15, "specular_power": 20,
             "show_scalar_bar": False}  # fmt: skip
    sheets = [(x.points_mm, x.faces, BONE, BONE_OPACITY[x.bone]) for x in scene.bones]
    sheets += [(x.points_mm, x.faces, CONDYLE, 0.5) for x in scene.condyles]
    sheets += [(x.points_mm, x.faces, OBSTACLE, 0.13) for x in scene.obstacles]
    for points, faces, colour, opacity in sheets:
        mesh = pv.PolyData.from_regular_faces(np.reshape(points, (-1, 3)).astype(float), faces)
        plotter.add_mesh(mesh, color=colour, opacity=opacity, **plain)
    for plateau in scene.plateaus:
        mesh = pv.PolyData.from_regular_faces(plateau.points_mm.reshape(-1, 3), plateau.faces)
        mesh.point_data["colour"] = pressure_colours(plateau, pressure_limit).reshape(-1, 3)
        plotter.add_mesh(mesh, scalars="colour", rgb=True, **plain)
    if scene.fibres:
        mesh = _fibres(pv, scene, strain_limit)
        plotter.add_mesh(mesh, scalars="colour", rgb=True, **plain)


def _fibres(pv, scene: Scene, limit: float):
    """Tubes and balls at the ends of those that are pulled, in one mesh: that draws much faster."""
    radius, shapes = 1.1 if len(scene.fibres) <= FEW_FIBRES else 0.6, []
    ball = {"radius": 1.4 * radius, "theta_resolution": 12, "phi_resolution": 12}
    for fibre in scene.fibres:
        points, faces = tube(fibre.points_mm, 2.0 * (0.4 if fibre.slack else 1.0) * radius, 12)
        shapes.append((pv.PolyData.from_regular_faces(points, faces), fibre_colour(fibre, limit)))
        shapes += [(pv.Sphere(center=end, **ball), _END)
                   for end in fibre.points_mm[[0, -1]] if not fibre.slack]  # fmt: skip
    for shape, colour in shapes:
        shape.clear_data()
        shape.point_data["colour"] = np.tile(to_rgb(colour), (shape.n_points, 1))
    return pv.merge([shape for shape, _ in shapes], merge_points=False)


def _aim(pv, plotter, view: Camera) -> None:
    plotter.enable_parallel_projection()
    plotter.camera.focal_point = tuple(view.center_mm)
    plotter.camera.position = tuple(view.center_mm + 500.0 * view.towards)
    plotter.camera.up = tuple(view.up)
    plotter.camera.parallel_scale = view.half_mm[1]
    plotter.camera.clipping_range = (1.0, 1500.0)
    # Light from all sides: the colours mean something, and shall be seen whatever way they face.
    sides = ((0.8, view.towards), (0.55, view.up), (0.4, -view.up), (0.45, -view.right),
             (0.35, view.right))  # fmt: skip
    for share, place in sides:
        plotter.add_light(pv.Light(position=tuple(view.center_mm + 500.0 * place),
                                   focal_point=tuple(view.center_mm), light_type="scene light",
                                   intensity=share))  # fmt: skip
