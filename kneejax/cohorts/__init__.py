"""Cohorts: many studies as one, read and checked whole, divided into tasks, brought together."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.cohorts._reading import Cohort as Cohort
    from kneejax.cohorts._reading import Member as Member
    from kneejax.cohorts._reading import is_cohort as is_cohort
    from kneejax.cohorts._reading import read_cohort as read_cohort
    from kneejax.cohorts._summary import CohortSummary as CohortSummary
    from kneejax.cohorts._summary import KneeAnswer as KneeAnswer
    from kneejax.cohorts._summary import summed_up as summed_up
    from kneejax.cohorts._synthesise import MadeUpKnee as MadeUpKnee
    from kneejax.cohorts._synthesise import Protocol as Protocol
    from kneejax.cohorts._synthesise import Spread as Spread
    from kneejax.cohorts._synthesise import synthesise as synthesise
    from kneejax.cohorts._tasks import Task as Task
    from kneejax.cohorts._tasks import bootstraps as bootstraps
    from kneejax.cohorts._tasks import check_bootstraps as check_bootstraps
    from kneejax.cohorts._tasks import computed as computed
    from kneejax.cohorts._tasks import plan as plan
    from kneejax.cohorts._tasks import reason as reason
    from kneejax.cohorts._tasks import workers as workers
else:
    lazy_imports(globals())
