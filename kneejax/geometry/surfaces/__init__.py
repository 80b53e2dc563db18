"""Analytic surfaces with their normals, jets and curvatures."""

from kneejax.geometry.surfaces._bases import BASES as BASES
from kneejax.geometry.surfaces._bases import CUBIC_SPLINE as CUBIC_SPLINE
from kneejax.geometry.surfaces._bases import POWER as POWER
from kneejax.geometry.surfaces._bases import partials as partials
from kneejax.geometry.surfaces._condyle import Condyle as Condyle
from kneejax.geometry.surfaces._condyle import Condyles as Condyles
from kneejax.geometry.surfaces._plateau import Plateau as Plateau
from kneejax.geometry.surfaces._quadrics import Ellipsoid as Ellipsoid
from kneejax.geometry.surfaces._quadrics import Plane as Plane
from kneejax.geometry.surfaces._quadrics import Sphere as Sphere
from kneejax.geometry.surfaces._surface import Height as Height
from kneejax.geometry.surfaces._surface import Jet as Jet
from kneejax.geometry.surfaces._surface import Surface as Surface
from kneejax.geometry.surfaces._surface import area_element as area_element
from kneejax.geometry.surfaces._surface import excess as excess
from kneejax.geometry.surfaces._surface import inside as inside
from kneejax.geometry.surfaces._surface import jet as jet
from kneejax.geometry.surfaces._surface import normal as normal
from kneejax.geometry.surfaces._surface import principal_curvatures as principal_curvatures
from kneejax.geometry.surfaces._surface import scaled as scaled
