"""The shortest way around an obstacle, with its derivatives."""

from kneejax.geometry.paths._obstacles import SIDES as SIDES
from kneejax.geometry.paths._obstacles import Obstacle as Obstacle
from kneejax.geometry.paths._obstacles import WrapCylinder as WrapCylinder
from kneejax.geometry.paths._obstacles import WrapEllipsoid as WrapEllipsoid
from kneejax.geometry.paths._obstacles import WrapSphere as WrapSphere
from kneejax.geometry.paths._wrapping import TautPath as TautPath
from kneejax.geometry.paths._wrapping import path_points as path_points
from kneejax.geometry.paths._wrapping import taut as taut
