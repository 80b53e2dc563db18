"""A study as data: a knee, a motion and a question; checked whole, then answered."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.studies._acl_plan import *
    from kneejax.studies._answers import *
    from kneejax.studies._fields import *
    from kneejax.studies._maps import *
    from kneejax.studies._progress import *
    from kneejax.studies._schema import *
    from kneejax.studies._study import *
else:
    lazy_imports(globals())
