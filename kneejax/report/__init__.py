"""Results for people: text, JSON, figures and the HTML report."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.report.calibration import *
    from kneejax.report.calibration_parameters import *
    from kneejax.report.calibration_verdict import *
    from kneejax.report.describe import *
    from kneejax.report.flexion import *
    from kneejax.report.joint_comparison import *
    from kneejax.report.knee_import import *
    from kneejax.report.look.page import write_page as write_page
    from kneejax.report.look.style import picture_png as picture_png
    from kneejax.report.look.style import save_figure as save_figure
    from kneejax.report.look.style import write_whole as write_whole
    from kneejax.report.maps import *
    from kneejax.report.plan import *
    from kneejax.report.plan_figures import *
    from kneejax.report.scene.drawing import *
    from kneejax.report.scene.figures import *
    from kneejax.report.scene.pressure import *
    from kneejax.report.scene.rendering import *
    from kneejax.report.scene.scene import *
    from kneejax.report.sensitivity_figures import *
else:
    lazy_imports(globals())
