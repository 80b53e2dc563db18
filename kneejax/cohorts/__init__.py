"""Cohorts: many studies as one, read and checked whole, dealt to tasks and brought together."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module: whether a cohort is meant is known without JAX.
_MODULES = {
    "Cohort": "kneejax.cohorts._cohort",
    "CohortProblems": "kneejax.cohorts._cohort",
    "Member": "kneejax.cohorts._cohort",
    "KneeDone": "kneejax.cohorts._execute",
    "Work": "kneejax.cohorts._execute",
    "in_process": "kneejax.cohorts._execute",
    "Task": "kneejax.cohorts._plan",
    "plan": "kneejax.cohorts._plan",
    "shard_of": "kneejax.cohorts._plan",
    "structures": "kneejax.cohorts._plan",
    "is_cohort": "kneejax.cohorts._reading",
    "read_cohort": "kneejax.cohorts._reading",
    "MadeUpKnee": "kneejax.cohorts._synthesise",
    "Protocol": "kneejax.cohorts._synthesise",
    "Spread": "kneejax.cohorts._synthesise",
    "synthesise": "kneejax.cohorts._synthesise",
}

if TYPE_CHECKING:
    from kneejax.cohorts._cohort import Cohort as Cohort
    from kneejax.cohorts._cohort import CohortProblems as CohortProblems
    from kneejax.cohorts._cohort import Member as Member
    from kneejax.cohorts._execute import KneeDone as KneeDone
    from kneejax.cohorts._execute import Work as Work
    from kneejax.cohorts._execute import in_process as in_process
    from kneejax.cohorts._plan import Task as Task
    from kneejax.cohorts._plan import plan as plan
    from kneejax.cohorts._plan import shard_of as shard_of
    from kneejax.cohorts._plan import structures as structures
    from kneejax.cohorts._reading import is_cohort as is_cohort
    from kneejax.cohorts._reading import read_cohort as read_cohort
    from kneejax.cohorts._synthesise import MadeUpKnee as MadeUpKnee
    from kneejax.cohorts._synthesise import Protocol as Protocol
    from kneejax.cohorts._synthesise import Spread as Spread
    from kneejax.cohorts._synthesise import synthesise as synthesise
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
