"""Figures of a motion, and doubts about its poses."""

from kneejax.report.motion._figures import flexion_axis as flexion_axis
from kneejax.report.motion._figures import ligament_forces_figure as ligament_forces_figure
from kneejax.report.motion._figures import mark_status as mark_status
from kneejax.report.motion._figures import measured_curve as measured_curve
from kneejax.report.motion._figures import motion_figure as motion_figure
from kneejax.report.motion._figures import part_legend as part_legend
from kneejax.report.motion._figures import simulation_figure as simulation_figure
from kneejax.report.motion._pose_doubts import accepted_statuses as accepted_statuses
from kneejax.report.motion._pose_doubts import motion_words as motion_words
from kneejax.report.motion._pose_doubts import pose_doubts as pose_doubts
from kneejax.report.motion._pose_doubts import row_status as row_status
from kneejax.report.motion._pose_words import pose_words as pose_words
from kneejax.report.motion._pose_words import search_words as search_words
from kneejax.report.motion._pose_words import second_balance as second_balance
