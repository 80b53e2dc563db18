"""A knee in space: scenes, pressure, renderings, the interactive page."""

from kneejax.report.scene.figures import film as film
from kneejax.report.scene.figures import scene_figure as scene_figure
from kneejax.report.scene.figures import scenes_figure as scenes_figure
from kneejax.report.scene.html import scene_page as scene_page
from kneejax.report.scene.lines import Places as Places
from kneejax.report.scene.pressure import PRESSURE_COLOURS as PRESSURE_COLOURS
from kneejax.report.scene.pressure import PlateauPressure as PlateauPressure
from kneejax.report.scene.pressure import plateau_pressures as plateau_pressures
from kneejax.report.scene.pressure import pressure_figure as pressure_figure
from kneejax.report.scene.rendering import BONE as BONE
from kneejax.report.scene.rendering import FEW_FIBRES as FEW_FIBRES
from kneejax.report.scene.rendering import MUSCLE as MUSCLE
from kneejax.report.scene.rendering import OBSTACLE as OBSTACLE
from kneejax.report.scene.rendering import SLACK as SLACK
from kneejax.report.scene.rendering import VIEWS as VIEWS
from kneejax.report.scene.rendering import CannotRender as CannotRender
from kneejax.report.scene.rendering import need_view_packages as need_view_packages
from kneejax.report.scene.rendering import pressure_bands as pressure_bands
from kneejax.report.scene.rendering import simplified as simplified
from kneejax.report.scene.rendering import strain_colour as strain_colour
from kneejax.report.scene.rendering import strain_colours as strain_colours
from kneejax.report.scene.scene import BoneMesh as BoneMesh
from kneejax.report.scene.scene import Scene as Scene
from kneejax.report.scene.scene import scenes as scenes
from kneejax.report.scene.surfaces import grid_triangles as grid_triangles
from kneejax.report.scene.surfaces import surface_grid as surface_grid
