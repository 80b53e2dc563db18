"""Surfaces through points."""

from kneejax.geometry.fitting._cylinder import CylinderFit as CylinderFit
from kneejax.geometry.fitting._cylinder import fit_cylinder as fit_cylinder
from kneejax.geometry.fitting._cylinder import fit_transverse_axis as fit_transverse_axis
from kneejax.geometry.fitting._fitting import SurfaceFit as SurfaceFit
from kneejax.geometry.fitting._fitting import fit_condyle as fit_condyle
from kneejax.geometry.fitting._fitting import fit_ellipsoid as fit_ellipsoid
from kneejax.geometry.fitting._fitting import fit_plane as fit_plane
from kneejax.geometry.fitting._fitting import fit_plateau as fit_plateau
from kneejax.geometry.fitting._fitting import fit_sphere as fit_sphere
from kneejax.geometry.fitting._splines import SplineFit as SplineFit
from kneejax.geometry.fitting._splines import fit_condyle_spline as fit_condyle_spline
from kneejax.geometry.fitting._splines import fit_plateau_spline as fit_plateau_spline
