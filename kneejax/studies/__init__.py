"""A study as data: a knee, a motion and a question; checked whole, then run."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module: what may be asked, with its defaults, is known without JAX.
_MODULES = {
    "plan_of": "kneejax.studies._acl_plan",
    "read_plan": "kneejax.studies._acl_plan",
    "drawn_parameters": "kneejax.studies._drawn_knees",
    "Sensitivities": "kneejax.studies._answer_sensitivity",
    "Identified": "kneejax.studies._answer_identify",
    "bootstrapped": "kneejax.studies._answer_calibrate",
    "run_side_by_side": "kneejax.studies._answer_calibrate",
    "about_maps": "kneejax.studies._answer_map",
    "fingerprint": "kneejax.studies._answer_map",
    "STUDY_FIELDS": "kneejax.studies._field_names",
    "measured_poses": "kneejax.studies._poses",
    "Identify": "kneejax.studies._questions",
    "Map": "kneejax.studies._questions",
    "Sensitivity": "kneejax.studies._questions",
    "read_study": "kneejax.studies._reading",
    "study_of": "kneejax.studies._reading",
    "check": "kneejax.studies._run",
    "run": "kneejax.studies._run",
    "FAULTS": "kneejax.studies._study_fields",
    "Study": "kneejax.studies._study",
    "Synthetic": "kneejax.studies._study_fields",
}

if TYPE_CHECKING:
    from kneejax.studies._acl_plan import plan_of as plan_of
    from kneejax.studies._acl_plan import read_plan as read_plan
    from kneejax.studies._answer_calibrate import bootstrapped as bootstrapped
    from kneejax.studies._answer_calibrate import run_side_by_side as run_side_by_side
    from kneejax.studies._answer_identify import Identified as Identified
    from kneejax.studies._answer_map import about_maps as about_maps
    from kneejax.studies._answer_map import fingerprint as fingerprint
    from kneejax.studies._answer_sensitivity import Sensitivities as Sensitivities
    from kneejax.studies._drawn_knees import drawn_parameters as drawn_parameters
    from kneejax.studies._field_names import STUDY_FIELDS as STUDY_FIELDS
    from kneejax.studies._poses import measured_poses as measured_poses
    from kneejax.studies._questions import Identify as Identify
    from kneejax.studies._questions import Map as Map
    from kneejax.studies._questions import Sensitivity as Sensitivity
    from kneejax.studies._reading import read_study as read_study
    from kneejax.studies._reading import study_of as study_of
    from kneejax.studies._run import check as check
    from kneejax.studies._run import run as run
    from kneejax.studies._study import Study as Study
    from kneejax.studies._study_fields import FAULTS as FAULTS
    from kneejax.studies._study_fields import Synthetic as Synthetic
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
