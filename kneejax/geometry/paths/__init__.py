"""The shortest way around an obstacle, with its derivatives."""

from kneejax.geometry.paths._wrapping import Obstacle as Obstacle
from kneejax.geometry.paths._wrapping import TautPath as TautPath
from kneejax.geometry.paths._wrapping import WrapCylinder as WrapCylinder
from kneejax.geometry.paths._wrapping import WrapEllipsoid as WrapEllipsoid
from kneejax.geometry.paths._wrapping import WrapSphere as WrapSphere
from kneejax.geometry.paths._wrapping import path_points as path_points
from kneejax.geometry.paths._wrapping import taut as taut
