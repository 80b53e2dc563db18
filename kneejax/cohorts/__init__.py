"""Cohorts: many studies as one, read and checked whole, dealt to tasks and brought together."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_names

#: Public name -> its module: whether a cohort is meant is known without JAX.
_MODULES = {
    "KneeAnswer": "kneejax.cohorts._answers",
    "KneeEstimate": "kneejax.cohorts._answers",
    "parameter_units": "kneejax.cohorts._answers",
    "read_answers": "kneejax.cohorts._answers",
    "Cohort": "kneejax.cohorts._cohort",
    "CohortProblems": "kneejax.cohorts._cohort",
    "Member": "kneejax.cohorts._cohort",
    "to_dataset": "kneejax.cohorts._dataset",
    "KneeDone": "kneejax.cohorts._execute",
    "Work": "kneejax.cohorts._execute",
    "in_process": "kneejax.cohorts._execute",
    "Task": "kneejax.cohorts._plan",
    "bootstraps": "kneejax.cohorts._plan",
    "check_bootstraps": "kneejax.cohorts._plan",
    "plan": "kneejax.cohorts._plan",
    "shard_of": "kneejax.cohorts._plan",
    "structures": "kneejax.cohorts._plan",
    "is_cohort": "kneejax.cohorts._reading",
    "read_cohort": "kneejax.cohorts._reading",
    "dashboard_of": "kneejax.cohorts._on_cluster",
    "local_workers": "kneejax.cohorts._on_cluster",
    "on_workers": "kneejax.cohorts._on_cluster",
    "workers_of": "kneejax.cohorts._on_cluster",
    "CohortSummary": "kneejax.cohorts._summary",
    "Outlier": "kneejax.cohorts._summary",
    "next_prior": "kneejax.cohorts._summary",
    "summed_up": "kneejax.cohorts._summary",
    "MadeUpKnee": "kneejax.cohorts._synthesise",
    "Protocol": "kneejax.cohorts._synthesise",
    "Spread": "kneejax.cohorts._synthesise",
    "synthesise": "kneejax.cohorts._synthesise",
}

if TYPE_CHECKING:
    from kneejax.cohorts._answers import KneeAnswer as KneeAnswer
    from kneejax.cohorts._answers import KneeEstimate as KneeEstimate
    from kneejax.cohorts._answers import parameter_units as parameter_units
    from kneejax.cohorts._answers import read_answers as read_answers
    from kneejax.cohorts._cohort import Cohort as Cohort
    from kneejax.cohorts._cohort import CohortProblems as CohortProblems
    from kneejax.cohorts._cohort import Member as Member
    from kneejax.cohorts._dataset import to_dataset as to_dataset
    from kneejax.cohorts._execute import KneeDone as KneeDone
    from kneejax.cohorts._execute import Work as Work
    from kneejax.cohorts._execute import in_process as in_process
    from kneejax.cohorts._on_cluster import dashboard_of as dashboard_of
    from kneejax.cohorts._on_cluster import local_workers as local_workers
    from kneejax.cohorts._on_cluster import on_workers as on_workers
    from kneejax.cohorts._on_cluster import workers_of as workers_of
    from kneejax.cohorts._plan import Task as Task
    from kneejax.cohorts._plan import bootstraps as bootstraps
    from kneejax.cohorts._plan import check_bootstraps as check_bootstraps
    from kneejax.cohorts._plan import plan as plan
    from kneejax.cohorts._plan import shard_of as shard_of
    from kneejax.cohorts._plan import structures as structures
    from kneejax.cohorts._reading import is_cohort as is_cohort
    from kneejax.cohorts._reading import read_cohort as read_cohort
    from kneejax.cohorts._summary import CohortSummary as CohortSummary
    from kneejax.cohorts._summary import Outlier as Outlier
    from kneejax.cohorts._summary import next_prior as next_prior
    from kneejax.cohorts._summary import summed_up as summed_up
    from kneejax.cohorts._synthesise import MadeUpKnee as MadeUpKnee
    from kneejax.cohorts._synthesise import Protocol as Protocol
    from kneejax.cohorts._synthesise import Spread as Spread
    from kneejax.cohorts._synthesise import synthesise as synthesise
else:
    __all__ = [*_MODULES]
    __getattr__, __dir__ = lazy_names(__name__, _MODULES)
