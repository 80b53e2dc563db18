"""Planning a reconstruction of the anterior cruciate ligament: grafts, tunnels, tension."""

from typing import TYPE_CHECKING

from kneejax._lazy import lazy_imports

if TYPE_CHECKING:
    from kneejax.planning._followed import *
    from kneejax.planning._footprints import *
    from kneejax.planning._front import *
    from kneejax.planning._map import *
    from kneejax.planning._optimum import *
    from kneejax.planning._plan import *
    from kneejax.planning._reconstruction import *
    from kneejax.planning._surgery import *
else:
    lazy_imports(globals())
