"""Simplified joints: a tibia that turns about an axis, fixed or moving with flexion."""

from kneejax.joints._clinical import MEASURES as MEASURES
from kneejax.joints._clinical import ClinicalMeasure as ClinicalMeasure
from kneejax.joints._clinical import clinical_measures as clinical_measures
from kneejax.joints._clinical import poses_from_clinical as poses_from_clinical
from kneejax.joints._comparison import MEASURED as MEASURED
from kneejax.joints._comparison import Comparison as Comparison
from kneejax.joints._comparison import Difference as Difference
from kneejax.joints._comparison import Prediction as Prediction
from kneejax.joints._comparison import Summary as Summary
from kneejax.joints._comparison import compare_motions as compare_motions
from kneejax.joints._joint import INTERPOLATIONS as INTERPOLATIONS
from kneejax.joints._joint import Joint as Joint
from kneejax.joints._joint import axis_between as axis_between
from kneejax.joints._joint import check_joint as check_joint
from kneejax.joints._joint import generalised_axis as generalised_axis
from kneejax.joints._joint import hinge as hinge
from kneejax.joints._joint import moving_axis as moving_axis
from kneejax.joints._repeated_measures import Pair as Pair
from kneejax.joints._repeated_measures import RepeatedMeasures as RepeatedMeasures
from kneejax.joints._repeated_measures import UnsuitableMotions as UnsuitableMotions
from kneejax.joints._repeated_measures import repeated_measures as repeated_measures
