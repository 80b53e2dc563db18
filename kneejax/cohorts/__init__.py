"""Cohorts: many studies as one, read and checked whole, divided into tasks, brought together."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.cohorts._reading import *
    from kneejax.cohorts._summary import *
    from kneejax.cohorts._synthesise import *
    from kneejax.cohorts._tasks import *
else:
    lazy_imports(globals())
