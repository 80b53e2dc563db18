"""A knee in space: scenes, pressure, renderings, the interactive page."""

from kneejax.report.scene.drawing import Drawing as Drawing
from kneejax.report.scene.figures import film as film
from kneejax.report.scene.figures import scene_figure as scene_figure
from kneejax.report.scene.figures import scenes_figure as scenes_figure
from kneejax.report.scene.lines import Places as Places
from kneejax.report.scene.page import look_at as look_at
from kneejax.report.scene.page import scales as scales
from kneejax.report.scene.page import scene_page as scene_page
from kneejax.report.scene.pressure import PlateauPressure as PlateauPressure
from kneejax.report.scene.pressure import plateau_pressures as plateau_pressures
from kneejax.report.scene.pressure import pressure_figure as pressure_figure
from kneejax.report.scene.rendering import CannotRender as CannotRender
from kneejax.report.scene.scene import BoneMesh as BoneMesh
from kneejax.report.scene.scene import Scene as Scene
from kneejax.report.scene.scene import scenes as scenes
from kneejax.report.scene.surfaces import grid_triangles as grid_triangles
from kneejax.report.scene.surfaces import surface_grid as surface_grid
