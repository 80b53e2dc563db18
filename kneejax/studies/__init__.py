"""A study as data: a knee, a motion and a question; checked whole, then answered."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.studies._acl_plan import drawn_parameters as drawn_parameters
    from kneejax.studies._acl_plan import read_plan as read_plan
    from kneejax.studies._answers import Identified as Identified
    from kneejax.studies._answers import Sensitivities as Sensitivities
    from kneejax.studies._answers import bootstrapped as bootstrapped
    from kneejax.studies._answers import calibrate as calibrate
    from kneejax.studies._answers import check as check
    from kneejax.studies._answers import identify as identify
    from kneejax.studies._answers import run_side_by_side as run_side_by_side
    from kneejax.studies._answers import sensitivity as sensitivity
    from kneejax.studies._fields import Identify as Identify
    from kneejax.studies._fields import Map as Map
    from kneejax.studies._fields import Sensitivity as Sensitivity
    from kneejax.studies._fields import file_named as file_named
    from kneejax.studies._fields import misspelt as misspelt
    from kneejax.studies._maps import about_maps as about_maps
    from kneejax.studies._maps import fingerprint as fingerprint
    from kneejax.studies._maps import plain_test as plain_test
    from kneejax.studies._maps import sensitivity_map as sensitivity_map
    from kneejax.studies._progress import stages_on_terminal as stages_on_terminal
    from kneejax.studies._schema import FAULTS as FAULTS
    from kneejax.studies._schema import STUDY_FIELDS as STUDY_FIELDS
    from kneejax.studies._schema import Synthetic as Synthetic
    from kneejax.studies._study import Study as Study
    from kneejax.studies._study import check_study_file as check_study_file
    from kneejax.studies._study import read_study as read_study
    from kneejax.studies._study import study_of as study_of
else:
    lazy_imports(globals())
