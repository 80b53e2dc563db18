"""A knee in space: scenes, pressure, renderings, the interactive page."""

from kneejax.report.scene._figure import film as film
from kneejax.report.scene._figure import scene_figure as scene_figure
from kneejax.report.scene._figure import scenes_figure as scenes_figure
from kneejax.report.scene._grids import surface_grid as surface_grid
from kneejax.report.scene._html import scene_page as scene_page
from kneejax.report.scene._pressure_map import PlateauPressure as PlateauPressure
from kneejax.report.scene._pressure_map import plateau_pressures as plateau_pressures
from kneejax.report.scene._pressure_map import pressure_figure as pressure_figure
from kneejax.report.scene._render import VIEWS as VIEWS
from kneejax.report.scene._render import CannotRender as CannotRender
from kneejax.report.scene._render import MissingPackage as MissingPackage
from kneejax.report.scene._render import need_view_packages as need_view_packages
from kneejax.report.scene._render import simplified as simplified
from kneejax.report.scene._scene import BoneMesh as BoneMesh
from kneejax.report.scene._scene import Scene as Scene
from kneejax.report.scene._scene import scenes as scenes
