"""Rigid motions, coordinate conventions and analytic surfaces. Knows no mechanics."""

from kneejax.geometry._articular import *
from kneejax.geometry._bases import *
from kneejax.geometry._conventions import *
from kneejax.geometry._coordinates import *
from kneejax.geometry._fit_cylinder import *
from kneejax.geometry._fit_spline import *
from kneejax.geometry._fit_surface import *
from kneejax.geometry._pose import *
from kneejax.geometry._quadrics import *
from kneejax.geometry._surface import *
from kneejax.geometry._vectors import *
from kneejax.geometry._wrapping import *
