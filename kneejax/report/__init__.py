"""Results for people: text, JSON, figures and the HTML report."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.report.calibration import calibration_answer as calibration_answer
    from kneejax.report.calibration import result_document as result_document
    from kneejax.report.calibration import write_report as write_report
    from kneejax.report.calibration_parameters import parameters_figure as parameters_figure
    from kneejax.report.calibration_parameters import remark as remark
    from kneejax.report.calibration_parameters import tests_figure as tests_figure
    from kneejax.report.calibration_verdict import Outcome as Outcome
    from kneejax.report.calibration_verdict import calibration_notes as calibration_notes
    from kneejax.report.calibration_verdict import message as message
    from kneejax.report.describe import knee_text as knee_text
    from kneejax.report.flexion import motion_figure as motion_figure
    from kneejax.report.joint_comparison import comparison_answer as comparison_answer
    from kneejax.report.joint_comparison import comparison_tables as comparison_tables
    from kneejax.report.joint_comparison import joint_comparison_figure as joint_comparison_figure
    from kneejax.report.knee_import import surface_fit_figure as surface_fit_figure
    from kneejax.report.look.page import write_page as write_page
    from kneejax.report.look.style import picture_png as picture_png
    from kneejax.report.look.style import save_figure as save_figure
    from kneejax.report.look.style import write_whole as write_whole
    from kneejax.report.maps import map_figure as map_figure
    from kneejax.report.maps import map_matrix_figure as map_matrix_figure
    from kneejax.report.plan import plan_answer as plan_answer
    from kneejax.report.plan_figures import front_figure as front_figure
    from kneejax.report.plan_figures import strain_figure as strain_figure
    from kneejax.report.plan_figures import tunnel_map_figure as tunnel_map_figure
    from kneejax.report.scene.drawing import scene_page as scene_page
    from kneejax.report.scene.figures import film as film
    from kneejax.report.scene.figures import scene_figure as scene_figure
    from kneejax.report.scene.figures import scenes_figure as scenes_figure
    from kneejax.report.scene.pressure import pressure_figure as pressure_figure
    from kneejax.report.scene.rendering import CannotRender as CannotRender
    from kneejax.report.scene.scene import BoneMesh as BoneMesh
    from kneejax.report.scene.scene import Scene as Scene
    from kneejax.report.scene.scene import scenes as scenes
    from kneejax.report.sensitivity_figures import local_curves_figure as local_curves_figure
    from kneejax.report.sensitivity_figures import local_heatmap_figure as local_heatmap_figure
    from kneejax.report.sensitivity_figures import sweep_figure as sweep_figure
else:
    lazy_imports(globals())
