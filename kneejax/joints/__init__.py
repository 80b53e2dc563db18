"""Simplified joints: a tibia that turns about an axis, fixed or moving with flexion."""

from kneejax.joints._joint import INTERPOLATIONS as INTERPOLATIONS
from kneejax.joints._joint import Joint as Joint
from kneejax.joints._joint import axis_between as axis_between
from kneejax.joints._joint import generalised_axis as generalised_axis
from kneejax.joints._joint import hinge as hinge
from kneejax.joints._joint import moving_axis as moving_axis
