"""Recorded movements: what they do to a knee."""

from kneejax.experiments.activity._activity import Activity as Activity
from kneejax.experiments.activity._activity import activity as activity
